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
    /// K / L in initial global axes (force x length).
    pub bending: DMat3,
    /// S in initial global axes (force x length).
    pub chord: DMat3,
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
            let mut beam = Beam::new(chord.length(), [a1, a2, a1.cross(a2)], &chain.section);
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
        let k = Kinematics::of(&nodes);
        let moment = self.bending * (k.phi - self.phi0);
        let g = self.chord * (k.c - self.c0);
        let n = self.ea * (k.l / self.rest_length - 1.0);
        // B M = M along phi, scaled across it: with s = sin(t/2) n = vec(r) and phi = b s,
        // b = (t/2) / sin(t/2) x 2 / 2; the projector uses s itself.
        let along = if k.s2 > 0.0 { k.s * (k.s.dot(moment) / k.s2) } else { DVec3::ZERO };
        let bm = along + (moment - along) * k.b;
        let mu = g.cross(k.c);
        let relative = bm - mu.cross(k.h) * 0.5;
        let half = mu * 0.5;
        let (m1, m2) = (k.mid * (half - relative), k.mid * (half + relative));
        let shear = k.mid * g;
        let f = k.e * n + (shear - k.e * k.e.dot(shear)) / k.l;
        [Wrench { force: -f, moment: m1 }, Wrench { force: f, moment: m2 }]
    }

    fn strain_energy(&self, nodes: [NodeState; 2]) -> f64 {
        let k = Kinematics::of(&nodes);
        let (p, d, strain) = (k.phi - self.phi0, k.c - self.c0, k.l / self.rest_length - 1.0);
        0.5 * (p.dot(self.bending * p) + d.dot(self.chord * d) + self.ea * self.rest_length * strain * strain)
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
        let k = Kinematics::of(&nodes);
        let moment = self.bending * (k.phi - self.phi0);
        let shear = self.chord * (k.c - self.c0) / k.l;
        let axis = k.c;
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

impl Beam {
    fn new(rest_length: f64, axes: [DVec3; 3], section: &Section) -> Self {
        let outer = |a: DVec3, k: f64| DMat3::from_cols(a * (a.x * k), a * (a.y * k), a * (a.z * k));
        let [a1, a2, a3] = axes;
        let l = rest_length;
        let shear = |ei: f64| 12.0 * ei / l / (1.0 + 12.0 * ei / (section.ga * l * l));
        Beam {
            rest_length,
            ea: section.ea,
            full_ea: section.ea,
            bending: outer(a1, section.gj / l) + outer(a2, section.ei[0] / l) + outer(a3, section.ei[1] / l),
            // A chord that leans towards a2 bends the beam about a3, and the other way round.
            chord: outer(a2, shear(section.ei[1])) + outer(a3, shear(section.ei[0])),
            phi0: DVec3::ZERO,
            c0: a1,
            stiffest: [section.ei[0].max(section.ei[1]), section.gj, shear(section.ei[0]).max(shear(section.ei[1])) * l / 12.0],
            mass: section.mass,
            polar: section.inertia,
        }
    }
}

/// What the energy depends on.
struct Kinematics {
    /// Unit chord, and its length.
    e: DVec3,
    l: f64,
    /// Vector part of q1^-1 q2, that is sin(t/2) n, and its square.
    s: DVec3,
    s2: f64,
    /// (t/2) / sin(t/2).
    b: f64,
    /// Relative rotation vector.
    phi: DVec3,
    /// tan(t/4) n.
    h: DVec3,
    /// Mid rotation.
    mid: DMat3,
    /// Chord seen from the mid rotation.
    c: DVec3,
}

impl Kinematics {
    #[inline]
    fn of(nodes: &[NodeState; 2]) -> Self {
        let d = nodes[1].x - nodes[0].x;
        let l = d.length();
        let e = d / l;
        let (q1, mut q2) = (nodes[0].q, nodes[1].q);
        if q1.dot(q2) < 0.0 {
            q2 = -q2;
        }
        let r = q1.conjugate() * q2;
        let s = r.xyz();
        let s2 = s.length_squared();
        // t/2 = asin(|s|) on the branch where the scalar part is not negative.
        let b = half_angle_over_sine(s2, r.w);
        let mid = DMat3::from_quat((q1 + q2).normalize());
        Kinematics { e, l, s, s2, b, phi: s * (2.0 * b), h: s / (1.0 + r.w), mid, c: mid.transpose() * e }
    }
}

/// (t/2) / sin(t/2) from sin^2(t/2) and cos(t/2): a series where the quotient loses digits.
#[inline]
fn half_angle_over_sine(s2: f64, w: f64) -> f64 {
    if s2 < 0.01 {
        // asin(s)/s; the first term left out is below 1e-17.
        1.0 + s2
            * (1.0 / 6.0
                + s2 * (3.0 / 40.0
                    + s2 * (15.0 / 336.0
                        + s2 * (105.0 / 3456.0 + s2 * (945.0 / 42240.0 + s2 * (10395.0 / 599040.0 + s2 * (135135.0 / 9676800.0)))))))
    } else {
        let s = s2.sqrt();
        s.atan2(w) / s
    }
}
