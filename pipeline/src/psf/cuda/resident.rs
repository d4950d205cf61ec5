//! What lies where in a pool of equal places on the device: least recently used leave first, what is in use stays.

use std::collections::{BTreeMap, HashMap};

/// Places of a pool and who has them.
#[derive(Debug)]
pub(super) struct Resident {
    capacity: usize,
    places: HashMap<usize, (usize, u64)>,
    by_age: BTreeMap<u64, usize>,
    clock: u64,
    /// Whoever asked since then stays.
    since: u64,
}

/// Where a key lies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Place {
    pub(super) index: usize,
    /// It was not there: its place must be filled.
    pub(super) fresh: bool,
}

impl Resident {
    pub(super) fn new(capacity: usize) -> Self {
        Self { capacity, places: HashMap::new(), by_age: BTreeMap::new(), clock: 0, since: 0 }
    }

    /// From now on, what was asked for before may leave.
    pub(super) fn release(&mut self) {
        self.since = self.clock;
    }

    /// A place for `key`; none if all are taken by what was asked for since [`Resident::release`].
    pub(super) fn place(&mut self, key: usize) -> Option<Place> {
        let (index, fresh) = match self.places.get(&key) {
            Some(&(index, age)) => {
                self.by_age.remove(&age);
                (index, false)
            }
            None if self.places.len() < self.capacity => (self.places.len(), true),
            None => {
                let (&age, &oldest) = self.by_age.first_key_value()?;
                if age > self.since {
                    return None;
                }
                self.by_age.remove(&age);
                let (index, _) = self.places.remove(&oldest)?;
                (index, true)
            }
        };
        self.clock += 1;
        self.places.insert(key, (index, self.clock));
        self.by_age.insert(self.clock, key);
        Some(Place { index, fresh })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_oldest_leaves_unless_it_is_in_use() {
        let mut pool = Resident::new(2);
        let mut place = |key, release| {
            if release {
                pool.release();
            }
            pool.place(key).map(|p| (p.index, p.fresh))
        };
        assert_eq!([place(7, false), place(8, false)], [Some((0, true)), Some((1, true))]);
        assert_eq!([place(7, false), place(9, false)], [Some((0, false)), None]);
        assert_eq!(
            [place(9, true), place(7, false), place(8, false)],
            [Some((1, true)), Some((0, false)), None]
        );
    }
}
