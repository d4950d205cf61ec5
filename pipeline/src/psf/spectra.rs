//! Node spectra on demand: built where a tile first needs them, kept along the tiles' path in a bounded cache.
//!
//! A spectrum is a pure function of the band and the node, so what is evicted and built again has the same bits. Two
//! workers that need one node at once build it once: the second waits for the first.

use crate::buffer::AlignedBuf;
use std::collections::{BTreeMap, HashMap};
use std::sync::{Arc, Mutex, OnceLock};

/// (band index, node id).
pub type Key = (usize, usize);

type Slot = Arc<OnceLock<Arc<AlignedBuf>>>;

/// Least-recently-used cache of spectra, bounded in bytes.
#[derive(Debug)]
pub struct SpectrumCache {
    limit: usize,
    state: Mutex<State>,
}

#[derive(Debug, Default)]
struct State {
    slots: HashMap<Key, (Slot, u64, usize)>,
    by_age: BTreeMap<u64, Key>,
    clock: u64,
    bytes: usize,
    built: u64,
}

impl SpectrumCache {
    /// A cache of at most `limit` bytes. Spectra in use live on beyond it.
    pub fn new(limit: usize) -> Self {
        Self { limit, state: Mutex::default() }
    }

    /// The spectrum of `key` of `bytes`, built by `build` if it is not there.
    pub fn get(&self, key: Key, bytes: usize, build: impl FnOnce() -> AlignedBuf) -> Arc<AlignedBuf> {
        let slot = {
            let mut guard = self.state.lock().expect("no panic while held");
            let state = &mut *guard;
            state.clock += 1;
            let now = state.clock;
            match state.slots.get_mut(&key) {
                Some((slot, age, _)) => {
                    state.by_age.remove(&std::mem::replace(age, now));
                    state.by_age.insert(now, key);
                    Arc::clone(slot)
                }
                None => {
                    let slot = Slot::default();
                    state.slots.insert(key, (Arc::clone(&slot), now, bytes));
                    state.by_age.insert(now, key);
                    state.bytes += bytes;
                    state.built += 1;
                    while state.bytes > self.limit && state.by_age.len() > 1 {
                        let (_, oldest) = state.by_age.pop_first().expect("not empty");
                        let (_, _, bytes) = state.slots.remove(&oldest).expect("in both maps");
                        state.bytes -= bytes;
                    }
                    slot
                }
            }
        };
        Arc::clone(slot.get_or_init(|| Arc::new(build())))
    }

    /// Spectra built so far: more than there are nodes when the cache is smaller than the path's working set.
    pub fn built(&self) -> u64 {
        self.state.lock().expect("no panic while held").built
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_oldest_leaves_first_and_the_rest_stay() {
        let cache = SpectrumCache::new(3 * 64);
        let make = |v: f32| {
            move || {
                let mut b = AlignedBuf::zeroed(16);
                b[0] = v;
                b
            }
        };
        for i in 0..3 {
            cache.get((0, i), 64, make(i as f32));
        }
        cache.get((0, 0), 64, || unreachable!("still there"));
        cache.get((0, 3), 64, make(3.0));
        cache.get((0, 0), 64, || unreachable!("used lately"));
        assert_eq!(cache.built(), 4);
        assert_eq!(cache.get((0, 1), 64, make(1.0))[0], 1.0);
        assert_eq!(cache.built(), 5);
    }
}
