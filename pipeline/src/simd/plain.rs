//! 8 lanes in plain Rust, for any processor: slow, and with the bits of [`super::Unfused`].
#![allow(unsafe_code, reason = "the functions of the abstraction that its other registers need")]

use super::isa::Isa;
use super::lanes::{Lanes, MAX_LANES, SimdOp};
use bytemuck::{Pod, Zeroable};
use std::array::from_fn;
use std::ops::{Add, Div, Mul, Sub};

/// 8 f32.
#[derive(Clone, Copy, Debug)]
#[repr(transparent)]
pub(crate) struct Plain([f32; 8]);

// SAFETY: 8 f32 and nothing else; any bits are valid.
unsafe impl Zeroable for Plain {}
// SAFETY: as above.
unsafe impl Pod for Plain {}

impl Plain {
    #[inline(always)]
    fn each(self, b: Self, of: impl Fn(f32, f32) -> f32) -> Self {
        Self(from_fn(|i| of(self.0[i], b.0[i])))
    }
}

macro_rules! operators {
    ($($operator:ident $method:ident),*) => {
        $(impl $operator for Plain {
            type Output = Self;
            #[inline(always)]
            fn $method(self, b: Self) -> Self {
                self.each(b, f32::$method)
            }
        })*
    };
}
operators!(Add add, Sub sub, Mul mul, Div div);

impl Lanes for Plain {
    const ISA: Isa = Isa::Portable;
    const LANES: usize = 8;
    type I32 = [i32; 8];
    type Mask = [bool; 8];

    unsafe fn run<O: SimdOp<Self>>(op: O) {
        op.run();
    }

    #[inline(always)]
    fn splat(v: f32) -> Self {
        Self([v; 8])
    }

    #[inline(always)]
    fn iota() -> Self {
        Self(from_fn(|i| i as f32))
    }

    #[inline(always)]
    fn abs(self) -> Self {
        Self(self.0.map(f32::abs))
    }

    #[inline(always)]
    fn min(self, b: Self) -> Self {
        self.each(b, |a, b| if a < b { a } else { b })
    }

    #[inline(always)]
    fn max(self, b: Self) -> Self {
        self.each(b, |a, b| if a > b { a } else { b })
    }

    #[inline(always)]
    fn zero_below(self, limit: Self) -> Self {
        self.each(limit, |v, limit| if v.abs() >= limit { v } else { 0.0 })
    }

    #[inline(always)]
    fn load(from: &[f32]) -> Self {
        Self(from[..8].try_into().expect("8 values"))
    }

    #[inline(always)]
    fn load_first(from: &[f32], n: usize) -> Self {
        Self(from_fn(|i| if i < n { from[i] } else { 0.0 }))
    }

    #[inline(always)]
    fn prefetch(_: &[f32], _: usize) {}

    #[inline(always)]
    fn prefetch_l2(_: &[f32], _: usize) {}

    #[inline(always)]
    fn store(self, to: &mut [f32]) {
        to[..8].copy_from_slice(&self.0);
    }

    #[inline(always)]
    fn reduce_min(self) -> f32 {
        self.0.into_iter().fold(f32::INFINITY, f32::min)
    }

    #[inline(always)]
    fn reduce_max(self) -> f32 {
        self.0.into_iter().fold(f32::NEG_INFINITY, f32::max)
    }

    #[inline(always)]
    fn permute(low: Self, high: Self, index: Self::I32) -> Self {
        Self(index.map(|i| if i < 8 { low.0[i as usize] } else { high.0[i as usize - 8] }))
    }

    #[inline(always)]
    fn select(mask: Self::Mask, a: Self, b: Self) -> Self {
        Self(from_fn(|i| if mask[i] { a.0[i] } else { b.0[i] }))
    }

    #[inline(always)]
    fn broadcast_in_quads<const I: i32>(self) -> Self {
        Self(from_fn(|i| self.0[i / 4 * 4 + I as usize]))
    }

    #[inline(always)]
    fn transpose_quads(rows: [Self; 4]) -> [Self; 4] {
        from_fn(|row| Self(from_fn(|i| rows[i % 4].0[i / 4 * 4 + row])))
    }

    #[inline(always)]
    unsafe fn load_quads(from: &[f32], at: &[i32; MAX_LANES], first: usize, offset: usize) -> Self {
        Self(from_fn(|i| from[at[first + i / 4 * 4] as usize + offset + i % 4]))
    }

    #[inline(always)]
    fn floor(self) -> Self {
        Self(self.0.map(f32::floor))
    }

    #[inline(always)]
    fn to_i32(self) -> Self::I32 {
        self.0.map(|v| v.round_ties_even() as i32)
    }

    #[inline(always)]
    fn load_i32(from: &[i32]) -> Self::I32 {
        from[..8].try_into().expect("8 values")
    }

    #[inline(always)]
    fn store_i32(a: Self::I32, to: &mut [i32]) {
        to[..8].copy_from_slice(&a);
    }

    #[inline(always)]
    fn add_i32(a: Self::I32, b: i32) -> Self::I32 {
        a.map(|v| v + b)
    }

    #[inline(always)]
    fn all_within(a: Self::I32, limit: i32) -> bool {
        a.iter().all(|v| (0..=limit).contains(v))
    }

    #[inline(always)]
    fn equals(a: Self::I32, b: i32) -> Self::Mask {
        a.map(|v| v == b)
    }
}
