//! Integration of PSF samples over film pixels: one weight per sample and pixel along each direction.
//!
//! *Point* samples: film pixel i takes the integral of the cubic B-spline interpolant over the pixel's width. *Integrated*
//! samples: the difference, between the pixel's edges, of the spline through the cumulative sum of the samples; exact where
//! pixel edges are sample edges.

use crate::lens::PsfSample;
use crate::spline;

/// Weights below this are dropped: they fall by 0.27 a sample away from the pixel's edge.
const NEGLIGIBLE: f64 = 1e-12;
/// The same for sums in f32: below its resolution even when summed over all dropped weights.
#[cfg(target_arch = "x86_64")]
const NEGLIGIBLE_F32: f64 = 5e-9;

/// Weights of the samples in one film pixel, along one direction.
#[derive(Debug)]
pub(super) struct PixelWeights {
    /// Index of the first sample.
    pub(super) first: usize,
    pub(super) weights: Vec<f64>,
    /// The shorter list for sums in f32: first sample, weights.
    #[cfg(target_arch = "x86_64")]
    pub(super) weights_f32: (usize, Vec<f32>),
}

/// The range from the first to the last weight above `limit`.
fn significant(weights: &[f64], limit: f64) -> std::ops::Range<usize> {
    let first = weights.iter().position(|w| w.abs() > limit).unwrap_or(0);
    first..weights.iter().rposition(|w| w.abs() > limit).map_or(first, |e| e + 1)
}

/// Weights of `samples` samples, each `ratio` film pixels wide and centred on the film window, for each of its `size` pixels.
pub(super) fn pixel_weights(samples: usize, ratio: f64, size: usize, kind: PsfSample) -> Vec<PixelWeights> {
    // The spline's zero boundary lies two film pixels and 24 samples (0.27^24 = 2e-14) outside the window.
    let margin = 24 + (2.0 / ratio).ceil() as usize;
    let centre = (samples as f64 - 1.0) / 2.0;
    let pixel = |i: usize| {
        let middle = i as f64 - (size as f64 - 1.0) / 2.0;
        let edges = (centre + (middle - 0.5) / ratio, centre + (middle + 0.5) / ratio);
        let weights = match kind {
            PsfSample::Point => point_weights(edges, samples, margin),
            PsfSample::Integrated => integrated_weights(edges, samples, margin),
        };
        let inside = &weights[margin..margin + samples];
        let range = significant(inside, NEGLIGIBLE);
        PixelWeights {
            first: range.start,
            weights: inside[range].to_vec(),
            #[cfg(target_arch = "x86_64")]
            weights_f32: {
                let range = significant(inside, NEGLIGIBLE_F32);
                (range.start, inside[range].iter().map(|&w| w as f32).collect())
            },
        }
    };
    (0..size).map(pixel).collect()
}

/// Weights of point samples between two edges, in samples from the first; `margin` more on either side.
fn point_weights((a, b): (f64, f64), samples: usize, margin: usize) -> Vec<f64> {
    let n = samples + 2 * margin;
    let mut w = vec![0.0; n + 1];
    for (s, w) in w[..n].iter_mut().enumerate() {
        let t = s as f64 - margin as f64;
        *w = spline::cumulative(b - t) - spline::cumulative(a - t);
    }
    // B is symmetric: the weights of the values are B⁻¹ times those of the coefficients.
    spline::coefficients(&mut w[..n]);
    w
}

/// Weights of integrated samples between two edges.
fn integrated_weights((a, b): (f64, f64), samples: usize, margin: usize) -> Vec<f64> {
    let n = samples + 2 * margin;
    let mut w = vec![0.0; n + 1];
    for (edge, sign) in [(b, 1.0), (a, -1.0)] {
        // Edge e lies half a sample before sample e; the cumulative sum there is Σ_{s<e} F_s.
        let t = edge + 0.5 + margin as f64;
        let cell = t.floor();
        for (k, v) in spline::weights(t - cell).iter().enumerate() {
            let e = cell as isize - 1 + k as isize;
            if (0..=n as isize).contains(&e) {
                w[e as usize] += sign * v;
            }
        }
    }
    spline::coefficients(&mut w);
    // From weights of the cumulative sums to weights of the samples: Σ over the edges beyond.
    let mut beyond = w[n];
    for s in (0..n).rev() {
        beyond += std::mem::replace(&mut w[s], beyond);
    }
    w
}

/// Integrates `samples` (m × m) into `film`, one pixel per pair of `pixels`; `half` is a buffer. Returns the sum of `film`.
pub(super) fn integrate(
    pixels: &[PixelWeights],
    samples: &[f64],
    m: usize,
    half: &mut Vec<f64>,
    film: &mut Vec<f64>,
) -> f64 {
    half.clear();
    half.resize(pixels.len() * m, 0.0);
    for (pixel, half) in pixels.iter().zip(half.chunks_exact_mut(m)) {
        for (w, line) in pixel.weights.iter().zip(samples[pixel.first * m..].chunks_exact(m)) {
            half.iter_mut().zip(line).for_each(|(h, v)| *h += w * v);
        }
    }
    film.clear();
    for half in half.chunks_exact(m) {
        film.extend(
            pixels.iter().map(|p| p.weights.iter().zip(&half[p.first..]).map(|(w, v)| w * v).sum::<f64>()),
        );
    }
    film.iter().sum()
}
