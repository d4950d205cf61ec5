//! Entries of a bounded cache in the order of their last use, with their bytes.

use std::collections::{BTreeMap, HashMap};
use std::hash::Hash;

/// Values by key; which of them are removed, and when, is up to the cache.
#[derive(Debug)]
pub struct Lru<K, V> {
    entries: HashMap<K, Entry<V>>,
    /// Keys by the time of their last use.
    by_age: BTreeMap<u64, K>,
    /// Incremented by each use.
    clock: u64,
    bytes: usize,
}

#[derive(Debug)]
struct Entry<V> {
    value: V,
    last_use: u64,
    bytes: usize,
}

impl<K, V> Default for Lru<K, V> {
    fn default() -> Self {
        Self { entries: HashMap::new(), by_age: BTreeMap::new(), clock: 0, bytes: 0 }
    }
}

impl<K: Copy + Eq + Hash, V> Lru<K, V> {
    /// Number of entries.
    pub fn count(&self) -> usize {
        self.entries.len()
    }

    /// Bytes of all entries.
    pub fn bytes(&self) -> usize {
        self.bytes
    }

    /// Whether `key` has an entry, which is not a use of it.
    pub fn contains(&self, key: K) -> bool {
        self.entries.contains_key(&key)
    }

    /// Uses the entry of `key`.
    pub fn get(&mut self, key: K) -> Option<&V> {
        let entry = self.entries.get_mut(&key)?;
        self.clock += 1;
        self.by_age.remove(&std::mem::replace(&mut entry.last_use, self.clock));
        self.by_age.insert(self.clock, key);
        Some(&entry.value)
    }

    /// Adds an entry of `bytes` for `key`, which has none.
    pub fn insert(&mut self, key: K, value: V, bytes: usize) {
        self.clock += 1;
        self.by_age.insert(self.clock, key);
        self.bytes += bytes;
        self.entries.insert(key, Entry { value, last_use: self.clock, bytes });
    }

    /// Removes the entry whose last use is the longest ago.
    pub fn pop_oldest(&mut self) -> Option<V> {
        let (_, key) = self.by_age.pop_first()?;
        let entry = self.entries.remove(&key)?;
        self.bytes -= entry.bytes;
        Some(entry.value)
    }

    /// Removes the entries whose keys are `unwanted`.
    pub fn remove_where(&mut self, unwanted: impl Fn(K) -> bool) -> Vec<V> {
        let keys: Vec<K> = self.by_age.values().copied().filter(|key| unwanted(*key)).collect();
        let removed = keys.into_iter().filter_map(|key| self.entries.remove(&key));
        let removed: Vec<Entry<V>> = removed.collect();
        for entry in &removed {
            self.by_age.remove(&entry.last_use);
            self.bytes -= entry.bytes;
        }
        removed.into_iter().map(|entry| entry.value).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn entries_are_removed_in_the_order_of_last_use() {
        let mut lru = Lru::default();
        (0..3u64).for_each(|key| lru.insert(key, key * 10, 8));
        assert_eq!((lru.get(0).copied(), lru.get(7).copied()), (Some(0), None));
        assert_eq!((lru.count(), lru.bytes()), (3, 24));
        let removed: Vec<u64> = std::iter::from_fn(|| lru.pop_oldest()).collect();
        assert_eq!((removed, lru.bytes(), lru.contains(0)), (vec![10, 20, 0], 0, false));
    }

    #[test]
    fn unwanted_entries_are_removed() {
        let mut lru = Lru::default();
        (0..6u64).for_each(|key| lru.insert(key, key * 10, 8));
        lru.get(1);
        let mut removed = lru.remove_where(|key| key % 2 == 1);
        removed.sort_unstable();
        assert_eq!((removed, lru.count(), lru.bytes()), (vec![10, 30, 50], 3, 24));
        let left: Vec<u64> = std::iter::from_fn(|| lru.pop_oldest()).collect();
        assert_eq!((left, lru.bytes(), lru.contains(1)), (vec![0, 20, 40], 0, false));
    }
}
