//! Node spectra on demand: built where a tile first needs them, kept along the tiles' path in a bounded cache.
//!
//! A spectrum is a pure function of the band and the node, so what is evicted and built again has the same bits. Two
//! workers that need one node at once build it once: the second waits for the first. Buffers of evicted spectra are used
//! again: given back to the allocator from many threads they would leave it holding twice the bound.

use crate::buffer::AlignedBuf;
use std::collections::{BTreeMap, HashMap};
use std::sync::{Arc, Mutex, OnceLock};

/// (band index, node id).
pub type Key = (usize, usize);

type Slot = Arc<OnceLock<Arc<AlignedBuf>>>;

/// Spectra, and the kernels that eight of them are made of, bounded in bytes: least recently used leave first.
#[derive(Debug)]
pub struct SpectrumCache {
    spectra: Cache,
    seeds: Cache,
}

/// Part of the limit that seeds may take. A seed is used again where the tiles' path comes to the mirrored places, half a
/// film later, when spectra of its time are gone: so seeds have room of their own. All 700 of a fine grid take 7 MB at
/// 51 px, 62 MB at 151 px.
const SEEDS: usize = 8;

#[derive(Debug)]
struct Cache {
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
    retired: Vec<Arc<AlignedBuf>>,
}

/// Evicted buffers kept for the next spectra; more only lie about while a block still uses them.
const RETIRED: usize = 8;

impl State {
    fn evict(&mut self, limit: usize) {
        while self.bytes > limit && self.by_age.len() > 1 {
            let (_, oldest) = self.by_age.pop_first().expect("not empty");
            let (slot, _, bytes) = self.slots.remove(&oldest).expect("in both maps");
            self.bytes -= bytes;
            let spectrum = Arc::into_inner(slot).and_then(OnceLock::into_inner);
            if self.retired.len() < RETIRED {
                self.retired.extend(spectrum);
            }
        }
    }

    /// A buffer nobody uses any more, or an empty one.
    fn buffer(&mut self) -> AlignedBuf {
        for i in (0..self.retired.len()).rev() {
            match Arc::try_unwrap(self.retired.swap_remove(i)) {
                Ok(buffer) => return buffer,
                Err(in_use) => self.retired.push(in_use),
            }
        }
        AlignedBuf::default()
    }
}

impl SpectrumCache {
    /// A cache of at most `limit` bytes. What is in use lives on beyond it.
    pub fn new(limit: usize) -> Self {
        let cache = |limit| Cache { limit, state: Mutex::default() };
        Self { spectra: cache(limit - limit / SEEDS), seeds: cache(limit / SEEDS) }
    }

    /// The spectrum of `key` of `bytes`, built by `build` (out of a buffer to use again) if it is not there.
    pub fn get(
        &self,
        key: Key,
        bytes: usize,
        build: impl FnOnce(AlignedBuf) -> AlignedBuf,
    ) -> Arc<AlignedBuf> {
        self.spectra.get(key, bytes, build)
    }

    /// The same for the seed of kernels.
    pub fn seed(
        &self,
        key: Key,
        bytes: usize,
        build: impl FnOnce(AlignedBuf) -> AlignedBuf,
    ) -> Arc<AlignedBuf> {
        self.seeds.get(key, bytes, build)
    }

    /// Spectra built so far: more than there are nodes when the cache is smaller than the path's working set.
    pub fn built(&self) -> u64 {
        self.spectra.state.lock().expect("no panic while held").built
    }
}

impl Cache {
    fn get(&self, key: Key, bytes: usize, build: impl FnOnce(AlignedBuf) -> AlignedBuf) -> Arc<AlignedBuf> {
        let mut buffer = AlignedBuf::default();
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
                    state.evict(self.limit);
                    buffer = state.buffer();
                    slot
                }
            }
        };
        Arc::clone(slot.get_or_init(|| Arc::new(build(buffer))))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_oldest_leaves_first_and_the_rest_stay() {
        let cache = SpectrumCache::new(4 * 64);
        let make = |v: f32| {
            move |mut b: AlignedBuf| {
                b.reset(16);
                b[0] = v;
                b
            }
        };
        for i in 0..3 {
            cache.get((0, i), 64, make(i as f32));
        }
        cache.get((0, 0), 64, |_| unreachable!("still there"));
        cache.get((0, 3), 64, make(3.0));
        cache.get((0, 0), 64, |_| unreachable!("used lately"));
        assert_eq!(cache.built(), 4);
        assert_eq!(cache.get((0, 1), 64, make(1.0))[0], 1.0);
        assert_eq!(cache.built(), 5);
    }
}
