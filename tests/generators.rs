//! Generated structures: counts, closure, clearance, masses, and the measures of the braid as it is laid.
use braid_ecs::generate::*;
use braid_ecs::measure::*;
use braid_ecs::prelude::*;
use braid_ecs::registry::Registry;
use std::collections::BTreeMap;

/// Glass in N, mm, t: E = 72 GPa, nu = 0.23, 2.58 g/cm3.
fn materials() -> BTreeMap<String, Material> {
    BTreeMap::from([("glass".to_string(), Material { young: 72e3, poisson: 0.23, density: 2.58e-9 })])
}

fn registry() -> Registry {
    Simulation::new(braid_ecs::systems::default_plugins).registry
}

fn in_model<T>(add: impl FnOnce(&Registry, &mut Build<'_>) -> Result<T, SpecError>) -> Result<(Model, T), SpecError> {
    let mut model = Model::new("test");
    let (materials, sections) = (materials(), BTreeMap::new());
    let mut build = Build { model: &mut model, materials: &materials, sections: &sections };
    let value = add(&registry(), &mut build)?;
    Ok((model, value))
}

fn braid_spec() -> BraidSpec {
    BraidSpec { undulation: Some(Length(0.031)), ..BraidSpec::new(3.0) }
}

fn tow_spec() -> TowSpec {
    TowSpec::new(0.0025, "glass")
}

fn braided(spec: &BraidSpec, tow: &TowSpec, seed: u64) -> (Model, BraidLayout) {
    in_model(|r, b| braid(spec, tow, seed, r, b)).expect("valid braid")
}

fn count(model: &Model, kind: &str) -> usize {
    registry().element(kind).map_or(0, |k| (k.count)(model))
}

fn position(model: &Model, n: NodeId) -> DVec3 {
    model.nodes[n.row()].position
}

fn initial_measures(model: &Model, layout: &BraidLayout) -> BraidMeasures {
    measure_braid(layout, &initial_traces(model), position(model, layout.dummy), &CrossingOptions::for_braid(layout, Heights::Radial))
}

#[test]
fn embedded_braid_has_hosts_then_dummy_then_tied_nodes() {
    let (model, layout) = braided(&braid_spec(), &tow_spec(), 1);
    let hosts = 84 * 32;
    assert_eq!(model.filaments.len(), 84);
    assert_eq!(layout.dummy, NodeId(hosts as u32));
    assert_eq!(model.nodes.len(), 2 * hosts + 1);
    assert_eq!((model.ties.len(), model.periodic.len()), (hosts, 84));
    assert_eq!((count(&model, "truss"), count(&model, "beam")), (84 * 31, 84 * 31));
    for t in &model.ties {
        assert!(t.host < layout.dummy && t.embedded > layout.dummy);
        assert_eq!(position(&model, t.host), position(&model, t.embedded));
    }
    let dummy = &model.nodes[layout.dummy.row()];
    assert!(dummy.dummy);
    assert!((dummy.position - DVec3::Z * 2.1997668580278).length() < 1e-12);
    assert_eq!(model.node_names["period"], layout.dummy);
    assert_eq!(model.fixed.len(), 1);
    assert_eq!(model.fixed[0].dofs, [Dof::Ux, Dof::Uy, Dof::Rx, Dof::Ry, Dof::Rz], "z of the period is free");
    assert_eq!(model.get::<BraidLayout>(), Some(&layout));
}

#[test]
fn filaments_leave_the_cell_where_their_successors_enter() {
    let tow = TowSpec { perturbation: 0.01, ..tow_spec() };
    for (cell, steps) in [(Cell::SixthTurn, [1, 5]), (Cell::FullTurn, [0, 0])] {
        let (model, layout) = braided(&BraidSpec { cell, ..braid_spec() }, &tow, 3);
        let h = position(&model, layout.dummy);
        let mut images = Vec::new();
        for p in &model.periodic {
            assert_eq!(position(&model, p.image), position(&model, p.node) + h, "to the bit");
            assert_eq!(p.dummies, [layout.dummy]);
            let from = model.filaments.iter().find(|f| *f.nodes.last().expect("nodes") == p.image).expect("an end");
            let into = model.filaments.iter().find(|f| f.nodes[0] == p.node).expect("a start");
            assert_eq!(from.index, into.index);
            assert_eq!(from.tow / 6, into.tow / 6);
            assert_eq!(into.tow % 6, (from.tow + steps[from.tow / 6]) % 6, "A_k into A_(k+1), B_k into B_(k-1)");
            images.push((p.node, p.image));
        }
        images.sort_unstable();
        images.dedup();
        assert_eq!(images.len(), 84, "every filament has one predecessor and one successor");
        // The last segment is as long as the others: nothing is folded at the face.
        for f in &model.filaments {
            let l: Vec<f64> = f.nodes.windows(2).map(|w| position(&model, w[0]).distance(position(&model, w[1]))).collect();
            let mean = l.iter().sum::<f64>() / l.len() as f64;
            assert!(l.iter().all(|x| (x / mean - 1.0).abs() < 0.02));
        }
    }
}

#[test]
fn filament_lengths_in_a_tow_differ_by_less_than_half_a_percent() {
    // Outward by d the helix is longer by d sin^2(55 deg) / R: 0.431 % for the outer site of seven.
    let (model, layout) = braided(&braid_spec(), &tow_spec(), 1);
    let traces = initial_traces(&model);
    let spacing = 2.0 * layout.radii.contact * 1.02;
    let expected = spacing * 55f64.to_radians().sin().powi(2) / 3.0;
    assert!((expected - 0.0043).abs() < 5e-5);
    for t in &layout.tows {
        let lengths: Vec<f64> = traces[t.filaments.clone()].iter().map(Trace::length).collect();
        let mean = lengths.iter().sum::<f64>() / 7.0;
        let spread = |f: fn(f64, f64) -> f64, start| lengths.iter().copied().fold(start, f) / mean - 1.0;
        assert!((spread(f64::max, 0.0) / expected - 1.0).abs() < 0.03);
        assert!((spread(f64::min, f64::MAX) / -expected - 1.0).abs() < 0.03);
        assert!((mean / layout.arc_length - 1.0).abs() < 1e-4);
    }
}

/// Smallest surface distance over the radius between segments of different filaments, and of one filament with
/// its periodic images, by brute force over all pairs with boxes that come near.
fn clearance(model: &Model, layout: &BraidLayout) -> f64 {
    let period = position(model, layout.dummy);
    let mut segments: Vec<(usize, [DVec3; 2])> = Vec::new();
    for (i, f) in model.filaments.iter().enumerate() {
        segments.extend(f.nodes.windows(2).map(|w| (i, [position(model, w[0]), position(model, w[1])])));
    }
    segments.sort_by(|a, b| a.1[0].z.total_cmp(&b.1[0].z));
    let reach = segments.iter().map(|s| (s.1[1] - s.1[0]).length()).fold(0.0, f64::max) + 2.0 * layout.radii.contact;
    let mut least = f64::INFINITY;
    for shift in [DVec3::ZERO, period] {
        for (i, a) in segments.iter().enumerate() {
            let from = if shift == DVec3::ZERO { i + 1 } else { 0 };
            for b in &segments[from..] {
                let q = b.1.map(|x| x + shift);
                if q[0].z > a.1[0].z + 2.0 * reach {
                    break;
                }
                if a.0 == b.0 || (a.1[0] - q[0]).length() > 2.0 * reach {
                    continue;
                }
                // Segments that meet in a periodic face are parts of one filament.
                if a.1[1] == q[0] || a.1[0] == q[1] {
                    continue;
                }
                least = least.min(segment_distance(a.1, q));
            }
        }
    }
    least / layout.radii.contact - 2.0
}

#[test]
fn nothing_overlaps_at_the_start() {
    for (filaments, pattern, cell) in [
        (7, Pattern::Diamond, Cell::SixthTurn),
        (7, Pattern::Regular, Cell::SixthTurn),
        (7, Pattern::Hercules, Cell::SixthTurn),
        (19, Pattern::Diamond, Cell::SixthTurn),
        (37, Pattern::Diamond, Cell::SixthTurn),
        (100, Pattern::Diamond, Cell::SixthTurn),
    ] {
        for perturbation in if filaments == 7 { vec![0.0, 0.01] } else { vec![0.01] } {
            let tow = TowSpec { filaments, perturbation, ..tow_spec() };
            let (model, layout) = braided(&BraidSpec { pattern, cell, ..braid_spec() }, &tow, 5);
            let clear = clearance(&model, &layout);
            // Neighbours in a tow start 0.04 radii apart, less what both are shifted.
            assert!(clear > 0.04 - 2.0 * perturbation - 1e-3, "{filaments} {pattern:?}: {clear}");
            assert!(clear < 0.05, "{filaments}: neighbours are where the gap factor puts them, {clear}");
        }
    }
}

#[test]
fn undulation_follows_the_tow_when_it_is_not_given() {
    let (model, layout) = braided(&BraidSpec::new(3.0), &tow_spec(), 1);
    assert!((layout.geometry.undulation - 1.02 * layout.outer_radius).abs() < 1e-15);
    assert!(clearance(&model, &layout) > 0.0);
}

#[test]
fn mass_is_that_of_the_real_filaments_and_counted_once() {
    let tow_mass = 100.0 * std::f64::consts::PI * 0.0025f64.powi(2) * 2.58e-9;
    for (model, filaments) in
        [(FilamentModel::Embedded, 7), (FilamentModel::Trusses, 7), (FilamentModel::Beams, 19), (FilamentModel::Beams, 100)]
    {
        let tow = TowSpec { model, filaments, ..tow_spec() };
        let (built, layout) = braided(&braid_spec(), &tow, 1);
        let expected = 12.0 * tow_mass * layout.arc_length;
        assert!((layout.mass / expected - 1.0).abs() < 1e-4, "{filaments}");
        let mut sim = Simulation::new(braid_ecs::systems::default_plugins);
        sim.build(&built).expect("the braid can be built");
        let mut query = sim.world.query::<&Mass>();
        let total: f64 = query.iter(&sim.world).map(|m| m.0).sum();
        // The dummy node may carry the mass of the image nodes a second time; it is no part of the sum.
        let dummy = sim.world.get::<Mass>(sim.world.resource::<NodeEntities>().0[sim.world.resource::<NodeRows>().of(layout.dummy)]);
        let total = total - dummy.map_or(0.0, |m| m.0);
        assert!((total / layout.mass - 1.0).abs() < 1e-12, "{filaments}: nodes carry {total}, filaments weigh {}", layout.mass);
    }
}

#[test]
fn braid_as_laid_has_its_angle_thickness_and_order() {
    for pattern in [Pattern::Diamond, Pattern::Regular, Pattern::Hercules] {
        for (cell, crossings) in [(Cell::SixthTurn, 12), (Cell::FullTurn, 72)] {
            for hand in [Hand::Right, Hand::Left] {
                let elements = if cell == Cell::FullTurn { 186 } else { 31 };
                let spec = BraidSpec { pattern, cell, hand, ..braid_spec() };
                let (model, layout) = braided(&spec, &TowSpec { elements, ..tow_spec() }, 1);
                let m = initial_measures(&model, &layout);
                assert_eq!(m.crossings.len(), crossings);
                assert_eq!(m.length, layout.cell_length);
                // Each tow has the helix angle of its own radius at the crossing.
                let full: f64 = [3.031f64, 2.969].iter().map(|r| (r / 3.0 * 55f64.to_radians().tan()).atan().to_degrees()).sum();
                assert!((m.angle.mean.to_degrees() - full).abs() < 0.1, "{pattern:?} {cell:?}: {}", m.angle.mean.to_degrees());
                // Two tows of seven, centre lines 2 x 0.031 apart: the sites with the largest |x| lie in the middle.
                // Crossings in the middle of a segment are nearer by the sag of the undulation in both tows,
                // l^2 a k^2 / 8 each with k = pi / (distance of crossings along the tow).
                let sag = 0.124f64.powi(2) * 0.031 * (std::f64::consts::PI / 1.918).powi(2) / 8.0;
                let thickness = 2.0 * (0.031 + layout.outer_radius);
                assert!((m.thickness.mean - thickness).abs() < 2.1 * sag, "{pattern:?}: {} {thickness}", m.thickness.mean);
                assert_eq!(m.order_changes(), 0);
                for c in &m.crossings {
                    assert!((c.separation.abs() - 0.062).abs() < 2.1 * sag);
                    let mut place = c.crossing.point;
                    if hand == Hand::Left {
                        place = spec.geometry(0.0).crossing(c.crossing.plus, c.crossing.m).point;
                    }
                    assert!((c.point - place).length() < 1e-3, "{:?}", c);
                }
                assert_eq!(passages(&layout, &initial_traces(&model), DVec3::Z * layout.cell_length), []);
            }
        }
    }
}

#[test]
fn a_filament_that_has_passed_through_is_found() {
    let (model, layout) = braided(&braid_spec(), &tow_spec(), 1);
    let mut traces = initial_traces(&model);
    let period = DVec3::Z * layout.cell_length;
    // Filament 3 of A_2 is pushed inwards around the middle of the cell, where A_2 crosses B_3 on top.
    let c = layout.crossings.iter().find(|c| c.plus == 2 && c.m == 1).copied().expect("in the cell");
    let inward = if c.plus_on_top { -0.2 } else { 0.2 };
    let f = layout.tows[2].filaments.start + 3;
    for p in &mut traces[f].points[12..20] {
        *p += DVec3::new(p.x, p.y, 0.0).normalize() * inward;
    }
    let found = passages(&layout, &traces, period);
    assert_eq!(found.len(), 7, "through all seven of the other tow");
    assert!(found.iter().all(|p| p.crossing == c && p.plus == 3));
    // A wave sideways is no passage.
    let mut traces = initial_traces(&model);
    for (i, p) in traces[f].points[12..20].iter_mut().enumerate() {
        let sideways = DVec3::new(-p.y, p.x, 0.0).normalize();
        *p += sideways * (0.15 * (i as f64 * 1.7).sin());
    }
    assert_eq!(passages(&layout, &traces, period), []);
}

#[test]
fn the_seed_decides_and_nothing_else() {
    let tow = TowSpec { perturbation: 0.01, ..tow_spec() };
    let points = |seed| {
        let (model, _) = braided(&braid_spec(), &tow, seed);
        model.nodes.iter().map(|n| n.position).collect::<Vec<_>>()
    };
    let (a, b) = (points(7), points(7));
    assert!(a.iter().zip(&b).all(|(x, y)| x.to_array().map(f64::to_bits) == y.to_array().map(f64::to_bits)));
    let c = points(8);
    assert!(a.iter().zip(&c).filter(|(x, y)| x != y).count() > a.len() - 2, "all but the dummy node move");
    let calm: Vec<DVec3> = braided(&braid_spec(), &tow_spec(), 7).0.nodes.iter().map(|n| n.position).collect();
    let radius = tow.radii().contact;
    let largest = a.iter().zip(&calm).map(|(x, y)| x.distance(*y)).fold(0.0, f64::max);
    assert!(largest < 0.01 * radius && largest > 0.0099 * radius, "{}", largest / radius);
}

#[test]
fn another_unit_of_length_scales_the_braid() {
    let (mm, _) = braided(&braid_spec(), &tow_spec(), 1);
    let spec = BraidSpec { undulation: Some(Length(31.0)), ..BraidSpec::new(3000.0) };
    let (um, layout) = braided(&spec, &TowSpec::new(2.5, "glass"), 1);
    for (a, b) in mm.nodes.iter().zip(&um.nodes) {
        assert!((a.position * 1000.0 - b.position).length() < 1e-9);
    }
    let m = initial_measures(&um, &layout);
    let (model, layout) = braided(&braid_spec(), &tow_spec(), 1);
    let reference = initial_measures(&model, &layout);
    assert!((m.angle.mean - reference.angle.mean).abs() < 1e-10);
    assert!((m.thickness.mean / 1000.0 - reference.thickness.mean).abs() < 1e-10);
}

#[test]
fn closed_form_of_the_free_helix_gives_the_published_lengths() {
    // Lengths of the smooth, stress-free helix of arc 3.836 mm under a force, before the mandrel.
    let (_, beams) = braided(&braid_spec(), &TowSpec { model: FilamentModel::Beams, ..tow_spec() }, 1);
    let (_, sum) = braided(&braid_spec(), &TowSpec { bending: Some(Bending::SumOfFilaments), ..tow_spec() }, 1);
    let start = 3.836 * 55f64.to_radians().cos();
    let smooth = |l: BraidLayout| BraidLayout {
        arc_length: 3.836,
        cell_length: start,
        geometry: BraidGeometry { pitch: 6.0 * start, ..l.geometry },
        ..l
    };
    let (beams, sum) = (smooth(beams), smooth(sum));
    for (layout, length, force) in [(&beams, 2.6304, 0.5e-3), (&beams, 2.9220, 1e-3), (&beams, 3.2692, 2e-3), (&sum, 3.0997, 0.1e-3)] {
        // Lengths are given to 5e-5 mm; the force may miss by that times its slope.
        let slope = (layout.helix_force(length + 1e-4) - layout.helix_force(length - 1e-4)) / 2e-4;
        assert!((layout.helix_force(length) - force).abs() < 6e-5 * slope, "{length}: {}", layout.helix_force(length));
    }
    assert!(beams.helix_force(start).abs() < 1e-18);
}

#[test]
fn filaments_are_made_of_the_named_elements() {
    for (model, truss, beam) in
        [(FilamentModel::Trusses, 2604, 0), (FilamentModel::Beams, 0, 2604), (FilamentModel::Custom("truss".into()), 2604, 0)]
    {
        let (built, _) = braided(&braid_spec(), &TowSpec { model, ..tow_spec() }, 1);
        assert_eq!((count(&built, "truss"), count(&built, "beam")), (truss, beam));
        assert!(built.ties.is_empty());
    }
    let custom = TowSpec { model: FilamentModel::Custom("trus".into()), ..tow_spec() };
    let error = in_model(|r, b| braid(&braid_spec(), &custom, 1, r, b)).map(|_| ()).expect_err("no such element");
    assert_eq!((error.path.as_str(), error.message.as_str()), ("tow.model", "unknown element `trus`"));
    assert!(error.help.expect("help").starts_with("did you mean `truss`?"));
}

#[test]
fn what_makes_no_sense_is_refused_by_field() {
    let wrong = |tow: TowSpec| in_model(|r, b| braid(&braid_spec(), &tow, 1, r, b)).map(|_| ()).expect_err("wrong").path;
    assert_eq!(wrong(TowSpec { material: "gloss".into(), ..tow_spec() }), "tow.material");
    assert_eq!(wrong(TowSpec { filaments: 0, ..tow_spec() }), "tow.filaments");
    assert_eq!(wrong(TowSpec { elements: 0, ..tow_spec() }), "tow.elements");
    assert_eq!(wrong(TowSpec { filament_radius: Length(f64::NAN), ..tow_spec() }), "tow.filament_radius");
    assert_eq!(wrong(TowSpec { gap: 0.9, ..tow_spec() }), "tow.gap");
    assert_eq!(wrong(TowSpec { perturbation: -0.1, ..tow_spec() }), "tow.perturbation");
    assert_eq!(wrong(TowSpec { filament_radius: Length(1.0), ..tow_spec() }), "braid.radius");
    let two = in_model(|r, b| {
        bundle(&BundleSpec::new(1.0, 10.0, 4, "glass"), 0, r, b)?;
        bundle(&BundleSpec::new(1.0, 10.0, 4, "glass"), 0, r, b)
    });
    assert!(two.map(|_| ()).expect_err("same name twice").message.contains("bundle.0.start"));
    let polyline_error =
        |points: &[[f64; 3]]| in_model(|r, b| polyline(&PolylineSpec::new(points, 2, 0.1, "glass"), r, b)).map(|_| ()).expect_err("wrong");
    assert_eq!(polyline_error(&[[0.0; 3]]).path, "polyline.points");
    let same = polyline_error(&[[0.0; 3], [1.0, 0.0, 0.0], [1.0, 0.0, 0.0]]);
    assert!(same.message.contains("zero-length element"), "{same}");
    assert_eq!(polyline_error(&[[0.0; 3], [f64::INFINITY, 0.0, 0.0]]).path, "polyline.points[1]");
}

#[test]
fn six_wires_touch_the_core_of_a_strand() {
    let spec = StrandSpec {
        end: EndCondition::Held(vec![Dof::Ux, Dof::Uy]),
        start: EndCondition::Clamped,
        ..StrandSpec::new(1.97, 1.865, 115.0, 40, "glass")
    };
    let (model, made) = in_model(|r, b| strand(&spec, r, b)).expect("valid strand");
    assert_eq!((model.filaments.len(), made.starts.len(), made.ends.len()), (7, 7, 7));
    let core = &model.filaments[0];
    for (k, f) in model.filaments.iter().enumerate().skip(1) {
        for (a, b) in core.nodes.iter().zip(&f.nodes) {
            let gap = position(&model, *a).distance(position(&model, *b)) - core.radius - f.radius;
            assert!(gap.abs() < 1e-12, "wire {k} touches the core at every node");
        }
        let length: f64 = f.nodes.windows(2).map(|w| position(&model, w[0]).distance(position(&model, w[1]))).sum();
        assert!((length * spec.lay_angle().cos() / 115.0 - 1.0).abs() < 1e-4);
    }
    assert_eq!(model.node_names["strand.0.end"], *core.nodes.last().expect("nodes"));
    assert_eq!(model.fixed.len(), 14);
    assert_eq!(model.fixed[0].dofs.len(), 6);
    assert_eq!(model.fixed[7].dofs, [Dof::Ux, Dof::Uy]);
    assert!(model.filaments.iter().map(|f| f.tow).eq(0..7));
}

#[test]
fn an_endless_strand_hands_every_wire_to_the_next() {
    let spec = StrandSpec { periodic: true, hand: Hand::Left, ..StrandSpec::new(1.97, 1.865, 115.0, 10, "glass") };
    let (model, made) = in_model(|r, b| strand(&spec, r, b)).expect("valid strand");
    let dummy = made.dummy.expect("periodic");
    assert!((position(&model, dummy).z - 115.0 / 6.0).abs() < 1e-12);
    assert_eq!(model.node_names["strand.period"], dummy);
    for (k, p) in model.periodic.iter().enumerate() {
        let into = model.filaments.iter().position(|f| f.nodes[0] == p.node).expect("a start");
        assert_eq!(into, if k == 0 { 0 } else { 1 + k % 6 });
        // The image is where the helix would have gone on.
        let image = position(&model, p.image);
        assert!((image.truncate().length() - if k == 0 { 0.0 } else { spec.helix_radius() }).abs() < 1e-12);
        let before = position(&model, model.filaments[k].nodes[9]);
        let first = position(&model, model.filaments[k].nodes[0]).distance(position(&model, model.filaments[k].nodes[1]));
        assert!((before.distance(image) - first).abs() < 1e-9);
    }
    let open = StrandSpec { length: Some(Length(100.0)), ..spec };
    assert_eq!(in_model(|r, b| strand(&open, r, b)).map(|_| ()).expect_err("does not close").path, "strand.length");
}

#[test]
fn bundles_lie_along_any_axis_and_may_be_twisted() {
    let straight = BundleSpec {
        start: EndCondition::Pinned,
        axis: [1.0, 0.0, 0.0],
        origin: [Length(1.0), Length(2.0), Length(3.0)],
        ..BundleSpec::new(0.5, 20.0, 8, "glass")
    };
    let (model, made) = in_model(|r, b| bundle(&straight, 0, r, b)).expect("valid bundle");
    assert_eq!((model.filaments.len(), model.filaments[0].nodes.len()), (7, 9));
    for f in &model.filaments {
        let (a, b) = (position(&model, f.nodes[0]), position(&model, f.nodes[8]));
        assert!((b - a - DVec3::X * 20.0).length() < 1e-12);
        assert!((a.x - 1.0).abs() < 1e-12 && f.radius == 0.5);
    }
    let centre: DVec3 = made.starts.iter().map(|n| position(&model, *n)).sum::<DVec3>() / 7.0;
    assert!((centre - DVec3::new(1.0, 2.0, 3.0)).length() < 1e-12);
    assert!((made.mass / (7.0 * std::f64::consts::PI * 0.25 * 20.0 * 2.58e-9) - 1.0).abs() < 1e-12);
    assert_eq!(model.fixed.len(), 7);

    let twisted = BundleSpec { pitch: Some(Length(40.0)), ..BundleSpec::new(0.5, 20.0, 8, "glass") };
    let (model, made) = in_model(|r, b| bundle(&twisted, 0, r, b)).expect("valid bundle");
    for (s, e) in made.starts.iter().zip(&made.ends) {
        let (a, b) = (position(&model, *s), position(&model, *e));
        assert!((a.truncate() + b.truncate()).length() < 1e-12, "half a turn over half a pitch");
    }
    let endless = BundleSpec { periodic: true, ..straight };
    let (model, made) = in_model(|r, b| bundle(&endless, 0, r, b)).expect("valid bundle");
    assert!((position(&model, made.dummy.expect("periodic")) - DVec3::X * 20.0).length() < 1e-12);
    assert!(model.periodic.iter().zip(&model.filaments).all(|(p, f)| p.node == f.nodes[0] && p.image == f.nodes[8]));
}

#[test]
fn polylines_are_divided_and_may_be_closed() {
    let corners = [[0.0, 0.0, 0.0], [3.0, 0.0, 0.0], [3.0, 4.0, 0.0]];
    let (model, made) = in_model(|r, b| polyline(&PolylineSpec::new(&corners, 3, 0.1, "glass"), r, b)).expect("valid");
    let f = &model.filaments[0];
    assert_eq!(f.nodes.len(), 7);
    assert!(!f.closed);
    assert!((position(&model, f.nodes[1]) - DVec3::X).length() < 1e-15);
    assert!((made.mass / (7.0 * std::f64::consts::PI * 0.01 * 2.58e-9) - 1.0).abs() < 1e-12);
    let ring = PolylineSpec { closed: true, ..PolylineSpec::new(&corners, 3, 0.1, "glass") };
    let (model, made) = in_model(|r, b| polyline(&ring, r, b)).expect("valid");
    let f = &model.filaments[0];
    assert_eq!((model.nodes.len(), f.nodes.len(), count(&model, "beam")), (9, 10, 9));
    assert_eq!(f.nodes[0], f.nodes[9], "the last node is the first one");
    assert!(f.closed);
    assert!((made.mass / (12.0 * std::f64::consts::PI * 0.01 * 2.58e-9) - 1.0).abs() < 1e-12);
}

#[test]
fn a_scene_writes_vectors_in_square_brackets() {
    let read = |text: &str| braid_ecs::scene::ron_options().from_str::<BundleSpec>(text);
    let spec =
        read(r#"(radius: "5 um", length: 2, elements: 4, material: "glass", origin: [0, "1 mm", 2.5], axis: [0, 1, 0])"#).expect("valid");
    assert_eq!((spec.radius, spec.origin, spec.axis), (Length(0.005), [0.0, 1.0, 2.5].map(Length), [0.0, 1.0, 0.0]));
    let text = ron::to_string(&spec).expect("writes");
    assert_eq!(read(&text).expect("reads back"), spec);
    let line: PolylineSpec =
        braid_ecs::scene::ron_options().from_str(r#"(points: [[0, 0, 0], [1, 2, 3]], radius: 0.1, material: "glass")"#).expect("valid");
    assert_eq!(line, PolylineSpec::new(&[[0.0; 3], [1.0, 2.0, 3.0]], 1, 0.1, "glass"));
}
