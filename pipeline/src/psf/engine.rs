//! The transforms behind the door: one engine per instruction set, the same sums.

use crate::buffer::AlignedBuf;
use crate::psf::blocks::Blocks;
use crate::psf::grid::NodeGrid;
use crate::psf::portable::{self, Portable};
#[cfg(target_arch = "x86_64")]
use crate::psf::simd::{self, Columns};
use crate::psf::{BlockView, Spectra};
#[cfg(target_arch = "x86_64")]
use crate::simd::{Avx2, Avx512};
use crate::simd::{Isa, Simd};

/// An engine for one cut of the film.
#[derive(Debug)]
pub(super) enum Engine {
    /// realfft and rustfft, on any machine.
    Portable(Portable),
    /// 16 columns in lanes.
    #[cfg(target_arch = "x86_64")]
    Avx512(Columns<Avx512>),
    /// 8 columns in lanes.
    #[cfg(target_arch = "x86_64")]
    Avx2(Columns<Avx2>),
}

/// Buffers of one worker for one engine.
#[derive(Debug)]
pub(super) enum EngineScratch {
    /// For [`Engine::Portable`].
    Portable(Box<portable::Scratch>),
    /// For the engines with columns in lanes.
    #[cfg(target_arch = "x86_64")]
    Simd(Box<simd::Scratch>),
}

/// Why the arms of the wrong pair cannot be reached.
#[cfg(target_arch = "x86_64")]
const OWN: &str = "an engine meets the scratch that it made";

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
            Isa::Avx512 | Isa::Avx2 => unreachable!("a choice this machine can run"),
        }
    }

    /// f32s of one spectrum.
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

    /// Spectrum of a kernel of the planned window, in the memory of `buffer`.
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
            _ => unreachable!("{OWN}"),
        }
    }

    /// Scatters one block of the remapped image into `out` (rows `stride` apart), whose first value is the film pixel (window − 1)/2
    /// above and left of the block's first. An engine may add
    /// up to 15 zeros past the last of the `cols + window − 1` values of a row.
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
            _ => unreachable!("{OWN}"),
        }
    }
}
