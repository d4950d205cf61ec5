//! The edge spread function that a PSF must give, summed straight from its samples.
//!
//! Across an edge of normal n everything is one-dimensional: with u_i = d_i · n the place of PSF sample i (share p_i) along n,
//!     ESF(u) = Σ_i p_i · S(u − u_i),
//! S the response of a step to all that stands between chart and film value beside the PSF: the chart pixel's square and the
//! film pixel's square (each, seen along n, a box of width |cos α| and one of |sin α|), the bin of the measurement, and the
//! taps of the interpolation between chart pixels, each a shift along n with a weight. A PSF at azimuth θ is not turned: its
//! samples are looked at along α − θ.
//!
//! Point samples are smooth only under a square at least as wide as their pitch: the film pixel's is.
//!
//! Numerically: shares are laid out on a line of 1/64 px by linear splitting (second moment wrong by at most 1/4 of a step
//! squared, 6e-5 px²), every box is a difference of running sums.

use crate::real;

/// Steps of the line per film pixel.
const FINE: f64 = 64.0;

/// A PSF sample: where it lies from the chief ray (row, column; film pixels), for a field point on +x, and its share of the
/// light.
pub type Share = ((f64, f64), f64);

/// What the step goes through beside the PSF.
#[derive(Clone, Debug, PartialEq)]
pub struct Step {
    /// Direction of the edge's normal, from dark to light: azimuth in rad.
    pub normal_rad: f64,
    /// Sides in film pixels of the squares that pixels are means over: the chart's, and the film's if the PSF's samples are
    /// points.
    pub squares_px: Vec<f64>,
    /// Width in film pixels of the bins of the measurement; 0 for none.
    pub bin_px: f64,
    /// Interpolation: where each tap lies from the pixel (row, column; film pixels), and its weight; they sum to 1.
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
    pub fn new(shares: impl Iterator<Item = Share>, azimuth_rad: f64, step: &Step) -> Self {
        let along = |angle: f64| {
            let (sin, cos) = real::sin_cos(angle);
            move |(row, col): (f64, f64)| col * cos + row * sin
        };
        let (psf, edge) = (along(step.normal_rad - azimuth_rad), along(step.normal_rad));
        let laid: Vec<(f64, f64)> = shares.map(|(d, p)| (psf(d), p)).collect();
        let taps: Vec<(f64, f64)> = step.taps.iter().map(|&(d, w)| (edge(d), w)).collect();
        let far = |of: &[(f64, f64)]| of.iter().fold(0.0f64, |m, v| m.max(v.0.abs()));
        let widths: Vec<f64> = {
            let (sin, cos) = real::sin_cos(step.normal_rad);
            let both = step.squares_px.iter().flat_map(|w| [w * cos.abs(), w * sin.abs()]);
            both.chain([step.bin_px]).filter(|w| *w > 1.0 / FINE).collect()
        };
        let reach = far(&laid) + far(&taps) + widths.iter().sum::<f64>() / 2.0 + 2.0;
        let n = (2.0 * reach * FINE).ceil() as usize + 1;
        let first_px = -reach;
        let mut line = vec![0.0; n];
        for (u, p) in laid {
            deposit(&mut line, (u - first_px) * FINE, p);
        }
        // Light from a tap at +d shows the chart there: the edge comes d earlier.
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
            // Light of a sample counts from its own place on: half of it there.
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

/// Adds `share` at `at` of the line, split between the two steps around it; beyond the ends at the ends.
fn deposit(line: &mut [f64], at: f64, share: f64) {
    let at = at.clamp(0.0, (line.len() - 1) as f64);
    let i = (at as usize).min(line.len() - 2);
    let t = at - i as f64;
    line[i] += share * (1.0 - t);
    line[i + 1] += share * t;
}

/// The mean over `width` steps about each.
fn smooth(line: &mut [f64], width: f64) {
    let mut sums = Vec::with_capacity(line.len() + 1);
    let mut sum = 0.0;
    sums.push(0.0);
    for v in line.iter() {
        sum += v;
        sums.push(sum);
    }
    // Σ of the steps before the place `at` between steps, each step spread over its own width.
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

/// Catmull-Rom weights of the four chart pixels around a place `t` beyond the second.
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

    fn plain(normal_rad: f64) -> Step {
        Step { normal_rad, squares_px: vec![], bin_px: 0.0, taps: vec![((0.0, 0.0), 1.0)] }
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
    fn a_gaussian_seen_from_any_side() {
        for (azimuth, normal) in [(0.0, 0.0), (0.0, 1.2), (0.7, 0.7), (2.5, 0.3), (-1.0, 3.0)] {
            // Twice the pitch of the samples: no stairs are left.
            let step = Step { squares_px: vec![0.5], ..plain(normal) };
            let esf = ExpectedEsf::new(gaussian().into_iter(), azimuth, &step);
            let (sin, cos) = f64::sin_cos(normal - azimuth);
            let sigma = (2.25 * cos * cos + 0.64 * sin * sin + 0.25 / 12.0).sqrt();
            for u in [-3.0, -1.1, 0.0, 0.37, 2.2] {
                let want = phi((u - 0.4 * cos) / sigma);
                assert!(
                    (esf.at(u) - want).abs() < 5e-4,
                    "θ {azimuth}, α {normal}, u {u}: {}",
                    esf.at(u) - want
                );
            }
        }
    }

    #[test]
    fn squares_taps_and_bins_add_up() {
        // A point through one square at 45° rises as a parabola over ±√2/2; a tap half a pixel out comes half earlier.
        let point = || std::iter::once(((0.0, 0.0), 1.0));
        let mut step = plain(std::f64::consts::FRAC_PI_4);
        step.squares_px = vec![1.0];
        let esf = ExpectedEsf::new(point(), 0.0, &step);
        let w = 0.5f64.sqrt();
        for u in [-0.6, -0.3, 0.0, 0.2, 0.5] {
            let want =
                if u < 0.0 { (u + w).powi(2) / (2.0 * w * w) } else { 1.0 - (w - u).powi(2) / (2.0 * w * w) };
            assert!((esf.at(u) - want).abs() < 2e-4, "{u}: {} for {want}", esf.at(u));
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
    fn catmull_rom_keeps_sums_and_lines() {
        for t in [0.0, 0.25, 0.5, 0.9] {
            let w = catmull_rom(t);
            assert!((w.iter().sum::<f64>() - 1.0).abs() < 1e-15);
            let place: f64 = w.iter().enumerate().map(|(i, w)| w * (i as f64 - 1.0)).sum();
            assert!((place - t).abs() < 1e-15);
        }
    }
}
