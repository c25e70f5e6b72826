//! Which springs make chains.
use crate::systems::constraint::Constraints;
use braid_ecs::prelude::*;
use std::collections::BTreeMap;

/// One bar of a chain: the rows of its ends, those that carry them, and its spring.
#[derive(Clone, Copy, Debug)]
pub struct Bar {
    pub rows: [u32; 2],
    pub carriers: [u32; 2],
    pub rest_length: f64,
    pub ea: f64,
}

/// One chain of bars, each starting where the one before ends.
#[derive(Clone, Debug, Default)]
pub struct Chain {
    pub bars: Vec<Bar>,
    pub closed: bool,
    /// Rates of stretch per velocity of the border: (bar, member, axis, coefficient with the sign of the end).
    pub couplings: Vec<(usize, usize, usize, f64)>,
}

/// Chains, and which springs are in them.
pub struct Built {
    pub chains: Vec<Chain>,
    pub taken: Vec<bool>,
}

/// Sorts the springs into chains: parallel springs merge, chains end at held nodes and do not run
/// through nodes where more than two bars meet.
pub fn chains(cx: &Install<'_>, springs: &[(usize, usize, [u32; 2], AxialSpring)]) -> Built {
    let constraints = cx.world.get_resource::<Constraints>();
    let carrier = |row: u32| -> Option<usize> {
        match constraints {
            Some(c) => c.carried(row as usize).map(|c| c.carrier),
            None => Some(row as usize),
        }
    };
    // Merge parallel springs: the same two rows.
    let mut merged: BTreeMap<[u32; 2], (f64, f64, Vec<usize>)> = BTreeMap::new();
    let mut taken = vec![false; springs.len()];
    for (s, (_, _, rows, spring)) in springs.iter().enumerate() {
        if carrier(rows[0]).is_some() && carrier(rows[1]).is_some() {
            let key = [rows[0].min(rows[1]), rows[0].max(rows[1])];
            let k = spring.ea / spring.rest_length;
            let entry = merged.entry(key).or_insert((0.0, 0.0, Vec::new()));
            entry.0 += k;
            entry.1 += k * spring.rest_length;
            entry.2.push(s);
        }
    }
    let bars: Vec<([u32; 2], f64, f64, Vec<usize>)> = merged.into_iter().map(|(rows, (k, kl, list))| (rows, k, kl / k, list)).collect();
    let held: Vec<bool> = {
        let entities = &cx.world.resource::<NodeEntities>().0;
        entities.iter().map(|e| cx.world.get::<InverseMass>(*e).is_some_and(|w| w.0 == DVec3::ZERO)).collect()
    };
    let mut at: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for (b, (rows, ..)) in bars.iter().enumerate() {
        for r in rows {
            at.entry(carrier(*r).expect("filtered above")).or_default().push(b);
        }
    }
    // A dummy node that moves on its own, beside a held node, joins bars across the chains: that is left to the
    // explicit scheme.
    let weight = |row: usize, axis: usize| {
        let entity = cx.world.resource::<NodeEntities>().0[row];
        cx.world.get::<InverseMass>(entity).map_or(0.0, |w| w.0[axis])
    };
    let tied = |row: u32| {
        let Some((c, carried)) = constraints.and_then(|c| Some((c, c.carried(row as usize)?))) else { return true };
        carried.dummies.iter().all(|d| (0..3).all(|axis| c.border_member(*d, axis).is_some() || weight(*d, axis) == 0.0))
    };
    let open = |vertex: usize| !held[vertex] && at[&vertex].len() <= 2;
    let usable: Vec<bool> = bars
        .iter()
        .map(|(rows, ..)| {
            let [a, b] = rows.map(|r| carrier(r).expect("filtered above"));
            a != b && (held[a] || open(a)) && (held[b] || open(b)) && rows.iter().all(|r| tied(*r))
        })
        .collect();
    let mut used = vec![false; bars.len()];
    let mut chains = Vec::new();
    // Open chains first, from their ends; what is left are rings.
    for rings in [false, true] {
        for first in 0..bars.len() {
            if used[first] || !usable[first] {
                continue;
            }
            let ends = bars[first].0.map(|r| carrier(r).expect("filtered above"));
            let follows = |vertex: usize, b: usize| at[&vertex].iter().copied().find(|o| *o != b && usable[*o]).filter(|_| open(vertex));
            let start = if rings {
                0
            } else {
                match (follows(ends[0], first), follows(ends[1], first)) {
                    (None, _) => 0,
                    (_, None) => 1,
                    _ => continue,
                }
            };
            let mut list = Vec::new();
            let (mut b, mut from) = (first, ends[start]);
            let closed = loop {
                used[b] = true;
                let (rows, k, rest, parts) = &bars[b];
                let ends = rows.map(|r| carrier(r).expect("filtered above"));
                let flip = ends[0] != from;
                let order = if flip { [rows[1], rows[0]] } else { *rows };
                let carriers = order.map(|r| carrier(r).expect("filtered above"));
                list.push(Bar { rows: order, carriers: carriers.map(|c| c as u32), rest_length: *rest, ea: k * rest });
                for p in parts {
                    taken[*p] = true;
                }
                from = carriers[1];
                match follows(from, b) {
                    Some(next) if !used[next] => b = next,
                    Some(next) => break next == first && list.len() > 2,
                    None => break false,
                }
            };
            chains.push(Chain { bars: list, closed, ..Chain::default() });
        }
    }
    if let Some(c) = constraints {
        for chain in &mut chains {
            couple(chain, c);
        }
    }
    Built { chains, taken }
}

/// Which bars of a chain feel which border members.
fn couple(chain: &mut Chain, constraints: &Constraints) {
    for (i, bar) in chain.bars.iter().enumerate() {
        for (side, sign) in [(0, -1.0), (1, 1.0)] {
            let carried = constraints.carried(bar.rows[side] as usize).expect("chains run through carried rows only");
            for axis in 0..3 {
                for j in 0..constraints.border_len() {
                    let mut coefficient = constraints.response(carried.carrier, axis, j);
                    let (row, member_axis) = constraints.border_dof(j);
                    if member_axis == axis && carried.dummies.contains(&row) {
                        coefficient += 1.0;
                    }
                    if coefficient != 0.0 {
                        chain.couplings.push((i, j, axis, sign * coefficient));
                    }
                }
            }
        }
    }
}
