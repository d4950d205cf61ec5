//! A bounded cache that loads nothing twice at once.
//!
//! Threads that ask for a key that another thread is loading wait for it. Beyond the limit the least recently used
//! values leave; a value in use lives on in its `Arc`. A load that fails is forgotten: whoever waited tries again, and
//! meets the error itself.

use std::collections::{BTreeMap, HashMap};
use std::hash::Hash;
use std::sync::{Arc, Condvar, Mutex, MutexGuard};

#[derive(Debug)]
enum Slot<T> {
    Loading,
    Ready { value: Arc<T>, bytes: usize, tick: u64 },
}

#[derive(Debug)]
struct State<T, K> {
    slots: HashMap<K, Slot<T>>,
    by_age: BTreeMap<u64, K>,
    bytes: usize,
    tick: u64,
}

/// Values of type `T` by key, at most `limit` bytes of them.
#[derive(Debug)]
pub struct Cache<T, K: Copy + Eq + Hash = u64> {
    state: Mutex<State<T, K>>,
    changed: Condvar,
    limit: usize,
}

/// Frees the slot of a load that did not come to its end.
struct Claim<'a, T, K: Copy + Eq + Hash>(&'a Cache<T, K>, K);

impl<T, K: Copy + Eq + Hash> Drop for Claim<'_, T, K> {
    fn drop(&mut self) {
        let mut state = self.0.lock();
        if let Some(Slot::Loading) = state.slots.get(&self.1) {
            state.slots.remove(&self.1);
        }
        drop(state);
        self.0.changed.notify_all();
    }
}

impl<T, K: Copy + Eq + Hash> Cache<T, K> {
    /// An empty cache of at most `limit` bytes.
    pub fn new(limit: usize) -> Self {
        let state = State { slots: HashMap::new(), by_age: BTreeMap::new(), bytes: 0, tick: 0 };
        Self { state: Mutex::new(state), changed: Condvar::new(), limit }
    }

    pub(super) fn limit(&self) -> usize {
        self.limit
    }

    /// Whether `key` is here or on its way.
    pub(super) fn has(&self, key: K) -> bool {
        self.lock().slots.contains_key(&key)
    }

    /// The value of `key`, from the cache or from `load`, which also tells its size in bytes.
    ///
    /// # Errors
    /// What `load` says.
    pub fn get<E>(&self, key: K, load: impl FnOnce() -> Result<(T, usize), E>) -> Result<Arc<T>, E> {
        let mut guard = self.lock();
        loop {
            let state = &mut *guard;
            match state.slots.get_mut(&key) {
                Some(Slot::Ready { value, tick, .. }) => {
                    let value = value.clone();
                    state.by_age.remove(tick);
                    state.tick += 1;
                    *tick = state.tick;
                    state.by_age.insert(state.tick, key);
                    return Ok(value);
                }
                Some(Slot::Loading) => {
                    guard = self.changed.wait(guard).expect("no panic while the cache is locked");
                }
                None => break,
            }
        }
        guard.slots.insert(key, Slot::Loading);
        drop(guard);
        let claim = Claim(self, key);
        let (value, bytes) = load()?;
        let value = Arc::new(value);
        self.keep(key, value.clone(), bytes);
        drop(claim);
        Ok(value)
    }

    fn keep(&self, key: K, value: Arc<T>, bytes: usize) {
        let mut guard = self.lock();
        let state = &mut *guard;
        state.tick += 1;
        state.slots.insert(key, Slot::Ready { value, bytes, tick: state.tick });
        state.by_age.insert(state.tick, key);
        state.bytes += bytes;
        while state.bytes > self.limit {
            let Some((_, oldest)) = state.by_age.pop_first() else { break };
            if let Some(Slot::Ready { bytes, .. }) = state.slots.remove(&oldest) {
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
    fn threads_that_ask_at_once_load_once() {
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
    fn the_least_recently_used_value_leaves() {
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
    fn a_failed_load_is_tried_again() {
        let cache: Cache<u8> = Cache::new(8);
        assert_eq!(cache.get(1, || Err("no")).unwrap_err(), "no");
        let panicked = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
            cache.get(1, || -> Result<_, ()> { panic!("in load") })
        }));
        assert!(panicked.is_err());
        assert_eq!(*cache.get(1, || Ok::<_, ()>((7, 1))).unwrap(), 7);
    }
}
