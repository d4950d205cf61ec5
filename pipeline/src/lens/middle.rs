//! The middle part of PSFs whose geometric blur fills their windows: between the core, on film pixels, and the power laws of the far tail.
//!
//! ```text
//! PSF = core + middle + T      core = τ(r) (p − T)       in the PSF window, half a side r₁
//!                              middle = (1 − τ(r)) (p − T)     up to R > r₁, from where on p = T
//! τ = 1 − u³ (10 − 15 u + 6 u²)      u = (r/r₁ − 0.4)/0.6, limited to 0…1
//! ```
//! r is the distance from the chief ray, T the tail of [`super::tail`], R its radius. τ and its first two derivatives are continuous, so that the middle part, of
//! the width of the blur, can be put on a coarse grid; core and middle have no seam.
//!
//! Samples are shares of all light in squares of their pitch, the chief ray in the centre sample, the field point on +x, row down; one image for each height of
//! the tail, linear between them.

use std::sync::Arc;

/// Share of half a window up to which the core is the whole PSF.
pub const WHOLE: f64 = 0.4;

/// Middle parts of the PSFs of a band.
#[derive(Clone, Debug, PartialEq)]
pub struct Middle {
    /// Samples a side, odd.
    pub size: usize,
    /// Their pitch, mm.
    pub pitch_mm: f64,
    /// The images, row-major, one for each height of the tail.
    pub samples: Arc<[f32]>,
}

/// τ at the distance `r` of a window of half a side `half`, in any unit.
pub fn core_share(r: f64, half: f64) -> f64 {
    let u = ((r / half - WHOLE) / (1.0 - WHOLE)).clamp(0.0, 1.0);
    1.0 - u.powi(3) * (10.0 - 15.0 * u + 6.0 * u * u)
}

impl Middle {
    /// The image of the height `k`.
    pub fn image(&self, k: usize) -> &[f32] {
        let n = self.size * self.size;
        &self.samples[k * n..][..n]
    }

    /// Share of the light of each height.
    pub fn shares(&self) -> Vec<f64> {
        let images = self.samples.chunks_exact((self.size * self.size).max(1));
        images.map(|image| image.iter().map(|v| f64::from(*v)).sum()).collect()
    }

    /// Light per mm² of the image of the height `k` at (x, y) mm from the chief ray, linear between samples.
    pub fn density(&self, k: usize, x: f64, y: f64) -> f64 {
        let (image, n) = (self.image(k), self.size);
        let place = |v: f64| v / self.pitch_mm + (n / 2) as f64;
        let (x, y) = (place(x), place(y));
        let inside = |v: f64| (0.0..(n - 1) as f64).contains(&v);
        if !inside(x) || !inside(y) {
            return 0.0;
        }
        let (column, row) = (x as usize, y as usize);
        let (s, t) = (x - column as f64, y - row as f64);
        let at = |row: usize, column: usize| f64::from(image[row * n + column]);
        let along = |row: usize| (1.0 - s) * at(row, column) + s * at(row, column + 1);
        ((1.0 - t) * along(row) + t * along(row + 1)) / (self.pitch_mm * self.pitch_mm)
    }

    /// What is wrong with the numbers of `heights` heights, if anything.
    pub(super) fn problem(&self, heights: usize) -> Option<String> {
        let Self { size, pitch_mm, samples } = self;
        if size.is_multiple_of(2) || *size < 3 {
            return Some(format!("has {size} samples a side, expected an odd number from 3 on"));
        }
        if !(*pitch_mm > 0.0 && pitch_mm.is_finite()) {
            return Some(format!("has a pitch of {pitch_mm} mm, expected a positive number"));
        }
        if samples.len() != heights * size * size {
            return Some(format!("has {} samples, expected {heights} x {size} x {size}", samples.len()));
        }
        if let Some(v) = samples.iter().find(|v| !v.is_finite()) {
            return Some(format!("has a sample of {v}, expected finite numbers"));
        }
        let shares = self.shares();
        let wrong = shares.iter().position(|share| !(*share > 0.0 && *share < 1.0))?;
        Some(format!(
            "at height {wrong} has a share of {} of the light, expected one between 0 and 1",
            shares[wrong]
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_core_ends_smoothly_at_half_a_window() {
        assert_eq!((core_share(0.0, 2.0), core_share(0.8, 2.0)), (1.0, 1.0));
        assert_eq!((core_share(2.0, 2.0), core_share(9.0, 2.0)), (0.0, 0.0));
        assert!((core_share(1.4, 2.0) - 0.5).abs() < 1e-15);
        for r in [0.8, 2.0] {
            let slope = (core_share(r + 1e-4, 2.0) - core_share(r - 1e-4, 2.0)) / 2e-4;
            assert!(slope.abs() < 1e-5, "{r}: {slope}");
        }
    }

    #[test]
    fn density_is_linear_between_samples_and_zero_beyond() {
        let samples: Vec<f32> = (0..18).map(|i| 0.005 * i as f32).collect();
        let middle = Middle { size: 3, pitch_mm: 0.5, samples: samples.into() };
        assert_eq!(middle.problem(2), None);
        assert!((middle.shares()[0] - 0.18).abs() < 1e-6);
        assert!((middle.density(1, 0.0, 0.0) - 0.065 / 0.25).abs() < 1e-6);
        assert!((middle.density(0, 0.25, -0.25) - 0.015 / 0.25).abs() < 1e-6);
        assert_eq!(middle.density(0, 0.6, 0.0), 0.0);
        assert!(middle.problem(3).unwrap().contains("expected 3 x 3 x 3"));
    }
}
