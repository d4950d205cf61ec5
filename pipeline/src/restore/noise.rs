//! The noise of a film, from its pixels alone.
//!
//! ```text
//! s = film ∗ [1 −2 1; −2 4 −2; 1 −2 1]/6          of independent noise of RMS σ: RMS σ;  0 of any plane, and of curvature along one axis
//! σ = median |s| / 0.6745                        0.6745: the median of |N(0, 1)|
//! ```
//! The stencil's even response to all pixels and the median keep edges out, as long as fewer than half of the pixels lie on detail that the lens resolved to the pixel. Of a film without noise
//! it is the detail itself: an upper bound, of little use. Source: Immerkær, Fast noise variance estimation, Comput. Vis. Image Underst. 64, 300 (1996), with the median in place of the mean.

use crate::real;
use std::f64::consts::TAU;

/// Median of |x| of a normal distribution of RMS 1.
const MEDIAN: f64 = 0.674_489_750_196_082;

/// Responses of the stencil at the pixels of `film`, rows of `width`, whose eight neighbours are in it, by size.
#[derive(Clone, Debug, Default)]
pub struct NoiseEstimate {
    responses: Vec<f32>,
}

impl NoiseEstimate {
    /// Adds a part of a film: at most `count` of its pixels, evenly spaced.
    pub fn add(&mut self, film: &[f32], width: usize, count: usize) {
        let height = film.len() / width;
        if height < 3 || width < 3 {
            return;
        }
        let inner = (height - 2) * (width - 2);
        let step = inner.div_ceil(count.max(1));
        for k in (0..inner).step_by(step) {
            let (y, x) = (k / (width - 2), k % (width - 2));
            let at = |dy: usize, dx: usize| f64::from(film[(y + dy) * width + x + dx]);
            let corners = at(0, 0) + at(0, 2) + at(2, 0) + at(2, 2);
            let sides = at(0, 1) + at(1, 0) + at(1, 2) + at(2, 1);
            self.responses.push(((corners - 2.0 * sides + 4.0 * at(1, 1)) / 6.0).abs() as f32);
        }
    }

    /// σ; 0 without pixels.
    pub fn sigma(mut self) -> f64 {
        if self.responses.is_empty() {
            return 0.0;
        }
        let middle = self.responses.len() / 2;
        let (_, median, _) = self.responses.select_nth_unstable_by(middle, f32::total_cmp);
        f64::from(*median) / MEDIAN
    }
}

/// `count` independent values of a normal distribution of RMS 1, the same for the same seed (Box and Muller).
pub fn unit_noise(count: usize, seed: u64) -> Vec<f64> {
    let mut state = seed;
    // SplitMix64: Steele, Lea and Flood, OOPSLA 2014.
    let mut next = || {
        state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = state;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    };
    (0..count).map(|_| (-2.0 * real::log(1.0 - next())).sqrt() * real::cos(TAU * next())).collect()
}
