//! Effective PSFs of a lens and the pixels of a film, oversampled: what photometry fits to stars.
//!
//! ```text
//! E(u)      light in a film pixel whose centre lies at u from the chief ray, over all light of the field point:
//!           E(u) = e·∫∫ K(v) dv over the p × p about u        K: the kernel at the place, sum 1 ([`on_film`](super::on_film)); e: its share of all light
//! u_i       (i − (n − 1)/2)·p/s, i = 0 … n − 1, n = w·s     p: film pitch, s: oversampling, w: window in film pixels, odd
//! Σ_i E     s²·e, less what lies within half a pixel of the window's edge
//! ```
//! Row down, column right, the chief ray in the middle of the array: on a sample for an odd s, between four samples for an even one. Every s-th sample
//! from a phase is the film of a point at that place of a pixel; of an odd s the middle ones are the film's kernel. E is a sum of s × s kernel pixels of
//! p/s, so that its error is that of the kernels. Light beyond the PSF windows is not in E.
//! Source: Anderson & King, PASP 112 (2000) 1360, 2.2 (the effective PSF).

use super::on_film::BandOnFilm;
use crate::lens::{LensBand, PsfSample};
use crate::psf::kernel::film_window;

/// Maximum oversampling.
pub const MAX_OVERSAMPLE: usize = 16;

/// Effective PSFs of a band.
#[derive(Debug)]
pub struct EffectivePsfs<'a> {
    /// The band on a film of p/s.
    film: BandOnFilm<'a>,
    sample: PsfSample,
    oversample: usize,
    window: usize,
}

/// The window of the kernels of `band` in pixels of a film of `film_pitch_um`, odd.
pub fn window_px(band: &LensBand, sample: PsfSample, film_pitch_um: f64) -> usize {
    film_window(band.psf_size, band.psf_pitch_um, film_pitch_um, sample)
}

impl<'a> EffectivePsfs<'a> {
    /// Of `band`, whose PSF samples are `sample`, on a film of `film_pitch_um`, `oversample` samples a pixel and `window` pixels (odd) a side.
    pub fn new(
        band: &'a LensBand,
        sample: PsfSample,
        film_pitch_um: f64,
        (oversample, window): (usize, usize),
    ) -> Self {
        let film = BandOnFilm::new(band, film_pitch_um / oversample as f64);
        Self { film, sample, oversample, window }
    }

    /// Whether the tables cover a film place, mm from the axis.
    pub fn covers(&self, place_mm: [f64; 2]) -> bool {
        self.film.covers(place_mm)
    }

    /// Samples a side.
    pub fn side(&self) -> usize {
        self.window * self.oversample
    }

    /// E at a film place, mm from the axis, and the share of all light in it, Σ E/s². `read`: as for [`BandOnFilm::kernel`].
    ///
    /// # Errors
    /// Those of `read`.
    pub fn at<R>(
        &self,
        place_mm: [f64; 2],
        read: impl FnMut(usize) -> Result<Vec<f32>, R>,
    ) -> Result<(Vec<f32>, f64), R> {
        let energy = self.film.energy(place_mm);
        let (size, kernel) = self.film.kernel(place_mm, self.sample, read)?;
        let n = self.side();
        // Rows of sums along x, then sums of these along y.
        let mut along_x = vec![0.0; size * n];
        for (row, sums) in kernel.chunks_exact(size).zip(along_x.chunks_exact_mut(n)) {
            let row: Vec<f64> = row.iter().map(|v| f64::from(*v)).collect();
            (0..n).for_each(|i| sums[i] = self.taken(i, size).map(|k| row[k]).sum());
        }
        let mut all = Vec::with_capacity(n * n);
        let mut total = 0.0;
        for i in 0..n {
            let rows = self.taken(i, size);
            for x in 0..n {
                let value = energy * rows.clone().map(|k| along_x[k * n + x]).sum::<f64>();
                total += value;
                all.push(value as f32);
            }
        }
        Ok((all, total / (self.oversample * self.oversample) as f64))
    }

    /// The kernel pixels, of `size`, that are in sample `i`.
    fn taken(&self, i: usize, size: usize) -> std::ops::Range<usize> {
        // From the middle one: i + k − ((w + 1)·s/2 − 1), k = 0 … s − 1; w + 1 is even.
        let first = (i + 1 + size / 2) as i64 - (self.window.div_ceil(2) * self.oversample) as i64;
        let within = |at: i64| at.clamp(0, size as i64) as usize;
        within(first)..within(first + self.oversample as i64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lens::LensBand;
    use std::convert::Infallible;

    /// A lens whose PSFs are a Gaussian beside the chief ray, 0.9 of the light of which are in the windows.
    fn lens() -> (LensBand, Vec<f32>) {
        let (n, pitch_um) = (81, 0.25);
        let sample = |i: usize| {
            let [y, x] = [i / n, i % n].map(|k| (k as f64 - 40.0) * pitch_um);
            (-((x - 1.0).powi(2) / 2.0 + y * y)).exp()
        };
        let all: Vec<f64> = (0..n * n).map(sample).collect();
        let sum: f64 = all.iter().sum();
        let band = LensBand {
            psf_height_mm: vec![0.0, 1.0],
            azimuth_count: vec![1, 4],
            psf_size: n,
            psf_pitch_um: pitch_um,
            kernel_pitch_um: None,
            psf_energy: vec![0.9; 2],
            ..LensBand::ideal(550.0, vec![0.0, 1.0])
        };
        (band, all.iter().map(|v| (v / sum) as f32).collect())
    }

    fn at(band: &LensBand, psf: &[f32], s: usize, window: usize, place_mm: [f64; 2]) -> (Vec<f32>, f64) {
        let psfs = EffectivePsfs::new(band, PsfSample::Point, 2.0, (s, window));
        psfs.at(place_mm, |_| Ok::<_, Infallible>(psf.to_vec())).unwrap()
    }

    /// ∫ of the Gaussian of the tests over a pixel of 2 µm about (x, y), as a sum of points.
    fn gaussian(x: f64, y: f64) -> f64 {
        let steps = 40;
        let at = |k: usize| (k as f64 + 0.5) / f64::from(steps) * 2.0 - 1.0;
        let points = (0..1600).map(|k| [x + at(k % 40), y + at(k / 40)]);
        let area = 4.0 / f64::from(steps * steps);
        let norm = std::f64::consts::TAU / 2f64.sqrt();
        points.map(|[x, y]| (-((x - 1.0).powi(2) / 2.0 + y * y)).exp()).sum::<f64>() * area / norm
    }

    #[test]
    fn samples_are_light_in_pixels_about_them() {
        let (band, psf) = lens();
        for s in [1, 2, 3, 4, 5] {
            let (window, place) = (9, [1.0, 0.0]);
            let (all, energy) = at(&band, &psf, s, window, place);
            let n = window * s;
            assert_eq!(all.len(), n * n);
            for (i, v) in all.iter().enumerate() {
                let [y, x] = [i / n, i % n].map(|k| (k as f64 - (n - 1) as f64 / 2.0) * 2.0 / s as f64);
                let expected = 0.9 * gaussian(x, y);
                assert!((f64::from(*v) - expected).abs() < 1e-4, "s {s}, ({x}, {y}) µm: {v}, {expected}");
            }
            let sum: f64 = all.iter().map(|v| f64::from(*v)).sum();
            assert!((energy - 0.9).abs() < 1e-6 && (sum / (s * s) as f64 - energy).abs() < 1e-6);
        }
    }

    #[test]
    fn psfs_are_rotated_to_their_place_and_cropped_to_the_window() {
        let (band, psf) = lens();
        let (right, all) = at(&band, &psf, 3, 9, [1.0, 0.0]);
        let (down, _) = at(&band, &psf, 3, 9, [0.0, 1.0]);
        let n = 27;
        let largest = (0..n * n).map(|i| (right[i] - down[(i % n) * n + i / n]).abs()).fold(0.0, f32::max);
        assert!(largest < 1e-6, "{largest}");
        // A smaller window is the middle of a larger one, with less light.
        let (small, less) = at(&band, &psf, 3, 3, [1.0, 0.0]);
        for i in 0..81 {
            assert_eq!(small[i], right[(i / 9 + 9) * n + i % 9 + 9]);
        }
        assert!(less < 0.97 * all, "{less} of {all}");
    }
}
