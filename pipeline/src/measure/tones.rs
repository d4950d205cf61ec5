//! Tones, noise and dynamic range of grey patches (after ISO 14524 and ISO 15739).
//!
//! A patch of the reflectance ρ (relative luminance of the chart) has the mean v and the standard deviation σ of its pixels around the plane that is fitted to them, so that light that falls off across it is not counted as noise.
//! With the slope g = dv/dρ of the opto-electronic conversion function (OECF) at the patch, by the parabola through it and its neighbours,
//! ```text
//! SNR(ρ) = ρ·g / σ,      D = ρ_max / ρ_min,   SNR(ρ_min) = 1
//! ```
//! ρ_max is the lightest patch that is not clipped; SNR is interpolated in log ρ, log SNR. If even the darkest patch has an SNR above 1, D is a lower bound, which the chart's contrast limits.
//! σ is that of one picture: fixed patterns are part of it, as in "total noise" of ISO 15739.

use crate::least_squares::Qr;
use crate::real;

/// A patch of a grey scale.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Patch {
    /// Reflectance, or relative luminance.
    pub reflectance: f64,
    /// Mean value.
    pub mean: f64,
    /// Standard deviation of a pixel around a plane.
    pub sigma: f64,
    /// Share of clipped pixels.
    pub clipped: f64,
}

/// A tone of a scale.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tone {
    /// The patch.
    pub patch: Patch,
    /// Slope of the OECF, value per reflectance.
    pub slope: f64,
    /// Signal-to-noise ratio; infinite without noise.
    pub snr: f64,
}

/// Dynamic range.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DynamicRange {
    /// Ratio of reflectances.
    pub ratio: f64,
    /// Whether it is at least this: the darkest patch has an SNR above 1.
    pub is_bound: bool,
}

/// Mean and standard deviation around a plane of pixels (row, column, value); `None` of fewer than 16, or all in a line.
pub fn statistics(pixels: &[(f64, f64, f64)]) -> Option<(f64, f64)> {
    if pixels.len() < 16 {
        return None;
    }
    let n = pixels.len() as f64;
    let mean = |of: &dyn Fn(&(f64, f64, f64)) -> f64| pixels.iter().map(of).sum::<f64>() / n;
    let (y, x, v) = (mean(&|p| p.0), mean(&|p| p.1), mean(&|p| p.2));
    let column = |of: &dyn Fn(&(f64, f64, f64)) -> f64| pixels.iter().map(of).collect::<Vec<f64>>();
    let (rows, columns, values) = (column(&|p| p.0 - y), column(&|p| p.1 - x), column(&|p| p.2 - v));
    let slopes = Qr::new(vec![rows.clone(), columns.clone()])?.solve(&values);
    let residual = |i: usize| values[i] - slopes[0] * rows[i] - slopes[1] * columns[i];
    let sum: f64 = (0..pixels.len()).map(|i| residual(i).powi(2)).sum();
    Some((v, (sum / (n - 3.0)).sqrt()))
}

/// Tones of at least three patches, dark to light; fewer have none.
pub fn tones(patches: &[Patch]) -> Vec<Tone> {
    if patches.len() < 3 {
        return Vec::new();
    }
    let tone = |k: usize| {
        let middle = k.clamp(1, patches.len() - 2);
        let slope =
            parabola_slope([middle - 1, middle, middle + 1].map(|i| &patches[i]), patches[k].reflectance);
        let patch = patches[k];
        let signal = patch.reflectance * slope;
        Tone { patch, slope, snr: if patch.sigma > 0.0 { signal / patch.sigma } else { f64::INFINITY } }
    };
    (0..patches.len()).map(tone).collect()
}

/// Slope at `x` of the parabola through three patches.
fn parabola_slope(of: [&Patch; 3], x: f64) -> f64 {
    let ([x0, x1, x2], [y0, y1, y2]) = (of.map(|p| p.reflectance), of.map(|p| p.mean));
    let (first, second) = ((y1 - y0) / (x1 - x0), (y2 - y1) / (x2 - x1));
    let bend = (second - first) / (x2 - x0);
    first + bend * (2.0 * x - x0 - x1)
}

/// Dynamic range of tones, dark to light; `None` if no tone that is not clipped has an SNR above 1.
pub fn dynamic_range(tones: &[Tone], max_clipped: f64) -> Option<DynamicRange> {
    let usable: Vec<&Tone> =
        tones.iter().filter(|t| t.patch.clipped <= max_clipped && t.patch.reflectance > 0.0).collect();
    let light = usable.last().filter(|t| t.snr > 1.0)?;
    // The darkest of the tones above 1 that have no tone below 1 among them and the lightest.
    let first = usable.iter().rposition(|t| t.snr.is_nan() || t.snr <= 1.0).map_or(0, |k| k + 1);
    let above = usable[first];
    let bound = DynamicRange { ratio: light.patch.reflectance / above.patch.reflectance, is_bound: true };
    let Some(below) = first.checked_sub(1).map(|k| usable[k]) else { return Some(bound) };
    if below.snr.is_nan() || below.snr <= 0.0 || above.snr.is_infinite() {
        return Some(bound);
    }
    let share = real::log(below.snr) / (real::log(below.snr) - real::log(above.snr));
    let least = real::log(below.patch.reflectance)
        + share * real::log(above.patch.reflectance / below.patch.reflectance);
    Some(DynamicRange { ratio: light.patch.reflectance / real::exp(least), is_bound: false })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sensor::random::uniform_of;

    /// Normal numbers by Box and Muller.
    fn normal(k: u32) -> f64 {
        let u = |i: u32| uniform_of([k, i, 0, 0], 11);
        (-2.0 * u(0).ln()).sqrt() * (std::f64::consts::TAU * u(1)).cos()
    }

    #[test]
    fn noise_on_a_slope_is_that_of_the_pixels_within_1_percent() {
        // 300 x 300 pixels: the standard error of σ is 0.24 %.
        let pixels: Vec<(f64, f64, f64)> = (0..90_000u32)
            .map(|k| {
                let (y, x) = (f64::from(k / 300), f64::from(k % 300));
                (y, x, 1000.0 + 0.3 * y - 0.2 * x + 1000f64.sqrt() * normal(k))
            })
            .collect();
        let (mean, sigma) = statistics(&pixels).unwrap();
        assert!((mean - 1014.95).abs() < 0.5, "{mean}");
        assert!((sigma / 1000f64.sqrt() - 1.0).abs() < 0.01, "{sigma}");
        assert_eq!(statistics(&pixels[..15]), None);
        assert_eq!(statistics(&pixels[..300]), None, "a single row");
    }

    /// Electrons of a camera with read noise: SNR = N/√(N + r²) = 1 at N = (1 + √(1 + 4r²))/2.
    #[test]
    fn dynamic_range_of_a_camera_is_that_of_its_noises_within_1_percent() {
        let (full, read) = (10_000.0, 5.0f64);
        let patch = |k: i32| {
            let reflectance = 10f64.powf(-f64::from(40 - k) / 10.0);
            let mean = full * reflectance;
            Patch { reflectance, mean, sigma: (mean + read * read).sqrt(), clipped: 0.0 }
        };
        let all: Vec<Patch> = (0..=40).map(patch).collect();
        let tones = tones(&all);
        let least = (1.0 + (1.0 + 4.0 * read * read).sqrt()) / 2.0;
        let range = dynamic_range(&tones, 0.01).unwrap();
        assert!(!range.is_bound && (range.ratio / (full / least) - 1.0).abs() < 0.01, "{range:?}");
        for tone in &tones {
            let n = tone.patch.mean;
            assert!((tone.snr / (n / (n + read * read).sqrt()) - 1.0).abs() < 1e-9, "{tone:?}");
        }
        // A chart that is not dark enough, and a clipped patch.
        let range = dynamic_range(&super::tones(&all[20..]), 0.01).unwrap();
        assert!(range.is_bound && (range.ratio / 100.0 - 1.0).abs() < 1e-9);
        let mut clipped = tones.clone();
        clipped[40].patch.clipped = 0.5;
        let range = dynamic_range(&clipped, 0.01).unwrap();
        assert!((range.ratio / (full / least / 10f64.powf(0.1)) - 1.0).abs() < 0.01, "{range:?}");
    }
}
