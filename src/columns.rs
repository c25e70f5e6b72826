//! Contiguous column views of components: the whole column of a table as one slice.
//!
//! Nodes of a model sit in one table in the order of their rows, elements of a kind likewise, so
//! a query over them has exactly one slice per component. Reading slices costs what plain arrays
//! cost; looking entities up one by one costs three to four times as much.
use bevy_ecs::prelude::*;
use bevy_ecs::query::{ArchetypeFilter, ContiguousQueryData};

/// The columns of a query whose entities all live in one table.
///
/// # Panics
/// When there is no such entity, or when the entities are spread over two tables: somebody changed
/// the components of a node or element after the build, and stored rows would be wrong.
pub fn columns<'a, 's, D: ContiguousQueryData, F: ArchetypeFilter>(query: &'a mut Query<'_, 's, D, F>) -> D::Contiguous<'a, 's> {
    let mut tables = query.contiguous_iter_mut().expect("only table components and filters in a column query");
    let first = tables.next().expect("a system without entities is not scheduled");
    assert!(tables.next().is_none(), "entities of one kind are spread over two tables");
    first
}
