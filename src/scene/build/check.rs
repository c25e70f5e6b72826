//! Checks of the finished model: masses, constraints that contradict each other, coincident filaments.
use super::{Builder, at};
use crate::components::{Dof, NodeId};
use crate::element::NodeMass;
use crate::scene::error::Problem;
use crate::scene::schema::Scene;
use crate::scene::spans::{Path, Step};
use std::collections::BTreeMap;

/// One degree of freedom of one node.
type Freedom = (NodeId, Dof);

/// The list and the place in it of a constraint. Generated constraints come after those of the scene.
type Place = (&'static str, usize);

/// What a dependent degree of freedom follows from.
type Dependents = BTreeMap<Freedom, (Place, Vec<Freedom>)>;

fn path_of(place: Place) -> Path {
    at(place.0).index(place.1)
}

impl Builder<'_> {
    pub(super) fn check_model(&mut self, scene: &Scene) {
        if self.model.nodes.is_empty() {
            self.problem(Path::default(), "the scene has no nodes");
            return;
        }
        let dependents = self.dependents();
        self.check_circles(&dependents);
        self.check_held(&dependents);
        if self.problems.is_empty() {
            self.check_masses(scene);
        }
        self.check_coincident();
    }

    /// Every dependent degree of freedom with the place that makes it dependent and what it depends on.
    fn dependents(&mut self) -> Dependents {
        let mut all: Vec<(Freedom, Place, Vec<Freedom>)> = Vec::new();
        for (i, e) in self.model.equations.iter().enumerate() {
            let (first, rest) = e.terms.split_first().expect("equations have terms");
            all.push(((first.node, first.dof), ("equations", i), rest.iter().map(|t| (t.node, t.dof)).collect()));
        }
        for (i, t) in self.model.ties.iter().enumerate() {
            for d in Dof::ALL {
                all.push(((t.embedded, d), ("ties", i), vec![(t.host, d)]));
            }
        }
        for (i, p) in self.model.periodic.iter().enumerate() {
            for d in Dof::ALL {
                let mut on = vec![(p.node, d)];
                if !d.is_rotation() {
                    on.extend(p.dummies.iter().map(|n| (*n, d)));
                }
                all.push(((p.image, d), ("periodic.pairs", i), on));
            }
        }
        let mut dependents: Dependents = BTreeMap::new();
        let mut named = None;
        for (dof, place, on) in all {
            if let Some((other, _)) = dependents.get(&dof) {
                // One message per pair of constraints, not one per degree of freedom.
                if named != Some(place) {
                    let (name, other) = (self.name_of(dof.0), path_of(*other));
                    self.problem(
                        path_of(place),
                        format!("over-constrained: {:?} of node {name} already depends on others by {other}", dof.1),
                    );
                    named = Some(place);
                }
                continue;
            }
            dependents.insert(dof, (place, on));
        }
        dependents
    }

    /// Refuses constraints that run in a circle: the system would have no independent unknown left.
    fn check_circles(&mut self, dependents: &Dependents) {
        // 0 untouched, 1 on the way, 2 done; an explicit stack, since chains may be long.
        let mut state: BTreeMap<Freedom, u8> = BTreeMap::new();
        for start in dependents.keys() {
            let mut way: Vec<(Freedom, usize)> = vec![(*start, 0)];
            if state.contains_key(start) {
                continue;
            }
            state.insert(*start, 1);
            while let Some((here, next)) = way.last_mut() {
                let here = *here;
                let on = &dependents[&here].1;
                let Some(to) = on.get(*next).copied() else {
                    state.insert(here, 2);
                    way.pop();
                    continue;
                };
                *next += 1;
                if !dependents.contains_key(&to) {
                    continue;
                }
                match state.get(&to) {
                    None => {
                        state.insert(to, 1);
                        way.push((to, 0));
                    }
                    Some(1) => {
                        let from = way.iter().position(|w| w.0 == to).expect("a freedom on the way is on the stack");
                        let mut names: Vec<String> = way[from..].iter().map(|w| format!("node {} {:?}", w.0.0.0, w.0.1)).collect();
                        names.push(names[0].clone());
                        let places: Vec<String> = way[from..].iter().map(|w| path_of(dependents[&w.0].0).to_string()).collect();
                        let message = format!("over-constrained: constraints run in a circle: {}", names.join(" -> "));
                        let help = format!("{} together leave only the zero solution; take one of them out", places.join(", "));
                        self.problems.push(Problem::new(path_of(dependents[&here].0), message).help(help));
                        return;
                    }
                    Some(_) => {}
                }
            }
        }
    }

    /// Refuses dependent degrees of freedom that are also fixed or prescribed.
    fn check_held(&mut self, dependents: &Dependents) {
        let fixed = self.model.fixed.iter().flat_map(|f| f.dofs.iter().map(move |d| ((f.node, *d), "fixed")));
        let prescribed = self.model.prescribed.iter().map(|p| ((p.node, p.dof), "prescribed"));
        let mut found = Vec::new();
        let mut seen: BTreeMap<Freedom, &str> = BTreeMap::new();
        for ((node, dof), how) in fixed.chain(prescribed) {
            if let Some((place, on)) = dependents.get(&(node, dof)) {
                let on: Vec<String> = on.iter().map(|(n, d)| format!("{d:?} of node {}", self.name_of(*n))).collect();
                found.push(
                    Problem::new(
                        path_of(*place),
                        format!(
                            "over-constrained: {dof:?} of node {} follows from {} and is also {how}",
                            self.name_of(node),
                            on.join(" and ")
                        ),
                    )
                    .help(format!("hold {} instead, or take the constraint out", on.join(" and "))),
                );
            }
            if let Some(other) = seen.insert((node, dof), how)
                && (other, how) != ("fixed", "fixed")
            {
                found.push(Problem::new(at("prescribed"), format!("{dof:?} of node {} is {other} and also {how}", self.name_of(node))));
            }
        }
        self.problems.extend(found);
    }

    /// Refuses nodes that can move but have no mass.
    fn check_masses(&mut self, scene: &Scene) {
        let masses = self.masses();
        let mut carried = vec![false; masses.len()];
        for t in &self.model.ties {
            carried[t.embedded.row()] = true;
        }
        for p in &self.model.periodic {
            carried[p.image.row()] = true;
            for d in &p.dummies {
                carried[d.row()] = true;
            }
        }
        let mut held = vec![[false; 3]; masses.len()];
        let dependent = self.model.equations.iter().map(|e| (e.terms[0].node, e.terms[0].dof));
        let fixed = self.model.fixed.iter().flat_map(|f| f.dofs.iter().map(move |d| (f.node, *d)));
        let prescribed = self.model.prescribed.iter().map(|p| (p.node, p.dof));
        for (n, d) in dependent.chain(fixed).chain(prescribed).filter(|(_, d)| !d.is_rotation()) {
            held[n.row()][d.axis()] = true;
        }
        // Mass reaches the node that carries a tied node or an image.
        let mut total = masses;
        let host: BTreeMap<NodeId, NodeId> = self.model.ties.iter().map(|t| (t.embedded, t.host)).collect();
        for t in &self.model.ties {
            // Circles of ties were refused before.
            let mut to = t.host;
            while let Some(next) = host.get(&to) {
                to = *next;
            }
            total[to.row()] += total[t.embedded.row()];
        }
        for p in &self.model.periodic {
            total[p.node.row()] += total[p.image.row()];
        }
        for i in 0..total.len() {
            if total[i] > 0.0 || carried[i] || held[i] == [true; 3] {
                continue;
            }
            let node = NodeId(i as u32);
            let name = self.name_of(node);
            let problem = if self.model.nodes[i].dummy {
                Problem::new(at("periodic.dummies"), format!("dummy node {name} can move but no periodic pair refers to it"))
                    .help("fix it, or pair nodes across its period")
            } else {
                let path = if i < scene.nodes.len() { at("nodes").index(i) } else { Path::default() };
                Problem::new(path, format!("node {name} can move but has no mass: no element is attached to it"))
                    .help("attach an element, give it a mass in node_masses, or fix its displacements")
            };
            self.problems.push(problem);
        }
    }

    /// Mass that elements and the scene give to each node.
    pub(super) fn masses(&self) -> Vec<f64> {
        let mut by_node: Vec<(NodeMass, f64)> =
            self.model.nodes.iter().map(|n| (NodeMass { mass: n.added_mass, inertia: n.added_inertia }, 0.0)).collect();
        for kind in &self.registry.elements {
            (kind.add_mass)(&self.model, &mut by_node);
        }
        by_node.iter().map(|(m, _)| m.mass).collect()
    }

    /// Refuses filaments of which a segment lies exactly on a segment of another one.
    fn check_coincident(&mut self) {
        let bits = |n: NodeId| self.model.nodes[n.row()].position.to_array().map(|v| (v + 0.0).to_bits());
        let mut segments: Vec<([[u64; 3]; 2], usize, usize)> = Vec::new();
        for (f, filament) in self.model.filaments.iter().enumerate().filter(|(_, f)| f.contact) {
            for (s, w) in filament.nodes.windows(2).enumerate() {
                let mut ends = [bits(w[0]), bits(w[1])];
                ends.sort();
                segments.push((ends, f, s));
            }
        }
        segments.sort();
        let twice = segments.windows(2).find(|w| w[0].0 == w[1].0 && w[0].1 != w[1].1);
        if let Some([a, b]) = twice {
            let (name_a, name_b) = (self.filament_name(a.1), self.filament_name(b.1));
            let path = self.source(b.1).map_or(Path::default(), |s| s.0);
            self.problems.push(
                Problem::new(
                    path,
                    format!("{name_b} lies exactly on {name_a} (segment {} on segment {}): the contact normal is undefined", b.2, a.2),
                )
                .help("move one of them"),
            );
        }
    }

    /// What to call filament `f` in a message.
    fn filament_name(&self, f: usize) -> String {
        let filament = &self.model.filaments[f];
        match self.source(f) {
            Some((path, n)) if path.to_string().starts_with("filaments") => format!("filament {n}"),
            Some((path, n)) => format!("filament {n} of {path}"),
            None => format!("filament {} of tow {}", filament.index, filament.tow),
        }
    }

    /// The entry of the scene that made filament `f`, and the number of the filament there.
    fn source(&self, f: usize) -> Option<(Path, usize)> {
        let (path, made) = self.sources.iter().find(|(_, made)| made.contains(&f))?;
        let listed = path.0.first() == Some(&Step::Key("filaments".into()));
        let number = if let (true, Some(Step::Index(i))) = (listed, path.0.last()) { *i } else { f - made.start };
        Some((path.clone(), number))
    }
}
