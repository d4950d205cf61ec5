//! SVPSF engines: one per instruction set, all of the same sums.

use crate::buffer::AlignedBuf;
use crate::psf::block_view::{BlockView, Spectra};
use crate::psf::blocks::Blocks;
use crate::psf::grid::NodeGrid;
use crate::psf::polar::BlockPlace;
use crate::psf::portable::{self, Portable};
#[cfg(target_arch = "x86_64")]
use crate::psf::simd::{self, Columns};
#[cfg(target_arch = "x86_64")]
use crate::simd::{Avx2, Avx512};
use crate::simd::{Isa, Simd};

/// An engine for one partition of the film.
#[derive(Debug)]
pub(super) enum Engine {
    /// realfft and rustfft, on any machine.
    Portable(Portable),
    /// 16 columns per register.
    #[cfg(target_arch = "x86_64")]
    Avx512(Columns<Avx512>),
    /// 8 columns per register.
    #[cfg(target_arch = "x86_64")]
    Avx2(Columns<Avx2>),
}

/// Buffers of one worker for one engine.
#[derive(Debug)]
pub(super) enum EngineScratch {
    /// For [`Engine::Portable`].
    Portable(Box<portable::Scratch>),
    /// For the SIMD engines.
    #[cfg(target_arch = "x86_64")]
    Simd(Box<simd::Scratch>),
}

#[cfg(target_arch = "x86_64")]
const SCRATCH_MISMATCH: &str = "scratch of another engine";

impl Engine {
    /// The engine of `simd` for `blocks`.
    pub(super) fn new(blocks: &Blocks, simd: Simd) -> Self {
        match simd.isa() {
            Isa::Portable => Self::Portable(Portable::new(blocks)),
            #[cfg(target_arch = "x86_64")]
            Isa::Avx512 => Self::Avx512(Columns::new(blocks, simd)),
            #[cfg(target_arch = "x86_64")]
            Isa::Avx2 => Self::Avx2(Columns::new(blocks, simd)),
            #[cfg(not(target_arch = "x86_64"))]
            Isa::Avx512 | Isa::Avx2 => unreachable!("Simd holds available instructions only"),
        }
    }

    /// Length of one spectrum in f32.
    pub(super) fn spectrum_len(&self) -> usize {
        match self {
            Self::Portable(e) => e.spectrum_len(),
            #[cfg(target_arch = "x86_64")]
            Self::Avx512(e) => e.spectrum_len(),
            #[cfg(target_arch = "x86_64")]
            Self::Avx2(e) => e.spectrum_len(),
        }
    }

    /// Buffers for one worker.
    pub(super) fn scratch(&self) -> EngineScratch {
        match self {
            Self::Portable(e) => EngineScratch::Portable(Box::new(e.scratch())),
            #[cfg(target_arch = "x86_64")]
            Self::Avx512(e) => EngineScratch::Simd(Box::new(e.scratch())),
            #[cfg(target_arch = "x86_64")]
            Self::Avx2(e) => EngineScratch::Simd(Box::new(e.scratch())),
        }
    }

    /// Spectrum of a kernel (window × window), in the memory of `buffer`.
    pub(super) fn spectrum(
        &self,
        kernel: &[f32],
        scratch: &mut EngineScratch,
        buffer: AlignedBuf,
    ) -> AlignedBuf {
        match (self, scratch) {
            (Self::Portable(e), EngineScratch::Portable(s)) => e.spectrum(kernel, s, buffer),
            #[cfg(target_arch = "x86_64")]
            (Self::Avx512(e), EngineScratch::Simd(s)) => e.spectrum(kernel, s, buffer),
            #[cfg(target_arch = "x86_64")]
            (Self::Avx2(e), EngineScratch::Simd(s)) => e.spectrum(kernel, s, buffer),
            #[cfg(target_arch = "x86_64")]
            _ => unreachable!("{SCRATCH_MISMATCH}"),
        }
    }

    /// Adds the contribution of one block of the remapped image to `out` (rows `stride` apart), `rows + window − 1` rows of
    /// `cols + window − 1` values. The first value of `out` is the film pixel (window − 1)/2 above and left of the block's first
    /// pixel. An engine may add up to 15 zeros past the end of a row.
    pub(super) fn scatter(
        &self,
        block: &BlockView<'_>,
        grid: &NodeGrid,
        spectra: &dyn Spectra,
        out: &mut [f32],
        stride: usize,
        scratch: &mut EngineScratch,
    ) {
        match (self, scratch) {
            (Self::Portable(e), EngineScratch::Portable(s)) => {
                e.scatter(block, grid, spectra, out, stride, s);
            }
            #[cfg(target_arch = "x86_64")]
            (Self::Avx512(e), EngineScratch::Simd(s)) => e.scatter(block, grid, spectra, out, stride, s),
            #[cfg(target_arch = "x86_64")]
            (Self::Avx2(e), EngineScratch::Simd(s)) => e.scatter(block, grid, spectra, out, stride, s),
            #[cfg(target_arch = "x86_64")]
            _ => unreachable!("{SCRATCH_MISMATCH}"),
        }
    }

    /// The transpose of [`Engine::scatter`]: adds to each pixel of the block at `place`, in `out`, the film under the kernels of the pixel. `film` has the
    /// film pixels that the block contributes to. Both are buffers and the pixels from row to row, in `out` and `film` complete panels of 16 columns, the film's zero from
    /// `cols + window − 1` on.
    pub(super) fn gather(
        &self,
        film: (&[f32], usize),
        place: &BlockPlace,
        grid: &NodeGrid,
        spectra: &dyn Spectra,
        out: (&mut [f32], usize),
        scratch: &mut EngineScratch,
    ) {
        match (self, scratch) {
            (Self::Portable(e), EngineScratch::Portable(s)) => e.gather(film, place, grid, spectra, out, s),
            #[cfg(target_arch = "x86_64")]
            (Self::Avx512(e), EngineScratch::Simd(s)) => e.gather(film, place, grid, spectra, out, s),
            #[cfg(target_arch = "x86_64")]
            (Self::Avx2(e), EngineScratch::Simd(s)) => e.gather(film, place, grid, spectra, out, s),
            #[cfg(target_arch = "x86_64")]
            _ => unreachable!("{SCRATCH_MISMATCH}"),
        }
    }
}
