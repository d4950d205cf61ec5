//! Selects the instructions of the loop over samples at run time. Bits do not depend on the choice: the loop adds, multiplies, divides and
//! compares, and no product and sum are fused.
#![allow(
    unsafe_code,
    reason = "instructions that the build does not assume, called after they were detected"
)]

#[cfg(target_arch = "x86_64")]
use super::lanes::Avx2;
use super::lanes::{LANES, Lanes};
use super::raster::{Row, RowHits, add_row};
use super::tile::Kept;

/// An instruction set that the loop over samples is compiled for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Engine(Set);

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Set {
    /// x86-64 with AVX2.
    #[cfg(target_arch = "x86_64")]
    Avx2,
    /// What the build assumes.
    Portable,
}

impl Engine {
    /// What the build assumes, on any machine.
    pub const PORTABLE: Self = Self(Set::Portable);

    /// All that this machine has, the fastest first.
    pub fn available() -> Vec<Self> {
        let mut engines = Vec::new();
        #[cfg(target_arch = "x86_64")]
        if std::arch::is_x86_feature_detected!("avx2") {
            engines.push(Self(Set::Avx2));
        }
        engines.push(Self::PORTABLE);
        engines
    }

    /// The fastest that this machine has.
    pub fn detect() -> Self {
        Self::available()[0]
    }

    /// Name for logs.
    pub const fn name(self) -> &'static str {
        match self.0 {
            #[cfg(target_arch = "x86_64")]
            Set::Avx2 => "avx2",
            Set::Portable => "portable",
        }
    }

    /// [`add_row`] by these instructions.
    pub(crate) fn add_row(self, row: &Row<'_>, kept: Kept, hits: &mut RowHits) {
        match self.0 {
            // SAFETY: the variant is only made where its instructions were detected (`available`).
            #[cfg(target_arch = "x86_64")]
            Set::Avx2 => unsafe { avx2(row, kept, hits) },
            Set::Portable => add::<[f64; LANES]>(row, kept, hits),
        }
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn avx2(row: &Row<'_>, kept: Kept, hits: &mut RowHits) {
    add::<Avx2>(row, kept, hits);
}

#[inline(always)]
fn add<V: Lanes>(row: &Row<'_>, kept: Kept, hits: &mut RowHits) {
    match kept {
        Kept::Nearest => add_row::<V, true>(row, hits),
        Kept::All => add_row::<V, false>(row, hits),
    }
}
