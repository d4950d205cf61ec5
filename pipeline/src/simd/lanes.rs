//! The words that work in lanes is written in: a register of f32, one of i32, and the gate.
//!
//! Everything is inlined into [`Lanes::run`], the one function per instruction set that is compiled for it: what a
//! [`Work`] does runs in its instructions, and no operation is a call. So every method here and every `run` of a work is
//! `#[inline(always)]`; works are pieces of microseconds, entered from plain code through a [`Gate`].
#![allow(unsafe_code, reason = "the gate into instructions that the build does not assume")]

use super::{Isa, Simd};
use bytemuck::Pod;
use std::fmt::Debug;
use std::marker::PhantomData;
use std::ops::{Add, Div, Mul, Sub};

/// The most lanes of any register.
pub(crate) const WIDEST: usize = 16;

/// A register of f32 lanes.
///
/// Values are made under [`Lanes::run`] only, whose caller vouches for the processor: so operations on them are safe.
pub(crate) trait Lanes:
    Pod + Debug + Send + Sync + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self>
{
    /// The instructions.
    const ISA: Isa;
    /// Lanes of a register; divides [`WIDEST`].
    const LANES: usize;
    /// As many i32.
    type Ints: Copy;
    /// One bit a lane.
    type Mask: Copy;

    /// Does `work`, compiled for these instructions.
    ///
    /// # Safety
    /// The machine has them.
    unsafe fn run<W: Work<Self>>(work: W);

    /// `v` in every lane.
    fn splat(v: f32) -> Self;
    /// 0, 1, 2, …
    fn count() -> Self;
    /// self·b + c, rounded once.
    fn mul_add(self, b: Self, c: Self) -> Self;
    /// self·b − c, rounded once.
    fn mul_sub(self, b: Self, c: Self) -> Self;
    /// c − self·b, rounded once.
    fn neg_mul_add(self, b: Self, c: Self) -> Self;
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
    /// Hints that `from[at]` is wanted soon, where there is one.
    fn prefetch(from: &[f32], at: usize);
    /// To the first `LANES` values.
    fn store(self, to: &mut [f32]);
    /// The least lane.
    fn least(self) -> f32;
    /// The greatest lane.
    fn greatest(self) -> f32;
    /// Turns rows to columns; there are `LANES` of both.
    fn transpose(rows: &mut [Self]);
    /// `low` then `high`, `2·LANES` values, at `index`.
    fn pick(low: Self, high: Self, index: Self::Ints) -> Self;
    /// `a` where `mask`, else `b`.
    fn select(mask: Self::Mask, a: Self, b: Self) -> Self;

    /// Lane i of each quad of lanes in all four.
    fn spread<const I: i32>(self) -> Self;
    /// Turns the rows of four quads to columns, quad by quad.
    fn transpose_quads(rows: [Self; 4]) -> [Self; 4];
    /// Four values from each of `at[first]`, `at[first + 4]`, … plus `offset` on.
    ///
    /// # Safety
    /// They lie in `from`.
    unsafe fn quads(from: &[f32], at: &[i32; WIDEST], first: usize, offset: usize) -> Self;

    /// The greatest whole number not above.
    fn floor(self) -> Self;
    /// Whole numbers as such.
    fn ints(self) -> Self::Ints;
    /// The first `LANES` values.
    fn load_ints(from: &[i32]) -> Self::Ints;
    /// To the first `LANES` values.
    fn store_ints(a: Self::Ints, to: &mut [i32]);
    /// a + `b`.
    fn plus(a: Self::Ints, b: i32) -> Self::Ints;
    /// Whether every lane is in 0..=`limit`.
    fn within(a: Self::Ints, limit: i32) -> bool;
    /// Where a = `b`.
    fn equal(a: Self::Ints, b: i32) -> Self::Mask;
}

/// A piece of work in lanes.
pub(crate) trait Work<V: Lanes> {
    /// Does it. `#[inline(always)]` in every implementation.
    fn run(self);
}

/// Proof that the machine has `V`'s instructions.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Gate<V>(PhantomData<V>);

impl<V: Lanes> Gate<V> {
    /// The gate for `simd`, which must be a choice of `V`'s instructions.
    pub(crate) fn open(simd: Simd) -> Self {
        assert_eq!(simd.isa(), V::ISA);
        Self(PhantomData)
    }

    /// Does `work` on the other side.
    pub(crate) fn run(self, work: impl Work<V>) {
        // SAFETY: a gate is made by `open` only, for a choice that this machine can run.
        unsafe { V::run(work) }
    }
}
