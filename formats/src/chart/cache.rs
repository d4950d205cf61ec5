//! A bounded least-recently-used cache that loads each value once.
//!
//! Requests for a key that another thread is loading wait for it. Evicted values that are still in use stay valid (`Arc`). A failed load
//! is not cached: threads that waited for it load again and get the error themselves.

use std::collections::HashSet;
use std::hash::Hash;
use std::sync::{Arc, Condvar, Mutex, MutexGuard};

use pipeline::lru::Lru;

#[derive(Debug)]
struct State<T, K> {
    ready: Lru<K, Arc<T>>,
    loading: HashSet<K>,
}

/// Values of type `T` by key, at most `limit` bytes of them.
#[derive(Debug)]
pub struct Cache<T, K: Copy + Eq + Hash = u64> {
    state: Mutex<State<T, K>>,
    changed: Condvar,
    limit: usize,
}

/// Ends a load, also one that failed or panicked.
struct Loading<'a, T, K: Copy + Eq + Hash>(&'a Cache<T, K>, K);

impl<T, K: Copy + Eq + Hash> Drop for Loading<'_, T, K> {
    fn drop(&mut self) {
        self.0.lock().loading.remove(&self.1);
        self.0.changed.notify_all();
    }
}

impl<T, K: Copy + Eq + Hash> Cache<T, K> {
    /// An empty cache of at most `limit` bytes.
    pub fn new(limit: usize) -> Self {
        let state = State { ready: Lru::default(), loading: HashSet::new() };
        Self { state: Mutex::new(state), changed: Condvar::new(), limit }
    }

    pub(super) fn limit(&self) -> usize {
        self.limit
    }

    /// Whether `key` is cached or being loaded.
    pub(super) fn contains(&self, key: K) -> bool {
        let state = self.lock();
        state.ready.contains(key) || state.loading.contains(&key)
    }

    /// The value of `key`, from the cache or from `load`, which returns it with its size in bytes.
    ///
    /// # Errors
    /// Those of `load`.
    pub fn get<E>(&self, key: K, load: impl FnOnce() -> Result<(T, usize), E>) -> Result<Arc<T>, E> {
        let mut state = self.lock();
        loop {
            if let Some(value) = state.ready.get(key) {
                return Ok(Arc::clone(value));
            }
            if state.loading.insert(key) {
                break;
            }
            state = self.changed.wait(state).expect("no panic while the cache is locked");
        }
        drop(state);
        let _loading = Loading(self, key);
        let (value, bytes) = load()?;
        let value = Arc::new(value);
        self.insert(key, Arc::clone(&value), bytes);
        Ok(value)
    }

    fn insert(&self, key: K, value: Arc<T>, bytes: usize) {
        let mut state = self.lock();
        state.ready.insert(key, value, bytes);
        while state.ready.bytes() > self.limit && state.ready.pop_oldest().is_some() {}
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
