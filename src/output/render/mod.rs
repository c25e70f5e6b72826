//! Pictures of filaments as shaded tubes, traced on the CPU.
//!
//! Orthographic rays against capsules in a bounding volume hierarchy, one lamp with shadows,
//! ambient occlusion, several rays per pixel. Every random number comes from a hash of the pixel,
//! so a picture has the same bytes for any number of threads.
mod camera;
mod shapes;
mod trace;

pub use camera::View;

use super::file::{OutputError, write_atomic};
use glam::DVec3;
use std::path::Path;

/// A filament to draw.
#[derive(Clone, Debug)]
pub struct Tube {
    /// Centre line, at least two points.
    pub points: Vec<DVec3>,
    /// Radius (length).
    pub radius: f64,
    /// Colour number; see [`colour`].
    pub colour: usize,
    /// Brightness factor near 1, to tell the filaments of a tow apart.
    pub shade: f64,
}

/// A rigid surface, drawn grey.
#[derive(Clone, Debug, PartialEq)]
pub enum Surface {
    /// An endless prism over a convex polygon, cut to the length of the filaments.
    Prism {
        /// Direction of the edges.
        axis: DVec3,
        /// Corners in order, in any plane across the axis.
        corners: Vec<DVec3>,
    },
    /// An endless round bar, cut to the length of the filaments.
    Cylinder {
        /// A point of the axis.
        centre: DVec3,
        /// Direction of the axis.
        axis: DVec3,
        /// Radius (length).
        radius: f64,
    },
    /// A plane with the filaments on the side of the normal.
    Plane {
        /// A point of the plane.
        point: DVec3,
        /// Normal towards the filaments.
        normal: DVec3,
    },
}

/// What a picture shows.
#[derive(Clone, Debug, Default)]
pub struct PictureInput {
    /// Filaments.
    pub tubes: Vec<Tube>,
    /// Rigid surfaces.
    pub surfaces: Vec<Surface>,
    /// Where to look from.
    pub view: View,
}

/// An image of 8-bit RGB pixels.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Image {
    /// Pixels across.
    pub width: u32,
    /// Pixels down.
    pub height: u32,
    /// Rows from top to bottom, three bytes a pixel.
    pub pixels: Vec<u8>,
}

/// Twelve colours that stay apart, also for most colour-blind readers; they repeat after twelve.
const PALETTE: [[u8; 3]; 12] = [
    [0xd5, 0x5e, 0x00],
    [0xe6, 0x9f, 0x00],
    [0xf0, 0xc8, 0x52],
    [0xc4, 0x4e, 0x52],
    [0xcc, 0x79, 0xa7],
    [0x8c, 0x56, 0x4b],
    [0x00, 0x72, 0xb2],
    [0x56, 0xb4, 0xe9],
    [0x00, 0x9e, 0x73],
    [0x7f, 0xb8, 0x5c],
    [0x6a, 0x5a, 0xb0],
    [0x4c, 0x8a, 0x9a],
];

/// The colour with number `index`, as 8-bit sRGB.
pub fn colour(index: usize) -> [u8; 3] {
    PALETTE[index % PALETTE.len()]
}

/// Draws the picture.
pub fn render(input: &PictureInput, width: u32, height: u32) -> Image {
    trace::render(input, width, height)
}

impl Image {
    /// The bytes of a PNG file with texts (`keyword`, `text`) in its header.
    pub fn png(&self, texts: &[(&str, &str)]) -> Vec<u8> {
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, self.width, self.height);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        for (keyword, text) in texts {
            encoder.add_itxt_chunk((*keyword).to_owned(), (*text).to_owned()).expect("texts come before the header is written");
        }
        let mut writer = encoder.write_header().expect("writing to memory does not fail");
        writer.write_image_data(&self.pixels).expect("the image has width x height pixels");
        writer.finish().expect("writing to memory does not fail");
        bytes
    }

    /// Writes a PNG file.
    ///
    /// # Errors
    /// What the operating system says.
    pub fn write_png(&self, path: &Path, texts: &[(&str, &str)]) -> Result<(), OutputError> {
        write_atomic(path, &self.png(texts))
    }
}

/// Repeats tubes along a period vector. `successor[i]` is the tube that carries on where tube `i`
/// ends (itself, if nothing does): it takes over the colour, so that a strand keeps its colour
/// from copy to copy.
pub fn repeat(tubes: &[Tube], successor: &[usize], count: usize, period: DVec3) -> Vec<Tube> {
    let mut colours: Vec<usize> = tubes.iter().map(|t| t.colour).collect();
    let mut out = Vec::with_capacity(tubes.len() * count);
    for copy in 0..count {
        let shift = period * copy as f64;
        out.extend(tubes.iter().zip(&colours).map(|(t, colour)| Tube {
            points: t.points.iter().map(|p| *p + shift).collect(),
            radius: t.radius,
            colour: *colour,
            shade: t.shade,
        }));
        let mut next = colours.clone();
        successor.iter().enumerate().for_each(|(i, s)| next[*s] = colours[i]);
        colours = next;
    }
    out
}
