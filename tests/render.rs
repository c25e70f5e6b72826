//! Pictures: what is in front covers what is behind, and the bytes do not depend on the threads.
use braid_ecs::output::render::{Image, PictureInput, Surface, Tube, View, render, repeat};
use glam::DVec3;

fn pixel(image: &Image, x: u32, y: u32) -> [u8; 3] {
    let i = 3 * (y * image.width + x) as usize;
    image.pixels[i..i + 3].try_into().unwrap()
}

/// Looking down on the xy plane, x to the right.
fn from_above() -> View {
    View { towards_eye: DVec3::Z, right: DVec3::X, tilt: 0.0 }
}

fn tube(points: &[DVec3], radius: f64, colour: usize) -> Tube {
    Tube { points: points.to_vec(), radius, colour, shade: 1.0 }
}

fn reddish(p: [u8; 3]) -> bool {
    p[0] > p[2].saturating_add(40)
}
fn bluish(p: [u8; 3]) -> bool {
    p[2] > p[0].saturating_add(40)
}

#[test]
fn the_upper_of_two_crossed_tubes_is_seen() {
    let x = [DVec3::new(-1.0, 0.0, 0.0), DVec3::new(1.0, 0.0, 0.0)];
    let y = [DVec3::new(0.0, -1.0, 0.4), DVec3::new(0.0, 1.0, 0.4)];
    // Colour 0 is a red, colour 6 a blue.
    let input = PictureInput { tubes: vec![tube(&x, 0.15, 0), tube(&y, 0.15, 6)], view: from_above(), surfaces: vec![] };
    let image = render(&input, 120, 120);
    assert_eq!(pixel(&image, 2, 2), [255; 3], "paper is white");
    assert!(bluish(pixel(&image, 60, 60)), "the upper tube covers the crossing: {:?}", pixel(&image, 60, 60));
    assert!(reddish(pixel(&image, 20, 60)) && reddish(pixel(&image, 100, 60)));
    assert!(bluish(pixel(&image, 60, 20)) && bluish(pixel(&image, 60, 100)));
    // The subject fills the frame but for the margin.
    let painted = |x: u32| (0..120).any(|y| pixel(&image, x, y) != [255; 3]);
    assert!(!painted(2) && painted(8) && painted(111) && !painted(117));
}

#[test]
fn a_bar_hides_what_runs_behind_it() {
    let behind = [DVec3::new(-2.0, 0.0, -1.5), DVec3::new(2.0, 0.0, -1.5)];
    let before = [DVec3::new(-2.0, 0.9, 1.5), DVec3::new(2.0, 0.9, 1.5)];
    let corners = [(-0.5, -1.0), (0.5, -1.0), (0.5, 1.0), (-0.5, 1.0)].map(|(x, z)| DVec3::new(x, 0.0, z)).to_vec();
    let bar = Surface::Prism { axis: DVec3::Y, corners };
    let input = PictureInput { tubes: vec![tube(&behind, 0.1, 0), tube(&before, 0.1, 0)], surfaces: vec![bar], view: from_above() };
    let image = render(&input, 200, 100);
    // Find the rows of the two tubes at the far left, then look at the same rows in the middle.
    let rows: Vec<u32> = (0..100).filter(|y| reddish(pixel(&image, 20, *y))).collect();
    let (top, bottom) = (rows[1], rows[rows.len() - 2]);
    assert!(bottom > top + 10, "two tubes: {rows:?}");
    assert!(reddish(pixel(&image, 100, top)), "in front of the bar");
    let grey = pixel(&image, 100, bottom);
    assert!(grey[0].abs_diff(grey[2]) < 5 && grey[0] < 250, "hidden by the grey bar: {grey:?}");
}

#[test]
fn the_picture_has_the_same_bytes_for_any_number_of_threads() {
    let points: Vec<DVec3> = (0..40).map(|i| f64::from(i) * 0.2).map(|s| DVec3::new(s.cos(), s.sin(), 0.3 * s)).collect();
    let surfaces = vec![Surface::Cylinder { centre: DVec3::ZERO, axis: DVec3::Z, radius: 0.8 }];
    let input = PictureInput { tubes: vec![tube(&points, 0.1, 3)], surfaces, view: View::along(DVec3::Z) };
    let with = |n| rayon::ThreadPoolBuilder::new().num_threads(n).build().unwrap().install(|| render(&input, 80, 60));
    let one = with(1);
    assert_eq!(one, with(3));
    assert!(one.pixels.iter().any(|b| *b < 128), "something is drawn");
}

#[test]
fn sizes_do_not_change_the_picture() {
    let points: Vec<DVec3> = (0..40).map(|i| f64::from(i) * 0.2).map(|s| DVec3::new(s.cos(), s.sin(), 0.3 * s)).collect();
    // The scale is a power of two, so that every operation rounds alike.
    let at = |k: f64| {
        let scaled: Vec<DVec3> = points.iter().map(|p| *p * k).collect();
        let surfaces = vec![Surface::Plane { point: DVec3::Z * -0.1 * k, normal: DVec3::Z }];
        render(&PictureInput { tubes: vec![tube(&scaled, 0.1 * k, 3)], surfaces, view: View::default() }, 80, 60)
    };
    let (big, small) = (at(1.0), at(2f64.powi(-20)));
    let differing = big.pixels.iter().zip(&small.pixels).filter(|(a, b)| a.abs_diff(**b) > 2).count();
    assert_eq!(differing, 0, "metres or micrometres, the picture is the same");
}

#[test]
fn strands_keep_their_colour_from_copy_to_copy() {
    // Two half strands in one cell: tube 0 ends where tube 1 of the next copy starts, and back.
    let tubes = [tube(&[DVec3::ZERO, DVec3::new(1.0, 1.0, 0.0)], 0.1, 0), tube(&[DVec3::Y, DVec3::X], 0.1, 1)];
    let all = repeat(&tubes, &[1, 0], 3, DVec3::X);
    assert_eq!(all.len(), 6);
    assert_eq!(all.iter().map(|t| t.colour).collect::<Vec<_>>(), [0, 1, 1, 0, 0, 1]);
    for copy in 0..2 {
        let end = *all[2 * copy].points.last().unwrap();
        let next = &all[2 * (copy + 1) + 1];
        assert_eq!(end, next.points[0]);
        assert_eq!(all[2 * copy].colour, next.colour);
    }
}

#[test]
fn odd_input_gives_a_picture_all_the_same() {
    let nothing = render(&PictureInput::default(), 8, 6);
    assert_eq!(nothing.pixels, vec![255; 144]);
    let broken = tube(&[DVec3::NAN, DVec3::ZERO, DVec3::ZERO, DVec3::X], 0.1, 5);
    let image = render(&PictureInput { tubes: vec![broken], surfaces: vec![], view: from_above() }, 40, 30);
    assert!(image.pixels.iter().any(|b| *b < 200));
    let png = image.png(&[("Software", "test")]);
    let mut reader = png::Decoder::new(std::io::Cursor::new(&png)).read_info().unwrap();
    let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
    reader.next_frame(&mut pixels).unwrap();
    assert_eq!(pixels, image.pixels);
}
