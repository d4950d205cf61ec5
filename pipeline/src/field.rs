//! Distortion h(r, λ) and relative illumination R(r, λ) of a band, as functions of REAL image height.
//!
//! ```text
//! h(r)   ideal height of the field point whose chief ray meets the film at real height r, mm;  film coordinates times h/r are
//!        coordinates on the ideal image plane (on the axis h/r = h₁/r₁, the ratio of the first field point)
//! R(r)   irradiance there over irradiance on the axis, from the lens's table, not cos⁴; R belongs to the field point and includes
//!        the change of area by distortion
//! ```
//! On a chart in the projection of the film ([`crate::projection`]) h is the height there of the ideal height. Both are linear between the dense field points of the tables (error ≤ max|f″|·Δr²/8, 1e-4 px by the accuracy required of lens packs), in f64.
//! Beyond the last point the band plan reports an error or, with [`Outside::Clamp`], h/r and R of the last point are used.
//! A centred lens has no dependence on azimuth; lenses without rotational symmetry: [`planar`].
#![allow(clippy::needless_range_loop, reason = "lanes of several arrays at once")]

pub mod planar;

use crate::geometry::Frame;
use crate::lens::{LensBand, LensError};
use crate::projection::Projection;
use std::borrow::Cow;

/// Treatment of a film that extends beyond the lens's tables.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outside {
    /// An error.
    Error,
    /// Use the last value.
    Clamp,
}

impl Outside {
    /// Checks that a table reaching `last_mm` covers `needed_mm`.
    ///
    /// # Errors
    /// [`LensError::Outside`] with both ranges, unless clamped.
    pub fn check(
        self,
        table: &'static str,
        wavelength_nm: f64,
        needed_mm: f64,
        last_mm: f64,
    ) -> Result<(), LensError> {
        // Tolerance for a film that ends exactly at the end of the table, rounded from px to mm.
        match self == Self::Clamp || needed_mm <= last_mm * (1.0 + 1e-9) {
            true => Ok(()),
            false => Err(LensError::Outside { table, wavelength_nm, needed_mm, last_mm }),
        }
    }
}

/// h/r and R by real image height, ready for lookup in film pixels.
#[derive(Clone, Debug)]
pub struct Field {
    /// Real heights of the field points, px.
    real_px: Vec<f64>,
    steps: Vec<TableInterval>,
    /// (h/r, R·gain) on the axis.
    paraxial: (f64, f64),
    /// Index of the interval at the beginning of each of equal intervals of r.
    buckets: Vec<u32>,
    buckets_per_px: f64,
}

/// Local scale of the map from film to ideal image plane, ideal over REAL length, over a part of the film.
///
/// With rotational symmetry h/r across the meridian, h′ = dh/dr along it, and the derivative of rows with respect to columns is at most |h′ − h/r|/2; without it
/// bounds of the singular values of the Jacobian.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stretch {
    /// Minimum of h/r and h′, or of the singular values.
    pub least: f64,
    /// Maximum of h/r and h′, or of the singular values.
    pub greatest: f64,
    /// Maximum of |h′ − h/r|/2, or of the derivatives of rows by columns and of columns by rows.
    pub shear: f64,
}

/// Radii looked up together.
pub(crate) const BLOCK: usize = 8;

/// Between the real heights `from` and `until` (px): h = h_at + h_slope·r, R = gain_at + gain_slope·r.
#[derive(Clone, Copy, Debug)]
pub(crate) struct TableInterval {
    pub(crate) from: f64,
    pub(crate) until: f64,
    pub(crate) h_at: f64,
    pub(crate) h_slope: f64,
    pub(crate) gain_at: f64,
    pub(crate) gain_slope: f64,
}

impl Field {
    /// The tables of `band` on a film of `pitch_mm`. Without `distortion` h = r; without `illumination` R = 1; `gain`
    /// multiplies R (film units).
    pub fn new(band: &LensBand, pitch_mm: f64, distortion: bool, illumination: bool, gain: f64) -> Self {
        Self::of_heights(band, &band.ideal_height_mm, pitch_mm, distortion, illumination, gain)
    }

    /// As [`Field::new`] on the film of `frame`, with h the height on the plane of its chart.
    pub fn on_chart(band: &LensBand, frame: &Frame, distortion: bool, illumination: bool, gain: f64) -> Self {
        let ideal = &band.ideal_height_mm;
        let on_chart = match frame.projection {
            Projection::Planar => Cow::Borrowed(&ideal[..]),
            Projection::Film(_) => ideal.iter().map(|h| frame.projection.chart_mm(*h)).collect(),
        };
        Self::of_heights(band, &on_chart, frame.pitch_mm(), distortion, illumination, gain)
    }

    fn of_heights(
        band: &LensBand,
        on_chart: &[f64],
        pitch_mm: f64,
        distortion: bool,
        illumination: bool,
        gain: f64,
    ) -> Self {
        let real = &band.image_height_mm[..];
        let ideal = if distortion { on_chart } else { real };
        let ri = &band.relative_illumination;
        let step = |i: usize| {
            let slope = |t: &[f64]| (t[i + 1] - t[i]) / (real[i + 1] - real[i]);
            let (h_slope, r_slope) = (slope(ideal), if illumination { slope(ri) } else { 0.0 });
            TableInterval {
                from: real[i] / pitch_mm,
                until: if i + 2 < real.len() { real[i + 1] / pitch_mm } else { f64::INFINITY },
                h_at: (ideal[i] - h_slope * real[i]) / pitch_mm,
                h_slope,
                gain_at: gain * if illumination { ri[i] - r_slope * real[i] } else { 1.0 },
                gain_slope: gain * r_slope * pitch_mm,
            }
        };
        let real_px: Vec<f64> = real.iter().map(|h| h / pitch_mm).collect();
        let last = real_px[real_px.len() - 1];
        let count = 4 * real_px.len();
        let buckets_per_px = count as f64 / last;
        let mut buckets = Vec::with_capacity(count + 1);
        let mut i = 0;
        for b in 0..=count {
            // Slightly early, so that with rounding the lookup never starts beyond the step of its radius.
            while i + 2 < real_px.len() && real_px[i + 1] <= (b as f64 - 1e-6) / buckets_per_px {
                i += 1;
            }
            buckets.push(i as u32);
        }
        // The last step is repeated: `block` reads a step and the next.
        let last = real.len() - 2;
        Self {
            paraxial: (ideal[1] / real[1], if illumination { gain * ri[0] } else { gain }),
            steps: (0..=last).chain([last]).map(step).collect(),
            real_px,
            buckets,
            buckets_per_px,
        }
    }

    /// The stretch over the radii from 0 to `reach_px`.
    pub fn stretch(&self, reach_px: f64) -> Stretch {
        let axis = self.paraxial.0;
        let mut all = Stretch { least: axis, greatest: axis, shear: 0.0 };
        let last = self.last_px();
        // Within a step h′ is constant and h/r monotone. Beyond the tables h/r is constant and h′ equal to it.
        for step in self.steps().iter().take_while(|s| s.from <= reach_px) {
            for r in [step.from, step.until.min(last)] {
                let (radial, tangential) = (step.h_slope, self.at(r).0);
                all.least = all.least.min(radial).min(tangential);
                all.greatest = all.greatest.max(radial).max(tangential);
                all.shear = all.shear.max((radial - tangential).abs() / 2.0);
            }
        }
        all
    }

    /// The steps, ascending.
    pub(crate) fn steps(&self) -> &[TableInterval] {
        &self.steps[..self.steps.len() - 1]
    }

    /// Index of the interval at the beginning of each of equal intervals of r, and intervals per px.
    pub(crate) fn buckets(&self) -> (&[u32], f64) {
        (&self.buckets, self.buckets_per_px)
    }

    /// Last real height of the tables, px.
    pub(crate) fn last_px(&self) -> f64 {
        self.real_px[self.real_px.len() - 1]
    }

    /// The step that contains `r`.
    #[inline(always)]
    pub(crate) fn step(&self, r: f64) -> usize {
        let mut i = self.buckets[((r * self.buckets_per_px) as usize).min(self.buckets.len() - 1)] as usize;
        while self.steps[i].until <= r {
            i += 1;
        }
        i
    }

    /// (h/r, R·gain) at real height `r_px`.
    #[inline]
    pub fn at(&self, r_px: f64) -> (f64, f64) {
        let r = r_px.min(self.real_px[self.real_px.len() - 1]);
        let s = &self.steps[self.step(r)];
        match r > 0.0 {
            true => (s.h_slope + s.h_at / r, s.gain_at + s.gain_slope * r),
            false => self.paraxial,
        }
    }

    /// [`Field::at`] of `BLOCK` radii, with the same bits; `None` unless they lie within two adjacent steps, as those of neighbouring
    /// film pixels usually do.
    #[inline(always)]
    pub(crate) fn block(&self, r_px: [f64; BLOCK]) -> Option<([f64; BLOCK], [f64; BLOCK])> {
        let (mut magnification, mut gain, mut r) = ([0.0; BLOCK], [0.0; BLOCK], [0.0; BLOCK]);
        let last = self.real_px[self.real_px.len() - 1];
        for i in 0..BLOCK {
            r[i] = if r_px[i] < last { r_px[i] } else { last };
        }
        let i = self.step(if r[0] < r[BLOCK - 1] { r[0] } else { r[BLOCK - 1] });
        let (a, b) = (&self.steps[i], &self.steps[i + 1]);
        let edge = a.until;
        // Also false at r = 0.
        let from = self.real_px[i].max(f64::MIN_POSITIVE);
        let mut fits = true;
        for r in r {
            fits &= (r >= from) & (r < b.until);
        }
        if !fits {
            return None;
        }
        // By bits: for a plain `if` the compiler selects addresses lane by lane, without SIMD.
        let select = |r: f64, a: f64, b: f64| {
            let mask = u64::from(r < edge).wrapping_neg();
            f64::from_bits(b.to_bits() ^ ((a.to_bits() ^ b.to_bits()) & mask))
        };
        for i in 0..BLOCK {
            let r = r[i];
            magnification[i] = select(r, a.h_slope, b.h_slope) + select(r, a.h_at, b.h_at) / r;
            gain[i] = select(r, a.gain_at, b.gain_at) + select(r, a.gain_slope, b.gain_slope) * r;
        }
        Some((magnification, gain))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn band(real: &[f64]) -> LensBand {
        LensBand {
            ideal_height_mm: real.iter().map(|h| h * (1.0 + 1e-3 * h)).collect(),
            relative_illumination: real.iter().map(|h| 1.0 - 0.01 * h * h).collect(),
            psf_height_mm: vec![0.0, 1.0],
            ..LensBand::ideal(550.0, real.to_vec())
        }
    }

    #[test]
    fn uneven_tables_are_interpolated_linearly() {
        let real = [0.0, 1e-4, 0.5, 0.50001, 0.6, 3.0, 3.1, 9.0];
        let b = band(&real);
        let field = Field::new(&b, 2e-3, true, true, 2.0);
        for i in 0..9000 {
            let r = f64::from(i) * 1e-3;
            let k = real.partition_point(|&x| x <= r).clamp(1, real.len() - 1);
            let u = (r - real[k - 1]) / (real[k] - real[k - 1]);
            let expected = |t: &[f64]| t[k - 1] + u * (t[k] - t[k - 1]);
            let (m, ri) = field.at(r / 2e-3);
            assert!((ri - 2.0 * expected(&b.relative_illumination)).abs() < 1e-12, "R at {r}");
            if r > 0.0 {
                assert!((m - expected(&b.ideal_height_mm) / r).abs() < 1e-12, "h/r at {r}");
            }
        }
        assert_eq!(field.at(1e9), field.at(9.0 / 2e-3), "beyond the table the last values are used");
    }

    #[test]
    fn stretch_bounds_all_difference_quotients() {
        let b = band(&[0.0, 1e-4, 0.5, 0.50001, 0.6, 3.0, 3.1, 9.0]);
        let field = Field::new(&b, 2e-3, true, true, 1.0);
        let s = field.stretch(5000.0);
        let h = |r: f64| r * field.at(r).0;
        for i in 1..5000 {
            let (r, step) = (f64::from(i), 1e-3);
            let (tangential, radial) = (field.at(r).0, (h(r + step) - h(r)) / step);
            for v in [tangential, radial] {
                assert!((s.least - 1e-6..=s.greatest + 1e-6).contains(&v), "{v} at {r} px, {s:?}");
            }
            assert!((radial - tangential).abs() / 2.0 <= s.shear + 1e-6, "at {r} px");
        }
        assert!(s.greatest < 1.03 && s.shear < 0.01, "{s:?}");
    }

    #[test]
    fn disabled_stages_are_the_identity() {
        let field = Field::new(&band(&[0.0, 1.0, 2.0]), 2e-3, false, false, 1.0);
        for r in [0.0, 0.3, 499.7, 500.0, 812.0] {
            let (m, ri) = field.at(r);
            assert!((m - 1.0).abs() < 1e-15 && ri == 1.0);
        }
    }
}
