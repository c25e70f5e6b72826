//! Neighbour lists, periodic images and sums of contact forces.
#[path = "support/contact_rig.rs"]
mod contact_rig;
use braid_ecs::prelude::*;
use braid_ecs::systems::contact::list::excluded;
use braid_ecs::systems::contact::near::segment_distance_squared;
use braid_ecs::systems::contact::search::Candidate;
use contact_rig::*;

/// Random wavy filaments in a box.
fn tangle(scale: f64, count: usize, seed: u64) -> Model {
    let mut noise = Noise(seed);
    let mut model = Model::new("");
    for _ in 0..count {
        let mut p = noise.vector() * 2.0;
        let mut d = noise.vector();
        let points: Vec<DVec3> = (0..12)
            .map(|_| {
                d = (d + 0.4 * noise.vector()).normalize();
                p += d * 0.7;
                p * scale
            })
            .collect();
        filament(&mut model, &points, 0.15 * scale * (1.0 + 0.1 * noise.next()));
    }
    model
}

#[test]
fn the_list_is_what_brute_force_finds() {
    for scale in [1.0, 1e-3, 1e-6] {
        for (seed, skin) in [(3, 0.1), (4, 1.0), (5, 3.0)] {
            let model = tangle(scale, 30, seed);
            let mut rig = Rig::new(&model, settings(1.0, scale), skin);
            let segments: Vec<u32> = rig.lines.segments().collect();
            let zero = rig.lines.images.zero();
            // A second and a third list come from the updated tree.
            for _ in 0..3 {
                let mut known = Vec::new();
                for (i, &a) in segments.iter().enumerate() {
                    for &b in &segments[i + 1..] {
                        let c = Candidate { a, b, image: zero };
                        let x = |s: u32| DVec3::from_slice(&rig.now.x[s as usize][..3]);
                        let reach = rig.now.x[a as usize][3] + rig.now.x[b as usize][3] + rig.search.skin;
                        let d = segment_distance_squared(x(a), x(a + 1), x(b), x(b + 1)).sqrt();
                        if d < reach && !excluded(&rig.lines, c) {
                            known.push(c);
                        }
                    }
                }
                known.sort();
                assert!(known.len() > 20);
                // The list also counts how far the centrelines leave their chords.
                assert!(known.iter().all(|c| rig.builder.candidates.binary_search(c).is_ok()));
                assert!(rig.builder.candidates.len() < 3 * known.len());
                let mut noise = Noise(seed + 100);
                for x in &mut rig.x {
                    x.0 += noise.vector() * 0.1 * scale;
                }
                rig.rebuild();
            }
        }
    }
}

/// One node swings so fast that it leaves half the skin in two steps, which would make 100 lists in 300 steps: a
/// list lasts at least for half a swing nevertheless, and holds whatever touches.
#[test]
fn a_node_that_whips_gets_room_of_its_own() {
    let mut model = Model::new("");
    for k in 0..40 {
        let from = DVec3::new(f64::from(k % 8) * 2.5, f64::from(k / 8) * 2.5, 0.0);
        filament(&mut model, &straight(from, DVec3::Z * 10.0, 13), 1.0);
    }
    let mut rig = Rig::new(&model, settings(1.0, 10.0), 1.0);
    let segments: Vec<u32> = rig.lines.segments().collect();
    let node = 13 * 17 + 6;
    let (home, zero) = (rig.x[node].0, rig.lines.images.zero());
    let (mut before, mut after) = (0, 0);
    for step in 0..400 {
        let phase = f64::from(step) * 0.3;
        rig.x[node].0 = home + DVec3::X * phase.sin();
        rig.v[node].0 = DVec3::X * (0.3 * phase.cos());
        rig.evaluate(1.0);
        if step == 100 {
            before = rig.search.rebuilds;
        }
        after = rig.search.rebuilds;
        let x = |s: u32| rig.x[rig.lines.joints[s as usize].row as usize].0;
        for (i, &a) in segments.iter().enumerate() {
            for &b in &segments[i + 1..] {
                let c = Candidate { a, b, image: zero };
                if segment_distance_squared(x(a), x(a + 1), x(b), x(b + 1)) < 4.0 && !excluded(&rig.lines, c) {
                    assert!(rig.builder.candidates.binary_search(&c).is_ok(), "{a} and {b} touch in step {step}");
                }
            }
        }
    }
    // Half a swing takes 10.5 steps, and a list may end in the look before.
    assert!(after - before < 40, "{} lists in 300 steps", after - before);
}

#[test]
fn metres_millimetres_and_micrometres_give_the_same_forces() {
    let forces = |scale: f64| {
        let model = tangle(scale, 40, 11);
        let mut rig = Rig::new(&model, settings(1.0, scale), 1.0);
        rig.settings.law.friction = 0.3;
        rig.settings.law.damping = 0.1;
        rig.mass.fill(scale);
        let mut noise = Noise(9);
        for _ in 0..20 {
            for (x, v) in rig.x.iter_mut().zip(&mut rig.v) {
                v.0 = noise.vector() * scale;
                x.0 += v.0 * 0.01;
            }
            rig.evaluate(0.01);
        }
        // k (force / length) is scale x 1: forces go with the square of the length.
        rig.force.iter().map(|f| *f / (scale * scale)).collect::<Vec<_>>()
    };
    let one = forces(1.0);
    let size = one.iter().fold(0.0f64, |m, f| m.max(f.length()));
    assert!(size > 1e-3);
    for scale in [1e-3, 1e-6] {
        let other = forces(scale);
        let worst = one.iter().zip(&other).fold(0.0f64, |m, (a, b)| m.max((*a - *b).length()));
        assert!(worst < 1e-9 * size, "scale {scale}: {worst:e} of {size}");
    }
}

#[test]
fn forces_are_in_balance_and_symmetric_under_exchange() {
    let model = tangle(1.0, 40, 21);
    let mut rig = Rig::new(&model, settings(1.0, 1.0), 1.0);
    rig.settings.law.friction = 0.3;
    rig.settle();
    let size: f64 = rig.force.iter().map(|f| f.length()).sum();
    let sum: DVec3 = rig.force.iter().sum();
    assert!(size > 0.01 && sum.length() < 1e-13 * size, "{sum} of {size}");
}

/// Two chains that leave the cell of height 4 through its top and come back at the bottom; they run
/// side by side, and two more cross them at the face.
fn periodic_cell(tilt: f64) -> Model {
    let height = 4.0;
    let mut model = Model::new("");
    model.nodes.push(Node { dummy: true, ..Node::at(DVec3::new(tilt, 0.0, height)) });
    let d = NodeId(0);
    let period = DVec3::new(tilt, 0.0, height);
    // Chain 1: filament 0 goes on in itself. Chain 2: filaments 1 and 2 go on in each other.
    let lanes: [(DVec3, DVec3, usize); 4] = [
        (DVec3::ZERO, DVec3::ZERO, 0),
        (DVec3::new(0.98, 0.03, 0.3), DVec3::new(0.0, 0.98, 0.0), 2),
        (DVec3::new(0.98, 1.01, 0.3), DVec3::new(0.0, -0.98, 0.0), 1),
        (DVec3::new(0.45, -0.88, -0.2), DVec3::ZERO, 3),
    ];
    let mut first = Vec::new();
    for (k, (from, aside, _)) in lanes.iter().enumerate() {
        let step = (period + *aside) / 8.0;
        let f = filament(&mut model, &straight(*from, step, 9), 0.5);
        assert_eq!(f, k);
        first.push(*model.filaments[f].nodes.first().unwrap());
    }
    for (k, (_, _, next)) in lanes.iter().enumerate() {
        let image = *model.filaments[k].nodes.last().unwrap();
        let place = model.nodes[first[*next].row()].position + period;
        model.nodes[image.row()].position = place;
        model.periodic.push(PeriodicPair { node: first[*next], image, dummies: vec![d] });
    }
    // A straight one across the top face: touches the others beyond it.
    filament(&mut model, &straight(DVec3::new(-3.0, 0.55, 4.55), DVec3::X * 0.9, 9), 0.5);
    model
}

#[test]
fn energy_and_forces_agree_across_periodic_faces() {
    // Weights that change with the angle have no energy of their own: all nodes, or all crossings.
    for (tilt, window) in [(0.0, [0.03, 0.06]), (0.6, [0.02, 0.03]), (0.0, [10.0, 20.0]), (0.6, [10.0, 20.0])] {
        let model = periodic_cell(tilt);
        let mut numbers = settings(1.0, 0.5);
        numbers.window = window;
        let mut base = Rig::new(&model, numbers, 1.0);
        let mut noise = Noise(77);
        // Bring everything into general position, images where their originals are.
        for x in &mut base.x {
            x.0 += noise.vector() * 0.004;
        }
        let obey = |x: &mut Vec<Position>| {
            for p in &model.periodic {
                x[p.image.row()].0 = x[p.node.row()].0 + x[0].0;
            }
        };
        obey(&mut base.x);
        base.rebuild();
        base.touch();
        base.settle();
        assert!(base.line.0.iter().any(|r| r.image != base.lines.images.zero()), "records across the face are wanted");
        let force = base.force.clone();
        assert!(force[0].length() > 1e-4, "the period must feel a force");
        for trial in 0..20 {
            let mut direction: Vec<DVec3> = (0..base.x.len()).map(|_| noise.vector()).collect();
            // Also motions of the period alone, and of the images against their originals.
            if trial % 3 == 0 {
                direction.iter_mut().skip(1).for_each(|d| *d = DVec3::ZERO);
            }
            if trial % 2 == 0 {
                let mut p: Vec<Position> = direction.iter().map(|d| Position(*d)).collect();
                obey(&mut p);
                direction = p.iter().map(|p| p.0).collect();
            }
            let h = 1e-6;
            let energy = |sign: f64, rig: &mut Rig| {
                for (x, (x0, d)) in rig.x.iter_mut().zip(base.x.iter().zip(&direction)) {
                    x.0 = x0.0 + *d * (sign * h);
                }
                for _ in 0..3 {
                    rig.evaluate(0.0);
                }
                rig.energy()
            };
            let mut rig = Rig::new(&model, numbers, 1.0);
            rig.x.clone_from(&base.x);
            rig.rebuild();
            rig.touch();
            let slope = (energy(1.0, &mut rig) - energy(-1.0, &mut rig)) / (2.0 * h);
            let work: f64 = force.iter().zip(&direction).map(|(f, d)| f.dot(*d)).sum();
            let size: f64 = force.iter().zip(&direction).map(|(f, d)| (f.length() * d.length()).abs()).sum();
            assert!(
                (slope + work).abs() < 2e-5 * size,
                "tilt {tilt}, window {window:?}, points {}, trial {trial}: dE {slope:e}, f.dx {work:e}, size {size:e}",
                rig.point.0.len()
            );
        }
    }
}

#[test]
fn a_cell_and_two_cells_carry_the_same() {
    // Filament 0 alone goes on in itself; a parallel one likewise: the line force is that of the whole height.
    let (height, n) = (4.0, 8);
    for seam in [0.0, 0.13, 2.0] {
        let mut model = Model::new("");
        model.nodes.push(Node { dummy: true, ..Node::at(DVec3::Z * height) });
        for from in [DVec3::ZERO, DVec3::new(0.99, 0.0, seam)] {
            let f = filament(&mut model, &straight(from, DVec3::Z * (height / n as f64), n + 1), 0.5);
            let nodes = &model.filaments[f].nodes;
            model.periodic.push(PeriodicPair { node: nodes[0], image: nodes[n], dummies: vec![NodeId(0)] });
        }
        let mut rig = Rig::new(&model, settings(2.0, 1.0), 1.0);
        rig.settle();
        assert_eq!(rig.line.0.len(), n, "one record per node, also at the seam {seam}");
        let f = rig.force_on(&model, 1).x;
        let known = 2.0 * height * (0.01 - 0.5e-3);
        assert!((f - known).abs() < 1e-12 * known + 1e-13, "seam {seam}: {f} instead of {known}");
        // Shearing the cell leaves the gap as it is.
        let on_period: DVec3 = rig.x.iter().zip(&rig.force).skip(1).map(|(x, f)| *f * (x.0.z / height)).sum::<DVec3>() + rig.force[0];
        assert!(on_period.length() < 1e-13, "{on_period}");
    }
}
