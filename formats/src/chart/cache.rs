//! A bounded least-recently-used cache that loads each value once.
//!
//! Requests for a key that another thread is loading wait for it. Evicted values that are still in use stay valid (`Arc`). A failed load
//! is not cached: threads that waited for it load again and get the error themselves.

use std::collections::{BTreeMap, HashMap};
use std::hash::Hash;
use std::sync::{Arc, Condvar, Mutex, MutexGuard};

#[derive(Debug)]
enum Entry<T> {
    Loading,
    Ready { value: Arc<T>, bytes: usize, tick: u64 },
}

#[derive(Debug)]
struct State<T, K> {
    entries: HashMap<K, Entry<T>>,
    /// Keys by the tick of their last use.
    by_age: BTreeMap<u64, K>,
    bytes: usize,
    /// Incremented by each use.
    tick: u64,
}

/// Values of type `T` by key, at most `limit` bytes of them.
#[derive(Debug)]
pub struct Cache<T, K: Copy + Eq + Hash = u64> {
    state: Mutex<State<T, K>>,
    changed: Condvar,
    limit: usize,
}

/// Removes the entry of a load that failed or panicked.
struct Loading<'a, T, K: Copy + Eq + Hash>(&'a Cache<T, K>, K);

impl<T, K: Copy + Eq + Hash> Drop for Loading<'_, T, K> {
    fn drop(&mut self) {
        let mut state = self.0.lock();
        if let Some(Entry::Loading) = state.entries.get(&self.1) {
            state.entries.remove(&self.1);
        }
        drop(state);
        self.0.changed.notify_all();
    }
}

impl<T, K: Copy + Eq + Hash> Cache<T, K> {
    /// An empty cache of at most `limit` bytes.
    pub fn new(limit: usize) -> Self {
        let state = State { entries: HashMap::new(), by_age: BTreeMap::new(), bytes: 0, tick: 0 };
        Self { state: Mutex::new(state), changed: Condvar::new(), limit }
    }

    pub(super) fn limit(&self) -> usize {
        self.limit
    }

    /// Whether `key` is cached or being loaded.
    pub(super) fn contains(&self, key: K) -> bool {
        self.lock().entries.contains_key(&key)
    }

    /// The value of `key`, from the cache or from `load`, which returns it with its size in bytes.
    ///
    /// # Errors
    /// Those of `load`.
    pub fn get<E>(&self, key: K, load: impl FnOnce() -> Result<(T, usize), E>) -> Result<Arc<T>, E> {
        let mut guard = self.lock();
        loop {
            let state = &mut *guard;
            match state.entries.get_mut(&key) {
                Some(Entry::Ready { value, tick, .. }) => {
                    let value = value.clone();
                    state.by_age.remove(tick);
                    state.tick += 1;
                    *tick = state.tick;
                    state.by_age.insert(state.tick, key);
                    return Ok(value);
                }
                Some(Entry::Loading) => {
                    guard = self.changed.wait(guard).expect("no panic while the cache is locked");
                }
                None => break,
            }
        }
        guard.entries.insert(key, Entry::Loading);
        drop(guard);
        let loading = Loading(self, key);
        let (value, bytes) = load()?;
        let value = Arc::new(value);
        self.insert(key, value.clone(), bytes);
        drop(loading);
        Ok(value)
    }

    fn insert(&self, key: K, value: Arc<T>, bytes: usize) {
        let mut guard = self.lock();
        let state = &mut *guard;
        state.tick += 1;
        state.entries.insert(key, Entry::Ready { value, bytes, tick: state.tick });
        state.by_age.insert(state.tick, key);
        state.bytes += bytes;
        while state.bytes > self.limit {
            let Some((_, oldest)) = state.by_age.pop_first() else { break };
            if let Some(Entry::Ready { bytes, .. }) = state.entries.remove(&oldest) {
                state.bytes -= bytes;
            }
        }
    }

    fn lock(&self) -> MutexGuard<'_, State<T, K>> {
        self.state.lock().expect("no panic while the cache is locked")
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicUsize, Ordering};

    use super::*;

    #[test]
    fn concurrent_requests_load_each_key_once() {
        let (cache, loads) = (Cache::new(1 << 20), AtomicUsize::new(0));
        std::thread::scope(|s| {
            for _ in 0..16 {
                s.spawn(|| {
                    for key in 0..50 {
                        let v = cache.get(key, || {
                            loads.fetch_add(1, Ordering::Relaxed);
                            std::thread::sleep(std::time::Duration::from_micros(100));
                            Ok::<_, ()>((key * 3, 8))
                        });
                        assert_eq!(*v.unwrap(), key * 3);
                    }
                });
            }
        });
        assert_eq!(loads.into_inner(), 50);
    }

    #[test]
    fn least_recently_used_value_is_evicted() {
        let cache = Cache::new(24);
        let loaded = |key| {
            let mut loaded = false;
            cache
                .get(key, || {
                    loaded = true;
                    Ok::<_, ()>((key, 8))
                })
                .unwrap();
            loaded
        };
        assert!(loaded(1) && loaded(2) && loaded(3) && !loaded(1) && loaded(4));
        assert!(!loaded(1) && !loaded(3) && loaded(2));
    }

    #[test]
    fn failed_or_panicked_load_is_retried() {
        let cache: Cache<u8> = Cache::new(8);
        assert_eq!(cache.get(1, || Err("no")).unwrap_err(), "no");
        let panicked = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
            cache.get(1, || -> Result<_, ()> { panic!("in load") })
        }));
        assert!(panicked.is_err());
        assert_eq!(*cache.get(1, || Ok::<_, ()>((7, 1))).unwrap(), 7);
    }
}
