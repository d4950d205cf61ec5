//! Charge that a pixel does not hold: the knee of its response, and blooming along its column.
//!
//! Of the charge q (e-, after the Poisson number) a pixel of the full well W and the knee k holds
//!
//! ```text
//! held(q) = q                                                             q ≤ kW
//!         = W·(k + (1 − k)·(1 − e^(−(q − kW)/((1 − k)·W))))               above: a straight line that bends towards W without a kink;   k = 1: min(q, W)
//! ```
//!
//! Of the rest, q − held(q), the share s (`blooming`) flows along the column, half of it up and half down; what is left is drained. Flowing charge fills every pixel that it passes up to W and goes on with what they do
//! not hold; what passes the first or the last row is drained. Where flows in both directions reach a pixel that is not full, it receives the mean of what it does if all that flows down comes first, and if all that flows up does.
//! So charge is kept but for what is drained, no pixel holds more than W, and a column upside down blooms upside down. Received charge has the noise of its source. Limits: columns do not mix; black sun is not modelled.

use super::noise::Exposer;
use super::quantile::exp;
use crate::geometry::Rect;

/// How pixels fill and overflow.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Overflow {
    /// Share of the full well up to which the charge is that of the light; 1: up to the full well.
    pub knee: f64,
    /// Share of the charge that is not held which flows along the column.
    pub blooming: f64,
}

/// Columns whose flows are followed together.
const COLUMNS: usize = 64;
/// Exponent beyond which e⁻ˣ is left out.
const FAR: f64 = 50.0;

impl Overflow {
    /// The full well is a limit, what is above it is drained.
    pub const NONE: Self = Self { knee: 1.0, blooming: 0.0 };

    /// Whether charge flows from pixel to pixel.
    pub fn flows(&self) -> bool {
        self.blooming > 0.0
    }

    /// Charge up to which a pixel holds all of it, e-.
    #[inline(always)]
    pub fn begins_e(&self, full_well_e: f64) -> f64 {
        self.knee.min(1.0) * full_well_e
    }

    /// Electrons that a pixel holds of a charge.
    #[inline(always)]
    pub fn held(&self, charge_e: f64, full_well_e: f64) -> f64 {
        let above = charge_e - self.knee * full_well_e;
        if self.knee >= 1.0 {
            return if charge_e < full_well_e { charge_e } else { full_well_e };
        }
        if above <= 0.0 {
            return charge_e;
        }
        let rest = (1.0 - self.knee) * full_well_e;
        let x = above / rest;
        let left = if x < FAR { exp(-x) } else { 0.0 };
        full_well_e - rest * left
    }
}

/// What each pixel of some columns of a sensor receives from others in its column.
///
/// `signal` (e-/s) is that of the pixels `rect`, row by row, which is all rows of the sensor; the result (e-) has the same order and is empty if no pixel overflows.
pub fn received(exposer: &Exposer, signal: &[f32], rect: Rect) -> Vec<f32> {
    let overflow = exposer.overflow();
    let mut all = Vec::new();
    let mut part = Vec::new();
    let begins_e = overflow.begins_e(exposer.full_well_e());
    // Most columns of most pictures have no pixel that overflows, which their signal shows without the charges.
    let within: Vec<f64> =
        (0..rect.height).map(|row| exposer.signal_within(begins_e, rect.y as u32 + row as u32)).collect();
    for first in (0..rect.width).step_by(COLUMNS) {
        let width = COLUMNS.min(rect.width - first);
        part.clear();
        signal.chunks(rect.width).for_each(|line| part.extend_from_slice(&line[first..first + width]));
        let may_overflow = |(line, within): (&[f32], &f64)| line.iter().any(|v| f64::from(*v) > *within);
        if !part.chunks(width).zip(&within).any(may_overflow) {
            continue;
        }
        let mut charge = vec![0.0; part.len()];
        let own = Rect::new(rect.y, rect.x + first as i64, rect.height, width);
        exposer.charges(&part, own, &mut charge);
        let Some(received) = overflow.spill(exposer.full_well_e(), &charge, width) else { continue };
        if all.is_empty() {
            all.resize(signal.len(), 0.0);
        }
        for (to, from) in all.chunks_mut(rect.width).zip(received.chunks(width)) {
            to[first..first + width].copy_from_slice(from);
        }
    }
    all
}

impl Overflow {
    /// What the pixels of whole columns, `width` a row, receive, of the charges `charge` before any limit; none if no pixel overflows.
    fn spill(&self, full_well_e: f64, charge: &[f64], width: usize) -> Option<Vec<f32>> {
        let held: Vec<f64> = charge.iter().map(|q| self.held(*q, full_well_e)).collect();
        let half: Vec<f64> =
            charge.iter().zip(&held).map(|(q, held)| 0.5 * self.blooming * (q - held)).collect();
        if half.iter().all(|half| *half == 0.0) {
            return None;
        }
        let rows = charge.len() / width;
        let free_e: Vec<f64> = held.iter().map(|held| full_well_e - held).collect();
        let of = |down_first: bool| {
            let mut filled = vec![0.0; charge.len()];
            for down in [down_first, !down_first] {
                let mut carried = vec![0.0; width];
                for k in 0..rows {
                    let row = if down { k } else { rows - 1 - k } * width;
                    for (c, carried) in carried.iter_mut().enumerate() {
                        let left: f64 = free_e[row + c] - filled[row + c];
                        let taken = if *carried < left { *carried } else { left };
                        filled[row + c] += taken;
                        *carried += half[row + c] - taken;
                    }
                }
            }
            filled
        };
        let mean = |(a, b): (f64, f64)| (0.5 * (a + b)) as f32;
        Some(of(true).into_iter().zip(of(false)).map(mean).collect())
    }
}

#[cfg(test)]
mod tests;
