//! Crosstalk: the part of the charge of a pixel's light that other pixels collect.
//!
//! Light on the pixel i passes the filter c of i. Of the charge that it makes at the wavelength λ the share K(d; λ) is collected by the pixel i + d, d = (down, right), Σ_d K = 1: light that enters the photodiode of a
//! neighbour (a table), and charge that diffuses ([`super::diffusion`]). K is linear between its wavelengths and constant beyond them. So the signal (e-/s) of the pixel j is, before the exposure's
//! Poisson numbers (which stay independent: each electron is collected by one pixel),
//!
//! ```text
//! signal_j = Σ_d Σ_b κ_cb(d) S_b(j − d),    S_b = A·w_cb·⟨E_b⟩,    κ_cb(d) = ∫ hat_b λ QE_c T K(d; λ) dλ / ∫ hat_b λ QE_c T dλ       c: filter of the pixel j − d
//! ```
//!
//! hat_b, w_cb as in [`super::spectrum`]. Where the weights w differ over the sensor ([`super::field_weights`]), κ is that of perpendicular light. Nothing leaves the sensor at its edges: a share of a pixel that is not there stays
//! where it came from. All of it is computed as zero-sum corrections of the signal without crosstalk, plane by plane:
//!
//! ```text
//! κ_cb(d) ≈ Σ_m a_cbm k_m(d), d ≠ 0;    P_m = Σ_b a_cbm S_b;    signal_j = S(j) + Σ_m Σ_d k_m(d) (P_m(j − d) − P_m(j))
//! ```
//!
//! The k_m are found by Gram and Schmidt's orthogonalization with pivoting until every κ is within 3·10⁻⁶; a film is read once ([`super::spread`]), and light is kept whatever their number.

use super::model::{Channel, Sensor};
use super::{Curve, Pattern};
use std::borrow::Cow;
use std::sync::Arc;

/// Largest error of a share.
const TOLERANCE: f64 = 3e-6;
/// Largest step between nodes of curves that are products of shares and curves, nm.
const STEP_NM: f64 = 5.0;
/// Pixels on each side that a kernel reaches at most.
pub const MAX_RADIUS: usize = 3;

/// Shares of the charge of a pixel over wavelength.
#[derive(Clone, Debug, PartialEq)]
pub struct Crosstalk {
    /// Pixels that it reaches on each side.
    pub radius: usize,
    /// Nodes, ascending, nm.
    pub wavelengths_nm: Vec<f64>,
    /// At each node the shares of the pixels around, row by row; their sum is 1.
    pub shares: Vec<Vec<f64>>,
    /// At each node the share that goes farther, which is counted at the pixel itself.
    pub farther: Vec<f64>,
}

/// A plane of corrections.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Term {
    /// a, by channel and band.
    pub(super) factors: Vec<Vec<f64>>,
    /// k, row by row; 0 for the pixel itself.
    pub(super) kernel: Vec<f64>,
}

/// The corrections of the signal of a sensor in films of some bands.
#[derive(Clone, Debug, PartialEq)]
pub struct Corrections {
    pub(super) radius: usize,
    pub(super) terms: Arc<[Term]>,
}

impl Crosstalk {
    /// Pixels along a side of a kernel.
    pub fn side(&self) -> usize {
        2 * self.radius + 1
    }

    /// Share `k` of a kernel at a wavelength.
    pub fn share_at(&self, k: usize, nm: f64) -> f64 {
        self.between(nm, |i| self.shares[i][k])
    }

    /// Share that goes farther than the kernel, counted at the pixel itself, at a wavelength.
    pub fn farther_at(&self, nm: f64) -> f64 {
        self.between(nm, |i| self.farther[i])
    }

    /// The value at a wavelength of what is `at` the nodes.
    fn between(&self, nm: f64, at: impl Fn(usize) -> f64) -> f64 {
        let x = &self.wavelengths_nm;
        let i = x.partition_point(|v| *v <= nm);
        if i == 0 || i == x.len() {
            return at(i.saturating_sub(1));
        }
        let (a, b) = (at(i - 1), at(i));
        a + (b - a) / (x[i] - x[i - 1]) * (nm - x[i - 1])
    }

    /// That of `self` and then `other`, within [`MAX_RADIUS`]; what goes farther stays at the pixel.
    #[must_use]
    pub fn and(&self, other: &Self) -> Self {
        let radius = (self.radius + other.radius).min(MAX_RADIUS);
        let mut wavelengths_nm: Vec<f64> =
            self.wavelengths_nm.iter().chain(&other.wavelengths_nm).copied().collect();
        wavelengths_nm.sort_by(f64::total_cmp);
        wavelengths_nm.dedup();
        let side = 2 * radius + 1;
        let at = |nm: f64| {
            let mut shares = vec![0.0; side * side];
            for p in 0..self.side() * self.side() {
                for q in 0..other.side() * other.side() {
                    let place = |k: usize, of: &Self| {
                        let along = |i: usize| i as isize - of.radius as isize;
                        (along(k / of.side()), along(k % of.side()))
                    };
                    let ((pi, pj), (qi, qj)) = (place(p, self), place(q, other));
                    let within = |i: isize| usize::try_from(i + radius as isize).ok().filter(|i| *i < side);
                    if let (Some(i), Some(j)) = (within(pi + qi), within(pj + qj)) {
                        shares[i * side + j] += self.share_at(p, nm) * other.share_at(q, nm);
                    }
                }
            }
            let cut = 1.0 - shares.iter().sum::<f64>();
            (with_rest(shares), cut + self.farther_at(nm) + other.farther_at(nm))
        };
        let (shares, farther) = wavelengths_nm.iter().map(|nm| at(*nm)).unzip();
        Self { radius, wavelengths_nm, shares, farther }
    }

    /// Corrections of the signal of `sensor` in films of the bands `bands_nm`.
    pub fn corrections(&self, sensor: &Sensor, bands_nm: &[f64]) -> Corrections {
        let channels = sensor.channels.len();
        let own = self.side() * self.side() / 2;
        let mut rows: Vec<Vec<f64>> = Vec::new();
        for channel in 0..channels {
            let weights = sensor.band_weights(channel, bands_nm);
            let mut own_rows = vec![vec![0.0; self.side() * self.side()]; bands_nm.len()];
            for k in (0..self.side() * self.side()).filter(|k| *k != own) {
                let parts = sensor.band_weights_times(
                    channel,
                    bands_nm,
                    (&self.wavelengths_nm, |nm| self.share_at(k, nm)),
                );
                for ((row, part), weight) in own_rows.iter_mut().zip(parts).zip(&weights) {
                    row[k] = if *weight > 0.0 { part / weight } else { 0.0 };
                }
            }
            rows.extend(own_rows);
        }
        let by_channel = |all: &[f64]| all.chunks(bands_nm.len()).map(<[f64]>::to_vec).collect();
        let term = |(factors, kernel): (Vec<f64>, _)| Term { factors: by_channel(&factors), kernel };
        Corrections { radius: self.radius, terms: factorized(rows).into_iter().map(term).collect() }
    }
}

/// `shares` with the rest of their sum to 1 at the pixel itself.
pub fn with_rest(mut shares: Vec<f64>) -> Vec<f64> {
    let own = shares.len() / 2;
    shares[own] = 0.0;
    shares[own] = 1.0 - shares.iter().sum::<f64>();
    shares
}

/// Columns and rows whose products add up to `rows` within [`TOLERANCE`].
fn factorized(mut rows: Vec<Vec<f64>>) -> Vec<(Vec<f64>, Vec<f64>)> {
    let square = |row: &[f64]| row.iter().map(|v| v * v).sum::<f64>();
    let mut terms = Vec::new();
    while rows.iter().flatten().any(|v| v.abs() > TOLERANCE) {
        let largest = rows
            .iter()
            .map(|row| square(row))
            .enumerate()
            .fold((0, 0.0), |a, b| if b.1 > a.1 { b } else { a });
        let kernel = rows[largest.0].clone();
        let of = |row: &mut Vec<f64>| {
            let factor = std::iter::zip(&*row, &kernel).map(|(a, b)| a * b).sum::<f64>() / largest.1;
            std::iter::zip(row, &kernel).for_each(|(v, k)| *v -= factor * k);
            factor
        };
        let factors = rows.iter_mut().map(of).collect();
        terms.push((factors, kernel));
    }
    terms
}

impl Sensor {
    /// The sensor whose filters respond as this one's do in a picture of one colour: with what they get from their neighbours behind other filters, the mean over their places in the mosaic.
    pub fn in_uniform_light(&self) -> Cow<'_, Self> {
        let Some(crosstalk) = &self.crosstalk else { return Cow::Borrowed(self) };
        let mut nodes: Vec<f64> = self
            .channels
            .iter()
            .flat_map(|c| &c.curve.wavelengths_nm)
            .chain(&crosstalk.wavelengths_nm)
            .copied()
            .collect();
        nodes.sort_by(f64::total_cmp);
        nodes.dedup();
        // A product of two pieces that are linear is not: nodes closer to each other, within the kernels' range, beyond which they are constant.
        let (first, last) =
            (crosstalk.wavelengths_nm[0], crosstalk.wavelengths_nm[crosstalk.wavelengths_nm.len() - 1]);
        let mut dense: Vec<f64> = nodes
            .windows(2)
            .flat_map(|ends| {
                let inside = ends[0] >= first && ends[1] <= last;
                let n = if inside { ((ends[1] - ends[0]) / STEP_NM).ceil().max(1.0) as usize } else { 1 };
                let ends = (ends[0], ends[1]);
                (0..n).map(move |k| ends.0 + (ends.1 - ends.0) * k as f64 / n as f64)
            })
            .collect();
        dense.extend(nodes.last());
        let channel = |c: usize| {
            let places = (0..self.pattern.channels.len()).filter(|p| self.pattern.channels[*p] == c);
            let places: Vec<usize> = places.collect();
            let at = |nm: &f64| {
                let sums = places.iter().map(|place| self.collected_at(crosstalk, *place, *nm));
                sums.sum::<f64>() / places.len() as f64
            };
            let curve = Curve { values: dense.iter().map(at).collect(), wavelengths_nm: dense.clone() };
            Channel { curve, ..self.channels[c].clone() }
        };
        let channels = (0..self.channels.len()).map(channel).collect();
        Cow::Owned(Self { channels, crosstalk: None, ..self.clone() })
    }

    /// Σ_d K(d)·curve of the filter at the place −d of the mosaic.
    fn collected_at(&self, crosstalk: &Crosstalk, place: usize, nm: f64) -> f64 {
        let Pattern { rows, columns, .. } = self.pattern;
        let side = crosstalk.side();
        let back = |from: usize, k: usize, n: usize| {
            (from as isize + crosstalk.radius as isize - k as isize).rem_euclid(n as isize) as usize
        };
        let of = |k: usize| {
            let (y, x) = (back(place / columns, k / side, rows), back(place % columns, k % side, columns));
            crosstalk.share_at(k, nm) * self.channels[self.pattern.channel(y, x)].curve.at(nm)
        };
        (0..side * side).map(of).sum()
    }
}

#[cfg(test)]
mod tests;
