//! Kernels whose PSFs are read when a kernel of their height is computed, and kept in the cache of spectra.
//!
//! The depth nodes of a lens with large blurs have gigabytes of PSFs, of which a tile of the film needs a few heights of a few nodes; a lens with
//! errors has up to a gigabyte a band in the blue. The PSFs of a set ([`NodeGrid::psf_set`]: all of a height) are read and prepared at once,
//! into one buffer: of each its spline coefficients and its kernel at azimuth 0. Symmetry is that of each height's own PSF.
//! A set of several PSFs, or the sets of a row of nodes, are read, and their kernels are computed, by all threads, one at a time: other workers need them as well, or their own would
//! take as much memory again.

use super::resampler::{PreparedPsf, Resampler};
use super::{BaseGroup, KernelScratch, KernelSymmetry, is_mirrored, lane_sum};
use crate::buffer::AlignedBuf;
use crate::lens::PsfSample;
use crate::parts::for_each_part;
use crate::psf::grid::{Node, NodeGrid};
use crate::simd::Simd;
use std::convert::Infallible;
use std::ops::Range;
use std::sync::{Arc, Mutex, OnceLock};

/// Error of a reader of PSFs.
pub type PsfReadError = Box<dyn std::error::Error + Send + Sync>;

/// Reads the samples of the PSFs of (depth node, consecutive sets of PSFs), window after window; 0 is the depth node of a lens without any.
pub type PsfReader = Arc<dyn Fn(usize, Range<usize>) -> Result<Vec<f32>, PsfReadError> + Send + Sync>;

/// Where PSFs are read from, and the first error of it. What was computed after an error is not valid.
#[derive(Clone)]
pub struct PsfSource {
    reader: PsfReader,
    error: Arc<Mutex<Option<String>>>,
    /// Threads that read a set of several PSFs.
    threads: usize,
    /// Held while they do.
    set: Arc<Mutex<()>>,
}

impl std::fmt::Debug for PsfSource {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("PsfSource").finish_non_exhaustive()
    }
}

impl PsfSource {
    /// Reads by `reader`; sets of several PSFs on `threads` threads.
    pub fn new(reader: PsfReader, threads: usize) -> Self {
        Self { reader, error: Arc::default(), threads, set: Arc::default() }
    }

    /// Fails if a PSF could not be read.
    ///
    /// # Errors
    /// The first error of the reader.
    pub fn check(&self) -> Result<(), PsfReadError> {
        match &*self.error.lock().expect("no panic while held") {
            Some(error) => Err(error.clone().into()),
            None => Ok(()),
        }
    }

    /// Passes each of `parts` to `each`, on all threads.
    fn share<P: Send>(
        &self,
        parts: impl Iterator<Item = P> + Send,
        each: impl Fn(&mut KernelScratch, P) + Sync,
    ) {
        let each = |s: &mut KernelScratch, part| {
            each(s, part);
            Ok::<_, Infallible>(())
        };
        let Ok(()) = for_each_part(self.threads, parts, KernelScratch::default, each);
    }

    /// The samples of the PSFs of `sets`, `samples` in all, or zeros and a note of the error.
    pub(crate) fn read(&self, node: usize, sets: Range<usize>, samples: usize) -> Vec<f32> {
        let first = sets.start;
        let problem = match (self.reader)(node, sets) {
            Ok(psf) if psf.len() == samples => return psf,
            Ok(psf) => {
                format!("PSF {first} of depth node {node} has {} samples, expected {samples}", psf.len())
            }
            Err(error) => error.to_string(),
        };
        self.error.lock().expect("no panic while held").get_or_insert(problem);
        vec![0.0; samples]
    }
}

/// Kernels of one depth node, or of a band without depth nodes.
#[derive(Debug)]
pub struct KernelsOnDemand {
    resampler: Resampler,
    source: PsfSource,
    /// Index of the depth node in the lens.
    node: usize,
    /// Whether the PSF of each set of one PSF is symmetric about the meridian, once it has been read.
    mirrored: Vec<OnceLock<bool>>,
}

impl KernelsOnDemand {
    /// Of depth node `node` with `sets` sets of PSFs of `psf` (side in samples, pitch in µm, kind of samples), for a film of `film_pitch_um`; `window`
    /// crops kernels to that many film pixels (odd).
    pub fn new(
        (source, node): (&PsfSource, usize),
        sets: usize,
        psf: (usize, f64, PsfSample),
        film_pitch_um: f64,
        window: Option<usize>,
        simd: Simd,
    ) -> Self {
        Self {
            resampler: Resampler::new(psf, film_pitch_um, window, simd),
            source: source.clone(),
            node,
            mirrored: (0..sets).map(|_| OnceLock::new()).collect(),
        }
    }

    /// Fails if a PSF could not be read.
    ///
    /// # Errors
    /// The first error of the reader.
    pub(in crate::psf) fn check_read(&self) -> Result<(), PsfReadError> {
        self.source.check()
    }

    /// Side of a kernel in film pixels, odd.
    pub fn size(&self) -> usize {
        self.resampler.size()
    }

    /// Bytes of the prepared PSFs of a set of `count`.
    pub(in crate::psf) fn psf_bytes(&self, count: usize) -> usize {
        let (coefficients, kernel) = self.resampler.lengths();
        count * (coefficients + kernel) * size_of::<f32>()
    }

    /// Reads and prepares the PSFs of the set `set` of `grid` into `buffer`.
    pub(in crate::psf) fn prepare(
        &self,
        grid: &NodeGrid,
        set: usize,
        mut buffer: AlignedBuf,
        s: &mut KernelScratch,
    ) -> AlignedBuf {
        let (n, count) = (self.resampler.samples(), grid.psf_rows(set).len());
        buffer.reset(self.psf_bytes(count) / size_of::<f32>());
        if count > 1 {
            let _set = self.source.set.lock().expect("no panic while held");
            self.prepare_together(set, count, &mut buffer);
            return buffer;
        }
        let psf = self.source.read(self.node, set..set + 1, n * n);
        self.mirrored[set].get_or_init(|| {
            let light = lane_sum(&psf, &psf, |v, _| f64::from(v));
            is_mirrored(&psf, n, light)
        });
        self.prepare_one(&psf, true, &mut buffer, s);
        buffer
    }

    /// Reads and prepares the `count` PSFs of the set `set`, one after another in `to`.
    fn prepare_together(&self, set: usize, count: usize, to: &mut [f32]) {
        let (n, length) = (self.resampler.samples(), to.len() / count);
        let psfs = self.source.read(self.node, set..set + 1, count * n * n);
        let psfs = psfs.chunks_exact(n * n).zip(to.chunks_exact_mut(length)).enumerate();
        self.source.share(psfs, |s, (a, (psf, to))| {
            // At other azimuths than 0, 90, 180 and 270° kernels are rotated.
            self.prepare_one(psf, (4 * a).is_multiple_of(count), to, s);
        });
    }

    /// Prepares `psf` in `to`: its coefficients, and if `is_used_unrotated` its kernel at azimuth 0.
    fn prepare_one(&self, psf: &[f32], is_used_unrotated: bool, to: &mut [f32], s: &mut KernelScratch) {
        let (coefficients, unrotated) = to.split_at_mut(self.resampler.lengths().0);
        coefficients.copy_from_slice(&self.resampler.coefficients(psf, s));
        if is_used_unrotated {
            unrotated.copy_from_slice(&self.resampler.unrotated(psf, s));
        }
    }

    /// The kernels of the nodes `nodes` of `grid`, those of a height with several PSFs or of a row, row down, one after another into `out`.
    pub(in crate::psf) fn kernels_together(&self, grid: &NodeGrid, nodes: &BaseGroup, out: &mut [f32]) {
        let _set = self.source.set.lock().expect("no panic while held");
        let (set, area) = (grid.psf_set(nodes.first), self.size() * self.size());
        let count = grid.psf_rows(set).len();
        if count == 1 {
            let n = self.resampler.samples();
            let psfs = self.source.read(self.node, set..set + nodes.count, nodes.count * n * n);
            self.source.share(psfs.chunks_exact(n * n).zip(out.chunks_mut(area)), |s, (psf, out)| {
                out.copy_from_slice(&self.resampler.unrotated(psf, s));
            });
            return;
        }
        let mut psfs = AlignedBuf::zeroed(self.psf_bytes(count) / size_of::<f32>());
        self.prepare_together(set, count, &mut psfs);
        let groups = nodes.parts(grid).zip(out.chunks_mut(BaseGroup::MAX_COUNT * area));
        self.source.share(groups, |s, (group, out)| self.base_kernels(grid, &group, &psfs, s, out));
    }

    /// How the kernel of `node` follows from a base kernel; `read` makes its set be prepared if it never was.
    pub(in crate::psf) fn symmetry_of(
        &self,
        grid: &NodeGrid,
        node: Node,
        read: impl FnOnce(),
    ) -> KernelSymmetry {
        if !grid.is_symmetric_at(node) {
            return KernelSymmetry::new(grid, node, false);
        }
        let mirrored = &self.mirrored[grid.psf_set(node)];
        if mirrored.get().is_none() {
            read();
        }
        KernelSymmetry::new(grid, node, mirrored.get().copied().unwrap_or(false))
    }

    /// The kernels of `group` of the prepared PSFs of its set, row down, one after another into `out`.
    pub(in crate::psf) fn base_kernels(
        &self,
        grid: &NodeGrid,
        group: &BaseGroup,
        psfs: &[f32],
        s: &mut KernelScratch,
        out: &mut [f32],
    ) {
        let (coefficients, kernel) = self.resampler.lengths();
        let psf = |a: usize| {
            let (coefficients, unrotated) =
                psfs[a * (coefficients + kernel)..][..coefficients + kernel].split_at(coefficients);
            PreparedPsf { coefficients, unrotated }
        };
        self.resampler.base_kernels(grid, group, psf, s, out);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lens::PsfStack;
    use crate::psf::kernel::NodeKernels;

    /// Two PSFs of 21 samples, the second not symmetric about the meridian.
    fn stack() -> PsfStack {
        let spot = |i: usize, skew: f64| {
            let (y, x) = ((i / 21) as f64 - 10.0, (i % 21) as f64 - 10.0);
            (-(x - 1.0).powi(2) / 9.0 - (y - skew).powi(2) / 5.0).exp()
        };
        let one = |skew: f64| {
            let psf: Vec<f64> = (0..441).map(|i| spot(i, skew)).collect();
            let sum: f64 = psf.iter().sum();
            psf.into_iter().map(move |v| (v / sum) as f32)
        };
        let samples = one(0.0).chain(one(0.8)).collect();
        PsfStack { size: 21, pitch_um: 0.7, sample: PsfSample::Point, samples }
    }

    #[test]
    fn kernels_are_those_of_psfs_in_memory() {
        let (stack, simd) = (stack(), Simd::detect());
        let grid = NodeGrid::new(&[0.0, 1.0], &[1, 8], 2e-3);
        let all = NodeKernels::new(&stack, 2.0, None, simd);
        let samples = stack.samples.clone();
        let reader: PsfReader = Arc::new(move |node, sets| {
            assert_eq!(node, 7);
            Ok(samples[441 * sets.start..441 * sets.end].to_vec())
        });
        let source = PsfSource::new(reader, 2);
        let shape = (21, 0.7, PsfSample::Point);
        let kernels = KernelsOnDemand::new((&source, 7), 2, shape, 2.0, None, simd);
        let (mut s, mut other) = (KernelScratch::default(), KernelScratch::default());
        for (k, js) in [(0, 0..1), (1, 0..8)] {
            let psf = kernels.prepare(&grid, k, AlignedBuf::default(), &mut s);
            assert_eq!(psf.len() * 4, kernels.psf_bytes(1));
            for j in js {
                let symmetry = kernels.symmetry_of(&grid, Node { k, j }, || unreachable!("prepared"));
                assert_eq!(symmetry, all.symmetry_of(&grid, Node { k, j }));
                let mut base = vec![0.0; kernels.size() * kernels.size()];
                kernels.base_kernels(&grid, &BaseGroup::single(symmetry.base), &psf, &mut s, &mut base);
                assert_eq!(
                    base,
                    all.base_kernel(&grid, symmetry.base, &mut other),
                    "height {k}, azimuth {j}"
                );
            }
        }
        source.check().unwrap();
    }

    #[test]
    fn the_first_error_of_reading_remains() {
        let reader: PsfReader = Arc::new(|_, sets| match sets.start {
            0 => Ok(vec![0.0; 9]),
            k => Err(format!("no height {k}").into()),
        });
        let source = PsfSource::new(reader, 2);
        let shape = (3, 2.0, PsfSample::Integrated);
        let kernels = KernelsOnDemand::new((&source, 0), 3, shape, 2.0, None, Simd::PORTABLE);
        let mut s = KernelScratch::default();
        let grid = NodeGrid::new(&[0.0, 1.0, 2.0], &[1, 4, 4], 2e-3);
        let mut prepare = |k| kernels.prepare(&grid, k, AlignedBuf::default(), &mut s);
        prepare(0);
        source.check().unwrap();
        prepare(2);
        prepare(1);
        assert_eq!([source.check(), source.check()].map(|e| e.unwrap_err().to_string()), ["no height 2"; 2]);
    }
}
