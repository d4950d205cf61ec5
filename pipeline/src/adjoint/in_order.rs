//! Adds parts that threads compute in any order in the order of their numbers, so that a sum has the same bits with any number of threads.

use std::collections::BTreeMap;
use std::sync::Mutex;

/// A sum of parts, the first of which has the number 0.
pub(super) struct InOrder<S, P, F> {
    add: F,
    state: Mutex<State<S, P>>,
}

struct State<S, P> {
    sum: S,
    /// Number of the part to be added next.
    next: usize,
    /// Parts whose turn is later: about as many as there are threads.
    later: BTreeMap<usize, P>,
    /// Parts that have been added, for reuse.
    added: Vec<P>,
}

impl<S, P: Default, F: Fn(&mut S, &P)> InOrder<S, P, F> {
    /// `sum`, to which `add` adds a part.
    pub(super) fn new(sum: S, add: F) -> Self {
        let state = State { sum, next: 0, later: BTreeMap::new(), added: Vec::new() };
        Self { add, state: Mutex::new(state) }
    }

    /// Adds part `number` as soon as those before it are; returns a part to reuse.
    pub(super) fn add(&self, number: usize, part: P) -> P {
        let state = &mut *self.state.lock().expect("no panic while held");
        state.later.insert(number, part);
        while let Some(part) = state.later.remove(&state.next) {
            (self.add)(&mut state.sum, &part);
            state.added.push(part);
            state.next += 1;
        }
        state.added.pop().unwrap_or_default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_are_added_in_order() {
        let sum = InOrder::new(Vec::new(), |sum: &mut Vec<u32>, part: &u32| sum.push(*part));
        for number in [2, 0, 3, 1, 5, 4] {
            sum.add(number, number as u32);
        }
        assert_eq!(sum.state.into_inner().unwrap().sum, [0, 1, 2, 3, 4, 5]);
    }
}
