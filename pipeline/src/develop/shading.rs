//! Shading correction: division by the relative illumination.
//!
//!   S_c(r) = Σ_b w_cb·R(r, λ_b) / Σ_b w_cb      of a lens, for the filter c at the real image height r in mm
//! with w_cb the weights of the film's bands ([`crate::sensor::spectrum`]) and R the relative illumination, linear in wavelength between the
//! lens's bands; of a sensor whose response depends on the angle of incidence times that ([`ResponseMap`]). Of a flat (a raw of a uniform chart): its value over the mean of the same filter in the middle of the picture.
//! A divisor is at least 1/8: where less light arrives, amplified noise is all that a picture would show.

use crate::lens::Lens;
use crate::sensor::response_map::ResponseMap;

/// Minimum divisor.
pub const MIN_DIVISOR: f32 = 0.125;
/// Nodes of the table over height.
const NODES: usize = 4096;

/// Shading of a lens by distance from its axis.
#[derive(Clone, Debug)]
pub struct LensShading {
    /// Of each filter, at equal steps of distance.
    tables: Vec<Vec<f32>>,
    /// Nodes per pixel.
    nodes_per_px: f32,
    /// Row and column of the axis, pixels.
    axis_px: (f32, f32),
    /// Response over the angle of incidence, the place (row, column) on the sensor of the picture's first pixel, and the distance of its pixels there.
    angles: Option<(ResponseMap, (f32, f32), f32)>,
}

impl LensShading {
    /// For pixels of `pitch_mm` whose axis lies at `axis_px` (row, column) and that reach `reach_px` from it. `weights`: per filter, of the
    /// bands at `wavelengths_nm`.
    ///
    /// # Errors
    /// A text, if the lens does not cover the pixels or the wavelengths.
    pub fn new(
        lens: &Lens,
        wavelengths_nm: &[f64],
        weights: &[Vec<f64>],
        (pitch_mm, axis_px, reach_px): (f64, (f64, f64), f64),
    ) -> Result<Self, String> {
        let reach_mm = reach_px * pitch_mm;
        for band in &lens.bands {
            let last = band.image_height_mm.last().copied().unwrap_or(0.0);
            if last * (1.0 + 1e-9) < reach_mm {
                return Err(format!(
                    "lens {} at {} nm reaches {last:.3} mm from the axis, the picture {reach_mm:.3} mm",
                    lens.name, band.wavelength_nm
                ));
            }
        }
        let bands: Vec<(usize, usize, f64)> =
            wavelengths_nm.iter().map(|nm| between(lens, *nm)).collect::<Result<_, _>>()?;
        // A single pixel on the axis has no reach of its own.
        let step_px = (reach_px / (NODES - 2) as f64).max(1e-3);
        let illumination: Vec<Vec<f64>> = (0..NODES)
            .map(|k| {
                let r = k as f64 * step_px * pitch_mm;
                let of =
                    |b: usize| at(&lens.bands[b].image_height_mm, &lens.bands[b].relative_illumination, r);
                bands.iter().map(|&(low, high, t)| of(low) * (1.0 - t) + of(high) * t).collect()
            })
            .collect();
        let table = |w: &Vec<f64>| -> Vec<f32> {
            let all: f64 = w.iter().sum();
            let node = |r: &Vec<f64>| std::iter::zip(w, r).map(|(w, r)| w * r).sum::<f64>() / all;
            illumination.iter().map(|r| (node(r) as f32).max(MIN_DIVISOR)).collect()
        };
        Ok(Self {
            tables: weights.iter().map(table).collect(),
            nodes_per_px: (1.0 / step_px) as f32,
            axis_px: (axis_px.0 as f32, axis_px.1 as f32),
            angles: None,
        })
    }

    /// With the response `map` of a sensor: the picture's first pixel lies at `first` (row, column) of it, its pixels `step` of the sensor's apart.
    #[must_use]
    pub fn with_angles(self, map: ResponseMap, first: (f64, f64), step: f64) -> Self {
        Self { angles: Some((map, (first.0 as f32, first.1 as f32), step as f32)), ..self }
    }

    /// Divisor of a pixel behind a filter.
    #[inline]
    pub fn divisor(&self, filter: usize, row: usize, column: usize) -> f32 {
        let (dy, dx) = (row as f32 - self.axis_px.0, column as f32 - self.axis_px.1);
        let at = (dy * dy + dx * dx).sqrt() * self.nodes_per_px;
        let table = &self.tables[filter];
        let k = (at as usize).min(table.len() - 2);
        let illumination = table[k] + (table[k + 1] - table[k]) * (at - k as f32).min(1.0);
        match &self.angles {
            None => illumination,
            Some((map, first, step)) => {
                let place = (first.0 + row as f32 * step, first.1 + column as f32 * step);
                (illumination * map.at(filter, place)).max(MIN_DIVISOR)
            }
        }
    }
}

/// Bands of a lens around a wavelength, and the share of the second.
fn between(lens: &Lens, nm: f64) -> Result<(usize, usize, f64), String> {
    let all: Vec<f64> = lens.bands.iter().map(|b| b.wavelength_nm).collect();
    let above = all.partition_point(|w| *w < nm - 1e-9);
    match (above.checked_sub(1), all.get(above)) {
        (_, Some(w)) if (w - nm).abs() < 1e-6 => Ok((above, above, 0.0)),
        (Some(below), Some(w)) => Ok((below, above, (nm - all[below]) / (w - all[below]))),
        _ => Err(format!(
            "lens {} has bands from {} to {} nm and none at {nm} nm",
            lens.name,
            all.first().copied().unwrap_or(f64::NAN),
            all.last().copied().unwrap_or(f64::NAN)
        )),
    }
}

/// A table, linear between its nodes, constant beyond.
fn at(x: &[f64], y: &[f64], v: f64) -> f64 {
    let i = x.partition_point(|n| *n <= v).clamp(1, x.len() - 1);
    let t = ((v - x[i - 1]) / (x[i] - x[i - 1])).clamp(0.0, 1.0);
    y[i - 1] + (y[i] - y[i - 1]) * t
}
