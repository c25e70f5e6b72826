//! What a simulation has to remember, saved and restored with every bit.
//!
//! Installers name the components and resources that carry state from one step to the next
//! ([`Install::remember`], [`Install::remember_pool`], [`Install::remember_resource`]); everything
//! else follows from the scene. A saved state is restored into a simulation that has been built from
//! the same scene, on any number of threads, and goes on with the same bits. Numbers are stored as
//! postcard does (<https://postcard.jamesmunns.com/wire-format>): floats as their bits.
use crate::simulation::Install;
use bevy_ecs::component::Mutable;
use bevy_ecs::prelude::*;
use serde::Serialize;
use serde::de::DeserializeOwned;

/// One component or resource that is saved.
#[derive(Clone, Copy)]
struct Part {
    name: fn() -> &'static str,
    save: fn(&mut World) -> Result<Vec<u8>, postcard::Error>,
    load: fn(&mut World, &[u8], Option<Grow>) -> Result<(), String>,
    grow: Option<Grow>,
}

/// A resource of which only some changes from step to step; the rest follows from the scene.
pub trait Kept: Resource<Mutability = Mutable> {
    /// What is saved of it.
    type State: Serialize + DeserializeOwned;
    /// What to save.
    fn state(&self) -> Self::State;
    /// Puts back what was saved.
    fn put_back(&mut self, state: Self::State);
}

/// Makes room for so many entities of a pool.
pub type Grow = fn(&mut World, usize);

/// All that is saved, in order, and what has to be done after a restore.
#[derive(Resource, Clone, Default)]
pub(crate) struct StateParts {
    parts: Vec<Part>,
    after: Vec<fn(&mut World)>,
}

impl StateParts {
    fn push(&mut self, part: Part) {
        if self.parts.iter().all(|p| (p.name)() != (part.name)()) {
            self.parts.push(part);
        }
    }
}

impl Install<'_> {
    /// Saves a component of all entities that have it.
    pub fn remember<C: Component<Mutability = Mutable> + Serialize + DeserializeOwned>(&mut self) {
        remember::<C>(self.world);
    }

    /// Saves a component of pooled entities, of which `grow` makes more where a saved state has more.
    pub fn remember_pool<C: Component<Mutability = Mutable> + Serialize + DeserializeOwned>(&mut self, grow: Grow) {
        #[cfg(debug_assertions)]
        crate::stepper::inspect::know_component::<C>(self.world);
        let part = Part { name: std::any::type_name::<C>, save: save_column::<C>, load: load_column::<C>, grow: Some(grow) };
        self.world.get_resource_or_init::<StateParts>().push(part);
    }

    /// Saves a resource, or that it is not there.
    pub fn remember_resource<R: Resource + Serialize + DeserializeOwned>(&mut self) {
        remember_resource::<R>(self.world);
    }

    /// Saves what changes of a resource.
    pub fn remember_part<R: Kept>(&mut self) {
        #[cfg(debug_assertions)]
        crate::stepper::inspect::know_part::<R>(self.world);
        let part = Part { name: std::any::type_name::<R>, save: save_part::<R>, load: load_part::<R>, grow: None };
        self.world.get_resource_or_init::<StateParts>().push(part);
    }

    /// Runs `repair` after every restore, for what is derived from the state.
    pub fn after_restore(&mut self, repair: fn(&mut World)) {
        self.world.get_resource_or_init::<StateParts>().after.push(repair);
    }
}

pub(crate) fn remember<C: Component<Mutability = Mutable> + Serialize + DeserializeOwned>(world: &mut World) {
    #[cfg(debug_assertions)]
    crate::stepper::inspect::know_component::<C>(world);
    let part = Part { name: std::any::type_name::<C>, save: save_column::<C>, load: load_column::<C>, grow: None };
    world.get_resource_or_init::<StateParts>().push(part);
}

pub(crate) fn remember_resource<R: Resource + Serialize + DeserializeOwned>(world: &mut World) {
    #[cfg(debug_assertions)]
    crate::stepper::inspect::know_resource::<R>(world);
    let part = Part { name: std::any::type_name::<R>, save: save_resource::<R>, load: load_resource::<R>, grow: None };
    world.get_resource_or_init::<StateParts>().push(part);
}

/// The state as bytes.
///
/// # Errors
/// A component or resource that cannot be written, by name.
pub fn save(world: &mut World) -> Result<Vec<u8>, String> {
    let parts = world.get_resource_or_init::<StateParts>().parts.clone();
    let mut out = Vec::new();
    for part in parts {
        let name = (part.name)();
        let bytes = (part.save)(world).map_err(|e| format!("{name} cannot be saved: {e}"))?;
        out = postcard::to_extend(&(name, bytes.len()), out).map_err(|e| e.to_string())?;
        out.extend(bytes);
    }
    Ok(out)
}

/// Names of the components and resources in which two saved states differ.
///
/// # Errors
/// Bytes that are no saved state.
pub fn differences(a: &[u8], b: &[u8]) -> Result<Vec<String>, String> {
    let (a, b) = (split(a)?, split(b)?);
    let names = a.keys().chain(b.keys()).collect::<std::collections::BTreeSet<_>>();
    Ok(names.into_iter().filter(|n| a.get(*n) != b.get(*n)).map(|n| (*n).to_owned()).collect())
}

/// The parts of a saved state by the full names of their types.
///
/// # Errors
/// Bytes that are no saved state.
pub fn split(mut bytes: &[u8]) -> Result<std::collections::BTreeMap<&str, &[u8]>, String> {
    let mut parts = std::collections::BTreeMap::new();
    while !bytes.is_empty() {
        let ((name, length), rest): ((&str, usize), &[u8]) = postcard::take_from_bytes(bytes).map_err(|e| e.to_string())?;
        parts.insert(name, rest.get(..length).ok_or_else(|| format!("cut off in {name}"))?);
        bytes = &rest[length..];
    }
    Ok(parts)
}

/// Restores a state saved from a simulation of the same scene.
///
/// # Errors
/// A state of another scene or another version of the program, or cut off; the world is then of no use.
pub fn restore(world: &mut World, mut bytes: &[u8]) -> Result<(), String> {
    let StateParts { parts, after } = world.get_resource_or_init::<StateParts>().clone();
    for part in parts {
        let name = (part.name)();
        let ((saved, length), rest): ((&str, usize), &[u8]) =
            postcard::take_from_bytes(bytes).map_err(|e| format!("the saved state ends before {name}: {e}"))?;
        if saved != name {
            return Err(format!("the saved state has {saved} where this simulation has {name}: another scene or another program"));
        }
        let here = rest.get(..length).ok_or_else(|| format!("the saved state is cut off in {name}"))?;
        (part.load)(world, here, part.grow).map_err(|e| format!("{name}: {e}"))?;
        bytes = &rest[length..];
    }
    if !bytes.is_empty() {
        return Err(format!("{} bytes are left over in the saved state: another scene or another program", bytes.len()));
    }
    for repair in after {
        repair(world);
    }
    Ok(())
}

fn save_column<C: Component + Serialize>(world: &mut World) -> Result<Vec<u8>, postcard::Error> {
    let mut query = world.query::<&C>();
    postcard::to_extend(&query.iter(world).collect::<Vec<_>>(), Vec::new())
}

fn load_column<C: Component<Mutability = Mutable> + DeserializeOwned>(
    world: &mut World,
    bytes: &[u8],
    grow: Option<Grow>,
) -> Result<(), String> {
    let (saved, rest): (Vec<C>, &[u8]) = postcard::take_from_bytes(bytes).map_err(|e| e.to_string())?;
    let mut query = world.query::<&mut C>();
    if let Some(grow) = grow {
        grow(world, saved.len());
        let surplus: Vec<Entity> = world.query_filtered::<Entity, With<C>>().iter(world).skip(saved.len()).collect();
        for entity in surplus {
            world.despawn(entity);
        }
    } else if query.iter(world).len() != saved.len() {
        return Err(format!("{} saved, {} in this scene", saved.len(), query.iter(world).len()));
    }
    if !rest.is_empty() {
        return Err("not what was saved".into());
    }
    for (mut to, from) in query.iter_mut(world).zip(saved) {
        *to = from;
    }
    Ok(())
}

fn save_resource<R: Resource + Serialize>(world: &mut World) -> Result<Vec<u8>, postcard::Error> {
    postcard::to_extend(&world.get_resource::<R>(), Vec::new())
}

fn load_resource<R: Resource + DeserializeOwned>(world: &mut World, bytes: &[u8], _: Option<Grow>) -> Result<(), String> {
    match postcard::from_bytes::<Option<R>>(bytes).map_err(|e| e.to_string())? {
        Some(resource) => world.insert_resource(resource),
        None => drop(world.remove_resource::<R>()),
    }
    Ok(())
}

fn save_part<R: Kept>(world: &mut World) -> Result<Vec<u8>, postcard::Error> {
    postcard::to_extend(&world.resource::<R>().state(), Vec::new())
}

fn load_part<R: Kept>(world: &mut World, bytes: &[u8], _: Option<Grow>) -> Result<(), String> {
    let state = postcard::from_bytes(bytes).map_err(|e| e.to_string())?;
    world.resource_mut::<R>().put_back(state);
    Ok(())
}
