//! Frames for ParaView: the lines of the model with their state, and the contacts.
use super::lines::Lines;
use super::vtp::{DataArray, Polylines, Values};
use crate::assembly::node_states;
use crate::systems::contact::{ContactKind, all_contacts};
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

/// All places where filaments and surfaces touch or are less than a radius apart: one short line each, from
/// the place along the normal, with the arrays `kind` (0 side by side, 1 crossing, 2 on a surface, 3 over an
/// edge), `filament`, `other` (filament or surface), `gap`, `normal_force`, `friction_force`, `angle`
/// (degrees between the centrelines) and `slides`.
pub fn contact_frame(world: &mut World, provenance: &[(String, String)]) -> Polylines {
    let contacts = all_contacts(world);
    let number = |kind: ContactKind| match kind {
        ContactKind::Line => 0,
        ContactKind::Point => 1,
        ContactKind::Surface => 2,
        ContactKind::Edge => 3,
    };
    Polylines {
        points: contacts.iter().flat_map(|c| [c.place, c.place + c.normal * c.radius]).collect(),
        lengths: vec![2; contacts.len()],
        point_data: Vec::new(),
        line_data: vec![
            DataArray::integers("kind", contacts.iter().map(|c| number(c.kind))),
            DataArray::integers("filament", contacts.iter().map(|c| c.filament as i64)),
            DataArray::integers("other", contacts.iter().map(|c| c.other as i64)),
            DataArray::scalars("gap", contacts.iter().map(|c| c.gap)),
            DataArray::scalars("normal_force", contacts.iter().map(|c| c.normal_force)),
            DataArray::vectors("friction_force", contacts.iter().map(|c| c.friction_force)),
            DataArray::scalars("angle", contacts.iter().map(|c| c.angle.to_degrees())),
            DataArray::integers("slides", contacts.iter().map(|c| i64::from(c.slides))),
        ],
        field_data: provenance.iter().map(|(k, v)| DataArray::text(k.clone(), v.clone())).collect(),
    }
}
