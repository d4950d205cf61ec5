//! Edge spread function expected from a PSF, as a direct sum over its samples.
//!
//! Across an edge of normal n (azimuth α) the problem is one-dimensional: with u_i = d_i · n the position of PSF sample i (share p_i) along n,
//! ```text
//! ESF(u) = Σ_i p_i · S(u − u_i)
//! ```
//! where S is the response to a step of all operations between chart and film value other than the PSF: the mean over the chart pixel's
//! square and over the film pixel's square (each, along n, a box of width |cos α| and one of |sin α|), the bin of the measurement, and
//! the taps of the interpolation between chart pixels, each a shift along n with a weight. A PSF at azimuth θ is not rotated: its samples
//! are projected along α − θ.
//!
//! Point samples need a square at least as wide as their pitch, such as the film pixel's, for a smooth result.
//!
//! Numerically, shares are deposited on a line of steps of 1/64 px by linear splitting (error of the second moment at most 1/4 of a step
//! squared, 6e-5 px²); every box is a difference of running sums.

use crate::real;

/// Steps of the line per film pixel.
const FINE: f64 = 64.0;

/// A PSF sample of a field point on +x: position relative to the chief ray (row, column; film pixels), and its share of the light.
pub type Share = ((f64, f64), f64);

/// Operations on the step other than the PSF.
#[derive(Clone, Debug, PartialEq)]
pub struct StepEdge {
    /// Direction of the edge's normal, from dark to light: azimuth in rad.
    pub normal_rad: f64,
    /// Sides in film pixels of the squares over which pixels are means: the chart's, and the film's if the PSF has point samples.
    pub squares_px: Vec<f64>,
    /// Width in film pixels of the bins of the measurement; 0 for none.
    pub bin_px: f64,
    /// Interpolation: position of each tap relative to the pixel (row, column; film pixels), and its weight; weights sum to 1.
    pub taps: Vec<Share>,
}

/// An ESF on a fine line.
#[derive(Clone, Debug)]
pub struct ExpectedEsf {
    values: Vec<f64>,
    first_px: f64,
}

impl ExpectedEsf {
    /// The ESF of the PSF `shares` (which sum to 1) at azimuth `azimuth_rad` under `step`.
    pub fn new(shares: impl Iterator<Item = Share>, azimuth_rad: f64, step: &StepEdge) -> Self {
        let along = |angle: f64| {
            let (sin, cos) = real::sin_cos(angle);
            move |(row, col): (f64, f64)| col * cos + row * sin
        };
        let (psf, edge) = (along(step.normal_rad - azimuth_rad), along(step.normal_rad));
        let samples: Vec<(f64, f64)> = shares.map(|(d, p)| (psf(d), p)).collect();
        let taps: Vec<(f64, f64)> = step.taps.iter().map(|&(d, w)| (edge(d), w)).collect();
        let far = |points: &[(f64, f64)]| points.iter().fold(0.0f64, |m, v| m.max(v.0.abs()));
        let widths: Vec<f64> = {
            let (sin, cos) = real::sin_cos(step.normal_rad);
            let both = step.squares_px.iter().flat_map(|w| [w * cos.abs(), w * sin.abs()]);
            both.chain([step.bin_px]).filter(|w| *w > 1.0 / FINE).collect()
        };
        let reach = far(&samples) + far(&taps) + widths.iter().sum::<f64>() / 2.0 + 2.0;
        let n = (2.0 * reach * FINE).ceil() as usize + 1;
        let first_px = -reach;
        let mut line = vec![0.0; n];
        for (u, p) in samples {
            deposit(&mut line, (u - first_px) * FINE, p);
        }
        // A tap at +d reads the chart there: the edge appears d earlier.
        let mut spread = vec![0.0; n];
        for &(d, w) in &taps {
            let shift = -d * FINE;
            for (i, v) in line.iter().enumerate().filter(|(_, v)| **v != 0.0) {
                deposit(&mut spread, i as f64 + shift, v * w);
            }
        }
        for width in widths {
            smooth(&mut spread, width * FINE);
        }
        let mut sum = 0.0;
        for v in &mut spread {
            // A sample counts fully beyond its position and by half at it.
            let share = std::mem::replace(v, sum + *v / 2.0);
            sum += share;
        }
        Self { values: spread, first_px }
    }

    /// Its value `distance_px` from the edge.
    pub fn at(&self, distance_px: f64) -> f64 {
        let at = ((distance_px - self.first_px) * FINE).clamp(0.0, (self.values.len() - 1) as f64);
        let i = (at as usize).min(self.values.len() - 2);
        self.values[i] + (at - i as f64) * (self.values[i + 1] - self.values[i])
    }
}

/// Adds `share` at position `at` of the line, split linearly between the two nearest steps; clamped to the ends.
fn deposit(line: &mut [f64], at: f64, share: f64) {
    let at = at.clamp(0.0, (line.len() - 1) as f64);
    let i = (at as usize).min(line.len() - 2);
    let t = at - i as f64;
    line[i] += share * (1.0 - t);
    line[i + 1] += share * t;
}

/// Replaces each value by the mean over `width` steps about it.
fn smooth(line: &mut [f64], width: f64) {
    let mut sums = Vec::with_capacity(line.len() + 1);
    let mut sum = 0.0;
    sums.push(0.0);
    for v in line.iter() {
        sum += v;
        sums.push(sum);
    }
    // Σ of the values before position `at`, each spread over its step.
    let before = |at: f64| {
        let at = at.clamp(0.0, line_end(&sums));
        let i = (at as usize).min(sums.len() - 2);
        sums[i] + (at - i as f64) * (sums[i + 1] - sums[i])
    };
    for (i, v) in line.iter_mut().enumerate() {
        let middle = i as f64 + 0.5;
        *v = (before(middle + width / 2.0) - before(middle - width / 2.0)) / width;
    }
}

fn line_end(sums: &[f64]) -> f64 {
    (sums.len() - 1) as f64
}

/// Catmull-Rom weights of four chart pixels for a position `t` beyond the second.
pub fn catmull_rom(t: f64) -> [f64; 4] {
    // Keys 1981, a = −1/2, from the kernel's definition by distance.
    let near = |d: f64| (1.5 * d - 2.5) * d * d + 1.0;
    let far = |d: f64| ((-0.5 * d + 2.5) * d - 4.0) * d + 2.0;
    [far(1.0 + t), near(t), near(1.0 - t), far(2.0 - t)]
}

#[cfg(test)]
mod tests {
    use super::super::edge::tests::phi;
    use super::*;

    fn plain(normal_rad: f64) -> StepEdge {
        StepEdge { normal_rad, squares_px: vec![], bin_px: 0.0, taps: vec![((0.0, 0.0), 1.0)] }
    }

    /// An elliptical Gaussian: σ 1.5 along +x, 0.8 across, centre 0.4 px out.
    fn gaussian() -> Vec<Share> {
        let all =
            (-40..=40).flat_map(|i| (-40..=40).map(move |j| (f64::from(i) * 0.25, f64::from(j) * 0.25)));
        let mut shares: Vec<Share> =
            all.map(|(y, x)| ((y, x), (-(x - 0.4) * (x - 0.4) / 4.5 - y * y / 1.28).exp())).collect();
        let sum: f64 = shares.iter().map(|s| s.1).sum();
        shares.iter_mut().for_each(|s| s.1 /= sum);
        shares
    }

    #[test]
    fn gaussian_psf_at_any_azimuth_has_an_analytic_esf() {
        for (azimuth, normal) in [(0.0, 0.0), (0.0, 1.2), (0.7, 0.7), (2.5, 0.3), (-1.0, 3.0)] {
            // Twice the pitch of the samples: no staircase.
            let step = StepEdge { squares_px: vec![0.5], ..plain(normal) };
            let esf = ExpectedEsf::new(gaussian().into_iter(), azimuth, &step);
            let (sin, cos) = f64::sin_cos(normal - azimuth);
            let sigma = (2.25 * cos * cos + 0.64 * sin * sin + 0.25 / 12.0).sqrt();
            for u in [-3.0, -1.1, 0.0, 0.37, 2.2] {
                let expected = phi((u - 0.4 * cos) / sigma);
                assert!(
                    (esf.at(u) - expected).abs() < 5e-4,
                    "θ {azimuth}, α {normal}, u {u}: {}",
                    esf.at(u) - expected
                );
            }
        }
    }

    #[test]
    fn squares_taps_and_bins_are_applied() {
        // A point through one square at 45° rises as a parabola over ±√2/2; a tap at +0.5 px shifts the edge by −0.5 px.
        let point = || std::iter::once(((0.0, 0.0), 1.0));
        let mut step = plain(std::f64::consts::FRAC_PI_4);
        step.squares_px = vec![1.0];
        let esf = ExpectedEsf::new(point(), 0.0, &step);
        let w = 0.5f64.sqrt();
        for u in [-0.6, -0.3, 0.0, 0.2, 0.5] {
            let expected =
                if u < 0.0 { (u + w).powi(2) / (2.0 * w * w) } else { 1.0 - (w - u).powi(2) / (2.0 * w * w) };
            assert!((esf.at(u) - expected).abs() < 2e-4, "{u}: {} for {expected}", esf.at(u));
        }
        let mut shifted = plain(0.0);
        shifted.bin_px = 0.5;
        shifted.taps = vec![((0.0, 0.5), 1.0)];
        let esf = ExpectedEsf::new(point(), 0.0, &shifted);
        assert!(
            (esf.at(-0.5) - 0.5).abs() < 0.02 && esf.at(-0.8) < 1e-9 && (esf.at(-0.2) - 1.0).abs() < 1e-9
        );
    }

    #[test]
    fn catmull_rom_reproduces_constants_and_lines() {
        for t in [0.0, 0.25, 0.5, 0.9] {
            let w = catmull_rom(t);
            assert!((w.iter().sum::<f64>() - 1.0).abs() < 1e-15);
            let position: f64 = w.iter().enumerate().map(|(i, w)| w * (i as f64 - 1.0)).sum();
            assert!((position - t).abs() < 1e-15);
        }
    }
}
