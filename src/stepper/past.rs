//! The way back: saved states from which any earlier step is made again, with the same bits.

/// Steps between two saved states, while they are recent.
const SPACING: u64 = 32;
/// Saved states of one spacing; older ones lie twice as far apart, and so on.
const EACH: u64 = 8;
/// Largest memory of all saved states (bytes); beyond it the oldest go.
const LARGEST: usize = 512 << 20;

/// The state at the end of a step.
pub struct Saved {
    /// The step.
    pub step: u64,
    /// The state.
    pub state: Vec<u8>,
    /// Kept whatever its age: the start, and where somebody changed something.
    pinned: bool,
}

/// Saved states in the order of their steps.
#[derive(Default)]
pub struct Past {
    list: Vec<Saved>,
}

/// True if the state of `step` is kept when the run has come to `now`.
fn keeps(step: u64, now: u64) -> bool {
    let generations = (now - step) / (SPACING * EACH);
    let level = if generations == 0 { 0 } else { generations.ilog2() + 1 };
    step.is_multiple_of(SPACING << level)
}

impl Past {
    /// True if the state of this step is to be saved.
    pub fn wants(&self, step: u64) -> bool {
        step.is_multiple_of(SPACING) && self.list.last().is_none_or(|s| s.step < step)
    }

    /// Keeps a state; one of the same step is replaced, later ones are forgotten.
    pub fn keep(&mut self, step: u64, state: Vec<u8>, pinned: bool) {
        let pinned = pinned || self.list.iter().any(|s| s.step == step && s.pinned);
        self.list.retain(|s| s.step < step && (s.pinned || keeps(s.step, step)));
        self.list.push(Saved { step, state, pinned });
        while self.bytes() > LARGEST
            && let Some(oldest) = self.list.iter().position(|s| !s.pinned)
        {
            self.list.remove(oldest);
        }
    }

    /// Forgets what comes after this step.
    pub fn cut(&mut self, step: u64) {
        self.list.retain(|s| s.step <= step);
    }

    /// The last state at or before this step.
    pub fn before(&self, step: u64) -> Option<&Saved> {
        self.list.iter().rev().find(|s| s.step <= step)
    }

    /// Number of states.
    pub fn len(&self) -> usize {
        self.list.len()
    }

    /// Memory of all states (bytes).
    pub fn bytes(&self) -> usize {
        self.list.iter().map(|s| s.state.len()).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn old_states_get_fewer_and_the_start_stays() {
        let mut past = Past::default();
        past.keep(0, vec![0], true);
        for step in 1..=100_000 {
            if past.wants(step) {
                past.keep(step, vec![0], false);
            }
        }
        assert!(past.len() < 120, "{}", past.len());
        assert_eq!(past.before(0).expect("the start").step, 0);
        // A step back from here is made again from close by, one far back from not too far.
        assert_eq!(past.before(99_999).expect("recent").step, 99_968);
        assert!(50_000 - past.before(50_000).expect("old").step <= SPACING << 8);
        past.cut(99_000);
        assert!(past.before(u64::MAX).expect("some").step <= 99_000 && past.wants(99_008));
    }
}
