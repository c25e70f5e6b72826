//! Linear multi-point constraints: general equations and periodic pairs, eliminated exactly.
//!
//! With the independent degrees of freedom v and all of them T v: velocities and positions of
//! dependents follow (`follow_velocities`, `impose`), forces go back with the transpose (`condense`), and the mass matrix
//! becomes T^t M T. That matrix is diagonal except for the few independents that share a
//! dependent. A small set of them (the *border*: the dummy node in a periodic cell) covers all the
//! off-diagonal terms, so that the accelerations follow from one small dense Schur complement,
//!
//! S = C - sum_i B_i B_i^t / A_i,  S a_border = f_border - sum_i B_i f_i / A_i,  a_i = (f_i - B_i . a_border) / A_i.
//!
//! `condense` leaves *effective* forces, such that force x inverse mass is the acceleration and the
//! integration needs to know nothing of constraints.
//! Source: S. M. Shephard, *Int. J. Numer. Methods Eng.* 20 (1984) 2107-2121 for the elimination.
use braid_ecs::prelude::*;
use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;

/// Registers equations and periodic pairs.
pub fn plugin(sim: &mut Simulation) {
    sim.add_installer("constraints", install);
}

/// A degree of freedom by row: row x 6 + [`Dof`].
type Index = u32;

fn index(row: usize, dof: usize) -> Index {
    (row * 6 + dof) as Index
}

/// One dependent degree of freedom: u = constant + sum(c_i u_i) over independents.
#[derive(Clone, Debug)]
struct Dependent {
    dof: Index,
    constant: f64,
    /// Its part of [`Constraints::terms`].
    terms: Range<usize>,
    /// True if the position can be imposed and not only the velocity (no rotation involved).
    positional: bool,
}

/// An independent degree of freedom with a diagonal mass, coupled to border members.
#[derive(Clone, Debug)]
struct Interior {
    dof: Index,
    mass: f64,
    /// Its part of [`Constraints::couplings`].
    couplings: Range<usize>,
}

/// The constraints of a model in solved form.
#[derive(Resource, Clone, Debug, Default)]
pub struct Constraints {
    dependents: Vec<Dependent>,
    /// Independents and coefficients of all dependents, one behind the other.
    terms: Vec<(Index, f64)>,
    interior: Vec<Interior>,
    /// Border members and masses that couple the interior to them, one behind the other.
    couplings: Vec<(usize, f64)>,
    border: Vec<Index>,
    /// Diagonal of the border block of T^t M T.
    border_mass: Vec<f64>,
    /// Inverse of the Schur complement, row by row.
    schur_inverse: Vec<f64>,
    /// Velocities that the interior takes from each border member, in order.
    responses: Vec<Vec<(Index, f64)>>,
    /// Initial coordinates of all degrees of freedom.
    initial: Vec<f64>,
    /// All degrees of freedom that take part, sorted, and room for one value of each.
    touched: Vec<Index>,
    scratch: Vec<f64>,
    /// Room for one value of each dependent.
    values: Vec<f64>,
    /// The same lists as above, as places in `touched`.
    local: LocalPlaces,
    /// Images of periodic pairs by row, and rows that take part in general equations.
    images: BTreeMap<usize, Carried>,
    in_equations: BTreeSet<usize>,
    /// Force on each border member after T^t and before the masses are taken into account: its
    /// residual (force).
    pub border_residual: Vec<f64>,
}

#[derive(Clone, Debug, Default)]
struct LocalPlaces {
    dependents: Vec<usize>,
    terms: Vec<usize>,
    interior: Vec<usize>,
    border: Vec<usize>,
}

/// How a row moves, as the implicit axial solve needs it: with the velocity of row `carrier`, plus
/// those of dummy nodes.
#[derive(Clone, Debug, PartialEq)]
pub struct Carried {
    /// The row whose displacements it shares.
    pub carrier: usize,
    /// Rows of the dummy nodes added to it.
    pub dummies: Vec<usize>,
}

impl Constraints {
    /// Number of border members.
    pub fn border_len(&self) -> usize {
        self.border.len()
    }

    /// Row and axis of border member `j`.
    pub fn border_dof(&self, j: usize) -> (usize, usize) {
        (self.border[j] as usize / 6, self.border[j] as usize % 6)
    }

    /// Diagonal of T^t M T for border member `j`.
    pub fn border_mass(&self, j: usize) -> f64 {
        self.border_mass[j]
    }

    /// Entry of the inverse Schur complement: velocity of member `i` per impulse on member `j`.
    pub fn schur_inverse(&self, i: usize, j: usize) -> f64 {
        self.schur_inverse[i * self.border.len() + j]
    }

    /// Velocity of (row, axis) per unit velocity of border member `j` when no other impulse acts.
    pub fn response(&self, row: usize, axis: usize, j: usize) -> f64 {
        let of = &self.responses[j];
        of.binary_search_by_key(&index(row, axis), |r| r.0).map_or(0.0, |k| of[k].1)
    }

    /// The border member that is (row, axis), if it is one.
    pub fn border_member(&self, row: usize, axis: usize) -> Option<usize> {
        self.border.binary_search(&index(row, axis)).ok()
    }

    /// How `row` moves, or `None` if an axial chain cannot run through it: it belongs to a general equation.
    pub fn carried(&self, row: usize) -> Option<Carried> {
        let carried = self.images.get(&row).cloned().unwrap_or(Carried { carrier: row, dummies: Vec::new() });
        let free = |r: &usize| {
            !self.images.contains_key(r) && !self.in_equations.contains(r) && (0..3).all(|axis| self.border_member(*r, axis).is_none())
        };
        free(&carried.carrier).then_some(carried)
    }

    /// Velocity change of every interior degree of freedom (row, dof) per unit of border member `j`.
    pub fn responses(&self, j: usize) -> impl Iterator<Item = (usize, usize, f64)> + '_ {
        self.responses[j].iter().map(|(i, response)| (*i as usize / 6, *i as usize % 6, *response))
    }

    fn terms_of(&self, d: &Dependent) -> &[(Index, f64)] {
        &self.terms[d.terms.clone()]
    }

    fn index_places(&mut self) {
        let mut all: BTreeSet<Index> = self.border.iter().copied().collect();
        all.extend(self.interior.iter().map(|i| i.dof));
        all.extend(self.dependents.iter().map(|d| d.dof));
        all.extend(self.terms.iter().map(|t| t.0));
        self.touched = all.into_iter().collect();
        self.scratch = vec![0.0; self.touched.len()];
        self.values = vec![0.0; self.dependents.len()];
        self.border_residual = vec![0.0; self.border.len()];
        let place = |i: Index| self.touched.binary_search(&i).expect("every degree of freedom is in the list");
        self.local = LocalPlaces {
            dependents: self.dependents.iter().map(|d| place(d.dof)).collect(),
            terms: self.terms.iter().map(|t| place(t.0)).collect(),
            interior: self.interior.iter().map(|i| place(i.dof)).collect(),
            border: self.border.iter().map(|b| place(*b)).collect(),
        };
    }

    /// Turns the raw forces in `scratch` into effective ones (module text).
    fn condense_scratch(&mut self) {
        let f = &mut self.scratch;
        for (d, place) in self.dependents.iter().zip(&self.local.dependents) {
            let value = std::mem::take(&mut f[*place]);
            for ((_, c), t) in self.terms[d.terms.clone()].iter().zip(&self.local.terms[d.terms.clone()]) {
                f[*t] += c * value;
            }
        }
        let n = self.border.len();
        if n == 0 {
            return;
        }
        for (r, b) in self.border_residual.iter_mut().zip(&self.local.border) {
            *r = f[*b];
        }
        let mut rhs = self.border_residual.clone();
        for (i, place) in self.interior.iter().zip(&self.local.interior) {
            for (j, b) in &self.couplings[i.couplings.clone()] {
                rhs[*j] -= b * f[*place] / i.mass;
            }
        }
        let acceleration: Vec<f64> = (0..n).map(|i| (0..n).map(|j| self.schur_inverse[i * n + j] * rhs[j]).sum()).collect();
        for (i, place) in self.interior.iter().zip(&self.local.interior) {
            for (j, b) in &self.couplings[i.couplings.clone()] {
                f[*place] -= b * acceleration[*j];
            }
        }
        for ((b, a), m) in self.local.border.iter().zip(&acceleration).zip(&self.border_mass) {
            f[*b] = a * m;
        }
    }

    /// Row, axis and terms (row x 6 + dof, coefficient) of every dependent displacement.
    pub fn dependent_displacements(&self) -> impl Iterator<Item = (usize, usize, &[(u32, f64)])> + '_ {
        self.dependents.iter().filter(|d| d.dof % 6 < 3).map(|d| (d.dof as usize / 6, d.dof as usize % 6, self.terms_of(d)))
    }

    /// Rows of all dependents, sorted.
    pub fn dependent_rows(&self) -> Vec<usize> {
        let rows: BTreeSet<usize> = self.dependents.iter().map(|d| d.dof as usize / 6).collect();
        rows.into_iter().collect()
    }

    /// T v: fills the dependents of a vector of all degrees of freedom (row x 6 + dof).
    pub fn impose_on(&self, v: &mut [f64]) {
        for d in &self.dependents {
            v[d.dof as usize] = self.terms_of(d).iter().map(|(t, c)| c * v[*t as usize]).sum();
        }
    }

    /// T^t f: moves the dependents of a vector of all degrees of freedom to the independents.
    pub fn condense_on(&self, f: &mut [f64]) {
        for d in &self.dependents {
            let value = std::mem::take(&mut f[d.dof as usize]);
            for (t, c) in self.terms_of(d) {
                f[*t as usize] += c * value;
            }
        }
    }
}

fn install(cx: &mut Install<'_>) {
    if cx.model.equations.is_empty() && cx.model.periodic.is_empty() {
        return;
    }
    let mut constraints = match build(cx) {
        Ok(c) => c,
        Err(message) => {
            cx.world.resource_mut::<Failure>().0 = Some(message);
            return;
        }
    };
    for e in &cx.model.equations {
        cx.world.spawn(e.clone());
    }
    for p in &cx.model.periodic {
        cx.world.spawn(p.clone());
    }
    for p in &cx.model.periodic {
        let carried = Carried { carrier: cx.row(p.node), dummies: p.dummies.iter().map(|d| cx.row(*d)).collect() };
        constraints.images.insert(cx.row(p.image), carried);
    }
    constraints.in_equations =
        cx.model.equations.iter().flat_map(|e| &e.terms).filter(|t| !t.dof.is_rotation()).map(|t| cx.row(t.node)).collect();
    let rotational = constraints.dependents.iter().map(|d| d.dof).chain(constraints.terms.iter().map(|t| t.0)).any(|i| i % 6 >= 3);
    // Independents and border members move with the mass of what hangs on them.
    let mut inverse = vec![];
    for i in &constraints.interior {
        inverse.push((i.dof, 1.0 / i.mass));
    }
    for (d, m) in constraints.border.iter().zip(&constraints.border_mass) {
        inverse.push((*d, 1.0 / m));
    }
    for d in &constraints.dependents {
        inverse.push((d.dof, 0.0));
    }
    let entities = cx.world.resource::<NodeEntities>().0.clone();
    for (d, w) in inverse {
        let mut node = cx.world.entity_mut(entities[d as usize / 6]);
        let dof = d as usize % 6;
        if dof < 3 {
            node.get_mut::<InverseMass>().expect("every node has a mass").0[dof] = w;
        } else {
            node.get_mut::<InverseInertia>().expect("rotations are stored").0[dof - 3] = w;
        }
    }
    cx.world.insert_resource(constraints);
    cx.add_system(StepSet::Constraints, impose);
    if rotational {
        cx.add_system(StepSet::Kinematics, follow_velocities_with_rotations);
        cx.add_system(StepSet::Condensation, condense_with_rotations);
    } else {
        cx.add_system(StepSet::Kinematics, follow_velocities);
        cx.add_system(StepSet::Condensation, condense);
    }
}

/// Terms, constant and name of a solved equation.
type Solved = (Vec<(Index, f64)>, f64, String);

/// One equation before elimination, with the words for messages.
struct Row {
    terms: Vec<(Index, f64)>,
    constant: f64,
    name: String,
}

fn build(cx: &Install<'_>) -> Result<Constraints, String> {
    let rows = cx.world.resource::<NodeRows>();
    let held = &cx.world.resource::<HeldDofs>().0;
    let rotations = cx.rotations();
    let mut equations = Vec::new();
    for (k, p) in cx.model.periodic.iter().enumerate() {
        for dof in 0..if rotations { 6 } else { 3 } {
            let mut terms = vec![(index(rows.of(p.image), dof), 1.0), (index(rows.of(p.node), dof), -1.0)];
            if dof < 3 {
                terms.extend(p.dummies.iter().map(|d| (index(rows.of(*d), dof), -1.0)));
            }
            equations.push(Row { terms, constant: 0.0, name: format!("periodic pair {k} (nodes {} and {})", p.node.0, p.image.0) });
        }
    }
    for (k, e) in cx.model.equations.iter().enumerate() {
        if let Some(t) = e.terms.iter().find(|t| t.dof.is_rotation() && !rotations) {
            return Err(format!(
                "equation {k} uses the rotation {:?} of node {}, but no element of the scene has rotations",
                t.dof, t.node.0
            ));
        }
        let terms = e.terms.iter().map(|t| (index(rows.of(t.node), t.dof as usize), t.coefficient)).collect();
        equations.push(Row { terms, constant: e.constant, name: format!("equation {k}") });
    }
    let word = |i: Index| format!("{:?} of node {}", Dof::ALL[i as usize % 6], rows.id(i as usize / 6).0);
    let is_held = |i: Index| held[i as usize / 6][i as usize % 6];

    let mut solved: BTreeMap<Index, Solved> = BTreeMap::new();
    for eq in equations {
        let mut sum: BTreeMap<Index, f64> = BTreeMap::new();
        let mut constant = eq.constant;
        let mut through = Vec::new();
        for (t, c) in &eq.terms {
            match solved.get(t) {
                Some((terms, c0, name)) => {
                    for (u, cu) in terms {
                        *sum.entry(*u).or_default() += c * cu;
                    }
                    constant -= c * c0;
                    through.push(name.clone());
                }
                None => *sum.entry(*t).or_default() += c,
            }
        }
        let scale = eq.terms.iter().fold(0.0f64, |m, t| m.max(t.1.abs()));
        sum.retain(|_, c| c.abs() > 1e-12 * scale);
        let chain = || {
            let mut names = vec![eq.name.clone()];
            names.extend(through.iter().cloned());
            names.dedup();
            names.join(", ")
        };
        if sum.is_empty() {
            if constant.abs() > 1e-12 * scale {
                return Err(format!("over-constrained: {} contradict each other (0 = {constant})", chain()));
            }
            continue; // the same equation twice
        }
        if sum.len() == 1 && eq.terms.len() > 1 && through.len() + 1 > 1 && !is_held(*sum.keys().next().expect("one term")) {
            let (i, _) = sum.iter().next().expect("one term");
            return Err(format!("over-constrained: {} run in a cycle that has only the zero solution for the {}", chain(), word(*i)));
        }
        let first = eq.terms[0].0;
        let candidate = if sum.contains_key(&first) && !is_held(first) {
            Some(first)
        } else {
            eq.terms.iter().map(|t| t.0).chain(sum.keys().copied()).find(|t| sum.contains_key(t) && !is_held(*t))
        };
        let Some(dependent) = candidate else {
            return Err(format!(
                "over-constrained: in {} every degree of freedom is already held by a support or a prescribed motion ({})",
                eq.name,
                eq.terms.iter().map(|t| word(t.0)).collect::<Vec<_>>().join(", ")
            ));
        };
        let c = sum.remove(&dependent).expect("the dependent is one of the terms");
        let terms: Vec<(Index, f64)> = sum.into_iter().map(|(t, ct)| (t, -ct / c)).collect();
        let c0 = constant / c;
        for (others, oc, _) in solved.values_mut() {
            if let Some(at) = others.iter().position(|o| o.0 == dependent) {
                let (_, factor) = others.remove(at);
                *oc += factor * c0;
                for (t, ct) in &terms {
                    match others.iter_mut().find(|o| o.0 == *t) {
                        Some(o) => o.1 += factor * ct,
                        None => others.push((*t, factor * ct)),
                    }
                }
                others.sort_unstable_by_key(|o| o.0);
            }
        }
        solved.insert(dependent, (terms, c0, eq.name));
    }
    for p in &cx.model.prescribed {
        let d = index(rows.of(p.node), p.dof as usize);
        if solved.contains_key(&d) {
            return Err(format!("the prescribed {} is also a dependent of {}", word(d), solved[&d].2));
        }
    }
    let mut terms = Vec::new();
    let dependents: Vec<Dependent> = solved
        .into_iter()
        .map(|(dof, (own, constant, _))| {
            let positional = dof % 6 < 3 && own.iter().all(|t| t.0 % 6 < 3);
            Dependent { dof, constant, terms: appended(&mut terms, own), positional }
        })
        .collect();
    let (masses, initial) = masses_and_positions(cx, rotations);
    let is_dummy = |i: Index| cx.model.nodes[rows.id(i as usize / 6).row()].dummy;
    reduce_mass(dependents, terms, &masses, initial, is_held, is_dummy, word)
}

/// Puts some behind all the others; returns where they are.
fn appended<T>(all: &mut Vec<T>, some: impl IntoIterator<Item = T>) -> Range<usize> {
    let from = all.len();
    all.extend(some);
    from..all.len()
}

/// Mass of every degree of freedom by index, and initial coordinates of the displacements.
fn masses_and_positions(cx: &Install<'_>, rotations: bool) -> (Vec<f64>, Vec<f64>) {
    let entities = &cx.world.resource::<NodeEntities>().0;
    let (mut masses, mut initial) = (Vec::with_capacity(entities.len() * 6), Vec::with_capacity(entities.len() * 6));
    for &e in entities {
        let m = cx.world.get::<Mass>(e).expect("nodes have a mass").0;
        let x = cx.world.get::<InitialPosition>(e).expect("nodes have a position").0;
        let j = if rotations { cx.world.get::<RotaryInertia>(e).expect("rotations are stored").0 } else { 0.0 };
        masses.extend([m, m, m, j, j, j]);
        initial.extend([x.x, x.y, x.z, 0.0, 0.0, 0.0]);
    }
    (masses, initial)
}

/// T^t M T, split into interior and border, and the inverse of the Schur complement.
fn reduce_mass(
    dependents: Vec<Dependent>,
    terms: Vec<(Index, f64)>,
    masses: &[f64],
    initial: Vec<f64>,
    is_held: impl Fn(Index) -> bool,
    is_dummy: impl Fn(Index) -> bool,
    word: impl Fn(Index) -> String,
) -> Result<Constraints, String> {
    let mut matrix: BTreeMap<(Index, Index), f64> = BTreeMap::new();
    for d in &dependents {
        let free: Vec<_> = terms[d.terms.clone()].iter().filter(|t| !is_held(t.0)).collect();
        for (i, ci) in &free {
            matrix.entry((*i, *i)).or_insert_with(|| masses[*i as usize]);
            for (j, cj) in &free {
                *matrix.entry((*i, *j)).or_insert_with(|| if i == j { masses[*i as usize] } else { 0.0 }) +=
                    ci * cj * masses[d.dof as usize];
            }
        }
    }
    // Vertex cover of the off-diagonal couplings: dummy nodes first, then greedily by degree. An
    // axial chain can run through a node that is not in the border.
    let mut edges: BTreeSet<(Index, Index)> = matrix.iter().filter(|((i, j), m)| i < j && **m != 0.0).map(|(k, _)| *k).collect();
    let mut border: Vec<Index> = Vec::new();
    for (i, j) in edges.clone() {
        for d in [i, j] {
            if is_dummy(d) && !border.contains(&d) {
                border.push(d);
                edges.retain(|(i, j)| *i != d && *j != d);
            }
        }
    }
    while !edges.is_empty() {
        let mut degree: BTreeMap<Index, usize> = BTreeMap::new();
        for (i, j) in &edges {
            *degree.entry(*i).or_default() += 1;
            *degree.entry(*j).or_default() += 1;
        }
        let (&most, _) = degree.iter().max_by_key(|(i, d)| (**d, std::cmp::Reverse(**i))).expect("edges have ends");
        border.push(most);
        edges.retain(|(i, j)| *i != most && *j != most);
    }
    border.sort_unstable();
    let place = |i: Index| border.binary_search(&i).ok();
    let n = border.len();
    let (mut interior, mut couplings) = (Vec::new(), Vec::new());
    for ((i, j), m) in &matrix {
        if i == j && place(*i).is_none() {
            if *m <= 0.0 {
                return Err(format!("the {} can move but has no mass", word(*i)));
            }
            let own = matrix
                .range((*i, 0)..=(*i, Index::MAX))
                .filter(|((_, k), m)| k != i && **m != 0.0)
                .map(|((_, k), m)| (place(*k).expect("the border covers every coupling"), *m));
            interior.push(Interior { dof: *i, mass: *m, couplings: appended(&mut couplings, own) });
        }
    }
    let mut schur = vec![0.0; n * n];
    for (a, i) in border.iter().enumerate() {
        for (b, j) in border.iter().enumerate() {
            schur[a * n + b] = matrix.get(&(*i, *j)).copied().unwrap_or(0.0);
        }
    }
    let border_mass: Vec<f64> = (0..n).map(|a| schur[a * n + a]).collect();
    for i in &interior {
        let own = &couplings[i.couplings.clone()];
        for (a, ma) in own {
            for (b, mb) in own {
                schur[a * n + b] -= ma * mb / i.mass;
            }
        }
    }
    let schur_inverse =
        invert(schur, n).ok_or_else(|| format!("the {} can move but has no mass", border.first().map_or(String::new(), |b| word(*b))))?;
    let mut responses = vec![Vec::new(); n];
    for i in &interior {
        for (j, b) in &couplings[i.couplings.clone()] {
            responses[*j].push((i.dof, -b / i.mass));
        }
    }
    let mut constraints = Constraints {
        dependents,
        terms,
        interior,
        couplings,
        border,
        border_mass,
        schur_inverse,
        responses,
        initial,
        ..Default::default()
    };
    constraints.index_places();
    Ok(constraints)
}

/// Inverse of a small symmetric positive definite matrix by Gauss-Jordan; `None` if it is not.
fn invert(mut a: Vec<f64>, n: usize) -> Option<Vec<f64>> {
    let mut inv = vec![0.0; n * n];
    for i in 0..n {
        inv[i * n + i] = 1.0;
    }
    for k in 0..n {
        let pivot = a[k * n + k];
        if pivot <= 0.0 || !pivot.is_finite() {
            return None;
        }
        for j in 0..n {
            a[k * n + j] /= pivot;
            inv[k * n + j] /= pivot;
        }
        for i in 0..n {
            let f = a[i * n + k];
            if i != k && f != 0.0 {
                for j in 0..n {
                    a[i * n + j] -= f * a[k * n + j];
                    inv[i * n + j] -= f * inv[k * n + j];
                }
            }
        }
    }
    Some(inv)
}

/// Dependents and places per parallel chunk: most of the time goes to fetching their rows.
const CHUNK: usize = 1024;

/// Row and degree of freedom of an index.
#[inline(always)]
fn place(i: Index) -> (usize, usize) {
    (i as usize / 6, i as usize % 6)
}

impl Constraints {
    /// Finds what `of` makes of each dependent and its terms.
    fn derive(&mut self, of: impl Fn(&Constraints, &Dependent, &[(Index, f64)]) -> f64 + Sync) {
        let mut values = std::mem::take(&mut self.values);
        parallel::zip2(&mut values, &self.dependents, CHUNK, |value, d| *value = of(self, d, self.terms_of(d)));
        self.values = values;
    }

    /// The sum of the terms of each dependent; `get` knows the independents by row and degree of freedom.
    fn derive_sums(&mut self, get: impl Fn((usize, usize)) -> f64 + Sync) {
        self.derive(|_, _, terms| terms.iter().map(|(t, c)| c * get(place(*t))).sum());
    }

    /// The dependents, with what was found of them.
    fn derived(&self) -> impl Iterator<Item = (&Dependent, f64)> {
        self.dependents.iter().zip(self.values.iter().copied())
    }

    /// Turns the forces of all that take part, by row and degree of freedom, into effective ones.
    fn condense_with(&mut self, get: impl Fn((usize, usize)) -> f64 + Sync) {
        parallel::zip2(&mut self.scratch, &self.touched, CHUNK, |local, i| *local = get(place(*i)));
        self.condense_scratch();
    }

    /// All that take part, with their effective forces.
    fn condensed(&self) -> impl Iterator<Item = ((usize, usize), f64)> {
        self.touched.iter().map(|i| place(*i)).zip(self.scratch.iter().copied())
    }
}

/// Dependents take their velocities before anything moves, so that orientations and positions of
/// independents and dependents are integrated over the same step.
fn follow_velocities(mut constraints: ResMut<Constraints>, mut nodes: Query<&mut Velocity>) {
    let mut v = columns(&mut nodes);
    let v = v.bypass_change_detection();
    constraints.derive_sums(|(row, k)| v[row].0[k]);
    for (d, value) in constraints.derived() {
        let (row, k) = place(d.dof);
        v[row].0[k] = value;
    }
}

fn follow_velocities_with_rotations(mut constraints: ResMut<Constraints>, mut nodes: Query<(&mut Velocity, &mut AngularVelocity)>) {
    let (mut v, mut w) = columns(&mut nodes);
    let (v, w) = (v.bypass_change_detection(), w.bypass_change_detection());
    constraints.derive_sums(|(row, k)| if k < 3 { v[row].0[k] } else { w[row].0[k - 3] });
    for (d, value) in constraints.derived() {
        match place(d.dof) {
            (row, k @ ..3) => v[row].0[k] = value,
            (row, k) => w[row].0[k - 3] = value,
        }
    }
}

/// Positions of dependents from those of the independents: the equation holds to rounding for ever.
fn impose(mut constraints: ResMut<Constraints>, mut nodes: Query<&mut Position>) {
    let mut x = columns(&mut nodes);
    let x = x.bypass_change_detection();
    constraints.derive(|all, d, terms| {
        let moved = |(t, c): &(Index, f64)| {
            let (row, k) = place(*t);
            c * (x[row].0[k] - all.initial[*t as usize])
        };
        if d.positional { all.initial[d.dof as usize] + terms.iter().fold(d.constant, |u, t| u + moved(t)) } else { 0.0 }
    });
    for (d, value) in constraints.derived().filter(|(d, _)| d.positional) {
        let (row, k) = place(d.dof);
        x[row].0[k] = value;
    }
}

fn condense(mut constraints: ResMut<Constraints>, mut nodes: Query<&mut Force>) {
    let mut f = columns(&mut nodes);
    let f = f.bypass_change_detection();
    constraints.condense_with(|(row, k)| f[row].0[k]);
    for ((row, k), value) in constraints.condensed() {
        f[row].0[k] = value;
    }
}

fn condense_with_rotations(mut constraints: ResMut<Constraints>, mut nodes: Query<(&mut Force, &mut Moment)>) {
    let (mut f, mut m) = columns(&mut nodes);
    let (f, m) = (f.bypass_change_detection(), m.bypass_change_detection());
    constraints.condense_with(|(row, k)| if k < 3 { f[row].0[k] } else { m[row].0[k - 3] });
    for (at, value) in constraints.condensed() {
        match at {
            (row, k @ ..3) => f[row].0[k] = value,
            (row, k) => m[row].0[k - 3] = value,
        }
    }
}
