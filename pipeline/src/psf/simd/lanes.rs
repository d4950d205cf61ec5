//! The words that the SIMD rooms are written in: a register of f32 lanes, complex numbers made of two, and the gate.
//!
//! Everything is inlined into [`Lanes::run`], the one function per instruction set that is compiled for it: what a
//! [`Work`] does runs in its instructions, and no operation is a call. So every method here and every `run` of a work is
//! `#[inline(always)]`; works are pieces of microseconds, entered from plain code through a [`Gate`].
#![allow(unsafe_code, reason = "the gate into instructions that the build does not assume")]

use bytemuck::{Pod, Zeroable};
use std::fmt::Debug;
use std::marker::PhantomData;
use std::ops::{Add, Div, Mul, Sub};

/// A register of f32 lanes.
///
/// Values are made under [`Lanes::run`] only, whose caller vouches for the processor: so operations on them are safe.
pub(in crate::psf) trait Lanes:
    Pod + Debug + Send + Sync + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self>
{
    /// Lanes of a register.
    const LANES: usize;

    /// Whether this machine has the instructions.
    fn available() -> bool;

    /// Does `work`, compiled for these instructions.
    ///
    /// # Safety
    /// The machine has them: [`Lanes::available`].
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
    /// Turns rows to columns: `from` and `to` hold `LANES` elements.
    fn transpose(from: &[Complex<Self>], to: &mut [Complex<Self>]);
}

/// A piece of work in lanes.
pub(in crate::psf) trait Work<V: Lanes> {
    /// Does it. `#[inline(always)]` in every implementation.
    fn run(self);
}

/// Proof that the machine has `V`'s instructions.
#[derive(Clone, Copy, Debug)]
pub(in crate::psf) struct Gate<V>(PhantomData<V>);

impl<V: Lanes> Gate<V> {
    /// The gate, where the machine has the instructions.
    pub(in crate::psf) fn open() -> Option<Self> {
        V::available().then_some(Self(PhantomData))
    }

    /// Does `work` on the other side.
    pub(in crate::psf) fn run(self, work: impl Work<V>) {
        // SAFETY: a gate is made by `open` only, which asks the machine.
        unsafe { V::run(work) }
    }
}

/// As many complex numbers as there are lanes.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub(in crate::psf) struct Complex<V> {
    pub(in crate::psf) re: V,
    pub(in crate::psf) im: V,
}

// SAFETY: all zeros are zeros of both parts.
unsafe impl<V: Zeroable> Zeroable for Complex<V> {}
// SAFETY: two values of one plain type in C's order leave no padding.
unsafe impl<V: Pod> Pod for Complex<V> {}

impl<V: Lanes> Complex<V> {
    /// self·w, `w` one number for all lanes.
    #[inline(always)]
    pub(in crate::psf) fn times(self, w: [f32; 2]) -> Self {
        let (re, im) = (V::splat(w[0]), V::splat(w[1]));
        Self { re: self.re.mul_sub(re, self.im * im), im: self.re.mul_add(im, self.im * re) }
    }

    /// self·w̄, `w` one number for all lanes.
    #[inline(always)]
    pub(in crate::psf) fn times_conjugate(self, w: [f32; 2]) -> Self {
        let (re, im) = (V::splat(w[0]), V::splat(w[1]));
        Self { re: self.re.mul_add(re, self.im * im), im: self.im.mul_sub(re, self.re * im) }
    }
}

impl<V: Lanes> Add for Complex<V> {
    type Output = Self;
    #[inline(always)]
    fn add(self, b: Self) -> Self {
        Self { re: self.re + b.re, im: self.im + b.im }
    }
}

impl<V: Lanes> Sub for Complex<V> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, b: Self) -> Self {
        Self { re: self.re - b.re, im: self.im - b.im }
    }
}
