//! Where to look from, and the frame that holds everything.
use glam::DVec3;

/// Direction of the view.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// From the scene towards the eye (any length).
    pub towards_eye: DVec3,
    /// Direction that appears level or rising to the right.
    pub right: DVec3,
    /// Angle by which `right` rises in the picture (radian).
    pub tilt: f64,
}

impl Default for View {
    fn default() -> Self {
        View::along(DVec3::Z)
    }
}

impl View {
    /// Oblique view of something long: `axis` runs from left to right and a little upwards, and
    /// its far end comes towards the eye.
    pub fn along(axis: DVec3) -> Self {
        let a = axis.normalize_or(DVec3::Z);
        // The global axis most across `axis` counts as sideways, so that a prism shows two faces.
        let helper = if a.x.abs() <= a.y.abs() && a.x.abs() <= a.z.abs() {
            DVec3::X
        } else if a.y.abs() <= a.z.abs() {
            DVec3::Y
        } else {
            DVec3::Z
        };
        let side = (helper - helper.dot(a) * a).normalize();
        let up = a.cross(side);
        View { towards_eye: 0.55 * a + 0.78 * side + 0.62 * up, right: a, tilt: 0.14 }
    }
}

/// Unit vectors of the picture: right, up, towards the eye.
#[derive(Clone, Copy, Debug)]
pub(super) struct Frame {
    pub right: DVec3,
    pub up: DVec3,
    pub eye: DVec3,
}

impl Frame {
    pub fn new(view: &View) -> Self {
        let eye = view.towards_eye.normalize_or(DVec3::Z);
        let level = (view.right - view.right.dot(eye) * eye).normalize_or(eye.any_orthonormal_vector());
        let upright = eye.cross(level);
        let (s, c) = view.tilt.sin_cos();
        Frame { right: c * level - s * upright, up: s * level + c * upright, eye }
    }

    /// Coordinates in the picture: across, up, towards the eye.
    pub fn project(&self, p: DVec3) -> DVec3 {
        DVec3::new(p.dot(self.right), p.dot(self.up), p.dot(self.eye))
    }
}

/// Smallest box around projected points.
#[derive(Clone, Copy, Debug)]
pub(super) struct Bounds {
    pub min: DVec3,
    pub max: DVec3,
}

impl Bounds {
    pub const EMPTY: Bounds = Bounds { min: DVec3::INFINITY, max: DVec3::NEG_INFINITY };
    pub fn add(&mut self, p: DVec3, margin: f64) {
        self.min = self.min.min(p - margin);
        self.max = self.max.max(p + margin);
    }
    pub fn is_empty(&self) -> bool {
        !(self.min.cmple(self.max).all() && self.min.is_finite() && self.max.is_finite())
    }
}
