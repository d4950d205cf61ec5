//! Registers whose multiply-adds round twice, product and sum, so that a sum has the same bits with registers of any length, and with none ([`super::Plain`]).
#![allow(unsafe_code, reason = "passes the guarantees of the registers on")]

use super::isa::Isa;
use super::lanes::{Lanes, MAX_LANES, SimdOp};
use bytemuck::{Pod, Zeroable};
use std::ops::{Add, Div, Mul, Sub};

/// A register of `V`.
#[derive(Clone, Copy, Debug)]
#[repr(transparent)]
pub(crate) struct Unfused<V>(V);

// SAFETY: a `V` and nothing else.
unsafe impl<V: Zeroable> Zeroable for Unfused<V> {}
// SAFETY: as above.
unsafe impl<V: Pod> Pod for Unfused<V> {}

/// An operation on the registers of `V`, which `Unfused` wraps.
struct Wrapped<O>(O);

impl<V: Lanes, O: SimdOp<Unfused<V>>> SimdOp<V> for Wrapped<O> {
    #[inline(always)]
    fn run(self) {
        self.0.run();
    }
}

macro_rules! operators {
    ($($operator:ident $method:ident),*) => {
        $(impl<V: Lanes> $operator for Unfused<V> {
            type Output = Self;
            #[inline(always)]
            fn $method(self, b: Self) -> Self {
                Self(self.0.$method(b.0))
            }
        })*
    };
}
operators!(Add add, Sub sub, Mul mul, Div div);

impl<V: Lanes> Lanes for Unfused<V> {
    const ISA: Isa = V::ISA;
    const LANES: usize = V::LANES;
    type I32 = V::I32;
    type Mask = V::Mask;

    unsafe fn run<O: SimdOp<Self>>(op: O) {
        // SAFETY: the caller guarantees the instructions of V.
        unsafe { V::run(Wrapped(op)) }
    }

    #[inline(always)]
    fn splat(v: f32) -> Self {
        Self(V::splat(v))
    }

    #[inline(always)]
    fn iota() -> Self {
        Self(V::iota())
    }

    #[inline(always)]
    fn abs(self) -> Self {
        Self(self.0.abs())
    }

    #[inline(always)]
    fn min(self, b: Self) -> Self {
        Self(self.0.min(b.0))
    }

    #[inline(always)]
    fn max(self, b: Self) -> Self {
        Self(self.0.max(b.0))
    }

    #[inline(always)]
    fn zero_below(self, limit: Self) -> Self {
        Self(self.0.zero_below(limit.0))
    }

    #[inline(always)]
    fn load(from: &[f32]) -> Self {
        Self(V::load(from))
    }

    #[inline(always)]
    fn load_first(from: &[f32], n: usize) -> Self {
        Self(V::load_first(from, n))
    }

    #[inline(always)]
    fn prefetch(from: &[f32], at: usize) {
        V::prefetch(from, at);
    }

    #[inline(always)]
    fn prefetch_l2(from: &[f32], at: usize) {
        V::prefetch_l2(from, at);
    }

    #[inline(always)]
    fn store(self, to: &mut [f32]) {
        self.0.store(to);
    }

    #[inline(always)]
    fn reduce_min(self) -> f32 {
        self.0.reduce_min()
    }

    #[inline(always)]
    fn reduce_max(self) -> f32 {
        self.0.reduce_max()
    }

    #[inline(always)]
    fn permute(low: Self, high: Self, index: Self::I32) -> Self {
        Self(V::permute(low.0, high.0, index))
    }

    #[inline(always)]
    fn select(mask: Self::Mask, a: Self, b: Self) -> Self {
        Self(V::select(mask, a.0, b.0))
    }

    #[inline(always)]
    fn broadcast_in_quads<const I: i32>(self) -> Self {
        Self(self.0.broadcast_in_quads::<I>())
    }

    #[inline(always)]
    fn transpose_quads(rows: [Self; 4]) -> [Self; 4] {
        V::transpose_quads(rows.map(|row| row.0)).map(Self)
    }

    #[inline(always)]
    unsafe fn load_quads(from: &[f32], at: &[i32; MAX_LANES], first: usize, offset: usize) -> Self {
        // SAFETY: the caller's guarantee.
        Self(unsafe { V::load_quads(from, at, first, offset) })
    }

    #[inline(always)]
    fn floor(self) -> Self {
        Self(self.0.floor())
    }

    #[inline(always)]
    fn to_i32(self) -> Self::I32 {
        self.0.to_i32()
    }

    #[inline(always)]
    fn load_i32(from: &[i32]) -> Self::I32 {
        V::load_i32(from)
    }

    #[inline(always)]
    fn store_i32(a: Self::I32, to: &mut [i32]) {
        V::store_i32(a, to);
    }

    #[inline(always)]
    fn add_i32(a: Self::I32, b: i32) -> Self::I32 {
        V::add_i32(a, b)
    }

    #[inline(always)]
    fn all_within(a: Self::I32, limit: i32) -> bool {
        V::all_within(a, limit)
    }

    #[inline(always)]
    fn equals(a: Self::I32, b: i32) -> Self::Mask {
        V::equals(a, b)
    }
}
