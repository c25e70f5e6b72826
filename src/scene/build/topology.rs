//! Nodes, contact surfaces, constraints.
use super::{Builder, at};
use crate::components::{Equation, NodeId, PeriodicPair, Term, Tie};
use crate::model::{Filament, Node};
use crate::registry::SpecError;
use crate::scene::schema::{PairSpec, Scene};
use crate::scene::spans::Path;
use glam::DVec3;

impl Builder<'_> {
    pub(super) fn add_nodes(&mut self, scene: &Scene) {
        for p in &scene.nodes {
            self.model.add_node(DVec3::from(*p));
        }
        for (name, number) in &scene.node_names {
            let path = at("node_names").key(name);
            if *number as usize >= scene.nodes.len() {
                self.problem(path, format!("node {number} does not exist: the scene has {} nodes, numbered from 0", scene.nodes.len()));
            } else {
                self.model.node_names.insert(name.clone(), NodeId(*number));
            }
        }
        if let Some(periodic) = &scene.periodic {
            for (name, period) in &periodic.dummies {
                let path = at("periodic.dummies").key(name);
                if DVec3::from(*period) == DVec3::ZERO {
                    self.problem(path.clone(), format!("the period vector of dummy node `{name}` is zero"));
                }
                if self.model.node_names.contains_key(name) {
                    self.problem(path, format!("the name `{name}` is taken"));
                }
                let id = self.model.add_node(DVec3::from(*period));
                self.model.nodes[id.row()].dummy = true;
                self.model.node_names.insert(name.clone(), id);
            }
        }
    }

    pub(super) fn add_node_values(&mut self, scene: &Scene) {
        for (i, m) in scene.node_masses.iter().enumerate() {
            let path = at("node_masses").index(i);
            self.not_negative(path.key("mass"), "an added mass", m.mass.0);
            self.not_negative(path.key("inertia"), "an added inertia", m.inertia.0);
            for n in self.nodes(&path.key("nodes"), &m.nodes) {
                let node: &mut Node = &mut self.model.nodes[n.row()];
                node.added_mass += m.mass.0;
                node.added_inertia += m.inertia.0;
            }
        }
        for (i, v) in scene.initial_velocity.iter().enumerate() {
            for n in self.nodes(&at("initial_velocity").index(i).key("nodes"), &v.nodes) {
                let node = &mut self.model.nodes[n.row()];
                node.velocity = DVec3::from(v.velocity);
                node.angular_velocity = DVec3::from(v.angular);
            }
        }
    }

    pub(super) fn add_filaments(&mut self, scene: &Scene) {
        for (i, f) in scene.filaments.iter().enumerate() {
            let path = at("filaments").index(i);
            self.above_zero(path.key("radius"), &format!("contact radius of filament {i}"), f.radius.0);
            let nodes = self.nodes(&path.key("nodes"), &f.nodes);
            let checked = self.with_build(|b| b.check_nodes("nodes", &nodes));
            if self.noted(&path, checked).is_none() {
                continue;
            }
            if nodes.len() < 2 {
                self.problem(path.key("nodes"), format!("a filament needs at least two nodes, {} given", nodes.len()));
                continue;
            }
            let index = self.model.filaments.iter().filter(|g| g.tow == f.tow).count();
            let number = self.model.filaments.len();
            self.sources.push((path, number..number + 1));
            self.model.filaments.push(Filament { nodes, radius: f.radius.0, tow: f.tow, index, closed: false, contact: f.contact });
        }
    }

    pub(super) fn add_constraints(&mut self, scene: &Scene) {
        for (i, t) in scene.ties.iter().enumerate() {
            let path = at("ties").index(i);
            let (embedded, host) = (self.node(&path.key("embedded"), &t.embedded), self.node(&path.key("host"), &t.host));
            let (Some(embedded), Some(host)) = (embedded, host) else { continue };
            let distance = (self.model.nodes[embedded.row()].position - self.model.nodes[host.row()].position).length();
            if embedded == host {
                self.problem(path, format!("node {} is tied to itself", host.0));
            } else if distance > 0.0 {
                let (a, b) = (self.name_of(embedded), self.name_of(host));
                self.problem(path, format!("tied nodes {a} and {b} are not at the same point: they are {distance:.3e} apart"));
            } else {
                self.model.ties.push(Tie { embedded, host });
            }
        }
        for (i, e) in scene.equations.iter().enumerate() {
            let path = at("equations").index(i);
            let mut terms = Vec::new();
            for (k, t) in e.terms.iter().enumerate() {
                let place = path.key("terms").index(k);
                if t.0.0 == 0.0 && k == 0 {
                    self.problem(place.index(0), "the coefficient of the first (dependent) term must not be zero");
                }
                if let Some(node) = self.node(&place.index(1), &t.1) {
                    terms.push(Term { coefficient: t.0.0, node, dof: t.2 });
                }
            }
            if terms.len() == e.terms.len() {
                if terms.is_empty() {
                    self.problem(path.key("terms"), "an equation needs at least one term");
                } else {
                    self.model.equations.push(Equation { terms, constant: e.constant.0 });
                }
            }
        }
        if let Some(p) = &scene.periodic {
            let longest = p.dummies.values().map(|v| DVec3::from(*v).length()).fold(0.0, f64::max);
            let tolerance = p.tolerance.map_or(1e-9 * longest, |t| t.0);
            self.not_negative(at("periodic.tolerance"), "the tolerance of periodic pairs", tolerance);
            for (i, pair) in p.pairs.iter().enumerate() {
                self.add_pair(&at("periodic.pairs").index(i), pair, tolerance);
            }
            if p.matching {
                self.match_pairs(&p.dummies.keys().cloned().collect::<Vec<_>>(), tolerance);
            }
        }
    }

    fn add_pair(&mut self, path: &Path, pair: &PairSpec, tolerance: f64) {
        let (node, image) = (self.node(&path.key("node"), &pair.node), self.node(&path.key("image"), &pair.image));
        let mut dummies = Vec::new();
        for (k, name) in pair.dummies.iter().enumerate() {
            let id = self.model.node_names.get(name).copied().filter(|n| self.model.nodes[n.row()].dummy);
            let known = self.model.node_names.iter().filter(|(_, n)| self.model.nodes[n.row()].dummy).map(|(k, _)| k.as_str());
            let id = id.ok_or_else(|| SpecError::unknown("", "dummy node", name, known));
            dummies.extend(self.noted(&path.key("dummies").index(k), id));
        }
        let (Some(node), Some(image)) = (node, image) else { return };
        if dummies.is_empty() {
            if pair.dummies.is_empty() {
                self.problem(path.key("dummies"), "a periodic pair needs at least one dummy node");
            }
            return;
        }
        let place = |n: NodeId| self.model.nodes[n.row()].position;
        let wanted = place(node) + dummies.iter().map(|d| place(*d)).sum::<DVec3>();
        let distance = (place(image) - wanted).length();
        if distance > tolerance {
            let (a, b) = (self.name_of(node), self.name_of(image));
            let message = format!(
                "periodic pair does not match: node {b} should be at [{}, {}, {}], the period away from node {a}, and is {distance:.3e} away from there",
                wanted.x, wanted.y, wanted.z
            );
            self.problems
                .push(crate::scene::error::Problem::new(path.clone(), message).help(format!("periodic.tolerance is {tolerance:.3e}")));
            return;
        }
        self.model.periodic.push(PeriodicPair { node, image, dummies });
    }

    /// Pairs every node with its images; the independent node is the one that is no image itself,
    /// because sums of more period vectors are tried first.
    fn match_pairs(&mut self, names: &[String], tolerance: f64) {
        let dummies: Vec<NodeId> = names.iter().map(|n| self.model.node_names[n]).collect();
        if dummies.len() > 3 {
            self.problem(at("periodic.dummies"), format!("pairs are matched for at most three dummy nodes, not {}", dummies.len()));
            return;
        }
        let tied: std::collections::BTreeSet<NodeId> = self.model.ties.iter().map(|t| t.embedded).collect();
        let ids: Vec<NodeId> =
            (0..self.model.nodes.len() as u32).map(NodeId).filter(|n| !self.model.nodes[n.row()].dummy && !tied.contains(n)).collect();
        let place = |n: NodeId| self.model.nodes[n.row()].position;
        // Sorted by x, so that a partner is looked for in a narrow slice.
        let mut sorted: Vec<(f64, NodeId)> = ids.iter().map(|n| (place(*n).x, *n)).collect();
        sorted.sort_by(|a, b| a.0.total_cmp(&b.0));
        let find = |p: DVec3| {
            let from = sorted.partition_point(|s| s.0 < p.x - tolerance);
            sorted[from..].iter().take_while(|s| s.0 <= p.x + tolerance).map(|s| s.1).find(|n| (place(*n) - p).length() <= tolerance)
        };
        let mut subsets: Vec<Vec<NodeId>> = (1..1usize << dummies.len())
            .map(|bits| dummies.iter().enumerate().filter(|(k, _)| bits >> k & 1 == 1).map(|(_, d)| *d).collect())
            .collect();
        subsets.sort_by_key(|s: &Vec<NodeId>| std::cmp::Reverse(s.len()));
        let mut pairs = Vec::new();
        for image in &ids {
            for subset in &subsets {
                let shift: DVec3 = subset.iter().map(|d| place(*d)).sum();
                if let Some(node) = find(place(*image) - shift).filter(|n| n != image) {
                    pairs.push(PeriodicPair { node, image: *image, dummies: subset.clone() });
                    break;
                }
            }
        }
        if pairs.is_empty() {
            self.problem(at("periodic.matching"), format!("no node has an image one period away (within {tolerance:.3e})"));
        }
        self.model.periodic.extend(pairs);
    }
}
