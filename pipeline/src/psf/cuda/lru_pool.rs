//! Allocation of equal entries in a device buffer: least recently used entries are evicted first, pinned ones never.

/// No entry.
const NONE: u32 = u32::MAX;

/// Entries by key, in arrays: a batch looks up tens of thousands of keys.
#[derive(Debug)]
pub(super) struct LruPool {
    capacity: usize,
    /// Index of the entry of each key, or [`NONE`].
    index_of: Vec<u32>,
    entries: Vec<Entry>,
    /// First and last entry in the order of use.
    oldest: u32,
    newest: u32,
    clock: u64,
    /// Keys used after this time are pinned.
    pinned_after: u64,
}

#[derive(Clone, Copy, Debug)]
struct Entry {
    key: usize,
    last_use: u64,
    /// Neighbours in the order of use.
    older: u32,
    newer: u32,
}

/// Entry of a key.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct PoolEntry {
    pub(super) index: usize,
    /// Newly allocated: its contents must be computed.
    pub(super) is_new: bool,
}

impl LruPool {
    /// `capacity` entries for keys below `keys`.
    pub(super) fn new(capacity: usize, keys: usize) -> Self {
        let (index_of, entries) = (vec![NONE; keys], Vec::with_capacity(capacity.min(keys)));
        Self { capacity, index_of, entries, oldest: NONE, newest: NONE, clock: 0, pinned_after: 0 }
    }

    /// Unpins all entries.
    pub(super) fn unpin_all(&mut self) {
        self.pinned_after = self.clock;
    }

    /// The entry of `key`, pinned until [`LruPool::unpin_all`]; none if all entries are pinned by other keys.
    pub(super) fn acquire(&mut self, key: usize) -> Option<PoolEntry> {
        let found = self.index_of[key];
        let (index, is_new) = match found {
            NONE if self.entries.len() < self.capacity => {
                self.entries.push(Entry { key, last_use: 0, older: NONE, newer: NONE });
                (self.entries.len() as u32 - 1, true)
            }
            NONE => {
                let oldest = self.oldest;
                let entry = self.entries.get_mut(oldest as usize)?;
                if entry.last_use > self.pinned_after {
                    return None;
                }
                self.index_of[entry.key] = NONE;
                entry.key = key;
                self.unlink(oldest);
                (oldest, true)
            }
            index => {
                self.unlink(index);
                (index, false)
            }
        };
        self.index_of[key] = index;
        self.append(index);
        Some(PoolEntry { index: index as usize, is_new })
    }

    /// Removes an entry from the order of use.
    fn unlink(&mut self, index: u32) {
        let Entry { older, newer, .. } = self.entries[index as usize];
        match self.entries.get_mut(older as usize) {
            Some(entry) => entry.newer = newer,
            None => self.oldest = newer,
        }
        match self.entries.get_mut(newer as usize) {
            Some(entry) => entry.older = older,
            None => self.newest = older,
        }
    }

    /// Appends an entry to the order of use.
    fn append(&mut self, index: u32) {
        self.clock += 1;
        let (last_use, older) = (self.clock, self.newest);
        let entry = &mut self.entries[index as usize];
        *entry = Entry { last_use, older, newer: NONE, ..*entry };
        match self.entries.get_mut(older as usize) {
            Some(entry) => entry.newer = index,
            None => self.oldest = index,
        }
        self.newest = index;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn oldest_entry_is_evicted_unless_pinned() {
        let mut pool = LruPool::new(2, 10);
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

    #[test]
    fn entries_of_many_keys_are_those_of_a_plain_list() {
        let mut pool = LruPool::new(5, 12);
        let mut list: Vec<(usize, usize)> = Vec::new(); // (key, index), oldest first
        for step in 0..500usize {
            let key = (step * step + step / 7) % 12;
            pool.unpin_all();
            let entry = pool.acquire(key).unwrap();
            let index = match list.iter().position(|(k, _)| *k == key) {
                Some(at) => list.remove(at).1,
                None if list.len() < 5 => list.len(),
                None => list.remove(0).1,
            };
            assert_eq!(entry.index, index, "step {step}");
            list.push((key, index));
        }
    }
}
