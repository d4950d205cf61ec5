//! Pieces of the pupil at a film place, from the kernel of a depth node far from focus.
//!
//! There each part of the kernel is a part of the pupil: what a ray through the pupil point u meets on the film is −ρ u from the chief ray. So no more than
//! the lens's PSFs is needed, and vignetting and the pupil's shape over the field are those of the lens.
//!
//! ```text
//! (E, y, x)   energy and centroid (px from the chief ray) of cells of ⌈n/64⌉² samples of the PSF of n² samples, linear in the film place's height
//!             between two PSFs, turned by its azimuth; each is spread over 3 × 3 points of its cell, so that pieces change little from one film place
//!             to the next where cells of the PSF pass from piece to piece
//! scale       √(2 Σ E |d − d̄|²): the radius of a uniform disc of that second moment
//! piece       ring by |d − d̄|/scale (4, 12, 18 and 22 pieces of equal area of a uniform disc; what lies beyond is of the last ring), sector by angle
//! f_p, d_p    energy and centroid of a piece;   R = √(2 (Σ E |d|² − Σ f_p |d_p|²)):  what is left of the second moment, as that of a disc
//! ```

use crate::psf::kernel::on_demand::PsfSource;
use crate::real;
use crate::simd::Simd;
use std::f64::consts::TAU;
use std::sync::OnceLock;

/// Pieces of each ring, from the middle.
const RINGS: [usize; 4] = [4, 12, 18, 22];
/// Number of pieces.
pub(super) const PIECES: usize = 56;
/// Cells of a PSF in a row, at most.
const CELLS: usize = 64;
/// Points of a cell, in cells from its centroid.
const POINTS: [f64; 3] = [-1.0 / 3.0, 0.0, 1.0 / 3.0];

/// Pieces at a film place.
#[derive(Debug)]
pub(super) struct Pieces {
    /// Share of the light, and centroid (y, x) on the film from the chief ray, px, of those that have light.
    pub(super) pieces: Vec<(f32, (f64, f64))>,
    /// Radius of the disc that a piece is on the film, px.
    pub(super) radius_px: f64,
    /// Signed blur radius of the kernel that they are parts of, px.
    pub(super) blur_px: f64,
}

impl Pieces {
    /// Adds the mean over the pupil of `of_pieces`, one plane after the other, to `to`.
    pub(super) fn add_mean(&self, of_pieces: &[f32], to: &mut [f32]) {
        for ((share, _), plane) in self.pieces.iter().zip(of_pieces.chunks_exact(to.len())) {
            to.iter_mut().zip(plane).for_each(|(sum, v)| *sum += share * v);
        }
    }

    /// The largest of the coordinates of the centroids, px.
    pub(super) fn farthest_px(&self) -> f64 {
        self.pieces.iter().fold(0f64, |most, (_, (y, x))| most.max(y.abs()).max(x.abs()))
    }
}

/// A part of a PSF whose field point lies on +x: energy, and centroid (y, x) from the chief ray, film px.
type Part = (f64, (f64, f64));

/// The PSFs of the depth node.
#[derive(Debug)]
pub(in crate::depth) struct Shape {
    source: PsfSource,
    /// Index of the depth node in the lens.
    node: usize,
    heights_px: Vec<f64>,
    /// Samples of a side, odd.
    samples: usize,
    /// Film pixels per sample.
    sample_px: f64,
    /// Half the window that the film uses, px.
    half_px: f64,
    blur_px: f64,
    parts: Vec<OnceLock<Vec<Part>>>,
    /// Instructions of the correction, whose bits do not depend on them.
    pub(super) simd: Simd,
}

impl Shape {
    /// Of depth node `node` of blur radius `blur_px` (signed), whose PSFs at `heights_px` have `samples` of `sample_px` film pixels in a row; kernels
    /// on the film are `window` pixels wide.
    pub(in crate::depth) fn new(
        source: &PsfSource,
        (node, blur_px): (usize, f64),
        heights_px: &[f64],
        (samples, sample_px): (usize, f64),
        (window, simd): (usize, Simd),
    ) -> Self {
        let parts = heights_px.iter().map(|_| OnceLock::new()).collect();
        let (source, heights_px, half_px) = (source.clone(), heights_px.to_vec(), window as f64 / 2.0);
        Self { source, node, heights_px, samples, sample_px, half_px, blur_px, parts, simd }
    }

    /// Parts of the PSF of height `k`, of sum 1.
    fn parts(&self, k: usize) -> &[Part] {
        self.parts[k].get_or_init(|| {
            let n = self.samples;
            let psf = self.source.read(self.node, k..k + 1, n * n);
            let step = n.div_ceil(CELLS);
            let across = n.div_ceil(step);
            let mut sums = vec![(0.0, (0.0, 0.0)); across * across];
            let at = |i: usize| (i as f64 - (n / 2) as f64) * self.sample_px;
            for (i, v) in psf.iter().enumerate() {
                let (y, x) = (i / n, i % n);
                if at(y).abs().max(at(x).abs()) <= self.half_px {
                    let (to, v) = (&mut sums[y / step * across + x / step], f64::from(*v));
                    to.0 += v;
                    to.1.0 += v * at(y);
                    to.1.1 += v * at(x);
                }
            }
            // Samples below 0 are rounding of the PSF's transform.
            sums.retain(|part| part.0 > 0.0);
            let energy: f64 = sums.iter().map(|part| part.0).sum();
            sums.into_iter().map(|(e, (y, x))| (e / energy, (y / e, x / e))).collect()
        })
    }

    /// Pieces at the film place (dy, dx) px from the axis.
    pub(super) fn pieces(&self, dy: f64, dx: f64) -> Pieces {
        let last = self.heights_px.len() - 1;
        let r = real::hypot(dy, dx).min(self.heights_px[last]);
        let above = self.heights_px.partition_point(|h| *h <= r).clamp(1, last);
        let (low, high) = (self.heights_px[above - 1], self.heights_px[above]);
        let share = (r - low) / (high - low);
        let (cos, sin) = if dy == 0.0 && dx == 0.0 {
            (1.0, 0.0)
        } else {
            (dx / real::hypot(dy, dx), dy / real::hypot(dy, dx))
        };
        let cell_px = self.samples.div_ceil(CELLS) as f64 * self.sample_px;
        let points = POINTS.map(|y| POINTS.map(|x| (y * cell_px, x * cell_px)));
        let mut parts = Vec::new();
        for (k, share) in [(above - 1, 1.0 - share), (above, share)] {
            let share = share / points.as_flattened().len() as f64;
            for (e, (y, x)) in self.parts(k) {
                let turned = points.as_flattened().iter().map(|(dy, dx)| {
                    let (y, x) = (y + dy, x + dx);
                    (e * share, (y * cos + x * sin, x * cos - y * sin))
                });
                parts.extend(turned);
            }
        }
        of_parts(&parts, self.blur_px)
    }
}

/// The pieces of `parts`, of sum 1, of a kernel of blur radius `blur_px`.
fn of_parts(parts: &[Part], blur_px: f64) -> Pieces {
    let mean = |of: &dyn Fn(f64, f64) -> f64| parts.iter().map(|(e, (y, x))| e * of(*y, *x)).sum::<f64>();
    let (my, mx) = (mean(&|y, _| y), mean(&|_, x| x));
    let second = mean(&|y, x| y * y + x * x);
    let scale = (2.0 * (second - my * my - mx * mx).max(0.0)).sqrt();
    let mut sums = [(0.0, (0.0, 0.0)); PIECES];
    for (e, (y, x)) in parts {
        let to = &mut sums[piece((y - my) / scale, (x - mx) / scale)];
        to.0 += e;
        to.1.0 += e * y;
        to.1.1 += e * x;
    }
    let with_light = sums.iter().filter(|sum| sum.0 > 0.0);
    let pieces: Vec<(f64, (f64, f64))> = with_light.map(|(e, (y, x))| (*e, (y / e, x / e))).collect();
    let between: f64 = pieces.iter().map(|(e, (y, x))| e * (y * y + x * x)).sum();
    let radius_px = (2.0 * (second - between).max(0.0)).sqrt();
    Pieces { pieces: pieces.into_iter().map(|(e, at)| (e as f32, at)).collect(), radius_px, blur_px }
}

/// Index of the piece at (y, x) of a uniform disc of radius 1.
fn piece(y: f64, x: f64) -> usize {
    let r2 = y * y + x * x;
    let (mut first, mut ring) = (0, 0);
    while ring + 1 < RINGS.len() && r2 * PIECES as f64 >= (first + RINGS[ring]) as f64 {
        first += RINGS[ring];
        ring += 1;
    }
    let n = RINGS[ring] as f64;
    // Sectors of neighbouring rings do not begin at one angle.
    let turns = real::atan2(y, x) / TAU + (ring as f64 + 0.37) / (2.0 * n);
    first + (turns * n).floor().rem_euclid(n) as usize
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::ops::Range;
    use std::sync::Arc;

    /// Disc of `radius` samples about (cy, cx), with light where `is_open` (pupil coordinates −y, −x), 301 samples a row.
    fn psf(radius: f64, is_open: impl Fn(f64, f64) -> bool) -> Vec<f32> {
        let at = |i: usize| (i as f64 - 150.0) / radius;
        let value = |i: usize| {
            let (y, x) = (at(i / 301), at(i % 301));
            if y.hypot(x) < 1.0 && is_open(-y, -x) { 1.0 } else { 0.0 }
        };
        (0..301 * 301).map(value).collect()
    }

    fn shape(psfs: Vec<Vec<f32>>) -> Shape {
        let heights: Vec<f64> = (0..psfs.len()).map(|k| 100.0 * k as f64).collect();
        let source = PsfSource::new(
            Arc::new(move |node, sets: Range<usize>| {
                assert_eq!(node, 3);
                Ok(psfs[sets].concat())
            }),
            1,
        );
        Shape::new(&source, (3, 30.0), &heights, (301, 0.25), (91, Simd::detect()))
    }

    #[test]
    fn pieces_of_a_disc_have_equal_shares_and_radii() {
        let shape = shape(vec![psf(120.0, |_, _| true); 2]);
        let pieces = shape.pieces(0.0, 0.0);
        assert_eq!(pieces.pieces.len(), PIECES);
        for (share, _) in &pieces.pieces {
            assert!(
                (share * PIECES as f32 - 1.0).abs() < 0.04,
                "{share}: points of cells of the PSF are 1/72 of the disc apart"
            );
        }
        // A disc of 30 px in 56 pieces: √(2 (1/2 − Σ f u²)) = 0.138 of it.
        assert!((pieces.radius_px - 0.138 * 30.0).abs() < 0.1, "{}", pieces.radius_px);
        let ring = |p: &(f32, (f64, f64))| p.1.0.hypot(p.1.1) / 30.0;
        let inner: Vec<f64> = pieces.pieces[..4].iter().map(ring).collect();
        let outer: Vec<f64> = pieces.pieces[34..].iter().map(ring).collect();
        assert!(
            inner.iter().all(|r| (r - 0.16).abs() < 0.02) && outer.iter().all(|r| (r - 0.89).abs() < 0.02)
        );
    }

    /// The lens is symmetrical about its axis, so pieces of a disc are the same at all azimuths but for the grid of the PSF: shares within 0.04, it was 0.15.
    #[test]
    fn pieces_change_little_with_the_azimuth() {
        let shape = shape(vec![psf(120.0, |_, _| true); 2]);
        let first = shape.pieces(0.0, 50.0).pieces;
        for turn in (0..90).step_by(7) {
            let (sin, cos) = f64::from(turn).to_radians().sin_cos();
            for (piece, there) in std::iter::zip(&shape.pieces(50.0 * sin, 50.0 * cos).pieces, &first) {
                assert!(
                    (piece.0 - there.0).abs() * (PIECES as f32) < 0.06,
                    "{turn} degrees: {piece:?}, {there:?}"
                );
                let (dy, dx) = (piece.1.0 - there.1.0, piece.1.1 - there.1.1);
                assert!(dy.abs().max(dx.abs()) < 0.008 * 30.0, "{turn} degrees: {piece:?}, {there:?}");
            }
        }
    }

    /// Half of the pupil is vignetted: the light is that of the other half, and turns with the film place.
    #[test]
    fn pieces_follow_vignetting_and_azimuth() {
        let shape = shape(vec![psf(120.0, |_, x| x > 0.0); 3]);
        let centroid = |dy: f64, dx: f64| {
            let pieces = shape.pieces(dy, dx).pieces;
            pieces
                .iter()
                .fold((0.0, 0.0), |sum, (e, at)| (sum.0 + f64::from(*e) * at.0, sum.1 + f64::from(*e) * at.1))
        };
        // Centroid of half a disc of 30 px: 4/(3 π) of it, towards −x of the field point on +x.
        let expected = -4.0 / (3.0 * std::f64::consts::PI) * 30.0;
        for (dy, dx) in [(0.0, 50.0), (0.0, 170.0), (80.0, 0.0), (-90.0, 90.0)] {
            let (found, r) = (centroid(dy, dx), f64::hypot(dy, dx));
            assert!(
                (found.0 - expected * dy / r).abs() < 0.2 && (found.1 - expected * dx / r).abs() < 0.2,
                "{found:?}"
            );
        }
    }

    #[test]
    fn samples_beyond_the_window_of_the_film_do_not_count() {
        let wide = shape(vec![psf(120.0, |_, _| true); 2]);
        let cropped = Shape { half_px: 20.5, ..wide };
        assert!(cropped.parts(0).iter().all(|(_, (y, x))| y.abs() <= 20.5 && x.abs() <= 20.5));
        assert!((cropped.parts(0).iter().map(|part| part.0).sum::<f64>() - 1.0).abs() < 1e-12);
    }
}
