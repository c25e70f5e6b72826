//! Nodes as a scene names them.
use crate::components::NodeId;
use crate::model::Model;
use crate::registry::SpecError;
use serde::{Deserialize, Deserializer, Serialize};

/// A node by number or by name.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(untagged)]
pub enum NodeRef {
    /// Number in the node list.
    Id(u32),
    /// Name.
    Name(String),
}

impl<'de> Deserialize<'de> for NodeRef {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Visitor;
        impl serde::de::Visitor<'_> for Visitor {
            type Value = NodeRef;
            fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.write_str("a node number or a node name in quotes")
            }
            fn visit_u64<E: serde::de::Error>(self, v: u64) -> Result<NodeRef, E> {
                u32::try_from(v).map(NodeRef::Id).map_err(|_| E::custom(format!("node number {v} is too large")))
            }
            fn visit_i64<E: serde::de::Error>(self, v: i64) -> Result<NodeRef, E> {
                u32::try_from(v).map(NodeRef::Id).map_err(|_| E::custom(format!("{v} is not a node number")))
            }
            fn visit_str<E: serde::de::Error>(self, v: &str) -> Result<NodeRef, E> {
                Ok(NodeRef::Name(v.to_string()))
            }
        }
        deserializer.deserialize_any(Visitor)
    }
}

impl NodeRef {
    /// The node meant; errors name the field `path`.
    ///
    /// # Errors
    /// A number or name that no node has.
    pub fn resolve(&self, path: &str, model: &Model) -> Result<NodeId, SpecError> {
        match self {
            NodeRef::Id(id) if (*id as usize) < model.nodes.len() => Ok(NodeId(*id)),
            NodeRef::Id(id) => Err(SpecError::new(path, format!("node {id} does not exist"))
                .help(format!("the scene has {} nodes, numbered from 0", model.nodes.len()))),
            NodeRef::Name(name) => model
                .node_names
                .get(name)
                .copied()
                .ok_or_else(|| SpecError::unknown(path, "node", name, model.node_names.keys().map(String::as_str))),
        }
    }

    /// The nodes meant, where a name may hold one `*` for any text (`strand.*.end`); errors name the field `path`.
    ///
    /// # Errors
    /// A number or name that no node has.
    pub fn resolve_all(&self, path: &str, model: &Model) -> Result<Vec<NodeId>, SpecError> {
        if let NodeRef::Name(pattern) = self
            && let Some((head, tail)) = pattern.split_once('*')
        {
            let matches = |n: &str| n.len() >= head.len() + tail.len() && n.starts_with(head) && n.ends_with(tail);
            let found: Vec<NodeId> = model.node_names.iter().filter(|(n, _)| matches(n)).map(|(_, id)| *id).collect();
            if found.is_empty() {
                return Err(SpecError::unknown(path, "node", pattern, model.node_names.keys().map(String::as_str)));
            }
            return Ok(found);
        }
        Ok(vec![self.resolve(path, model)?])
    }
}
