//! The processor's peak: fused multiply-adds on independent registers, nothing read and nothing written.
#![allow(unsafe_code, reason = "instructions that the build does not assume")]

use crate::simd::{Isa, Simd};
use std::hint::black_box;

/// Numbers in flight: 16 registers of 16 f32, twice what latency × throughput of any processor so far asks for.
const NUMBERS: usize = 256;

/// Does `rounds` multiply-adds on each of 256 numbers with the instructions of `simd`; how many that were.
///
/// The portable path multiplies and adds apart: a fused operation without the instruction is a call to a library.
pub fn fused_multiply_adds(simd: Simd, rounds: usize) -> u64 {
    match simd.isa() {
        #[cfg(target_arch = "x86_64")]
        Isa::Avx512 => {
            #[target_feature(enable = "avx512f")]
            fn go(rounds: usize) {
                run(rounds, f32::mul_add);
            }
            // SAFETY: a choice of AVX-512F is only made where the processor has it.
            unsafe { go(rounds) }
        }
        #[cfg(target_arch = "x86_64")]
        Isa::Avx2 => {
            #[target_feature(enable = "avx2,fma")]
            fn go(rounds: usize) {
                run(rounds, f32::mul_add);
            }
            // SAFETY: a choice of AVX2 with FMA is only made where the processor has both.
            unsafe { go(rounds) }
        }
        _ => run(rounds, |a, b, c| a * b + c),
    }
    (rounds * NUMBERS) as u64
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
