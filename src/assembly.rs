//! The generic element loops: forces of all elements of a kind, their sum at the nodes, their
//! energy and stiffness bounds.
//!
//! Two passes without atomics: the element pass writes each element's end forces into its own
//! component; the node pass sums, for every node, the ends that meet there, in a fixed order. The
//! result has the same bits for any number of threads.
use crate::columns::columns;
use crate::components::*;
use crate::element::*;
use crate::model::Model;
use crate::parallel;
use crate::simulation::{Install, NodeRows};
use crate::step::StepSet;
use bevy_ecs::prelude::*;
use glam::{DQuat, DVec3};
use serde::{Deserialize, Serialize};
use std::marker::PhantomData;

/// Which ends meet at each node, in a fixed order.
#[derive(Clone, Debug, Default)]
pub struct Incidence<T> {
    /// Rows of the nodes at which any do, in order.
    pub nodes: Vec<u32>,
    start: Vec<u32>,
    ends: Vec<T>,
}

impl<T: Copy + Ord> Incidence<T> {
    /// From ends with the rows of their nodes.
    pub fn new(ends: impl Iterator<Item = (u32, T)>) -> Self {
        let mut pairs: Vec<(u32, T)> = ends.collect();
        pairs.sort_unstable();
        let (mut nodes, mut start) = (Vec::new(), Vec::new());
        for (i, p) in pairs.iter().enumerate() {
            if nodes.last() != Some(&p.0) {
                nodes.push(p.0);
                start.push(i as u32);
            }
        }
        start.push(pairs.len() as u32);
        Incidence { nodes, start, ends: pairs.iter().map(|p| p.1).collect() }
    }

    /// Ends that meet at the node in place `k` of the list.
    #[inline]
    pub fn at(&self, k: usize) -> &[T] {
        &self.ends[self.start[k] as usize..self.start[k + 1] as usize]
    }
}

/// For every node with elements of kind `E`: which ends meet there (element x N + side).
#[derive(Resource)]
pub struct EndMap<E: Element<N>, const N: usize> {
    meeting: Incidence<u32>,
    /// True if no element of the kind exerts a force any more.
    rests: bool,
    kind: PhantomData<fn() -> E>,
}

impl<E: Element<N>, const N: usize> EndMap<E, N> {
    fn new(rows: impl Iterator<Item = [u32; N]>) -> Self {
        let ends = rows.enumerate().flat_map(|(e, r)| r.into_iter().enumerate().map(move |(side, row)| (row, (e * N + side) as u32)));
        EndMap { meeting: Incidence::new(ends), rests: false, kind: PhantomData }
    }

    /// Forces of the ends that meet at the node in place `k` of the list.
    #[inline]
    fn at<'a>(&'a self, k: usize, ends: &'a [EndForces<E, N>]) -> impl Iterator<Item = &'a E::Force> {
        self.meeting.at(k).iter().map(|end| &ends[*end as usize / N].0[*end as usize % N])
    }
}

/// Rows and stiffness of an axial spring on offer.
pub type SpringOffer = ([u32; 2], AxialSpring);

/// What one kind of element contributes at the last look: filled by `measure`, read by monitors.
pub struct KindReport {
    /// Scene key of the kind.
    pub name: &'static str,
    /// Number of elements.
    pub count: usize,
    /// Strain energy now.
    pub strain_energy: fn(&mut World) -> f64,
    /// Adds the stiffness bounds to the rows.
    pub stiffness: fn(&mut World, &mut [StiffnessBound]),
    /// Section force of element `i`.
    pub section_force: fn(&mut World, usize) -> Option<SectionForce>,
    /// Rows of element `i`.
    pub rows: fn(&mut World, usize) -> Vec<u32>,
    /// Axial springs that the elements offer, with their rows; `None` for elements without.
    pub springs: fn(&mut World) -> Vec<Option<SpringOffer>>,
    /// Tells the marked elements that their axial spring was taken.
    pub release: fn(&mut World, &[bool]),
    /// Calls back with the rows and section forces of every element, in order.
    pub sections: SectionReport,
}

/// Hands the rows and section forces of elements to a callback.
pub type SectionReport = fn(&mut World, &mut dyn FnMut(&[u32], SectionForce));

/// Reports of all kinds present in the model, in registration order.
#[derive(Resource, Default)]
pub struct KindReports(pub Vec<KindReport>);

pub(crate) fn add_mass<E: Element<N>, const N: usize>(model: &Model, out: &mut [(NodeMass, f64)]) {
    for (e, nodes) in model.elements::<E, N>() {
        for (m, n) in e.mass().iter().zip(nodes) {
            let (sum, length) = &mut out[n.row()];
            sum.mass += m.mass;
            sum.inertia += m.inertia;
            *length = length.max(e.inertia_length());
        }
    }
}

pub(crate) fn install<E: Element<N>, const N: usize>(cx: &mut Install<'_>) {
    let list = cx.model.elements::<E, N>();
    if list.is_empty() {
        return;
    }
    let rows = cx.world.resource::<NodeRows>();
    let bundles: Vec<_> =
        list.iter().map(|(e, nodes)| (e.clone(), Connectivity(nodes.map(|n| rows.of(n) as u32)), EndForces::<E, N>::default())).collect();
    cx.world.insert_resource(EndMap::<E, N>::new(bundles.iter().map(|b| b.1.0)));
    cx.world.spawn_batch(bundles);
    cx.remember::<E>();
    cx.world.get_resource_or_init::<KindReports>().0.push(KindReport {
        name: E::NAME,
        count: list.len(),
        strain_energy: strain_energy::<E, N>,
        stiffness: stiffness::<E, N>,
        section_force: section_force::<E, N>,
        rows: element_rows::<E, N>,
        springs: springs::<E, N>,
        release: release::<E, N>,
        sections: sections::<E, N>,
    });
    if <E::Force as NodeForce>::ROTATIONS {
        cx.add_system(StepSet::ElementForces, rotational_forces::<E, N>);
        cx.add_system(StepSet::Assembly, gather_wrenches::<E, N>);
    } else {
        cx.add_system(StepSet::ElementForces, translational_forces::<E, N>);
        cx.add_system(StepSet::Assembly, gather_forces::<E, N>);
    }
}

/// Elements per parallel chunk: at 20 to 100 ns an element a chunk is worth a hand-over.
const CHUNK: usize = 256;

/// Columns of nodes without rotations.
#[derive(Clone, Copy)]
struct Points<'a> {
    x: &'a [Position],
    v: &'a [Velocity],
}

impl NodeColumns for Points<'_> {
    #[inline(always)]
    fn x(self, row: u32) -> DVec3 {
        self.x[row as usize].0
    }
    #[inline(always)]
    fn v(self, row: u32) -> DVec3 {
        self.v[row as usize].0
    }
    #[inline(always)]
    fn q(self, _: u32) -> DQuat {
        DQuat::IDENTITY
    }
    #[inline(always)]
    fn w(self, _: u32) -> DVec3 {
        DVec3::ZERO
    }
}

/// Columns of nodes with rotations.
#[derive(Clone, Copy)]
struct Sections<'a> {
    points: Points<'a>,
    q: &'a [Orientation],
    w: &'a [AngularVelocity],
}

impl NodeColumns for Sections<'_> {
    #[inline(always)]
    fn x(self, row: u32) -> DVec3 {
        self.points.x(row)
    }
    #[inline(always)]
    fn v(self, row: u32) -> DVec3 {
        self.points.v(row)
    }
    #[inline(always)]
    fn q(self, row: u32) -> DQuat {
        self.q[row as usize].0
    }
    #[inline(always)]
    fn w(self, row: u32) -> DVec3 {
        self.w[row as usize].0
    }
}

fn translational_forces<E: Element<N>, const N: usize>(
    map: Res<EndMap<E, N>>,
    mut nodes: Query<(&Position, &Velocity)>,
    elements: Query<(&mut E, &Connectivity<N>, &mut EndForces<E, N>)>,
) {
    let (x, v) = columns(&mut nodes);
    internal_forces(&map, Points { x, v }, elements);
}

fn rotational_forces<E: Element<N>, const N: usize>(
    map: Res<EndMap<E, N>>,
    mut nodes: Query<(&Position, &Velocity, &Orientation, &AngularVelocity)>,
    elements: Query<(&mut E, &Connectivity<N>, &mut EndForces<E, N>)>,
) {
    let (x, v, q, w) = columns(&mut nodes);
    internal_forces(&map, Sections { points: Points { x, v }, q, w }, elements);
}

fn internal_forces<E: Element<N>, const N: usize>(
    map: &EndMap<E, N>,
    nodes: impl NodeColumns,
    mut elements: Query<(&mut E, &Connectivity<N>, &mut EndForces<E, N>)>,
) {
    if map.rests {
        return;
    }
    let (mut e, c, mut out) = columns(&mut elements);
    parallel::chunks3_mut(e.bypass_change_detection(), c, out.bypass_change_detection(), CHUNK, |e, c, out| {
        E::internal_forces(e, c, nodes, out);
    });
}

fn gather_forces<E: Element<N>, const N: usize>(map: Res<EndMap<E, N>>, mut ends: Query<&EndForces<E, N>>, mut nodes: Query<&mut Force>) {
    if map.rests {
        return;
    }
    let ends = columns(&mut ends);
    let mut force = columns(&mut nodes);
    parallel::picked1(force.bypass_change_detection(), &map.meeting.nodes, CHUNK, |k, _, f| {
        f.0 -= map.at(k, ends).map(|e| e.force()).sum::<DVec3>()
    });
}

fn gather_wrenches<E: Element<N>, const N: usize>(
    map: Res<EndMap<E, N>>,
    mut ends: Query<&EndForces<E, N>>,
    mut nodes: Query<(&mut Force, &mut Moment)>,
) {
    if map.rests {
        return;
    }
    let ends = columns(&mut ends);
    let (mut force, mut moment) = columns(&mut nodes);
    parallel::picked2(force.bypass_change_detection(), moment.bypass_change_detection(), &map.meeting.nodes, CHUNK, |k, _, f, m| {
        let (mut force, mut moment) = (DVec3::ZERO, DVec3::ZERO);
        for e in map.at(k, ends) {
            force += e.force();
            moment += e.moment();
        }
        f.0 -= force;
        m.0 -= moment;
    });
}

/// Calls `f` with every element of a kind, its rows and the states of its nodes.
fn visit<E: Element<N>, const N: usize>(world: &mut World, mut f: impl FnMut(usize, &E, [u32; N], [NodeState; N])) {
    let states = node_states(world);
    let mut query = world.query::<(&E, &Connectivity<N>)>();
    for (i, (e, c)) in query.iter(world).enumerate() {
        f(i, e, c.0, c.0.map(|r| states[r as usize]));
    }
}

/// States of all nodes by row; for monitors and outputs, not for the step.
pub fn node_states(world: &mut World) -> Vec<NodeState> {
    let mut query = world.query::<(&Position, &Velocity, Option<&Orientation>, Option<&AngularVelocity>)>();
    query
        .iter(world)
        .map(|(x, v, q, w)| NodeState { x: x.0, v: v.0, q: q.map_or(DQuat::IDENTITY, |q| q.0), w: w.map_or(DVec3::ZERO, |w| w.0) })
        .collect()
}

/// What `of` says of every element of a kind, from its rows and the states of its nodes; in order, chunk by chunk.
fn survey<E: Element<N>, const N: usize, T: Send>(world: &mut World, of: impl Fn(&E, [u32; N], [NodeState; N]) -> T + Sync) -> Vec<Vec<T>> {
    let states = node_states(world);
    let mut query = world.query::<(&E, &Connectivity<N>)>();
    let mut query = query.query(world);
    let (elements, ends) = columns(&mut query);
    parallel::chunks(elements.len(), CHUNK, |range| {
        elements[range.clone()].iter().zip(&ends[range]).map(|(e, c)| of(e, c.0, c.0.map(|r| states[r as usize]))).collect()
    })
}

fn strain_energy<E: Element<N>, const N: usize>(world: &mut World) -> f64 {
    survey::<E, N, _>(world, |e, _, s| e.strain_energy(s)).iter().flatten().sum()
}

fn stiffness<E: Element<N>, const N: usize>(world: &mut World, out: &mut [StiffnessBound]) {
    let mut query = world.query::<(&Mass, Option<&RotaryInertia>)>();
    let masses: Vec<NodeMass> = query.iter(world).map(|(m, j)| NodeMass { mass: m.0, inertia: j.map_or(0.0, |j| j.0) }).collect();
    let bounds = survey::<E, N, _>(world, |e, rows, s| (rows, e.stiffness_bound(s, rows.map(|r| masses[r as usize]))));
    for (rows, bounds) in bounds.into_iter().flatten() {
        for (row, b) in rows.into_iter().zip(bounds) {
            out[row as usize].translation += b.translation;
            out[row as usize].rotation += b.rotation;
        }
    }
}

fn section_force<E: Element<N>, const N: usize>(world: &mut World, index: usize) -> Option<SectionForce> {
    let mut found = None;
    visit::<E, N>(world, |i, e, _, s| {
        if i == index {
            found = Some(e.section_force(s));
        }
    });
    found
}

fn sections<E: Element<N>, const N: usize>(world: &mut World, each: &mut dyn FnMut(&[u32], SectionForce)) {
    visit::<E, N>(world, |_, e, rows, s| each(&rows, e.section_force(s)));
}

fn element_rows<E: Element<N>, const N: usize>(world: &mut World, index: usize) -> Vec<u32> {
    let mut query = world.query::<(&E, &Connectivity<N>)>();
    query.iter(world).nth(index).map_or(Vec::new(), |(_, c)| c.0.to_vec())
}

fn springs<E: Element<N>, const N: usize>(world: &mut World) -> Vec<Option<SpringOffer>> {
    let mut query = world.query::<(&E, &Connectivity<N>)>();
    query.iter(world).map(|(e, c)| e.axial_spring().map(|s| ([c.0[0], c.0[1]], s))).collect()
}

fn release<E: Element<N>, const N: usize>(world: &mut World, taken: &[bool]) {
    let mut query = world.query::<&mut E>();
    for (mut e, taken) in query.iter_mut(world).zip(taken) {
        if *taken {
            e.release_axial();
        }
    }
    let rests = world.query::<&E>().iter(world).all(E::rests);
    world.resource_mut::<EndMap<E, N>>().rests = rests;
}

/// A source of nodal stiffness that is not an element: adds its bounds to the rows.
pub type StiffnessSource = fn(&mut World, &mut [StiffnessBound]);

/// Stiffness that is not in elements (contacts, surfaces), with a name for the report of the limit.
#[derive(Resource, Default)]
pub struct StiffnessSources(pub Vec<(&'static str, StiffnessSource)>);

/// Stiffness that comes and goes from step to step: its source among the [`StiffnessSources`] is asked before a run only.
#[derive(Resource, Clone, Debug, Default)]
pub struct ActingStiffness {
    /// Name of the source.
    pub name: &'static str,
    /// Rows and what acts at them now, as stiffness over mass (1 / time^2).
    pub rows: Vec<(u32, f64)>,
}

/// Set by a system that has added stiffness since the last look at the time step: look again in
/// this step.
#[derive(Resource, Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub struct StiffnessChanged(pub bool);
