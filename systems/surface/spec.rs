//! What a scene says about rigid surfaces.
use crate::systems::contact::{ContactSpec, InitialOverlap, bounded, positive};
use braid_ecs::prelude::*;
use braid_ecs::scene::units::{Angle, Length, Point, Ratio, Stiffness, StiffnessPerLength};

/// All rigid surfaces of a model.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Surfaces(pub Vec<SurfaceSpec>);

/// The mandrel of a braid: one more rigid surface, with a key of its own.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Mandrel(pub SurfaceSpec);

impl Settings for Surfaces {
    const KEY: &'static str = "surfaces";
    const ABOUT: &'static str = "rigid surfaces that filaments lie on, with friction";

    fn check(&mut self, build: &mut Build<'_>) -> Result<(), SpecError> {
        for k in 0..self.0.len() {
            self.0[k].like_filaments(build.model);
            let s = &self.0[k];
            s.check().map_err(|e| SpecError { path: format!("[{k}].{}", e.path), ..e })?;
            if self.0[..k].iter().any(|other| other.name == s.name) {
                return Err(SpecError::new(format!("[{k}].name"), format!("two surfaces are called `{}`", s.name)));
            }
        }
        Ok(())
    }
}

impl Settings for Mandrel {
    const KEY: &'static str = "mandrel";
    const ABOUT: &'static str = "the rigid bar inside a braid";

    fn check(&mut self, build: &mut Build<'_>) -> Result<(), SpecError> {
        self.0.like_filaments(build.model);
        self.0.check()
    }
}

/// A rigid surface at rest that filaments lie on: a mandrel, a floor.
///
/// Lying on it, a filament meets the force `line_stiffness` x penetration per length; over an edge
/// the force is `stiffness` x penetration.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SurfaceSpec {
    /// Name for probes and messages. Default `mandrel`.
    #[serde(default = "mandrel")]
    pub name: String,
    /// Shape.
    pub shape: ShapeSpec,
    /// A point of the axis, or of the plane (length). Default the origin.
    #[serde(default)]
    pub position: Point,
    /// Direction of the axis, or normal of the plane. Default z.
    #[serde(default = "along_z", with = "braid_ecs::scene::units::list")]
    pub axis: [f64; 3],
    /// Turn of the cross-section about the axis. Default 0.
    #[serde(default)]
    pub turn: Angle,
    /// How filaments are kept out. Default `Penalty`.
    #[serde(default)]
    pub enforcement: Enforcement,
    /// Coulomb friction coefficient. Default: that of `contact`, or 0.2.
    #[serde(default)]
    pub friction: Option<Ratio>,
    /// Normal stiffness over an edge (force / length). Default from mass and time step.
    #[serde(default)]
    pub stiffness: Option<Stiffness>,
    /// Normal stiffness per length of a filament lying on the surface (force / length^2). Default from mass and time step.
    #[serde(default)]
    pub line_stiffness: Option<StiffnessPerLength>,
    /// Tangential over normal stiffness of the friction springs. Default 0.5.
    #[serde(default = "half")]
    pub friction_stiffness: Ratio,
    /// Damping ratio of the normal springs. Default 0.05.
    #[serde(default = "damping")]
    pub damping: Ratio,
    /// What to do where filaments reach into the surface at the start by more than 5 % of the radius. Default `Error`.
    #[serde(default)]
    pub initial_overlap: InitialOverlap,
}

/// How a surface keeps filaments out.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Enforcement {
    /// By springs: a force for every penetration.
    #[default]
    Penalty,
    /// By correcting velocities: no penetration, no limit on the time step.
    Kinematic,
}

fn mandrel() -> String {
    "mandrel".into()
}
fn along_z() -> [f64; 3] {
    [0.0, 0.0, 1.0]
}
fn half() -> Ratio {
    Ratio(0.5)
}
fn damping() -> Ratio {
    Ratio(0.05)
}

/// Shapes. Prisms and cylinders are infinitely long along their axis; the others have their origin at
/// the surface's position and their own z along its axis.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub enum ShapeSpec {
    /// A half space; the axis is its outward normal.
    Plane,
    /// A round bar.
    Cylinder {
        /// Radius (length).
        radius: Length,
    },
    /// A square bar.
    Square {
        /// Side (length).
        side: Length,
        /// Radius of the edges (length), 0 for sharp ones. Default 0.
        #[serde(default)]
        edge_radius: Length,
    },
    /// A bar with a regular polygon as cross-section.
    Regular {
        /// Number of sides, at least 3.
        sides: u32,
        /// Length of a side (length).
        side: Length,
        /// Radius of the edges (length), 0 for sharp ones. Default 0.
        #[serde(default)]
        edge_radius: Length,
    },
    /// A bar with a convex polygon as cross-section.
    Polygon {
        /// Corners in the plane across the axis (length), either way round.
        #[serde(with = "braid_ecs::scene::units::lists")]
        corners: Vec<[Length; 2]>,
        /// Radius of the edges (length), 0 for sharp ones. Default 0.
        #[serde(default)]
        edge_radius: Length,
    },
    /// A tapered round bar of finite length, from the position along the axis.
    Frustum {
        /// Radius at the position (length).
        start_radius: Length,
        /// Radius at the other end (length).
        end_radius: Length,
        /// Length (length).
        length: Length,
    },
    /// A ball.
    Sphere {
        /// Radius (length).
        radius: Length,
    },
    /// Any closed body, as a mesh of triangles.
    Mesh {
        /// Corners (length).
        #[serde(with = "braid_ecs::scene::units::lists")]
        vertices: Vec<[Length; 3]>,
        /// Numbers of three vertices each, counter-clockwise seen from outside.
        triangles: Vec<[u32; 3]>,
    },
}

/// All surfaces of a model: the mandrel, then the others in their order.
pub fn surface_specs(model: &Model) -> Vec<SurfaceSpec> {
    let mandrel = model.get::<Mandrel>().map(|m| m.0.clone());
    mandrel.into_iter().chain(model.get::<Surfaces>().iter().flat_map(|s| s.0.iter().cloned())).collect()
}

impl SurfaceSpec {
    /// A surface of this shape with default settings.
    pub fn new(shape: ShapeSpec) -> Self {
        SurfaceSpec {
            name: mandrel(),
            shape,
            position: Point::default(),
            axis: along_z(),
            turn: Angle(0.0),
            enforcement: Enforcement::Penalty,
            friction: None,
            stiffness: None,
            line_stiffness: None,
            friction_stiffness: half(),
            damping: damping(),
            initial_overlap: InitialOverlap::Error,
        }
    }

    /// Takes the friction of the contact between filaments where none is given.
    fn like_filaments(&mut self, model: &Model) {
        self.friction.get_or_insert(model.get::<ContactSpec>().map_or(Ratio(0.2), |c| c.friction));
    }

    /// Checks the numbers and the shape.
    ///
    /// # Errors
    /// The first field that makes no sense.
    pub fn check(&self) -> Result<(), SpecError> {
        bounded("friction", "the friction coefficient", self.friction.map_or(0.0, |f| f.0), 0.0, f64::INFINITY)?;
        positive("stiffness", "the stiffness over an edge", self.stiffness.map(f64::from))?;
        positive("line_stiffness", "the stiffness per length", self.line_stiffness.map(f64::from))?;
        bounded("friction_stiffness", "the stiffness ratio of friction", self.friction_stiffness.0, 1e-6, 1.0)?;
        bounded("damping", "the damping ratio", self.damping.0, 0.0, 1.0)?;
        let axis = DVec3::from_array(self.axis);
        if !axis.is_finite() || axis == DVec3::ZERO {
            return Err(SpecError::new("axis", "the axis needs a direction").help("[0, 0, 1] is the z axis"));
        }
        super::shape::Body::new(&self.shape).map(|_| ())
    }
}
