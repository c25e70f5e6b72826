//! Frames for ParaView: the lines of the model with their state.
use super::lines::Lines;
use super::vtp::{DataArray, Polylines, Values};
use crate::assembly::node_states;
use bevy_ecs::prelude::World;
use glam::DQuat;

/// The present state as polylines with the point arrays `radius`, `tow`, `filament`, `velocity`,
/// `axial_force`, and for models with rotations `bending_moment`, `tangent`, `normal` and
/// `rotation` (quaternion x, y, z, w from the initial configuration).
pub fn frame(lines: &Lines, world: &mut World, provenance: &[(String, String)]) -> Polylines {
    let states = node_states(world);
    let results = lines.results(world);
    let per_point = |f: fn(&super::lines::Line) -> f64| lines.lines.iter().flat_map(move |l| std::iter::repeat_n(f(l), l.rows.len()));
    let mut out = Polylines {
        points: lines.rows().map(|r| states[r].x).collect(),
        lengths: lines.lines.iter().map(|l| l.rows.len()).collect(),
        ..Default::default()
    };
    out.point_data = vec![
        DataArray::scalars("radius", per_point(|l| l.radius)),
        DataArray::integers("tow", per_point(|l| l.tow as f64).map(|v| v as i64)),
        DataArray::integers("filament", per_point(|l| l.index as f64).map(|v| v as i64)),
        DataArray::vectors("velocity", lines.rows().map(|r| states[r].v)),
        DataArray::scalars("axial_force", results.axial),
    ];
    let rotations: Vec<DQuat> = states.iter().map(|s| s.q).collect();
    if let Some(triads) = lines.current_triads(&rotations) {
        let quaternions = lines.rows().flat_map(|r| rotations[r].to_array()).map(|v| v as f32).collect();
        out.point_data.extend([
            DataArray::scalars("bending_moment", results.bending),
            DataArray::vectors("tangent", triads.iter().map(|t| t.0)),
            DataArray::vectors("normal", triads.iter().map(|t| t.1)),
            DataArray { name: "rotation".into(), components: 4, values: Values::F32(quaternions) },
        ]);
    }
    out.field_data = provenance.iter().map(|(k, v)| DataArray::text(k.clone(), v.clone())).collect();
    out
}
