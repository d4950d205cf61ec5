//! Figures of merit of a lens, from its tables and one PSF window: distortion, lateral colour, MTF, Strehl ratio, RMS radius.
//!
//! ```text
//! distortion = (r − h)/h                   r REAL height, h ideal height f·tan(field), f the DISTORTION focal length
//! lateral colour = r(h, λ) − r(h, λ₀)      at equal ideal height, λ₀ the primary wavelength
//! MTF(f) = E |Σ_x e^(−2πi f x) Σ_y P(x, y)|      tangential: x along the meridian; sagittal: across it; f in lp/mm
//! Strehl = E P(0, 0)/p² / (R Ω/λ²)         against a pupil of the same solid angle R Ω, evenly filled, no aberration
//! RMS² = Σ P |ρ − ρ̄|²                      inside the window
//! ```
//! P is the share of the window's light per sample (sum 1), p the sample pitch, E the window's share of all the light: light outside
//! the window counts as uniform, so MTF(0) = 1 and MTF(f) tends to E for small f > 0. For integrated samples the MTF is divided by the sample's sinc(f p), and there is no
//! Strehl ratio, because the peak is averaged. Heights are linear between field points, PSFs between their heights, as on the film.
//! Source: Goodman, Introduction to Fourier Optics, 6.3-6.4; Born & Wolf 9.1.

pub mod effective_psf;
mod encircled;
pub mod on_film;

pub use encircled::EncircledEnergy;

use crate::lens::{LensBand, PsfSample, PsfStack, linear};
use crate::psf::kernel::{KernelScratch, NodeKernels};
use crate::real;
use crate::simd::Simd;
use std::f64::consts::PI;

/// The PSF of one field point on +x, sum 1.
#[derive(Clone, Debug, PartialEq)]
pub struct PsfWindow {
    /// Side, samples, odd.
    pub size: usize,
    /// Sample pitch, µm.
    pub pitch_um: f64,
    /// Meaning of a sample.
    pub sample: PsfSample,
    /// Samples, row down.
    pub samples: Vec<f32>,
    /// Share of all the light.
    pub energy: f64,
}

/// Direction in which the pattern of an MTF varies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Direction {
    /// Along the meridian: lines at right angles to the radius.
    Tangential,
    /// Across the meridian: lines along the radius.
    Sagittal,
}

impl LensBand {
    /// Ideal point of the field point at REAL film coordinates (X, Y), mm.
    pub fn ideal_point_at(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        match &self.planar {
            Some(planar) => planar.map.ideal_point_at([x, y]),
            None => {
                let real = real::hypot(x, y);
                let ratio = if real > 0.0 { self.ideal_height_at(real) / real } else { 1.0 };
                [x * ratio, y * ratio]
            }
        }
    }

    /// Ideal length over REAL length near the axis.
    pub fn scale_on_axis(&self) -> f64 {
        match &self.planar {
            Some(planar) => planar.map.scale_on_axis(),
            None => self.ideal_height_mm[1] / self.image_height_mm[1],
        }
    }

    /// Ideal height of the field point at a REAL height, mm; of a map towards its farthest corner.
    pub fn ideal_height_at(&self, real_mm: f64) -> f64 {
        if let Some(planar) = &self.planar {
            let [x, y] = planar.map.farthest_corner_mm();
            let share = real_mm / real::hypot(x, y);
            let [x, y] = planar.map.ideal_point_at([x * share, y * share]);
            return real::hypot(x, y);
        }
        linear(&self.image_height_mm, &self.ideal_height_mm, real_mm)
    }

    /// REAL height of the field point at an ideal height, mm.
    pub fn real_height_at(&self, ideal_mm: f64) -> f64 {
        linear(&self.ideal_height_mm, &self.image_height_mm, ideal_mm)
    }

    /// Relative illumination at a REAL height.
    pub fn illumination_at(&self, real_mm: f64) -> f64 {
        linear(&self.image_height_mm, &self.relative_illumination, real_mm)
    }

    /// Distortion at a REAL height, per cent; on the axis that of the first field point off axis.
    pub fn distortion_percent(&self, real_mm: f64) -> f64 {
        let real = real_mm.max(self.image_height_mm[1]);
        let ideal = self.ideal_height_at(real);
        100.0 * (real - ideal) / ideal
    }

    /// REAL height minus that in `primary` of the same field point, µm.
    pub fn lateral_colour_um(&self, primary: &Self, real_mm: f64) -> f64 {
        1e3 * (real_mm - primary.real_height_at(self.ideal_height_at(real_mm)))
    }

    /// The last REAL height of both the tables and the PSFs, mm; of a map the distance of its farthest corner from the axis.
    pub fn reach_mm(&self) -> f64 {
        if let Some(planar) = &self.planar {
            let [x, y] = planar.map.farthest_corner_mm();
            return real::hypot(x, y);
        }
        let last = |t: &[f64]| t[t.len() - 1];
        last(&self.image_height_mm).min(last(&self.psf_height_mm))
    }

    /// The PSF at a REAL height: linear between the two of `stack` around it.
    pub fn psf_at(&self, stack: &PsfStack, real_mm: f64) -> PsfWindow {
        let heights = &self.psf_height_mm;
        let k = heights.partition_point(|&h| h <= real_mm).clamp(1, heights.len() - 1);
        let share = ((real_mm - heights[k - 1]) / (heights[k] - heights[k - 1])).clamp(0.0, 1.0);
        let mix = |a: f64, b: f64| a + share * (b - a);
        let (a, b) = (stack.window(k - 1), stack.window(k));
        PsfWindow {
            size: stack.size,
            pitch_um: stack.pitch_um,
            sample: stack.sample,
            samples: a.iter().zip(b).map(|(&a, &b)| mix(f64::from(a), f64::from(b)) as f32).collect(),
            energy: mix(self.psf_energy[k - 1], self.psf_energy[k]),
        }
    }
}

impl PsfWindow {
    /// Coordinate of sample row or column `i` from the chief ray.
    fn at_um(&self, i: usize) -> f64 {
        (i as f64 - (self.size / 2) as f64) * self.pitch_um
    }

    /// Σ_y P over x (tangential) or Σ_x P over y (sagittal).
    fn line(&self, direction: Direction) -> Vec<f64> {
        let n = self.size;
        let mut line = vec![0.0; n];
        for (i, &v) in self.samples.iter().enumerate() {
            let at = match direction {
                Direction::Tangential => i % n,
                Direction::Sagittal => i / n,
            };
            line[at] += f64::from(v);
        }
        line
    }

    /// Centroid along the meridian from the chief ray, µm.
    pub fn centroid_um(&self) -> f64 {
        self.line(Direction::Tangential).iter().enumerate().map(|(i, v)| v * self.at_um(i)).sum()
    }

    /// RMS radius about the centroid inside the window, µm.
    pub fn rms_um(&self) -> f64 {
        let moment = |direction, power: i32| -> f64 {
            self.line(direction).iter().enumerate().map(|(i, v)| v * self.at_um(i).powi(power)).sum()
        };
        let both = [Direction::Tangential, Direction::Sagittal];
        both.map(|d| moment(d, 2) - moment(d, 1).powi(2)).iter().sum::<f64>().max(0.0).sqrt()
    }

    /// Strehl ratio at the chief ray; `None` for integrated samples.
    pub fn strehl(&self, band: &LensBand, real_mm: f64) -> Option<f64> {
        let solid_angle = band.solid_angle_sr * band.illumination_at(real_mm);
        let um = band.wavelength_nm * 1e-3;
        let peak = f64::from(self.samples[self.samples.len() / 2]) * self.energy / self.pitch_um.powi(2);
        (self.sample == PsfSample::Point).then(|| peak * um * um / solid_angle)
    }

    /// Modulation of a sine pattern of `lp_mm` line pairs per mm; 1 at 0.
    pub fn mtf(&self, lp_mm: f64, direction: Direction) -> f64 {
        let (re, im) = self.otf(lp_mm, direction);
        real::hypot(re, im)
    }

    /// Optical transfer function about the chief ray, real and imaginary part; 1 at 0.
    pub fn otf(&self, lp_mm: f64, direction: Direction) -> (f64, f64) {
        if lp_mm == 0.0 {
            return (1.0, 0.0);
        }
        let k = 2e-3 * PI * lp_mm;
        let (mut re, mut im) = (0.0, 0.0);
        for (i, v) in self.line(direction).iter().enumerate() {
            let (s, c) = real::sin_cos(k * self.at_um(i));
            re += v * c;
            im -= v * s;
        }
        let sample_mtf = match self.sample {
            PsfSample::Point => 1.0,
            PsfSample::Integrated => {
                let x = 0.5 * k * self.pitch_um;
                real::sin(x) / x
            }
        };
        (self.energy * re / sample_mtf, self.energy * im / sample_mtf)
    }

    /// The kernel on a film of `film_pitch_um`, sum 1: side and pixels.
    pub fn film_kernel(&self, film_pitch_um: f64) -> (usize, Vec<f32>) {
        let stack = PsfStack {
            size: self.size,
            pitch_um: self.pitch_um,
            sample: self.sample,
            samples: self.samples.clone(),
        };
        let kernels = NodeKernels::new(&stack, film_pitch_um, None, Simd::PORTABLE);
        (kernels.size(), kernels.unrotated(0, &mut KernelScratch::default()).to_vec())
    }
}

/// Modulation of the weighted sum of PSFs of several wavelengths: weight, place of the chief ray along the meridian in µm, PSF. Tangential
/// patterns are blurred by lateral colour.
pub fn polychromatic_mtf(psfs: &[(f64, f64, &PsfWindow)], lp_mm: f64, direction: Direction) -> f64 {
    let (mut re, mut im, mut total) = (0.0, 0.0, 0.0);
    for (weight, at_um, psf) in psfs {
        let (a, b) = psf.otf(lp_mm, direction);
        let shift = match direction {
            Direction::Tangential => -2e-3 * PI * lp_mm * at_um,
            Direction::Sagittal => 0.0,
        };
        let (s, c) = real::sin_cos(shift);
        re += weight * (a * c - b * s);
        im += weight * (a * s + b * c);
        total += weight;
    }
    real::hypot(re, im) / total
}

/// Σ |a − b| of two kernels of odd sides, each cropped to the smaller side and normalised there again.
pub fn kernel_l1((a_size, a): (usize, &[f32]), (b_size, b): (usize, &[f32])) -> f64 {
    let n = a_size.min(b_size);
    let crop = |size: usize, v: &[f32]| -> Vec<f64> {
        let edge = (size - n) / 2;
        let rows = v.chunks_exact(size).skip(edge).take(n);
        let cut: Vec<f64> = rows.flat_map(|r| r[edge..][..n].iter().map(|&v| f64::from(v))).collect();
        let sum: f64 = cut.iter().sum();
        cut.iter().map(|v| v / sum).collect()
    };
    crop(a_size, a).iter().zip(crop(b_size, b)).map(|(a, b)| (a - b).abs()).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn gauss(size: usize, pitch_um: f64, sx: f64, sy: f64, x0: f64) -> PsfWindow {
        let at = |i: usize| (i as f64 - (size / 2) as f64) * pitch_um;
        let value = |i: usize| {
            let (x, y) = (at(i % size) - x0, at(i / size));
            (-0.5 * ((x / sx).powi(2) + (y / sy).powi(2))).exp()
        };
        let sum: f64 = (0..size * size).map(value).sum();
        let samples = (0..size * size).map(|i| (value(i) / sum) as f32).collect();
        PsfWindow { size, pitch_um, sample: PsfSample::Point, samples, energy: 0.98 }
    }

    #[test]
    fn gaussian_has_analytic_moments_and_mtf() {
        let psf = gauss(121, 0.5, 4.0, 2.0, 1.5);
        assert!((psf.centroid_um() - 1.5).abs() < 1e-5);
        assert!((psf.rms_um() - 20f64.sqrt()).abs() < 1e-4);
        assert_eq!(psf.mtf(0.0, Direction::Tangential), 1.0);
        for lp in [1e-6, 10.0, 40.0] {
            let expected = |s: f64| 0.98 * (-2.0 * (PI * lp * s * 1e-3).powi(2)).exp();
            assert!((psf.mtf(lp, Direction::Tangential) - expected(4.0)).abs() < 1e-5);
            assert!((psf.mtf(lp, Direction::Sagittal) - expected(2.0)).abs() < 1e-5);
        }
    }

    #[test]
    fn kernels_of_two_pitches_agree_on_the_film() {
        let (a, b) = (gauss(161, 0.5, 5.0, 3.0, 0.0), gauss(101, 0.8, 5.0, 3.0, 0.0));
        let ((an, ak), (bn, bk)) = (a.film_kernel(2.0), b.film_kernel(2.0));
        let same = kernel_l1((an, &ak), (bn, &bk));
        assert!(same < 1e-4, "{same}");
        let (cn, ck) = gauss(161, 0.5, 5.0, 3.0, 2.0).film_kernel(2.0);
        // Moved by a pixel: Σ |P(x) − P(x − 2)| of a Gaussian is 2 erf(1/(σ√2)).
        let moved = kernel_l1((an, &ak), (cn, &ck));
        assert!((moved - 2.0 * 0.158_519).abs() < 3e-3, "{moved}");
    }
}
