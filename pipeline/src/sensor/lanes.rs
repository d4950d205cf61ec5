//! Compiles a loop once per instruction set and selects one at run time. Bits do not depend on the choice: the loops add, multiply, divide,
//! take square roots and compare, and Rust never fuses a product and a sum.
#![allow(
    unsafe_code,
    reason = "instructions that the build does not assume, called after they were detected"
)]

/// An instruction set that loops over pixels are compiled for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Set {
    /// x86-64 with AVX-512 F, DQ and VL.
    #[cfg(target_arch = "x86_64")]
    Avx512,
    /// x86-64 with AVX2.
    #[cfg(target_arch = "x86_64")]
    Avx2,
    /// What the build assumes.
    Portable,
}

impl Set {
    /// The fastest that this machine has.
    pub(super) fn detect() -> Self {
        #[cfg(target_arch = "x86_64")]
        {
            use std::arch::is_x86_feature_detected as has;
            if has!("avx512f") && has!("avx512dq") && has!("avx512vl") {
                return Self::Avx512;
            }
            if has!("avx2") {
                return Self::Avx2;
            }
        }
        Self::Portable
    }

    /// All that this machine has.
    #[cfg(test)]
    pub(super) fn available() -> Vec<Self> {
        let mut sets = vec![Self::Portable];
        #[cfg(target_arch = "x86_64")]
        {
            if std::arch::is_x86_feature_detected!("avx2") {
                sets.push(Self::Avx2);
            }
            if Self::detect() == Self::Avx512 {
                sets.push(Self::Avx512);
            }
        }
        sets
    }

    /// What `work` returns, by these instructions: a closure must be inlined, and the functions that it calls (`#[inline(always)]`).
    pub(super) fn run<R>(self, work: impl FnOnce() -> R) -> R {
        match self {
            // SAFETY: the variant is only made where its instructions were detected (`detect`, `available`).
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => unsafe { avx512(work) },
            // SAFETY: as above.
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => unsafe { avx2(work) },
            Self::Portable => work(),
        }
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512dq,avx512vl")]
fn avx512<R>(work: impl FnOnce() -> R) -> R {
    work()
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn avx2<R>(work: impl FnOnce() -> R) -> R {
    work()
}
