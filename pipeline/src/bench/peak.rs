//! Peak rate of the processor: fused multiply-adds on independent registers, without memory access.

#[cfg(target_arch = "x86_64")]
use crate::simd::lanes::{Dispatch, Lanes, SimdOp};
#[cfg(target_arch = "x86_64")]
use crate::simd::{Avx2, Avx512};
use crate::simd::{Isa, Simd};
use std::hint::black_box;

/// Independent numbers: 16 registers of 16 f32, twice latency × throughput of current processors.
const NUMBERS: usize = 256;

/// Computes `rounds` multiply-adds on each of 256 numbers with the instructions of `simd`; returns their number.
///
/// The portable path multiplies and adds separately: without the instruction a fused operation is a library call.
pub fn fused_multiply_adds(simd: Simd, rounds: usize) -> u64 {
    match simd.isa() {
        #[cfg(target_arch = "x86_64")]
        Isa::Avx512 => Dispatch::<Avx512>::new(simd).run(Rounds(rounds)),
        #[cfg(target_arch = "x86_64")]
        Isa::Avx2 => Dispatch::<Avx2>::new(simd).run(Rounds(rounds)),
        _ => run(rounds, |a, b, c| a * b + c),
    }
    (rounds * NUMBERS) as u64
}

#[cfg(target_arch = "x86_64")]
struct Rounds(usize);

#[cfg(target_arch = "x86_64")]
impl<V: Lanes> SimdOp<V> for Rounds {
    #[inline(always)]
    fn run(self) {
        run(self.0, f32::mul_add);
    }
}

#[inline(always)]
fn run(rounds: usize, fma: impl Fn(f32, f32, f32) -> f32) {
    let mut numbers: [f32; NUMBERS] = std::array::from_fn(|i| i as f32);
    let (factor, term) = (black_box(0.999_f32), black_box(1e-3_f32));
    for _ in 0..rounds {
        for v in &mut numbers {
            *v = fma(*v, factor, term);
        }
    }
    black_box(numbers);
}
