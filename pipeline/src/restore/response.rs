//! What restoration makes of a point: resolution and overshoot.
//!
//! ```text
//! K = restored(A δ) − restored(0),  scaled to a sum of 1          effective PSF, chart pixel to restored pixel
//! MTF(f) = |Σ_x L(x) e^(−2πi f x)|,  L(x) = Σ_y K(y, x)          along rows; along columns likewise; f in cycles per pixel
//! ESF(x) = Σ_{u ≤ x} L(u),  overshoot = max(max ESF − 1, −min ESF)   of an edge of contrast 1 along a column or row
//! ```
//! MTF50 is the lowest f at which the MTF is one half, the geometric mean of rows and columns, and at most the Nyquist frequency 0.5. The overshoot is that of the worse direction.

use crate::geometry::{Rect, Size};
use crate::real;
use std::f64::consts::TAU;

/// Steps of the search for MTF50, up to 0.5 cycles per pixel.
const STEPS: usize = 500;

/// Resolution and overshoot of a point's image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Response {
    /// Frequency at which the MTF is one half, cycles per pixel.
    pub mtf50: f64,
    /// The largest overshoot or undershoot beside an edge, of its contrast.
    pub overshoot: f64,
}

impl Response {
    /// Of `image`, rows of a picture of `size`, in `rect`.
    pub fn new(image: &[f64], size: Size, rect: Rect) -> Self {
        let rows: Vec<f64> = (rect.y..rect.bottom())
            .map(|y| image[y as usize * size.width + rect.x as usize..][..rect.width].iter().sum())
            .collect();
        let columns: Vec<f64> = (rect.x..rect.right())
            .map(|x| {
                (rect.y..rect.bottom()).map(|y| image[y as usize * size.width + x as usize]).sum::<f64>()
            })
            .collect();
        let [down, across] = [&rows, &columns].map(|line| mtf50(line));
        let worst = overshoot(&rows).max(overshoot(&columns));
        Self { mtf50: (down * across).sqrt(), overshoot: worst }
    }
}

/// The lowest frequency at which the MTF of a line spread function is one half.
fn mtf50(line: &[f64]) -> f64 {
    let sum: f64 = line.iter().sum();
    let mtf = |f: f64| {
        let (mut re, mut im) = (0.0, 0.0);
        for (x, v) in line.iter().enumerate() {
            let (sin, cos) = real::sin_cos(TAU * f * x as f64);
            re += v * cos;
            im += v * sin;
        }
        real::hypot(re, im) / sum.abs()
    };
    let mut before = (0.0, 1.0);
    for step in 1..=STEPS {
        let f = 0.5 * step as f64 / STEPS as f64;
        let here = mtf(f);
        if here < 0.5 {
            let share = (before.1 - 0.5) / (before.1 - here);
            return before.0 + share * (f - before.0);
        }
        before = (f, here);
    }
    0.5
}

fn overshoot(line: &[f64]) -> f64 {
    let sum: f64 = line.iter().sum();
    let (mut esf, mut worst) = (0.0, 0.0f64);
    for value in line {
        esf += value / sum;
        worst = worst.max(esf - 1.0).max(-esf);
    }
    worst
}
