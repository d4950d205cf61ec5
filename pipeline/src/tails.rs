//! Tails of the PSFs on the film: the light beyond the windows, as a smooth layer per band.
//!
//! ```text
//! film = Σ_node (w_node · remapped) ∗ K_node  +  U G            K = p − T inside the window ([`crate::psf::kernel`]), not scaled to sum 1
//! G    = Σ_l  up(T_l ∗ L_l)                                     L_0 = Uᵀ remapped,  L_{l+1} = Uᵀ L_l
//! T_l(r, φ) = Σ_mj c_mj(h) [B_mj(r; R_l) − B_mj(r; R_{l+1})] cos m(φ − φ₀)      R_0 = R, R_l = g 4^{l−1} R
//! ```
//! T, B and c are those of [`crate::lens::tail`], R half a side of the PSF window, φ₀ the azimuth of the field point, r and φ from its chief ray. B has
//! a smooth part inside its radius, so T_l vanishes beyond R_{l+1} and varies over R_l: level l has bins of b_l = 4^l b film pixels, b the largest power
//! of two up to R/2.5, at most [`MAX_BIN_PX`] ([`plan`]). The kernels of all levels but the first are the same arrays but for a factor of each power law. What
//! is left of T after the last level, whose radius exceeds the film's diagonal, is spread evenly. Level 0 has two to three bins in its radius, the others have five or a
//! few more (g is the least that gives them).
//!
//! U: four-tap cubic Lagrange interpolation from the centres of bins, u = (x + ½)/b − ½; Uᵀ, its transpose, puts light into bins so that moments up to
//! the third are kept. On average over the places of a bin each U and each Uᵀ takes 11/720 b⁴ (∂⁴/∂x⁴ + ∂⁴/∂y⁴) T from T; the kernels have that added, as fourth differences. L_0 is computed from samples of the light at half bins ([`light`]), read from the chart on cells of their size (`cells`). A level is convolved harmonic by
//! harmonic (`harmonics`, `convolution`), in f32: the same bits on every host.
//!
//! Of a band whose PSFs have a middle part ([`crate::lens::middle`]), level 0 has that in place of T_0 (`middle`), K = τ (p − T), and T begins with level 1: g = 1, R the
//! radius beyond which no rays land.
//! Surroundings of the film that a level's kernels reach are part of its light.
//!
//! Light is conserved: the kernels K of a height have the sum 1 − Σ_j c_0j Σ_l Σ_bins b_l² B_0j, that of the sums on the bins, less the middle part. A uniform
//! remapped image and surround stays uniform but for the change of T with the height.
//!
//! The transpose, from a film to the chart, is in `transpose`.
//!
//! Errors of half planes and discs, of white, and of points: see `model.md`, tails. Of a single pixel near a point: up to 15 % of T between one and two radii on bins of R/2.5.
//! Left out: fringes beyond the window; change of c between the heights of the PSFs other than linear.

mod axis;
mod cells;
mod convolution;
mod curve;
mod harmonics;
mod lanes;
pub mod levels;
pub mod light;
mod middle;
pub mod plan;
mod remapped;
mod transpose;
mod weights;

pub use cells::ChartCells;
pub use levels::TailKernels;
pub use plan::TailPlan;
pub use remapped::TAIL_MARGIN_BINS;

use crate::layer::Taps;

/// Largest bin of level 0, film pixels.
pub const MAX_BIN_PX: usize = 8;
/// Weights of the parts of a bin in its mean, along one axis: Uᵀ over the number of parts per bin, `N`/4. They belong to the parts from
/// [`first_part`] on.
fn transposed<const N: usize>() -> [f64; N] {
    let parts = (N / 4) as f64;
    std::array::from_fn(|i| {
        let u = ((i as i64 + first_part(N)) as f64 + 0.5) / parts - 0.5;
        let cell = u.floor();
        // Coefficient 0 is tap −cell of the four from −1 on.
        let tap = usize::try_from(1 - cell as i64).expect("a tap of bin 0");
        Taps::Lagrange.weights(u - cell)[tap] / parts
    })
}

/// First part that bin 0 reads, of `taps` parts in all.
const fn first_part(taps: usize) -> i64 {
    (taps / 8) as i64 - (taps / 2) as i64
}

/// Ratio of the radii, and of the bins, of two levels.
const GROWTH: usize = 4;
/// Bins in the radius of each level but the first, at least.
const BINS_IN_LEVEL: usize = 5;
/// Bins around those of the film in the result of a level: two that interpolation to a finer level or to pixels reads, and one for the
/// difference of their grids.
const OUT_MARGIN: usize = 3;
