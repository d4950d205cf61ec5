//! The harmonics of a band's tails: kernels that are the same in the whole field, and how the light of each place is shared out among them.
//!
//! The tail of a source s, at the azimuth θ_s of the field, at a place in the direction φ from it:
//!
//! ```text
//! T_l = Σ_mj c_mj(h_s) [cos mθ_s C_mj + sin mθ_s S_mj] 4^{(2 − q)(l − 1)}         C_mj, S_mj: b² [B_mj(r; R_l) − B_mj(r; R_{l+1})] times cos mφ, sin mφ at the
//!                                                                                bins of level 1; level 0 has its own and no factor
//! Σ_s L(s) T_l = Σ_mj [(L c_mj cos mθ) ∗ C_mj + (L c_mj sin mθ) ∗ S_mj]
//! ```
//! as cos m(φ − θ) = cos mφ cos mθ + sin mφ sin mθ: 18 images for ORDERS = 5 and TERMS = 2, however many heights and azimuths a block has. c is linear between the heights of the band's
//! PSFs, as the near kernels are. Kernels are divided by their largest value, with which weights are multiplied. Of a block, kernels are left out whose weights nowhere exceed
//! [`NEGLIGIBLE`] of the largest weight of C_00.

use super::plan::TailPlan;
use crate::lens::tail::{Coefficients, ORDERS, TERMS};

/// Kernels of a level.
pub(super) const KERNELS: usize = TERMS * (2 * ORDERS - 1);
/// Weight of a kernel, as a share of that of C_00, up to which it is left out of a block.
pub(super) const NEGLIGIBLE: f64 = 2e-5;

/// A kernel: C_mj, or S_mj if it is `odd`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Kernel {
    pub(super) m: usize,
    pub(super) j: usize,
    pub(super) odd: bool,
}

/// All kernels: C_00 first.
pub(super) fn kernels() -> impl Iterator<Item = Kernel> {
    let of_order = |m: usize| {
        let parities = if m == 0 { &[false][..] } else { &[false, true] };
        parities.iter().flat_map(move |odd| (0..TERMS).map(move |j| Kernel { m, j, odd: *odd }))
    };
    (0..ORDERS).flat_map(of_order)
}

/// The images of all kernels on the bins of `level`, 0 or 1, and the largest value that each was divided by.
pub(super) fn images(plan: &TailPlan, level: usize) -> Vec<(Vec<f64>, f64)> {
    let parts = |m: usize, j: usize| -> [Vec<f64>; 2] {
        let (even, odd) = plan.kernels(level, m, j).unzip();
        [even, odd]
    };
    // Both parts of C_mj and S_mj at once.
    let mut parts: [[_; TERMS]; ORDERS] = std::array::from_fn(|m| std::array::from_fn(|j| parts(m, j)));
    let image = |Kernel { m, j, odd }: Kernel| {
        let mut image = std::mem::take(&mut parts[m][j][usize::from(odd)]);
        // A harmonic has no light; its sum over square bins has, of m = 4.
        if m > 0 {
            let centre = image.len() / 2;
            image[centre] -= image.iter().sum::<f64>();
        }
        let peak = image.iter().fold(0.0_f64, |peak, v| peak.max(v.abs()));
        image.iter_mut().for_each(|v| *v /= peak);
        (image, peak)
    };
    kernels().map(image).collect()
}

/// Coefficients without harmonics: those on the axis, where no azimuth is distinguished.
pub(super) fn on_axis(c: Coefficients) -> Coefficients {
    std::array::from_fn(|m| if m == 0 { c[0] } else { [0.0; TERMS] })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn there_are_as_many_kernels_as_images_and_the_first_is_that_of_the_mean() {
        let all: Vec<Kernel> = kernels().collect();
        assert_eq!(all.len(), KERNELS);
        assert_eq!(all[0], Kernel { m: 0, j: 0, odd: false });
        assert!(all.iter().enumerate().all(|(i, k)| all[..i].iter().all(|other| other != k)));
        assert!(all.iter().all(|k| k.m > 0 || !k.odd));
    }
}
