//! The contact law of filaments, by prescribed motion.
#[path = "support/contact_rig.rs"]
mod contact_rig;
use braid_ecs::prelude::*;
use braid_ecs::systems::contact::records::Action;
use contact_rig::*;

const R: f64 = 0.5;

/// Largest change of `values` relative to their mean.
fn ripple(values: &[f64]) -> f64 {
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    let (low, high) = values.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(*v), b.max(*v)));
    (high - low) / mean
}

/// A long filament along x and a short one beside it at a penetration of 1 % of the diameter.
fn side_by_side(length: f64, offset: f64, wobble: f64) -> (Model, usize, usize) {
    let mut model = Model::new("");
    let mut noise = Noise(7);
    let mut points = |from: DVec3, count: usize| -> Vec<DVec3> {
        straight(from, DVec3::X * length, count).iter().map(|p| *p + noise.vector() * wobble).collect()
    };
    let long = points(DVec3::ZERO, 40);
    let short = points(DVec3::new(15.0 * length + offset, 0.0, 0.99), 10);
    let a = filament(&mut model, &long, R);
    let b = filament(&mut model, &short, R);
    (model, a, b)
}

#[test]
fn sliding_side_by_side_has_no_ripple() {
    for (length, wobble, limit) in [(2.2, 0.0, 1e-12), (8.4, 0.0, 1e-12), (2.2, 1e-4, 1e-4), (8.4, 1e-4, 1e-4)] {
        let (model, _, b) = side_by_side(length, 0.1, wobble);
        // A skin so wide that the list stays and the records have to find their own way.
        let mut rig = Rig::new(&model, settings(1.0, length), 40.0);
        rig.v.iter_mut().skip(40).for_each(|v| v.0 = DVec3::X * (2.0 * length / 400.0));
        let mut forces = Vec::new();
        for _ in 0..400 {
            rig.shift(&model, b, DVec3::X * (2.0 * length / 400.0));
            rig.evaluate(1.0);
            forces.push(rig.force_on(&model, b).z);
        }
        assert!(rig.rehomed > 0, "the nodes must pass from segment to segment");
        let mean = forces.iter().sum::<f64>() / 400.0;
        // The wobble is noise of the penetration; its ripple is what remains of it in the mean.
        let expected = 9.0 * length * (0.01 - 0.5e-3);
        assert!((mean - expected).abs() < (1e-12 + 0.01 * wobble / 1e-4) * expected, "{mean} {expected}");
        let steps: Vec<f64> = forces.windows(2).map(|w| (w[1] - w[0]).abs()).collect();
        let largest = steps.iter().fold(0.0, |m: f64, s| m.max(*s)) / mean;
        assert!(largest < limit, "largest change in one of 400 steps {largest:e} (L/D {length}, wobble {wobble})");
        if wobble == 0.0 {
            assert!(ripple(&forces) < limit);
        }
    }
}

#[test]
fn stiffness_does_not_depend_on_the_alignment_of_nodes() {
    let mut forces = Vec::new();
    for offset in [0.0, 0.13, 0.25, 0.5, 0.77] {
        let (model, _, b) = side_by_side(2.2, offset * 2.2, 0.0);
        let mut rig = Rig::new(&model, settings(1.0, 2.2), 1.0);
        rig.settle();
        forces.push(rig.force_on(&model, b).z);
    }
    assert!(ripple(&forces) < 1e-12, "{forces:?}");
}

#[test]
fn filaments_of_the_same_length_touch_along_all_of_it() {
    for (nodes, shift) in [(2, 0.0), (9, 0.0), (9, 0.3)] {
        let mut model = Model::new("");
        let a = filament(&mut model, &straight(DVec3::ZERO, DVec3::X * 2.0, nodes), R);
        let b = filament(&mut model, &straight(DVec3::new(shift, 0.0, 0.99), DVec3::X * 2.0, nodes), R);
        let mut rig = Rig::new(&model, settings(3.0, 6.0), 1.0);
        rig.settle();
        let expected = 3.0 * ((nodes - 1) as f64 * 2.0 - shift) * (0.01 - 0.5e-3);
        let (fa, fb) = (rig.force_on(&model, a).z, rig.force_on(&model, b).z);
        assert!((fb - expected).abs() < 0.01 * expected, "{nodes} {shift}: {fb} instead of {expected}");
        assert!((fa + fb).abs() < 1e-13);
    }
}

#[test]
fn crossing_over_a_node_keeps_the_force() {
    for angle in [90.0f64, 45.0, 20.0, 10.0] {
        for length in [2.2, 8.4] {
            let direction = DVec3::new(angle.to_radians().cos(), angle.to_radians().sin(), 0.0);
            let mut forces = Vec::new();
            for step in 0..=80 {
                let mut model = Model::new("");
                filament(&mut model, &straight(DVec3::X * (-6.0 * length), DVec3::X * length, 13), R);
                let middle = DVec3::new(length * (step as f64 / 40.0 - 1.0), 0.0, 0.99);
                let from = middle - direction * (5.37 * length);
                let b = filament(&mut model, &straight(from, direction * length, 12), R);
                let mut rig = Rig::new(&model, settings(1.0, length), 1.0);
                rig.settle();
                forces.push(rig.force_on(&model, b).z);
            }
            let full = length * (0.01 - 0.5e-3);
            for f in &forces {
                assert!((f / full - 1.0).abs() < 0.01, "angle {angle}, L/D {length}: {f} of {full}");
            }
        }
    }
}

#[test]
fn no_angle_loses_the_contact() {
    for length in [2.2, 8.4] {
        for tenth in 1..=900 {
            let angle = (0.1 * tenth as f64).to_radians();
            let direction = DVec3::new(angle.cos(), angle.sin(), 0.0);
            for place in [0.0, 0.25, 0.5, 0.75] {
                let mut model = Model::new("");
                filament(&mut model, &straight(DVec3::X * (-30.0 * length), DVec3::X * length, 61), R);
                let from = DVec3::new(length * place, 0.0, 0.99) - direction * (29.37 * length);
                let b = filament(&mut model, &straight(from, direction * length, 60), R);
                let mut rig = Rig::new(&model, settings(1.0, length), 1.0);
                rig.settle();
                let f = rig.force_on(&model, b).z / (length * (0.01 - 0.5e-3));
                assert!(f > 0.9, "angle {:.1}, L/D {length}, place {place}: {f}", angle.to_degrees());
            }
        }
    }
}

/// Two nested arcs, pushed together, slid, pulled apart and slid back.
#[test]
fn a_closed_loop_takes_no_work() {
    let big = 20.0;
    let mut model = Model::new("");
    let arc = |radius: f64, from: f64, count: usize| -> Vec<DVec3> {
        (0..count)
            .map(|i| {
                let a = from + 2.2 / big * i as f64;
                DVec3::new(radius * a.sin(), 0.0, radius * a.cos())
            })
            .collect()
    };
    let a = filament(&mut model, &arc(big, -0.9, 18), R);
    let b = filament(&mut model, &arc(big + 1.01, -0.35, 7), R);
    let mut rig = Rig::new(&model, settings(1.0, 2.2), 1.0);
    let (mut net, mut gross) = (0.0, 0.0);
    let steps = 8000;
    let place = |s: f64| -> (f64, f64) {
        // (slide angle, depth) around the loop
        let q = s * 4.0;
        let ease = |x: f64| x * x * (3.0 - 2.0 * x);
        match q {
            q if q < 1.0 => (0.0, 0.03 * ease(q)),
            q if q < 2.0 => (0.25 * ease(q - 1.0), 0.03),
            q if q < 3.0 => (0.25, 0.03 * (1.0 - ease(q - 2.0))),
            q => (0.25 * (1.0 - ease(q - 3.0)), 0.0),
        }
    };
    let base: Vec<DVec3> = model.filaments[b].nodes.iter().map(|n| model.nodes[n.row()].position).collect();
    let at = |s: f64| -> Vec<DVec3> {
        let (slide, depth) = place(s);
        let turn = DQuat::from_rotation_y(slide);
        base.iter().map(|p| turn * (*p - p.normalize() * depth)).collect()
    };
    let mut before: Option<(Vec<DVec3>, Vec<DVec3>)> = None;
    for i in 0..=steps {
        let now = at(i as f64 / steps as f64);
        for (n, p) in model.filaments[b].nodes.iter().zip(&now) {
            rig.v[n.row()].0 = *p - rig.x[n.row()].0;
            rig.x[n.row()].0 = *p;
        }
        rig.evaluate(1.0);
        let f: Vec<DVec3> = model.filaments[b].nodes.iter().map(|n| rig.force[n.row()]).collect();
        if let Some((x0, f0)) = &before {
            for k in 0..now.len() {
                let w = 0.5 * (f[k] + f0[k]).dot(now[k] - x0[k]);
                net += w;
                gross += w.abs();
            }
        }
        before = Some((now, f));
    }
    assert!(rig.rehomed > 0 && gross > 0.0);
    assert!(net.abs() < 1e-5 * gross, "net {net:e} of {gross:e}");
    assert!((rig.force_on(&model, a) + rig.force_on(&model, b)).length() < 1e-12);
}

/// Four lanes at a time or one by one: the same bits, touching or not.
#[test]
fn the_vector_kernel_gives_the_bits_of_the_scalar_one() {
    use braid_ecs::systems::contact::assemble::{evaluate_lines, of_line};
    let mut model = Model::new("");
    let mut noise = Noise(11);
    for k in 0..7 {
        let across = DVec3::new(0.0, (k % 3) as f64, (k / 3) as f64) * 0.97;
        let points: Vec<DVec3> = straight(across, DVec3::X * 1.5, 23).iter().map(|p| *p + noise.vector() * 0.06).collect();
        filament(&mut model, &points, R);
    }
    let mut rig = Rig::new(&model, settings(1.0, 1.5), 1.0);
    rig.settings.law.friction = 0.3;
    rig.settings.law.damping = 0.1;
    rig.v.iter_mut().for_each(|v| v.0 = noise.vector());
    let mut touching = 0;
    for _ in 0..20 {
        for (x, v) in rig.x.iter_mut().zip(&rig.v) {
            x.0 += v.0 * 2e-3;
        }
        rig.refresh();
        rig.settings.law.dt = 2e-3;
        let (records, before) = (rig.line.0.clone(), rig.line.1.clone());
        assert!(records.len() > 100 && records.len() % 4 != 0, "{} records", records.len());
        evaluate_lines(&rig.settings, &rig.lines, &rig.now, &records, &mut rig.line.1, &mut rig.line.2);
        for (k, (record, state)) in records.iter().zip(&before).enumerate() {
            let one = of_line(&rig.settings, &rig.lines, &rig.now, record, state);
            if one.response.force.lane(0) != DVec3::ZERO {
                let Action { force, normal, turn, t } = rig.line.2[k].0;
                let found = (force, normal, turn.map(f64::to_bits), t.map(f64::to_bits));
                let (force, normal) = (one.response.force.lane(0), one.normal.lane(0));
                assert_eq!(found, (force, normal, one.turn.map(f64::to_bits), one.t.map(f64::to_bits)), "record {k}");
            }
            assert_eq!(rig.line.1[k].slip, one.response.memory.slip.lane(0));
            touching += usize::from(one.response.normal_force > 0.0);
        }
    }
    assert!(touching > 200, "{touching} touch");
}

/// Friction acts at the surface: filaments that turn as one body do not slide, filaments that turn each for itself do,
/// by the turn times their distance, and the forces of filaments that slide along each other have no moment.
#[test]
fn friction_acts_at_the_surface() {
    let (model, a, b) = side_by_side(1.5, 0.4, 0.0);
    let (dt, speed) = (0.1, 1e-2);
    let moving = |velocity: &dyn Fn(usize, DVec3) -> DVec3| {
        let mut rig = Rig::new(&model, settings(1.0, 1.5), 1.0);
        rig.settings.law.friction = 0.5;
        rig.settle();
        for f in [a, b] {
            for n in &model.filaments[f].nodes {
                rig.v[n.row()].0 = velocity(f, rig.x[n.row()].0);
            }
        }
        rig.evaluate(dt);
        rig
    };
    let slips = |rig: &Rig| {
        let slips: Vec<f64> = rig.line.1.iter().filter(|s| s.stiffness > 0.0).map(|s| s.slip.length()).collect();
        assert!(slips.len() >= 10);
        slips.into_iter().fold([f64::MAX, 0.0], |[low, high]: [f64; 2], s| [low.min(s), high.max(s)])
    };
    let (turn, somewhere) = (DVec3::Y * speed, DVec3::new(7.0, 1.0, -3.0));
    let as_one = moving(&|_, x| turn.cross(x - somewhere));
    assert!(slips(&as_one)[1] < 1e-14 * dt, "{:?}", slips(&as_one));
    let alone = moving(&|f, x| turn.cross(x - DVec3::Z * if f == a { 0.0 } else { 0.99 }));
    for s in slips(&alone) {
        assert!((s / (speed * 0.99 * dt) - 1.0).abs() < 1e-12, "{s}");
    }

    let along = moving(&|f, _| DVec3::X * if f == a { -speed } else { speed });
    let moment: DVec3 = along.x.iter().zip(&along.force).map(|(x, f)| x.0.cross(*f)).sum();
    let drag = along.force_on(&model, b).x.abs();
    assert!(drag > 0.0 && moment.length() < 1e-12 * drag * 20.0, "{moment} with a drag of {drag:e}");
    // The power of the forces is that of the friction springs, at the surface.
    let sliding = moving(&|f, x| turn.cross(x - DVec3::Z * if f == a { 0.0 } else { 0.99 }) + DVec3::X * if f == a { 0.0 } else { speed });
    let still = moving(&|_, _| DVec3::ZERO);
    let power: f64 = sliding.v.iter().zip(sliding.force.iter().zip(&still.force)).map(|(v, (f, n))| v.0.dot(*f - *n)).sum();
    let spring: f64 = sliding.line.1.iter().map(|s| 0.5 * s.stiffness.max(0.0) * s.slip.length_squared() / dt).sum();
    assert!((power / spring + 1.0).abs() < 1e-9, "{power:e} {spring:e}");
}
