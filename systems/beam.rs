//! Two-node beam in space: large displacements and rotations, bending and torsion, arbitrary
//! stress-free curvature and twist.
//!
//! Corotational Bernoulli-Euler element with a mid-rotation frame. q1, q2 are the rotations of the
//! end sections from the initial configuration, e the unit chord, l its length. With the relative
//! rotation vector phi = log(q1^-1 q2), the mid rotation R (half way from q1 to q2) and the chord
//! seen from it, c = R^-1 e, the energy is
//!
//! E = 1/2 (phi - phi0) . K (phi - phi0) / L + 1/2 (c - c0) . S (c - c0) + EA L (l/L - 1)^2 / 2
//!
//! K = GJ a1 a1 + EI2 a2 a2 + EI3 a3 a3 in the initial section axes a1 (chord), a2, a3, and
//! S = (12 / L)(EI3 a2 a2 / (1 + s3) + EI2 a3 a3 / (1 + s2)), s = 12 EI / (GA L^2), zero without shear. For
//! small rotations this is exactly the cubic beam (theta_1 = -phi/2 - beta, theta_2 = phi/2 - beta
//! gives EI/L (2 theta_1^2 + 2 theta_1 theta_2 + 2 theta_2^2)); constant curvature is exact for
//! any rotation below pi per element. Forces and moments are the exact gradient of E:
//!
//! * phi' = B (w2 - w1), B = 1 along phi and (t/2)/sin(t/2) across it, t = |phi|, spins w in the mid frame;
//! * mid spin w = (w1 + w2)/2 - h x (w2 - w1)/2, h = tan(t/4) phi/t.
//!
//! Both follow from the tangent map of the exponential; M. A. Crisfield, *Comput. Methods Appl.
//! Mech. Engrg.* 81 (1990) 131-150 for the corotational idea, J. M. Battini and C. Pacoste, ibid.
//! 191 (2002) 1755-1789 for the mid frame.
//!
//! The stiffest motion of a mesh of slender beams is the zigzag of its nodes, which S alone resists: it limits the time step,
//! and says nothing about a deflection that the mesh resolves. A scene may give S a least flexibility s (key
//! `shear_flexibility`): the step grows with sqrt(1 + s), and a cantilever of N elements bends by the share s / (4 N^2)
//! more, as one with GA = 12 EI / (s L^2): an error of second order in the length of the elements.
use braid_ecs::prelude::*;
use braid_ecs::scene::units::Ratio;

/// Registers the beam.
pub fn plugin(sim: &mut Simulation) {
    sim.add_element::<Beam, 2>();
}

/// State of one beam element.
#[derive(Component, Clone, Copy, Debug, Serialize, Deserialize)]
pub struct Beam {
    /// Rest length L (length).
    pub rest_length: f64,
    /// Axial stiffness EA (force); zero after the implicit scheme has taken it over.
    pub ea: f64,
    /// EA of the section, kept for output (force).
    pub full_ea: f64,
    /// K / L and S in initial global axes (force x length): xx, yy, zz, yz, zx, xy of each.
    pub stiffness: [[f64; 6]; 2],
    /// Stress-free relative rotation phi0 in initial global axes (radian).
    pub phi0: DVec3,
    /// Stress-free chord c0 in initial global axes.
    pub c0: DVec3,
    /// Largest EI, GJ, and largest EI / (1 + s), for the time step (force x length^2).
    pub stiffest: [f64; 3],
    /// Mass per unit rest length (mass / length).
    pub mass: f64,
    /// Polar mass moment per unit length (mass x length).
    pub polar: f64,
}

/// One entry of `elements: { "beam": [...] }`.
#[derive(Deserialize, Clone, Debug)]
#[serde(deny_unknown_fields)]
pub struct BeamSpec {
    /// Nodes in order; one element between each and the next.
    pub nodes: Vec<NodeId>,
    /// Name of the section.
    pub section: String,
    /// Direction of the second section axis, for sections with two bending stiffnesses.
    #[serde(default, with = "braid_ecs::scene::units::list_option")]
    pub orientation: Option<[Ratio; 3]>,
    /// Stress-free shape: `AsBuilt` (default) or `Straight(twist: 0)`.
    #[serde(default)]
    pub natural: NaturalShape,
    /// True if the last node is joined to the first by one more element.
    #[serde(default)]
    pub closed: bool,
}

impl Element<2> for Beam {
    const NAME: &'static str = "beam";
    const ABOUT: &'static str = "two-node corotational Bernoulli beam: axial force, bending and torsion, stress-free in any initial shape";
    type Force = Wrench;
    type Spec = BeamSpec;

    fn read(spec: BeamSpec, build: &mut Build<'_>) -> Result<(), SpecError> {
        if spec.nodes.len() < 2 {
            return Err(SpecError::new("nodes", format!("a beam joins at least two nodes, {} given", spec.nodes.len())));
        }
        build.check_nodes("nodes", &spec.nodes)?;
        let section = build.section("section", &spec.section)?;
        let orientation = spec.orientation.map(|o| DVec3::from_array(o.map(f64::from)));
        Beam::along(&Chain { nodes: spec.nodes, section, natural: spec.natural, orientation, closed: spec.closed }, build)
    }

    fn along(chain: &Chain, build: &mut Build<'_>) -> Result<(), SpecError> {
        let position = |n: NodeId| build.model.nodes[n.row()].position;
        let segments = chain.segments();
        let chords: Vec<DVec3> = segments.iter().map(|[a, b]| position(*b) - position(*a)).collect();
        let mut elements = Vec::with_capacity(segments.len());
        for (i, chord) in chords.iter().enumerate() {
            let a1 = chord.normalize();
            let a2 = match chain.orientation {
                Some(d) => {
                    let across = d - a1 * a1.dot(d);
                    if d.length() == 0.0 || across.length() < 1e-6 * d.length() {
                        return Err(SpecError::new(
                            "orientation",
                            format!("orientation [{}, {}, {}] is parallel to the beam axis of element {i}", d.x, d.y, d.z),
                        )
                        .help("it gives the second section axis and must point across the beam"));
                    }
                    across.normalize()
                }
                None => a1.any_orthonormal_vector(),
            };
            let mut beam = Beam::new(chord.length(), [a1, a2, a1.cross(a2)], &chain.section, build.model.integration.shear_flexibility);
            if let NaturalShape::Straight { twist } = chain.natural {
                // Turning of the tangent over this element in the initial shape, from the chords
                // before and after it; at a free end from the one neighbour.
                let n = chords.len();
                let before = if i > 0 {
                    Some(chords[i - 1])
                } else if chain.closed {
                    Some(chords[n - 1])
                } else {
                    None
                };
                let after = if i + 1 < n {
                    Some(chords[i + 1])
                } else if chain.closed {
                    Some(chords[0])
                } else {
                    None
                };
                let turn = |a: DVec3, b: DVec3| DQuat::from_rotation_arc(a.normalize(), b.normalize()).to_scaled_axis();
                let total = match (before, after) {
                    (Some(p), Some(q)) => (turn(p, *chord) + turn(*chord, q)) * 0.5,
                    (Some(p), None) => turn(p, *chord),
                    (None, Some(q)) => turn(*chord, q),
                    (None, None) => DVec3::ZERO,
                };
                beam.phi0 = -total - a1 * (twist * beam.rest_length);
            }
            elements.push(beam);
        }
        for (beam, pair) in elements.into_iter().zip(segments) {
            build.model.add_element(beam, pair);
        }
        Ok(())
    }

    #[inline]
    fn internal_force(&mut self, nodes: [NodeState; 2]) -> [Wrench; 2] {
        alone(self, nodes)
    }

    #[inline]
    fn internal_forces(elements: &mut [Self], rows: &[Connectivity<2>], nodes: impl NodeColumns, out: &mut [EndForces<Self, 2>]) {
        in_lanes(elements, rows, nodes, out);
    }

    fn strain_energy(&self, nodes: [NodeState; 2]) -> f64 {
        let k = Kinematics::<f64>::of(&[in_order()], &nodes[..]);
        let section = Stiffness::<f64>::of(std::slice::from_ref(self));
        let (p, d, strain) = (k.phi - section.phi0, k.c - section.c0, k.l / self.rest_length - 1.0);
        let [bending, chord] = [section.bending.times(p), section.chord.times(d)];
        0.5 * (p.dot(bending) + d.dot(chord) + self.ea * self.rest_length * strain * strain)
    }

    fn stiffness_bound(&self, nodes: [NodeState; 2], masses: [NodeMass; 2]) -> [StiffnessBound; 2] {
        // Across the axis the stiffest mode has w = (u, -u), theta = (p, p) and energy
        // EI/L^3 (sqrt(24) u + sqrt(6) L p)^2 / 2 (rank one), the other 2 EI/L p^2 / 2. Young's
        // inequality with the ratio s of the two inertias splits it into displacement and rotation.
        let l = (nodes[1].x - nodes[0].x).length().min(self.rest_length);
        let tension = (self.full_ea * (l / self.rest_length - 1.0)).max(0.0);
        let [ei, gj, sheared] = self.stiffest;
        masses.map(|m| {
            let (kt, kr) = (24.0 * sheared / l.powi(3), 6.0 * sheared / l);
            let s = if m.mass > 0.0 && m.inertia > 0.0 && kt > 0.0 { (kr / m.inertia) / (kt / m.mass) } else { 1.0 };
            let axial = 2.0 * self.ea / self.rest_length;
            StiffnessBound {
                translation: axial.max((1.0 + s) * kt + 2.0 * tension / l),
                rotation: (2.0 * gj / l).max((1.0 + 1.0 / s) * kr).max(2.0 * ei / l),
            }
        })
    }

    fn mass(&self) -> [NodeMass; 2] {
        [NodeMass { mass: 0.5 * self.mass * self.rest_length, inertia: 0.5 * self.polar * self.rest_length }; 2]
    }

    fn inertia_length(&self) -> f64 {
        self.rest_length
    }

    fn axial_spring(&self) -> Option<AxialSpring> {
        (self.ea > 0.0).then_some(AxialSpring { rest_length: self.rest_length, ea: self.ea })
    }

    fn release_axial(&mut self) {
        self.ea = 0.0;
    }

    fn section_force(&self, nodes: [NodeState; 2]) -> SectionForce {
        let k = Kinematics::<f64>::of(&[in_order()], &nodes[..]);
        let section = Stiffness::<f64>::of(std::slice::from_ref(self));
        let moment = section.bending.times(k.phi - section.phi0).lane(0);
        let shear = section.chord.times(k.c - section.c0).lane(0) / k.l;
        let axis = k.c.lane(0);
        let torsion = moment.dot(axis);
        let bending = moment - axis * torsion;
        // The end moments differ from the mean by half the shear force times the length.
        let arm = axis.cross(shear) * (0.5 * k.l);
        SectionForce {
            axial: self.full_ea * (k.l / self.rest_length - 1.0),
            shear: shear.length(),
            bending: (bending + arm).length().max((bending - arm).length()),
            torsion,
        }
    }
}

impl LaneElement<2> for Beam {
    #[inline(always)]
    fn at_once<L: Lane>(beams: &[Self], rows: &[Connectivity<2>], nodes: impl NodeColumns, out: &mut [EndForces<Self, 2>]) {
        let (zero, half) = (L::splat(0.0), L::splat(0.5));
        let k = Kinematics::<L>::of(rows, nodes);
        let section = Stiffness::<L>::of(beams);
        let moment = section.bending.times(k.phi - section.phi0);
        let g = section.chord.times(k.c - section.c0);
        let n = section.ea * (k.l / section.rest_length - L::splat(1.0));
        // B M = M along phi, scaled across it; the projector uses s = sin(t/2) n.
        let turned = zero.less(k.s2);
        let share = L::pick(turned, k.s.dot(moment) / L::pick(turned, k.s2, L::splat(1.0)), zero);
        let along = k.s * share;
        let bm = along + (moment - along) * k.b;
        let mu = g.cross(k.c);
        let relative = bm - mu.cross(k.h) * half;
        let mean = mu * half;
        let (m1, m2) = (k.global(mean - relative), k.global(mean + relative));
        let shear = k.global(g);
        let f = k.e * n + (shear - k.e * k.e.dot(shear)) * (L::splat(1.0) / k.l);
        f.each(|l, f| (out[l].0[0].force, out[l].0[1].force) = (-f, f));
        m1.each(|l, m| out[l].0[0].moment = m);
        m2.each(|l, m| out[l].0[1].moment = m);
    }
}

impl Beam {
    fn new(rest_length: f64, axes: [DVec3; 3], section: &Section, flexibility: f64) -> Self {
        let outer = |a: DVec3, k: f64| [a.x * a.x, a.y * a.y, a.z * a.z, a.y * a.z, a.z * a.x, a.x * a.y].map(|p| p * k);
        let sum = |parts: &[[f64; 6]]| std::array::from_fn(|i| parts.iter().map(|p| p[i]).sum());
        let [a1, a2, a3] = axes;
        let l = rest_length;
        let shear = |ei: f64| 12.0 * ei / l / (1.0 + flexibility.max(12.0 * ei / (section.ga * l * l)));
        Beam {
            rest_length,
            ea: section.ea,
            full_ea: section.ea,
            stiffness: [
                sum(&[outer(a1, section.gj / l), outer(a2, section.ei[0] / l), outer(a3, section.ei[1] / l)]),
                // A chord that leans towards a2 bends the beam about a3, and the other way round.
                sum(&[outer(a2, shear(section.ei[1])), outer(a3, shear(section.ei[0]))]),
            ],
            phi0: DVec3::ZERO,
            c0: a1,
            stiffest: [section.ei[0].max(section.ei[1]), section.gj, shear(section.ei[0]).max(shear(section.ei[1])) * l / 12.0],
            mass: section.mass,
            polar: section.inertia,
        }
    }
}

/// A symmetric matrix: xx, yy, zz, yz, zx, xy.
#[derive(Clone, Copy)]
struct Symmetric<L>([L; 6]);

impl<L: Lane> Symmetric<L> {
    #[inline(always)]
    fn times(&self, v: V3<L>) -> V3<L> {
        let [xx, yy, zz, yz, zx, xy] = self.0;
        V3::new(xx * v.x + xy * v.y + zx * v.z, xy * v.x + yy * v.y + yz * v.z, zx * v.x + yz * v.y + zz * v.z)
    }
}

/// Stiffness and stress-free shape of `L::WIDTH` beams.
struct Stiffness<L> {
    bending: Symmetric<L>,
    chord: Symmetric<L>,
    phi0: V3<L>,
    c0: V3<L>,
    ea: L,
    rest_length: L,
}

impl<L: Lane> Stiffness<L> {
    #[inline(always)]
    fn of(beams: &[Beam]) -> Self {
        let [xx, yy, zz, yz] = L::rows(|l| std::array::from_fn(|i| beams[l].stiffness[0][i]));
        let [zx, xy, cxx, cyy] =
            L::rows(|l| [beams[l].stiffness[0][4], beams[l].stiffness[0][5], beams[l].stiffness[1][0], beams[l].stiffness[1][1]]);
        let [czz, cyz, czx, cxy] = L::rows(|l| std::array::from_fn(|i| beams[l].stiffness[1][2 + i]));
        let [px, py, pz, ea] = L::rows(|l| [beams[l].phi0.x, beams[l].phi0.y, beams[l].phi0.z, beams[l].ea]);
        let [cx, cy, cz, rest_length] = L::rows(|l| [beams[l].c0.x, beams[l].c0.y, beams[l].c0.z, beams[l].rest_length]);
        Stiffness {
            bending: Symmetric([xx, yy, zz, yz, zx, xy]),
            chord: Symmetric([cxx, cyy, czz, cyz, czx, cxy]),
            phi0: V3::new(px, py, pz),
            c0: V3::new(cx, cy, cz),
            ea,
            rest_length,
        }
    }
}

/// What the energy depends on.
struct Kinematics<L> {
    /// Unit chord, and its length.
    e: V3<L>,
    l: L,
    /// Vector part of q1^-1 q2, that is sin(t/2) n, and its square.
    s: V3<L>,
    s2: L,
    /// (t/2) / sin(t/2).
    b: L,
    /// Relative rotation vector.
    phi: V3<L>,
    /// tan(t/4) n.
    h: V3<L>,
    /// Rows of the mid rotation.
    mid: [V3<L>; 3],
    /// Chord seen from the mid rotation.
    c: V3<L>,
}

impl<L: Lane> Kinematics<L> {
    /// Of `L::WIDTH` beams.
    #[inline(always)]
    fn of(rows: &[Connectivity<2>], nodes: impl NodeColumns) -> Self {
        let (one, two) = (L::splat(1.0), L::splat(2.0));
        let d = V3::<L>::gather(|l| nodes.x(rows[l].0[1]) - nodes.x(rows[l].0[0]));
        let q = [0, 1].map(|end| L::rows(|l| nodes.q(rows[l].0[end]).to_array()));
        let l = d.dot(d).sqrt();
        let e = d * (one / l);
        let [x1, y1, z1, w1] = q[0];
        let [x2, y2, z2, w2] = q[1];
        // Of the two quaternions of a rotation, the one on the side of the other end.
        let opposite = (x1 * x2 + y1 * y2 + z1 * z2 + w1 * w2).less(L::splat(0.0));
        let sign = L::pick(opposite, -one, one);
        let (u1, u2, w2) = (V3::new(x1, y1, z1), V3::new(x2, y2, z2) * sign, w2 * sign);
        let w = w1 * w2 + u1.dot(u2);
        let s = u2 * w1 - u1 * w2 - u1.cross(u2);
        let s2 = s.dot(s);
        let b = half_angle_over_sine(s2, w);
        let (u, v) = (u1 + u2, w1 + w2);
        // With n = 2 / |q|^2 a quaternion need not have length one.
        let n = two / (u.dot(u) + v * v);
        let (xx, yy, zz) = (u.x * u.x * n, u.y * u.y * n, u.z * u.z * n);
        let (xy, yz, zx) = (u.x * u.y * n, u.y * u.z * n, u.z * u.x * n);
        let (wx, wy, wz) = (v * u.x * n, v * u.y * n, v * u.z * n);
        let mid =
            [V3::new(one - yy - zz, xy - wz, zx + wy), V3::new(xy + wz, one - xx - zz, yz - wx), V3::new(zx - wy, yz + wx, one - xx - yy)];
        let c = mid[0] * e.x + mid[1] * e.y + mid[2] * e.z;
        Kinematics { e, l, s, s2, b, phi: s * (two * b), h: s * (one / (one + w)), mid, c }
    }

    /// A vector of the mid frame in global axes.
    #[inline(always)]
    fn global(&self, v: V3<L>) -> V3<L> {
        V3::new(self.mid[0].dot(v), self.mid[1].dot(v), self.mid[2].dot(v))
    }
}

/// (t/2) / sin(t/2) from sin^2(t/2) and cos(t/2): a series where the quotient loses digits.
#[inline(always)]
fn half_angle_over_sine<L: Lane>(s2: L, w: L) -> L {
    // asin(s)/s; the first term left out is below 1e-17 up to s^2 = 0.01.
    const SERIES: [f64; 8] =
        [135135.0 / 9676800.0, 10395.0 / 599040.0, 945.0 / 42240.0, 105.0 / 3456.0, 15.0 / 336.0, 3.0 / 40.0, 1.0 / 6.0, 1.0];
    let small = s2.less(L::splat(0.01));
    let series = SERIES.iter().fold(L::splat(0.0), |sum, c| sum * s2 + L::splat(*c));
    if !L::any(L::splat(0.01 - f64::EPSILON).less(s2)) {
        return series;
    }
    let exact = L::from_fn(|lane| {
        let s = s2.lane(lane).sqrt();
        s.atan2(w.lane(lane)) / s
    });
    L::pick(small, series, exact)
}
