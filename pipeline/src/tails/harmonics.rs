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
use crate::psf::polar::BlockPlace;
use crate::psf::simd::images::ImageSize;
use crate::simd::lanes::MAX_LANES;

/// Kernels of a level.
pub(super) const KERNELS: usize = TERMS * (2 * ORDERS - 1);
/// Weight of a kernel, as a share of that of C_00, up to which it is left out of a block.
const NEGLIGIBLE: f64 = 2e-5;

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

/// The weights of a block: one image of each kernel that is not left out.
#[derive(Default)]
pub(super) struct BlockWeights {
    /// Indices of the kernels, ascending.
    pub(super) kernels: Vec<usize>,
    /// Their images one after the other.
    pub(super) values: Vec<f32>,
    row: RowOfBins,
}

impl BlockWeights {
    /// The weights of the bins at `place` of `level`, whose kernels have the `peaks`; their size.
    pub(super) fn of_block(
        &mut self,
        plan: &TailPlan,
        (level, peaks): (usize, &[f64]),
        place: &BlockPlace,
    ) -> ImageSize {
        let stride = place.cols.next_multiple_of(MAX_LANES);
        let size = ImageSize { rows: place.rows, cols: place.cols, stride };
        let (values, bin_px) = (size.values(), plan.bins(level).bin_px as f64);
        self.values.clear();
        self.values.resize(KERNELS * values, 0.0);
        // c_mj by height.
        let by_height: Vec<Vec<f64>> = (0..ORDERS * TERMS)
            .map(|k| plan.coefficients().map(|c| c[k / TERMS][k % TERMS]).collect())
            .collect();
        let mut largest = [0.0_f64; KERNELS];
        for row in 0..size.rows {
            self.row.set(plan, bin_px, (place.dy_px + row as f64, place.dx_px), size.cols);
            let of_kernels = kernels().zip(peaks).zip(&mut largest);
            for (image, ((Kernel { m, j, odd }, peak), largest)) in
                self.values.chunks_exact_mut(values).zip(of_kernels)
            {
                self.row.turn_to(m, &by_height);
                let to = &mut image[row * size.stride..][..size.cols];
                let factor = peak * TailPlan::factor(level, j);
                *largest = largest.max(self.row.weigh(j, odd, factor, to));
            }
        }
        self.kernels.clear();
        self.kernels.extend((0..KERNELS).filter(|k| largest[*k] > NEGLIGIBLE * largest[0]));
        for (to, from) in self.kernels.iter().enumerate().filter(|(to, from)| to != *from) {
            self.values.copy_within(from * values..(from + 1) * values, to * values);
        }
        self.values.truncate(self.kernels.len() * values);
        size
    }
}

/// c_mj cos mθ and c_mj sin mθ at the bins of a row.
#[derive(Default)]
struct RowOfBins {
    /// Heights about each bin: the index of the one below, and the share of the next.
    below: Vec<usize>,
    share: Vec<f64>,
    /// cos θ and sin θ.
    first: [Vec<f64>; 2],
    /// Those of mθ, and c_mj of all j, for the order m.
    turned: [Vec<f64>; 2],
    coefficients: [Vec<f64>; TERMS],
    m: usize,
}

impl RowOfBins {
    /// Sets `columns` bins of `bin_px` film pixels from (y, x) bins from the axis on.
    fn set(&mut self, plan: &TailPlan, bin_px: f64, (y, x): (f64, f64), columns: usize) {
        let [cosines, sines] = &mut self.first;
        [&mut self.share, &mut *cosines, &mut *sines].into_iter().for_each(Vec::clear);
        self.below.clear();
        let mut below = 0;
        for column in 0..columns {
            let x = x + column as f64;
            let r = (y * y + x * x).sqrt();
            let (sin, cos) = if r > 0.0 { (y / r, x / r) } else { (0.0, 1.0) };
            let share;
            (below, share) = plan.around(r * bin_px, below);
            self.below.push(below);
            self.share.push(share);
            cosines.push(cos);
            sines.push(sin);
        }
        self.m = ORDERS;
    }

    /// Sets the order `m`, 0 first and then not below that of before: (cos + i sin)^m, and c_mj of the values `by_height`.
    fn turn_to(&mut self, m: usize, by_height: &[Vec<f64>]) {
        if self.m == m {
            return;
        }
        let [re, im] = &mut self.turned;
        if m == 0 {
            re.clear();
            re.resize(self.below.len(), 1.0);
            im.clear();
            im.resize(self.below.len(), 0.0);
        } else {
            let [cosines, sines] = &self.first;
            for ((re, im), (cos, sin)) in re.iter_mut().zip(im).zip(cosines.iter().zip(sines)) {
                (*re, *im) = (*re * cos - *im * sin, *re * sin + *im * cos);
            }
        }
        for (to, values) in self.coefficients.iter_mut().zip(&by_height[m * TERMS..]) {
            to.clear();
            to.extend(self.below.iter().zip(&self.share).map(|(k, t)| {
                let (a, b) = (values[*k], values[k + 1]);
                a + t * (b - a)
            }));
        }
        self.m = m;
    }

    /// The coefficient `j` times the cosine, or the sine if `odd`, times `factor`; the largest magnitude.
    fn weigh(&self, j: usize, odd: bool, factor: f64, to: &mut [f32]) -> f64 {
        const SIDE_BY_SIDE: usize = 8;
        let mut largest = [0.0_f64; SIDE_BY_SIDE];
        let turned = &self.turned[usize::from(odd)];
        let mut weigh = |to: &mut [f32], c: &[f64], turned: &[f64]| {
            for (((to, c), turned), largest) in to.iter_mut().zip(c).zip(turned).zip(&mut largest) {
                let weight = c * turned * factor;
                *to = weight as f32;
                *largest = if weight.abs() > *largest { weight.abs() } else { *largest };
            }
        };
        let (to, to_rest) = to.as_chunks_mut::<SIDE_BY_SIDE>();
        let (c, c_rest) = self.coefficients[j].as_chunks::<SIDE_BY_SIDE>();
        let (turned, turned_rest) = turned.as_chunks::<SIDE_BY_SIDE>();
        to.iter_mut().zip(c).zip(turned).for_each(|((to, c), turned)| weigh(to, c, turned));
        weigh(to_rest, c_rest, turned_rest);
        largest.into_iter().fold(0.0, f64::max)
    }
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
