//! From polylines to nodes, elements, ties and periodic pairs of a model.
use crate::components::{Dof, NodeId, PeriodicPair, Tie};
use crate::model::{Chain, Filament, NaturalShape, Node, Section};
use crate::registry::{Build, ElementKind, SpecError};
use glam::DVec3;
use std::ops::Range;

/// One kind of element along a filament.
pub(crate) struct Layer {
    pub kind: ElementKind,
    pub section: Section,
    /// True for a layer on nodes of its own, tied to those of the filament.
    pub embedded: bool,
}

/// The layers that make a filament.
pub(crate) struct Recipe {
    pub layers: Vec<Layer>,
    pub natural: NaturalShape,
    /// Mass per length of the whole filament.
    pub mass: f64,
}

/// A filament before it has nodes.
pub(crate) struct Path {
    /// Points in order; the last one of a periodic or closed path is left out.
    pub points: Vec<DVec3>,
    pub radius: f64,
    pub tow: usize,
    pub index: usize,
    /// The path whose first point, moved by the period, ends this one.
    pub successor: Option<usize>,
    /// True if the last point is joined to the first one.
    pub closed: bool,
    /// Which recipe.
    pub recipe: usize,
}

/// What [`lay`] added.
#[derive(Clone, Debug)]
pub(crate) struct Laid {
    /// Filaments of the model.
    pub filaments: Range<usize>,
    /// The dummy node of a periodic cell.
    pub dummy: Option<NodeId>,
    /// Mass of all filaments, from section and length.
    pub mass: f64,
}

/// Adds the nodes, filaments, elements, ties and periodic pairs of `paths`. Nodes come filament by
/// filament, then the dummy node, then the embedded nodes, so that the rows of all nodes with a
/// motion of their own are contiguous. `period` is the period vector and the name of its node.
pub(crate) fn lay(paths: &[Path], recipes: &[Recipe], period: Option<(DVec3, &str)>, build: &mut Build<'_>) -> Result<Laid, SpecError> {
    let model = &mut *build.model;
    let first_filament = model.filaments.len();
    let mut chains: Vec<Vec<NodeId>> = Vec::with_capacity(paths.len());
    for path in paths {
        let mut nodes: Vec<NodeId> = path.points.iter().map(|p| model.add_node(*p)).collect();
        if let (Some(s), Some((vector, _))) = (path.successor, period) {
            nodes.push(model.add_node(paths[s].points[0] + vector));
        }
        chains.push(nodes);
    }
    let mut dummy = None;
    if let Some((vector, name)) = period {
        model.nodes.push(Node { dummy: true, ..Node::at(vector) });
        let id = NodeId(model.nodes.len() as u32 - 1);
        if model.node_names.insert(name.to_string(), id).is_some() {
            return Err(SpecError::new("", format!("a node called `{name}` exists already")));
        }
        model.fix(id, &[Dof::Ux, Dof::Uy, Dof::Rx, Dof::Ry, Dof::Rz]);
        dummy = Some(id);
    }

    let mut mass = 0.0;
    for (path, nodes) in paths.iter().zip(&chains) {
        if let (Some(s), Some(d)) = (path.successor, dummy) {
            let image = *nodes.last().expect("a path has points");
            model.periodic.push(PeriodicPair { node: chains[s][0], image, dummies: vec![d] });
        }
        let mut contour = nodes.clone();
        if path.closed {
            contour.push(nodes[0]);
        }
        let length: f64 = contour.windows(2).map(|w| model.nodes[w[0].row()].position.distance(model.nodes[w[1].row()].position)).sum();
        mass += recipes[path.recipe].mass * length;
        model.filaments.push(Filament {
            nodes: contour,
            radius: path.radius,
            tow: path.tow,
            index: path.index,
            closed: path.closed,
            contact: true,
        });
    }
    let filaments = first_filament..model.filaments.len();

    for (path, nodes) in paths.iter().zip(&chains) {
        let recipe = &recipes[path.recipe];
        for layer in &recipe.layers {
            let mut on = nodes.clone();
            if layer.embedded {
                for node in &mut on {
                    let host = *node;
                    *node = build.model.add_node(build.model.nodes[host.row()].position);
                    build.model.ties.push(Tie { embedded: *node, host });
                }
            }
            let chain = Chain { nodes: on, section: layer.section, natural: recipe.natural, orientation: None, closed: path.closed };
            (layer.kind.along)(&chain, build)?;
        }
    }
    Ok(Laid { filaments, dummy, mass })
}
