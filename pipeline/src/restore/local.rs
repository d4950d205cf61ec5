//! The spectrum of AᵀA near a place, as if the lens were the same around it: the solver's preconditioner, and the prediction of residuals.
//!
//! ```text
//! N(f) = Re F[AᵀA δ]                            mean over points δ in the middle of the free pixels; |H|² g² of a PSF with the OTF H and the gain g
//! P(f) = max(N, FLOOR · N(0)) + λ |D(f)|²        |D(f)|² = 4 − 2 cos 2πf_row − 2 cos 2πf_column, of first differences; f in cycles per chart pixel
//! P⁻¹ r = F⁻¹[F[r]/P]
//! ```
//! P⁻¹ on a chart that is 0 outside its free pixels is symmetric and positive; it differs from the inverse of AᵀA + λDᵀD by what the PSF changes over a tile, by the tile's border and by
//! the wrap of the transform, which only cost iterations.

use super::Operator;
use crate::flow::SourceSinkError;
use crate::geometry::{Rect, Size};
use crate::real;
use crate::veil::fft::{Planes, side};
use std::f64::consts::TAU;

/// The least value of N, of N(0): the noise of f32 sums, far below any λ|D|² that is of use.
const FLOOR: f64 = 1e-7;
/// Points along each side that N is the mean of, at most.
const POINTS: usize = 3;
/// Pixels beyond the window of a point that AᵀA reaches, of interpolation.
const MARGIN_PX: usize = 4;

/// The spectrum of AᵀA near a place, on the transform of a chart.
#[derive(Clone, Debug)]
pub struct LocalSpectrum {
    planes: Planes,
    size: Size,
    /// Sides of the transform.
    sides: Size,
    /// N, rows of [`Planes::stride`].
    normal: Vec<f64>,
    /// |D|².
    differences: Vec<f64>,
}

impl LocalSpectrum {
    /// Of `operator`, whose PSFs have windows of `window_px`, around the middle of the rectangle `free` of its chart.
    ///
    /// # Errors
    /// Those of the operator.
    pub fn new(operator: &dyn Operator, window_px: usize, free: Rect) -> Result<Self, SourceSinkError> {
        let size = operator.chart();
        let sides = Size::new(side(size.height), side(size.width));
        let reach = window_px - 1 + MARGIN_PX;
        let points = points(free, 2 * reach + 1);
        let mut chart = vec![0.0f32; size.pixels()];
        points.iter().for_each(|(y, x)| chart[y * size.width + x] = 1.0);
        let mut film = vec![0.0; operator.film().pixels()];
        operator.apply(&chart, &mut film)?;
        operator.transpose(&film, &mut chart)?;
        let mut kernel = vec![0.0f64; sides.pixels()];
        let reach = reach as i64;
        for &(y, x) in &points {
            let (y, x) = (y as i64, x as i64);
            let part = Rect::new(y, x, 1, 1).grown(reach as usize).intersect(size.rect());
            for (row, column) in
                (part.y..part.bottom()).flat_map(|row| (part.x..part.right()).map(move |c| (row, c)))
            {
                let to = |d: i64, side: usize| d.rem_euclid(side as i64) as usize;
                let value = f64::from(chart[row as usize * size.width + column as usize]);
                kernel[to(row - y, sides.height) * sides.width + to(column - x, sides.width)] +=
                    value / points.len() as f64;
            }
        }
        Ok(Self::of_kernel(size, sides, &kernel))
    }

    /// Of a chart of `size`, of AᵀA δ on a plane of `sides` whose first pixel is that of δ.
    fn of_kernel(size: Size, sides: Size, kernel: &[f64]) -> Self {
        let planes = Planes::new(sides.height, sides.width);
        let stride = planes.stride();
        let spectrum = planes.forward(kernel, sides.width);
        let least = FLOOR * spectrum[0].re;
        let normal = spectrum.iter().map(|n| n.re.max(least)).collect();
        let along = |n: usize, k: usize| 2.0 - 2.0 * real::cos(TAU * k as f64 / n as f64);
        let columns: Vec<f64> = (0..stride).map(|u| along(sides.width, u)).collect();
        let of_row = |v: usize| {
            let row = along(sides.height, v);
            columns.iter().map(move |column| row + column).collect::<Vec<_>>()
        };
        let differences = (0..sides.height).flat_map(of_row).collect();
        Self { planes, size, sides, normal, differences }
    }

    /// With a share `density` of the film pixels measured, evenly spread: N times it.
    #[must_use]
    pub fn with_density(mut self, density: f64) -> Self {
        self.normal.iter_mut().for_each(|n| *n *= density);
        self
    }

    /// The shorter side of the transform.
    pub fn side_px(&self) -> usize {
        self.sides.height.min(self.sides.width)
    }

    /// N(0): the square of the film's value per value of a uniform chart, times the density.
    pub fn square_of_gain(&self) -> f64 {
        self.normal[0]
    }

    /// P⁻¹ of `chart`, with `lambda`.
    pub fn inverse(&self, lambda: f64, chart: &[f64]) -> Vec<f64> {
        let mut spectrum = self.planes.forward(chart, self.size.width);
        let scale = 1.0 / self.sides.pixels() as f64;
        let factors = self.normal.iter().zip(&self.differences);
        spectrum.iter_mut().zip(factors).for_each(|(v, (n, d))| *v *= scale / (n + lambda * d));
        let plane = self.planes.inverse(&mut spectrum, self.size.height);
        plane.chunks_exact(self.sides.width).flat_map(|row| &row[..self.size.width]).copied().collect()
    }

    /// [`LocalSpectrum::inverse`] at the `free` pixels, 0 elsewhere.
    pub(super) fn inverse_at(&self, lambda: f64, chart: &[f64], free: &[bool]) -> Vec<f64> {
        let mut values = self.inverse(lambda, chart);
        values.iter_mut().zip(free).for_each(|(value, free)| *value *= f64::from(u8::from(*free)));
        values
    }

    /// The transform that it is for.
    pub(super) fn planes(&self) -> (&Planes, Size) {
        (&self.planes, self.sides)
    }

    /// N and |D|² of the frequencies of the transform, with how often each stands for a pair of them.
    pub(super) fn frequencies(&self) -> impl Iterator<Item = (usize, f64, f64, f64)> + '_ {
        let (stride, half) = (self.planes.stride(), self.sides.width / 2);
        (0..self.normal.len()).filter_map(move |i| {
            let u = i % stride;
            let count = if u == 0 || u == half { 1.0 } else { 2.0 };
            (u <= half).then(|| (i, self.normal[i], self.differences[i], count))
        })
    }

    /// How far the response of P⁻¹AᵀA to a point reaches with `lambda`, px along a row: beyond it the sum of its absolute values is less than `share` of the total.
    pub fn reach_px(&self, lambda: f64, share: f64) -> usize {
        let (height, width) = (self.sides.height, self.sides.width);
        let mut spectrum: Vec<_> = self
            .normal
            .iter()
            .zip(&self.differences)
            // Of Aᵀ rather than AᵀA: what noise and unknown light of a film pixel become.
            .map(|(n, d)| num_complex::Complex64::new(n.sqrt() / (n + lambda * d), 0.0))
            .collect();
        let plane = self.planes.inverse(&mut spectrum, height);
        let half = (height.min(width) / 2).max(1);
        let mut at = vec![0.0; half + 1];
        for (i, value) in plane.iter().enumerate() {
            let fold = |k: usize, n: usize| k.min(n - k);
            let distance = fold(i / width, height).max(fold(i % width, width)).min(half);
            at[distance] += value.abs();
        }
        let total: f64 = at.iter().sum();
        let mut beyond = 0.0;
        for distance in (0..=half).rev() {
            beyond += at[distance];
            if beyond > share * total {
                return distance + 1;
            }
        }
        0
    }
}

/// Pixels of a grid in the middle of `free`, `apart` px from each other and half of that from its border: at least the middle one.
fn points(free: Rect, apart: usize) -> Vec<(usize, usize)> {
    let along = |first: i64, length: usize| {
        let count = (length / apart).clamp(1, POINTS);
        let start = first as usize + (length - (count - 1) * apart) / 2;
        (0..count).map(move |k| start + k * apart)
    };
    along(free.y, free.height).flat_map(|y| along(free.x, free.width).map(move |x| (y, x))).collect()
}
