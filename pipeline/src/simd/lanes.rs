//! SIMD vector abstraction: a register of f32, one of i32, and dispatch to code compiled for an instruction set.
//!
//! All vector code is inlined into [`Lanes::run`], the one function per instruction set that is compiled for it, so no operation
//! is a call. Every method here and every `run` of a [`SimdOp`] is therefore `#[inline(always)]`; an operation takes
//! microseconds and is entered from plain code through [`Dispatch`].
#![allow(unsafe_code, reason = "calls functions compiled for instructions that the build does not assume")]

use super::isa::{Isa, Simd};
use bytemuck::Pod;
use std::fmt::Debug;
use std::marker::PhantomData;
use std::ops::{Add, Div, Mul, Sub};

/// Largest number of lanes of any register.
pub(crate) const MAX_LANES: usize = 16;

/// A register of f32 lanes.
///
/// Values are created under [`Lanes::run`] only, whose caller guarantees the instructions: so operations on them are safe.
pub(crate) trait Lanes:
    Pod + Debug + Send + Sync + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self>
{
    /// The instruction set.
    const ISA: Isa;
    /// Lanes of a register; divides [`MAX_LANES`].
    const LANES: usize;
    /// A register of as many i32.
    type I32: Copy;
    /// One bit per lane.
    type Mask: Copy;

    /// Runs `op`, compiled for these instructions.
    ///
    /// # Safety
    /// The processor supports them.
    unsafe fn run<O: SimdOp<Self>>(op: O);

    /// `v` in every lane.
    fn splat(v: f32) -> Self;
    /// 0, 1, 2, …
    fn iota() -> Self;
    /// self·b + c: product and sum rounded, or together by registers that fuse them.
    #[inline(always)]
    fn mul_add(self, b: Self, c: Self) -> Self {
        self * b + c
    }
    /// self·b − c, rounded likewise.
    #[inline(always)]
    fn mul_sub(self, b: Self, c: Self) -> Self {
        self * b - c
    }
    /// c − self·b, rounded likewise.
    #[inline(always)]
    fn neg_mul_add(self, b: Self, c: Self) -> Self {
        c - self * b
    }
    /// |self|.
    fn abs(self) -> Self;
    /// The smaller, lane by lane.
    fn min(self, b: Self) -> Self;
    /// The larger, lane by lane.
    fn max(self, b: Self) -> Self;
    /// 0 where |self| < `limit`.
    fn zero_below(self, limit: Self) -> Self;
    /// The first `LANES` values.
    fn load(from: &[f32]) -> Self;
    /// The first `n` < `LANES` values, then zeros.
    fn load_first(from: &[f32], n: usize) -> Self;
    /// Prefetches the cache line of `from[at]` if that exists.
    fn prefetch(from: &[f32], at: usize);
    /// Prefetches the cache line of `from[at]`, which should exist, into the cache of the second level.
    fn prefetch_l2(from: &[f32], at: usize);
    /// Stores to the first `LANES` values.
    fn store(self, to: &mut [f32]);
    /// Minimum over the lanes.
    fn reduce_min(self) -> f32;
    /// Maximum over the lanes.
    fn reduce_max(self) -> f32;
    /// Elements `index` of `low` followed by `high`, `2·LANES` values.
    fn permute(low: Self, high: Self, index: Self::I32) -> Self;
    /// `a` where `mask` is set, else `b`.
    fn select(mask: Self::Mask, a: Self, b: Self) -> Self;

    /// Lane `I` of each quad of lanes in all four.
    fn broadcast_in_quads<const I: i32>(self) -> Self;
    /// Transposes four rows of four lanes, quad by quad.
    fn transpose_quads(rows: [Self; 4]) -> [Self; 4];
    /// Four values each from `at[first] + offset`, `at[first + 4] + offset`, … on.
    ///
    /// # Safety
    /// They lie in `from`.
    unsafe fn load_quads(from: &[f32], at: &[i32; MAX_LANES], first: usize, offset: usize) -> Self;
    /// Four columns of `LANES` rows that are `stride` apart: the first four values of each row. Loads gather the quads, as few ports have shuffles.
    #[inline(always)]
    fn transposed_quads(from: &[f32], stride: usize) -> [Self; 4] {
        let at: [i32; MAX_LANES] = std::array::from_fn(|i| (i % Self::LANES * stride) as i32);
        let from = &from[..(Self::LANES - 1) * stride + 4];
        // SAFETY: the last of the rows has four values.
        Self::transpose_quads(std::array::from_fn(|i| unsafe { Self::load_quads(from, &at, i, 0) }))
    }

    /// The largest integer not above.
    fn floor(self) -> Self;
    /// Converts integers.
    fn to_i32(self) -> Self::I32;
    /// The first `LANES` values.
    fn load_i32(from: &[i32]) -> Self::I32;
    /// Stores to the first `LANES` values.
    fn store_i32(a: Self::I32, to: &mut [i32]);
    /// a + `b`.
    fn add_i32(a: Self::I32, b: i32) -> Self::I32;
    /// Whether every lane is in 0..=`limit`.
    fn all_within(a: Self::I32, limit: i32) -> bool;
    /// a == `b`, lane by lane.
    fn equals(a: Self::I32, b: i32) -> Self::Mask;
}

/// An operation on registers of `V`.
pub(crate) trait SimdOp<V: Lanes> {
    /// Runs it. `#[inline(always)]` in every implementation.
    fn run(self);
}

/// Runs operations with the instructions of `V`; its existence proves that the processor supports them.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Dispatch<V>(PhantomData<V>);

impl<V: Lanes> Dispatch<V> {
    /// For `simd`, which must select the instructions of `V`.
    pub(crate) fn new(simd: Simd) -> Self {
        assert_eq!(simd.isa(), V::ISA);
        Self(PhantomData)
    }

    /// Runs `op`.
    pub(crate) fn run(self, op: impl SimdOp<V>) {
        // SAFETY: `new` admits only a `Simd` of V's instructions, and a `Simd` exists only if the processor supports them.
        unsafe { V::run(op) }
    }
}

/// Implements operators of the register type `$vector` by intrinsics, which `$intrinsic` wraps.
macro_rules! operators {
    ($vector:ident, $intrinsic:ident, $($operator:ident $method:ident $function:ident),*) => {
        $(impl $operator for $vector {
            type Output = Self;
            #[inline(always)]
            fn $method(self, b: Self) -> Self {
                Self($intrinsic!($function(self.0, b.0)))
            }
        })*
    };
}
pub(super) use operators;
