//! What is stored, by name: components and resources as texts, through their serde traits.
//!
//! Everything that is remembered ([`Install::remember`](crate::simulation::Install::remember) and its kin) and every
//! element is known here without extra work, that of plugins too. A value is shown as RON, and its fields are found by the
//! same paths as in scenes. Components that are not remembered are listed by their name alone.
use crate::assembly::KindReports;
use crate::components::*;
use crate::element::{Element, EndForces, NodeForce};
use crate::scene::ron_options;
use crate::scene::spans::{Path, Step, Value, tree};
use crate::state::Kept;
use bevy_ecs::component::{ComponentId, Mutable};
use bevy_ecs::prelude::*;
use glam::DVec3;
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::any::type_name;
use std::collections::BTreeMap;

/// A type of component.
#[derive(Clone)]
pub struct ComponentType {
    /// Short name (`Spring`).
    pub name: String,
    /// Name with its path, which is its own.
    pub full: &'static str,
    /// The entities that have it, in order.
    pub members: fn(&mut World) -> Vec<Entity>,
    show: fn(EntityRef<'_>) -> Option<String>,
    put: Option<fn(&mut World, Entity, &str) -> Result<(), String>>,
    rows: Option<fn(&[u8]) -> Option<Vec<String>>>,
}

/// A type of resource that is remembered.
#[derive(Clone)]
pub struct ResourceType {
    /// Short name (`Clock`).
    pub name: String,
    /// Name with its path, which is its own.
    pub full: &'static str,
    saved: fn(&[u8]) -> Option<String>,
    show: fn(&World) -> Option<String>,
    put: fn(&mut World, &str) -> Result<(), String>,
}

/// A kind of element of which the model has some.
#[derive(Clone, Copy)]
pub struct Kind {
    /// Scene key.
    pub name: &'static str,
    /// Name of its component, with its path.
    pub component: &'static str,
    /// Its elements, in order.
    pub members: fn(&mut World) -> Vec<Entity>,
}

/// All that can be shown by name.
#[derive(Resource, Default)]
pub struct Inspected {
    components: BTreeMap<ComponentId, ComponentType>,
    resources: Vec<ResourceType>,
    kinds: Vec<Kind>,
}

fn name_of(world: &World, id: ComponentId) -> String {
    world.components().get_info(id).map_or(String::new(), |info| info.name().shortname().to_string())
}

fn know(world: &mut World, id: ComponentId, add: impl FnOnce(String) -> ComponentType) {
    let name = name_of(world, id);
    world.get_resource_or_init::<Inspected>().components.insert(id, add(name));
}

fn text_of<T: Serialize>(value: &T) -> Option<String> {
    ron_options().to_string(value).ok()
}

fn show<C: Component + Serialize>(entity: EntityRef<'_>) -> Option<String> {
    entity.get::<C>().and_then(text_of)
}

fn put<C: Component<Mutability = Mutable> + DeserializeOwned>(world: &mut World, entity: Entity, text: &str) -> Result<(), String> {
    let value: C = ron_options().from_str(text).map_err(|e| e.code.to_string())?;
    *world.get_mut::<C>(entity).ok_or("the component is not there")? = value;
    Ok(())
}

fn rows<C: Serialize + DeserializeOwned>(bytes: &[u8]) -> Option<Vec<String>> {
    postcard::from_bytes::<Vec<C>>(bytes).ok()?.iter().map(text_of).collect()
}

/// A component that can be shown and set.
pub(crate) fn know_component<C: Component<Mutability = Mutable> + Serialize + DeserializeOwned>(world: &mut World) {
    let id = world.register_component::<C>();
    know(world, id, |name| ComponentType {
        name,
        full: type_name::<C>(),
        members: members::<C>,
        show: show::<C>,
        put: Some(put::<C>),
        rows: Some(rows::<C>),
    });
}

/// A component that can be shown.
fn know_constant<C: Component + Serialize>(world: &mut World) {
    let id = world.register_component::<C>();
    know(world, id, |name| ComponentType { name, full: type_name::<C>(), members: members::<C>, show: show::<C>, put: None, rows: None });
}

/// A resource that can be shown and set.
pub(crate) fn know_resource<R: Resource + Serialize + DeserializeOwned>(world: &mut World) {
    let id = world.register_component::<R>();
    let resource = ResourceType {
        name: name_of(world, id),
        full: type_name::<R>(),
        saved: |bytes| postcard::from_bytes::<Option<R>>(bytes).ok().flatten().as_ref().and_then(text_of),
        show: |world| world.get_resource::<R>().and_then(text_of),
        put: |world, text| {
            let value: R = ron_options().from_str(text).map_err(|e| e.code.to_string())?;
            world.insert_resource(value);
            Ok(())
        },
    };
    add_resource(world, resource);
}

/// A resource of which a part is remembered: that part can be shown and set.
pub(crate) fn know_part<R: Kept>(world: &mut World) {
    let id = world.register_component::<R>();
    let resource = ResourceType {
        name: name_of(world, id),
        full: type_name::<R>(),
        saved: |bytes| postcard::from_bytes::<R::State>(bytes).ok().as_ref().and_then(text_of),
        show: |world| world.get_resource::<R>().and_then(|r| text_of(&r.state())),
        put: |world, text| {
            let state = ron_options().from_str(text).map_err(|e| e.code.to_string())?;
            world.get_resource_mut::<R>().ok_or("it is not there now")?.put_back(state);
            Ok(())
        },
    };
    add_resource(world, resource);
}

fn add_resource(world: &mut World, resource: ResourceType) {
    let known = &mut world.get_resource_or_init::<Inspected>().resources;
    if known.iter().all(|k| k.full != resource.full) {
        known.push(resource);
    }
}

/// What nodes and ties have besides what is remembered.
pub(crate) fn know_constants(world: &mut World) {
    know_constant::<InitialPosition>(world);
    know_constant::<Mass>(world);
    know_constant::<InverseMass>(world);
    know_constant::<RotaryInertia>(world);
    know_constant::<InverseInertia>(world);
    know_constant::<Tie>(world);
}

/// A kind of element: its members, the rows of their nodes and the forces of their ends.
pub(crate) fn know_element<E: Element<N>, const N: usize>(world: &mut World) {
    let reported = world.get_resource::<KindReports>().is_some_and(|r| r.0.iter().any(|k| k.name == E::NAME));
    if !reported {
        return;
    }
    world.get_resource_or_init::<Inspected>().kinds.push(Kind { name: E::NAME, component: type_name::<E>(), members: members::<E> });
    know_constant::<Connectivity<N>>(world);
    let id = world.register_component::<EndForces<E, N>>();
    know(world, id, |_| ComponentType {
        name: "EndForces".into(),
        full: type_name::<EndForces<E, N>>(),
        members: members::<E>,
        show: show_end_forces::<E, N>,
        put: None,
        rows: None,
    });
}

fn members<E: Component>(world: &mut World) -> Vec<Entity> {
    world.query_filtered::<Entity, With<E>>().iter(world).collect()
}

/// Force and moment of an end.
#[derive(Serialize)]
struct EndWrench {
    force: DVec3,
    #[serde(skip_serializing_if = "Option::is_none")]
    moment: Option<DVec3>,
}

fn show_end_forces<E: Element<N>, const N: usize>(entity: EntityRef<'_>) -> Option<String> {
    let ends = entity.get::<EndForces<E, N>>()?.0;
    let moment = |f: &E::Force| <E::Force as NodeForce>::ROTATIONS.then(|| f.moment());
    text_of(&ends.iter().map(|f| EndWrench { force: f.force(), moment: moment(f) }).collect::<Vec<_>>())
}

/// A component of an entity.
pub struct Shown {
    /// Short name.
    pub name: String,
    /// Name with its path.
    pub full: &'static str,
    /// Its value as RON; `None` if it is known by its name alone.
    pub text: Option<String>,
}

impl Inspected {
    /// All components of an entity.
    pub fn components_of(world: &World, entity: Entity) -> Vec<Shown> {
        let (Ok(infos), Some(known)) = (world.inspect_entity(entity), world.get_resource::<Inspected>()) else { return Vec::new() };
        let all = infos.map(|(id, info)| match known.components.get(&id) {
            Some(c) => Shown { name: c.name.clone(), full: c.full, text: (c.show)(world.entity(entity)) },
            None => Shown { name: info.name().shortname().to_string(), full: "", text: None },
        });
        all.collect()
    }

    /// The kinds of element in the model, in registration order.
    pub fn kinds(world: &World) -> Vec<Kind> {
        world.get_resource::<Inspected>().map_or(Vec::new(), |i| i.kinds.clone())
    }

    /// All types of components.
    pub fn components(world: &World) -> Vec<ComponentType> {
        world.get_resource::<Inspected>().map_or(Vec::new(), |i| i.components.values().cloned().collect())
    }

    /// All resources.
    pub fn resources(world: &World) -> Vec<ResourceType> {
        world.get_resource::<Inspected>().map_or(Vec::new(), |i| i.resources.clone())
    }

    /// What a part of a saved state holds, as texts: the rows of a column, or a resource; `None` if it is not known.
    pub fn saved(world: &World, full: &str, bytes: &[u8]) -> Option<Vec<String>> {
        let known = world.get_resource::<Inspected>()?;
        match known.components.values().find(|c| c.full == full) {
            Some(c) => (c.rows?)(bytes),
            None => known.resources.iter().find(|r| r.full == full).and_then(|r| (r.saved)(bytes)).map(|text| vec![text]),
        }
    }

    /// Replaces a component of an entity.
    ///
    /// # Errors
    /// A component that follows from the scene, or a text that does not fit.
    pub fn put(world: &mut World, entity: Entity, full: &str, text: &str) -> Result<(), String> {
        let put = world.get_resource::<Inspected>().and_then(|i| i.components.values().find(|c| c.full == full)).and_then(|c| c.put);
        put.ok_or("it follows from the scene and cannot be set")?(world, entity, text)
    }
}

impl ResourceType {
    /// The value as RON; `None` while it is not there.
    pub fn text(&self, world: &World) -> Option<String> {
        (self.show)(world)
    }

    /// Replaces the resource.
    ///
    /// # Errors
    /// A text that does not fit.
    pub fn put(&self, world: &mut World, text: &str) -> Result<(), String> {
        (self.put)(world, text)
    }
}

/// Most items of a list that are shown.
const SHOWN: usize = 8;

/// The fields of a value with their texts, in order; a vector is one field, and the path of a bare value is empty.
pub fn fields(text: &str) -> Vec<(String, String)> {
    fn walk(text: &str, v: &Value, at: &Path, out: &mut Vec<(String, String)>) {
        let bare = v.items.iter().all(|i| i.key.is_none() && i.value.items.is_empty());
        if v.wraps_one() {
            walk(text, &v.items[0].value, at, out);
        } else if bare && v.items.len() <= SHOWN {
            out.push((at.to_string(), text[v.span.clone()].to_string()));
        } else {
            for (n, item) in v.items.iter().enumerate() {
                match &item.key {
                    Some(k) => walk(text, &item.value, &at.key(k), out),
                    None if n < SHOWN => walk(text, &item.value, &at.index(n), out),
                    None => {}
                }
            }
            if v.items.len() > SHOWN && v.items.iter().all(|i| i.key.is_none()) {
                out.push((at.to_string(), format!("{} items", v.items.len())));
            }
        }
    }
    let mut out = Vec::new();
    if let Some(root) = &tree(text).root {
        walk(text, root, &Path::default(), &mut out);
    }
    out
}

/// The path that a person means: `x`, `y` and `z` stand for the three numbers of a vector.
fn steps(text: &str) -> Option<Path> {
    let mut path = Path::parse(text)?;
    if let Some(last) = path.0.last_mut()
        && let Step::Key(k) = last
        && let Some(axis) = ["x", "y", "z"].iter().position(|a| a == k)
    {
        *last = Step::Index(axis);
    }
    Some(path)
}

/// Where a field stands in the text of a value.
pub fn field(text: &str, path: &str) -> Option<std::ops::Range<usize>> {
    let root = tree(text).root?;
    let plain = Path::parse(path).and_then(|p| root.find(&p).map(|v| v.span.clone()));
    plain.or_else(|| root.find(&steps(path)?).map(|v| v.span.clone()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fields_have_the_paths_of_scenes() {
        let text = "(rest_length:1.5,before:Some((0.5,2.0)),list:[(a:1),(a:2)],kind:Line)";
        let all = fields(text);
        let expected = [("rest_length", "1.5"), ("before", "(0.5,2.0)"), ("list[0].a", "1"), ("list[1].a", "2"), ("kind", "Line")];
        assert_eq!(all, expected.map(|(p, v)| (p.to_string(), v.to_string())));
        assert_eq!(fields("(1.0,2.0,3.0)"), [(String::new(), "(1.0,2.0,3.0)".to_string())]);
        assert_eq!(&text[field(text, "list[1].a").expect("there")], "2");
        assert_eq!(&"(1.0,2.0,3.0)"[field("(1.0,2.0,3.0)", "y").expect("there")], "2.0");
        assert!(field(text, "list[2].a").is_none() && field(text, "rest").is_none());
    }
}
