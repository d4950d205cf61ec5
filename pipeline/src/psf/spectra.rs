//! Cache of node spectra, base kernels, and PSFs that are read on demand, bounded in bytes, least recently used evicted first.
//!
//! Spectra are built on demand. A spectrum is a pure function of band and node, so one that is evicted and built again has the same
//! bits. Two workers that need a node at the same time build it once: the second blocks until the first is done. Buffers of evicted
//! spectra are reused, and large ones have pages of their own: between buffers of several sizes, as those of several bands and depth nodes, the
//! allocator would retain as much again as the bound.

use crate::buffer::AlignedBuf;
use crate::lru::Lru;
use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, OnceLock};

/// (band index, node id).
pub type SpectrumKey = (usize, usize);

type Entry = Arc<OnceLock<Arc<AlignedBuf>>>;

/// Spectra, the base kernels that up to eight of them are computed from, and prepared PSFs of depth nodes.
#[derive(Debug)]
pub struct SpectrumCache {
    limit: usize,
    spectra: Cache,
    base_kernels: Cache,
    psfs: Cache,
}

/// Base kernels may take one part in this many of the limit; spectra have the rest. A base kernel is used again at the mirrored azimuths,
/// half a film later, when the spectra of its first use are evicted: hence a limit of its own. It takes ten times the time of a spectrum
/// to build, and less memory: all 700 of a fine grid take 7 MB at 51 px, 62 MB at 151 px.
const BASE_KERNEL_PART: usize = 2;
/// Share of base kernels of a lens without rotational symmetry, one for each node, if that is enough for all of a band.
const KEPT_SHARE: f64 = 0.75;
/// Of PSFs that are read on demand: a quarter of the azimuths of a height have base kernels of it.
const PSF_PART: usize = 4;

#[derive(Debug, Default)]
struct Cache(Mutex<State>);

#[derive(Debug, Default)]
struct State {
    entries: Lru<SpectrumKey, Entry>,
    built: u64,
    /// Evicted buffers, for reuse, and their bytes.
    retired: Vec<Arc<AlignedBuf>>,
    retired_bytes: usize,
    /// Of a cache for bands in turn: the last two.
    latest: Option<VecDeque<usize>>,
}

/// Number of evicted buffers that are kept for reuse in any case; some may still be in use by a block.
const MIN_RETIRED: usize = 8;
/// Size from which on buffers have pages of their own, bytes.
const MAPPED: usize = 32 << 10;

impl State {
    /// Evicts the entries of all bands but `band` and the one before it, of a cache for bands in turn.
    fn begin(&mut self, band: usize) {
        let Some(latest) = self.latest.as_mut().filter(|latest| !latest.contains(&band)) else { return };
        latest.push_back(band);
        if latest.len() > 2 {
            let done = latest.pop_front();
            let entries = self.entries.remove_where(|(band, _)| Some(band) == done);
            entries.into_iter().for_each(|entry| self.retire(entry));
        }
    }

    fn evict(&mut self, limit: usize) {
        while self.entries.bytes() > limit
            && self.entries.count() > 1
            && let Some(entry) = self.entries.pop_oldest()
        {
            self.retire(entry);
        }
    }

    fn retire(&mut self, entry: Entry) {
        if let Some(buffer) = Arc::into_inner(entry).and_then(OnceLock::into_inner) {
            self.keep(buffer);
        }
    }

    fn keep(&mut self, buffer: Arc<AlignedBuf>) {
        self.retired_bytes += buffer.bytes();
        self.retired.push(buffer);
    }

    /// A retired buffer, which is no longer counted as one.
    fn take_retired(&mut self, at: usize) -> Arc<AlignedBuf> {
        let buffer = self.retired.swap_remove(at);
        self.retired_bytes -= buffer.bytes();
        buffer
    }

    /// A retired buffer of `bytes` that is no longer in use, or a new one. Those of another size, of another band, are freed: a spectrum in a
    /// larger buffer would take more memory than is counted.
    fn buffer(&mut self, bytes: usize) -> AlignedBuf {
        for i in (0..self.retired.len()).rev() {
            match Arc::try_unwrap(self.take_retired(i)) {
                Ok(buffer) if buffer.bytes() == bytes.next_multiple_of(64) => return buffer,
                Ok(_) => (),
                Err(in_use) => self.keep(in_use),
            }
        }
        if bytes < MAPPED { AlignedBuf::default() } else { AlignedBuf::mapped(bytes) }
    }

    /// Frees retired buffers, those of a cache for bands in turn that exceed `limit` together with its entries.
    fn free_retired(&mut self, limit: usize) {
        let within = if self.latest.is_some() { limit } else { 0 };
        while self.retired.len() > MIN_RETIRED && self.entries.bytes() + self.retired_bytes > within {
            drop(self.take_retired(0));
        }
    }
}

impl SpectrumCache {
    /// A cache of at most `limit` bytes, not counting evicted buffers still in use.
    pub fn new(limit: usize) -> Self {
        Self { limit, spectra: Cache::default(), base_kernels: Cache::default(), psfs: Cache::default() }
    }

    /// As [`SpectrumCache::new`], for bands that are computed one after the other, as those of a run: when a band begins, the buffers of the spectra of the
    /// band before the previous one are used for its own, so that no further memory is touched for the first time.
    pub fn in_turn(limit: usize) -> Self {
        let spectra = State { latest: Some(VecDeque::new()), ..State::default() };
        Self { spectra: Cache(Mutex::new(spectra)), ..Self::new(limit) }
    }

    /// The spectrum of `key`, `bytes` long; if absent, built by `build` from a buffer to reuse.
    pub fn get(
        &self,
        key: SpectrumKey,
        bytes: usize,
        build: impl FnOnce(AlignedBuf) -> AlignedBuf,
    ) -> Arc<AlignedBuf> {
        let limit = || self.limit.saturating_sub(self.base_kernels.bytes() + self.psfs.bytes());
        self.spectra.get(key, bytes, limit, build)
    }

    /// The same for base kernels, `all` bytes for all of the band, or more than any cache keeps. If it [keeps](Self::keeps) them, those of other bands are evicted.
    pub fn base_kernel(
        &self,
        key: SpectrumKey,
        (bytes, all): (usize, usize),
        build: impl FnOnce(AlignedBuf) -> AlignedBuf,
    ) -> Arc<AlignedBuf> {
        let limit = if self.keeps(all) { all } else { self.limit / BASE_KERNEL_PART };
        self.base_kernels.get(key, bytes, || limit, build)
    }

    /// Whether it keeps all base kernels of a band, of `all` bytes.
    pub fn keeps(&self, all: usize) -> bool {
        all as f64 <= KEPT_SHARE * self.limit as f64
    }

    /// The bytes of a cache that [keeps](Self::keeps) `kernels` bytes of base kernels.
    pub fn bytes_to_keep(kernels: usize) -> usize {
        (kernels as f64 / KEPT_SHARE).ceil() as usize
    }

    /// The same for prepared PSFs, by band and an id of the height.
    pub fn psf(
        &self,
        key: SpectrumKey,
        bytes: usize,
        build: impl FnOnce(AlignedBuf) -> AlignedBuf,
    ) -> Arc<AlignedBuf> {
        self.psfs.get(key, bytes, || self.limit / PSF_PART, build)
    }

    /// Spectra built so far: more than the nodes if the cache is smaller than the working set.
    pub fn built(&self) -> u64 {
        self.spectra.lock().built
    }
}

impl Cache {
    fn lock(&self) -> MutexGuard<'_, State> {
        self.0.lock().expect("no panic while held")
    }

    fn bytes(&self) -> usize {
        self.lock().entries.bytes()
    }

    /// As [`SpectrumCache::get`], within `limit` bytes, which is asked for when an entry is added.
    fn get(
        &self,
        key: SpectrumKey,
        bytes: usize,
        limit: impl FnOnce() -> usize,
        build: impl FnOnce(AlignedBuf) -> AlignedBuf,
    ) -> Arc<AlignedBuf> {
        let mut buffer = AlignedBuf::default();
        let entry = {
            let mut guard = self.lock();
            let state = &mut *guard;
            match state.entries.get(key) {
                Some(entry) => Arc::clone(entry),
                None => {
                    let (entry, limit) = (Entry::default(), limit());
                    state.begin(key.0);
                    state.entries.insert(key, Arc::clone(&entry), bytes);
                    state.built += 1;
                    state.evict(limit);
                    buffer = state.buffer(bytes);
                    state.free_retired(limit);
                    entry
                }
            }
        };
        Arc::clone(entry.get_or_init(|| Arc::new(build(buffer))))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn least_recently_used_is_evicted_first() {
        let cache = SpectrumCache::new(3 * 64);
        let build = |v: f32| {
            move |mut b: AlignedBuf| {
                b.reset(16);
                b[0] = v;
                b
            }
        };
        for i in 0..3 {
            cache.get((0, i), 64, build(i as f32));
        }
        cache.get((0, 0), 64, |_| unreachable!("cached"));
        cache.get((0, 3), 64, build(3.0));
        cache.get((0, 0), 64, |_| unreachable!("recently used"));
        assert_eq!(cache.built(), 4);
        assert_eq!(cache.get((0, 1), 64, build(1.0))[0], 1.0);
        assert_eq!(cache.built(), 5);
    }

    fn filled(mut b: AlignedBuf) -> AlignedBuf {
        b.reset(16);
        b
    }

    #[test]
    fn base_kernels_take_what_they_need_up_to_half_of_the_limit() {
        let cache = SpectrumCache::new(8 * 64);
        for i in 0..8 {
            cache.get((0, i), 64, filled);
        }
        cache.get((0, 0), 64, |_| unreachable!("no base kernels yet"));
        for i in 0..6 {
            cache.base_kernel((0, i), (64, 8 * 64), filled);
        }
        cache.base_kernel((0, 2), (64, 8 * 64), |_| unreachable!("four are kept"));
        cache.get((0, 8), 64, filled);
        assert_eq!((cache.spectra.bytes(), cache.base_kernels.bytes()), (4 * 64, 4 * 64));
    }

    #[test]
    fn kernels_of_other_bands_are_evicted() {
        let cache = SpectrumCache::new(16 * 64);
        assert_eq!([12 * 64, 12 * 64 + 1, usize::MAX].map(|all| cache.keeps(all)), [true, false, false]);
        for i in 0..12 {
            cache.base_kernel((0, i), (64, 12 * 64), filled);
        }
        cache.base_kernel((0, 0), (64, 12 * 64), |_| unreachable!("all of the band are kept"));
        assert_eq!(cache.base_kernels.bytes(), 12 * 64);
        for i in 0..2 {
            cache.base_kernel((1, i), (64, 3 * 64), filled);
        }
        cache.base_kernel((1, 0), (64, 3 * 64), |_| unreachable!("all of the band are kept"));
        cache.base_kernel((0, 0), (64, 3 * 64), |_| unreachable!("used last of the band before"));
        assert_eq!(cache.base_kernels.bytes(), 3 * 64);
    }

    #[test]
    fn buffers_of_the_band_before_the_previous_one_are_reused() {
        let cache = SpectrumCache::in_turn(64 * 1024);
        let filled = |mut b: AlignedBuf| {
            b.reset(256);
            b
        };
        let at = |band: usize| -> Vec<*const f32> {
            (0..20).map(|i| cache.get((band, i), 1024, filled).as_ptr()).collect()
        };
        let first = at(0);
        let second = at(1);
        assert_eq!(cache.spectra.bytes(), 40 * 1024, "two bands");
        assert!(!second.iter().any(|p| first.contains(p)));
        assert!(at(2).iter().all(|p| first.contains(p)));
        assert_eq!(cache.spectra.bytes(), 40 * 1024, "the last two");
        assert_eq!(at(1), second, "still there");
        assert_eq!(cache.built(), 60);
        // Of the limit, buffers that are kept for reuse take what spectra leave: a smaller band keeps those of a larger one.
        cache.get((3, 0), 1024, filled);
        let state = cache.spectra.lock();
        assert_eq!((state.entries.bytes(), state.retired_bytes), (21 * 1024, 19 * 1024));
    }

    #[test]
    fn buffers_of_another_size_are_not_reused() {
        let cache = SpectrumCache::new(8 * 1024);
        let filled = |bytes: usize| {
            move |mut b: AlignedBuf| {
                b.reset(bytes / 4);
                b
            }
        };
        for i in 0..8 {
            cache.get((0, i), 1024, filled(1024));
        }
        let reused = cache.get((0, 8), 1024, |b| {
            assert_eq!(b.bytes(), 1024);
            filled(1024)(b)
        });
        assert_eq!(reused.bytes(), 1024);
        for i in 0..64 {
            assert_eq!(cache.get((1, i), 512, filled(512)).bytes(), 512);
        }
    }
}
