//! Allocation of equal entries in a device buffer: least recently used entries are evicted first, pinned ones never.

use std::collections::{BTreeMap, HashMap};

/// Entries by key.
#[derive(Debug)]
pub(super) struct LruPool {
    capacity: usize,
    /// Index and time of last use of each key.
    entries: HashMap<usize, (usize, u64)>,
    by_last_use: BTreeMap<u64, usize>,
    clock: u64,
    /// Keys used after this time are pinned.
    pinned_after: u64,
}

/// Entry of a key.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct PoolEntry {
    pub(super) index: usize,
    /// Newly allocated: its contents must be computed.
    pub(super) is_new: bool,
}

impl LruPool {
    pub(super) fn new(capacity: usize) -> Self {
        let (entries, by_last_use) = (HashMap::new(), BTreeMap::new());
        Self { capacity, entries, by_last_use, clock: 0, pinned_after: 0 }
    }

    /// Unpins all entries.
    pub(super) fn unpin_all(&mut self) {
        self.pinned_after = self.clock;
    }

    /// The entry of `key`, pinned until [`LruPool::unpin_all`]; none if all entries are pinned by other keys.
    pub(super) fn acquire(&mut self, key: usize) -> Option<PoolEntry> {
        let (index, is_new) = match self.entries.get(&key) {
            Some(&(index, last_use)) => {
                self.by_last_use.remove(&last_use);
                (index, false)
            }
            None if self.entries.len() < self.capacity => (self.entries.len(), true),
            None => {
                let (&last_use, &oldest) = self.by_last_use.first_key_value()?;
                if last_use > self.pinned_after {
                    return None;
                }
                self.by_last_use.remove(&last_use);
                let (index, _) = self.entries.remove(&oldest)?;
                (index, true)
            }
        };
        self.clock += 1;
        self.entries.insert(key, (index, self.clock));
        self.by_last_use.insert(self.clock, key);
        Some(PoolEntry { index, is_new })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn oldest_entry_is_evicted_unless_pinned() {
        let mut pool = LruPool::new(2);
        let mut acquire = |key, unpin| {
            if unpin {
                pool.unpin_all();
            }
            pool.acquire(key).map(|entry| (entry.index, entry.is_new))
        };
        assert_eq!([acquire(7, false), acquire(8, false)], [Some((0, true)), Some((1, true))]);
        assert_eq!([acquire(7, false), acquire(9, false)], [Some((0, false)), None]);
        assert_eq!(
            [acquire(9, true), acquire(7, false), acquire(8, false)],
            [Some((1, true)), Some((0, false)), None]
        );
    }
}
