//! Instruction sets that a run computes with: detected once, or requested and then required.
//!
//! Films of one instruction set have the same bits on every machine that supports it; films of two differ within 2e-6 of the peak,
//! by rounding. So no other code that computes pixels of a film may select instructions: FFTs are compiled without rustfft's own detection,
//! and functions such as the sine come from the `libm` crate ([`crate::real`]). The sensor model selects its own
//! instructions (`sensor::lanes`): its bits do not depend on them.
//! Vector code is written once on the abstraction of `lanes`, which `avx512` and `avx2` implement.

#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
mod avx512;
mod isa;
#[cfg(target_arch = "x86_64")]
pub(crate) mod lanes;

#[cfg(target_arch = "x86_64")]
pub(crate) use avx2::Avx2;
#[cfg(target_arch = "x86_64")]
pub(crate) use avx512::Avx512;
pub use isa::{Isa, Simd, SimdError};
