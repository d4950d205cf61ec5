//! Instruction sets that a run computes with: detected once, or requested and then required.
//!
//! Films of one instruction set have the same bits on every machine that supports it; films of two differ within 2e-6 of the peak,
//! by rounding. So no other code that computes pixels of a film may select instructions: FFTs are compiled without rustfft's own detection,
//! and functions such as the sine come from the `libm` crate ([`crate::real`]). The sensor model selects its own
//! instructions (`sensor::lanes`): its bits do not depend on them.
//! PSFs of designs have the same bits with any instructions, as layers have: their loops are plain code that is compiled for each.
//! Vector code is written once on the abstraction of `lanes`, which `avx512` and `avx2` implement. Layers have the same bits with any instructions: their
//! code runs on registers that round products (`unfused`), or on none (`plain`).

#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
mod avx512;
mod isa;
pub(crate) mod lanes;
mod plain;
#[cfg(target_arch = "x86_64")]
mod unfused;

#[cfg(target_arch = "x86_64")]
pub(crate) use avx2::Avx2;
#[cfg(target_arch = "x86_64")]
pub(crate) use avx512::Avx512;
pub use isa::{Isa, Simd, SimdError};
use lanes::{Dispatch, SimdOp};
pub(crate) use plain::Plain;
#[cfg(target_arch = "x86_64")]
pub(crate) use unfused::Unfused;

/// An operation on registers that round products, of any instructions.
#[cfg(target_arch = "x86_64")]
pub(crate) trait UnfusedOp: SimdOp<Plain> + SimdOp<Unfused<Avx2>> + SimdOp<Unfused<Avx512>> {
    /// Runs it with `simd`.
    fn run_unfused(self, simd: Simd)
    where
        Self: Sized,
    {
        match simd.isa() {
            Isa::Avx512 => Dispatch::<Unfused<Avx512>>::new(simd).run(self),
            Isa::Avx2 => Dispatch::<Unfused<Avx2>>::new(simd).run(self),
            Isa::Portable => Dispatch::<Plain>::new(simd).run(self),
        }
    }
}
#[cfg(target_arch = "x86_64")]
impl<O: SimdOp<Plain> + SimdOp<Unfused<Avx2>> + SimdOp<Unfused<Avx512>>> UnfusedOp for O {}

/// An operation on registers that round products.
#[cfg(not(target_arch = "x86_64"))]
pub(crate) trait UnfusedOp: SimdOp<Plain> {
    /// Runs it.
    fn run_unfused(self, _: Simd)
    where
        Self: Sized,
    {
        Dispatch::<Plain>::new(Simd::PORTABLE).run(self);
    }
}
#[cfg(not(target_arch = "x86_64"))]
impl<O: SimdOp<Plain>> UnfusedOp for O {}
