//! Tails of the PSFs of a band: the closed form of the far tail, and power laws fitted to PSFs on a larger window.
//!
//! At each of a dozen heights the PSF is computed up to [`REACH`] half windows. Its means over rings, of p, p cos φ, p cos 2φ …, give the
//! harmonics of the azimuth; c_mj follow by least squares of the relative error ([`crate::lens::tail`]). c_00 is that of the edge of the
//! pupil ([`crate::design::pupil::edge`]), and c_01 makes the light whole: that in the window (by Parseval, of all light) and
//! that of T beyond its square are 1,
//!
//! ```text
//! ∫∫ beyond a square of half a side a:   r⁻³: 4√2/a    r⁻⁵: (10√2/9)/a³    r⁻³ cos 4φ: (4√2/15)/a    r⁻⁵ cos 4φ: 8/(3 a³) ∫₀^{π/4} cos³φ cos 4φ dφ
//! ```
//!
//! The light of T is not negative: where it would be, c_01 is 0.
//!
//! A band whose edge rays land beyond the window, or near its border, has no such tail: there it is geometric, not a power law ([`super::middle`]).

use rayon::prelude::*;

use super::squares::{squares, within};
use super::{PsfGrid, PsfScratch};
use crate::design::pupil::edge::Edge;
use crate::design::pupil::pupils::Pupils;
use crate::lens::tail::{BandTail, Coefficients, ORDERS, TERMS, light};

/// Half windows up to which the power laws are fitted, and half a side of the PSFs for it in samples at most.
const REACH: f64 = 3.0;
const MAX_HALF: usize = 768;
/// Pitch of the samples of these sums over that of the PSFs, at most, and of these samples half a window has at least: a ring of the fit then has four. What is aliased,
/// the light at frequencies near the limit of diffraction, lies at frequencies that the means over rings hardly have.
pub(super) const COARSER: f64 = 1.8;
const LEAST_HALF: f64 = 90.0;
/// Half a window over the edge rays' blur, at least: half planes of the Double Gauss from 400 to 460 nm have errors up to 1.5e-4 of white in the corner (at 1.3 and 1.1: 0.6e-4, 2.3e-4);
/// windows of 1.3 have 28 % more pixels.
pub(in crate::design) const CLEAR: f64 = 1.15;
/// Rings of the fit.
const RINGS: usize = 24;
/// ∫ beyond a square of half a side 1 of r⁻³, r⁻⁵, and of both times cos 4φ: 4√2, 10√2/9, 4√2/15 and 8/3 ∫₀^{π/4} cos³φ cos 4φ dφ.
const BEYOND: [[f64; TERMS]; 2] =
    [[5.656_854_249_492_381, 1.571_348_402_636_772_3], [0.377_123_616_632_825_3, 0.296_311_413_068_648_5]];

/// Why a band has no tail.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NoTail {
    /// The edge rays' largest blur, µm.
    pub blur_um: f64,
    /// Half a side of the window, µm.
    pub half_um: f64,
}

/// Largest distance from the chief ray of the rays at `edges` of pupils, µm.
pub(in crate::design) fn blur_um(edges: &[Edge]) -> f64 {
    edges.iter().fold(0.0, |largest, edge| largest.max(edge.blur_um))
}

/// The tails at `heights` (those that `pupils` were made with, which have `edges`) beyond windows of `window` samples of `pitch_um`, by power laws alone.
pub(super) fn power_laws(
    pupils: &Pupils<'_>,
    (heights, edges): (&[f64], &[Edge]),
    (window, pitch_um): (usize, f64),
) -> Result<BandTail, NoTail> {
    let half_um = 0.5 * window as f64 * pitch_um;
    let blur_um = blur_um(edges);
    if CLEAR * blur_um > half_um {
        return Err(NoTail { blur_um, half_um });
    }
    let half = ((REACH * 0.5 * window as f64) as usize).min(MAX_HALF.max(3 * window / 4));
    // In samples of the sums.
    let coarser = (0.5 * window as f64 / LEAST_HALF).clamp(1.0, COARSER);
    let (half, window, pitch_um) =
        ((half as f64 / coarser).ceil() as usize, window as f64 / coarser, coarser * pitch_um);
    let grid = PsfGrid::new(half, pitch_um);
    let rings = Rings::new(half, 0.5 * window);
    let coefficients = heights
        .par_iter()
        .zip(edges)
        .map_init(<(PsfScratch, Vec<f32>)>::default, |(scratch, psf), (h, edge)| {
            grid.psf_into(pupils.at(*h), 0.0, scratch, psf);
            rings.fit(psf, window, pitch_um, edge.tail_um)
        })
        .collect();
    Ok(BandTail { inner_mm: 1e-3 * half_um, height_mm: heights.to_vec(), coefficients, middle: None })
}

/// Rings about the centre of PSFs of one size, lengths in samples.
struct Rings {
    half: usize,
    /// The first radius, half a window.
    inner: f64,
    /// Ring of each sample and the cosine of its azimuth, of the rows from the centre down; [`RINGS`]: none.
    samples: Vec<(u8, f32)>,
    /// Samples of each ring, the lower and the upper half of the PSF.
    count: [f64; RINGS],
    /// Means of r^−q.
    basis: [[f64; TERMS]; RINGS],
}

impl Rings {
    fn new(half: usize, inner: f64) -> Self {
        let (n, outer) = (2 * half + 1, 0.99 * half as f64);
        let mut rings = Self {
            half,
            inner,
            samples: Vec::with_capacity((half + 1) * n),
            count: [0.0; RINGS],
            basis: [[0.0; TERMS]; RINGS],
        };
        // Radii in geometric sequence.
        let ratio = crate::real::pow(outer / inner, 1.0 / RINGS as f64);
        let edges: Vec<f64> =
            std::iter::successors(Some(inner), |r| Some(r * ratio)).take(RINGS + 1).collect();
        for y in 0..=half {
            for x in 0..n {
                let (x, y) = (x as f64 - half as f64, y as f64);
                let r = (x * x + y * y).sqrt();
                let ring = edges.partition_point(|edge| *edge <= r);
                if ring == 0 || ring > RINGS {
                    rings.samples.push((RINGS as u8, 0.0));
                    continue;
                }
                let weight = if y == 0.0 { 1.0 } else { 2.0 };
                rings.count[ring - 1] += weight;
                for (j, sum) in rings.basis[ring - 1].iter_mut().enumerate() {
                    *sum += weight * r.powi(-3 - 2 * j as i32);
                }
                rings.samples.push(((ring - 1) as u8, (x / r) as f32));
            }
        }
        for (sums, count) in rings.basis.iter_mut().zip(&rings.count) {
            sums.iter_mut().for_each(|sum| *sum /= count);
        }
        rings
    }

    /// Harmonics of `psf` (share per sample), by ring.
    fn harmonics(&self, psf: &[f32]) -> [[f64; ORDERS]; RINGS] {
        let n = 2 * self.half + 1;
        let mut sums = [[0.0; ORDERS]; RINGS];
        for (y, (row, samples)) in
            psf.chunks_exact(n).skip(self.half).zip(self.samples.chunks_exact(n)).enumerate()
        {
            let weight = if y == 0 { 1.0 } else { 2.0 };
            for (v, (ring, cosine)) in row.iter().zip(samples) {
                let Some(sums) = sums.get_mut(*ring as usize) else { continue };
                let (v, cosine) = (weight * f64::from(*v), f64::from(*cosine));
                let (mut last, mut this) = (cosine, 1.0);
                for (m, sum) in sums.iter_mut().enumerate() {
                    *sum += v * this;
                    (last, this) = (this, if m == 0 { cosine } else { 2.0 * cosine * this - last });
                }
            }
        }
        for (sums, count) in sums.iter_mut().zip(&self.count) {
            let norm = |m: usize| if m == 0 { 1.0 } else { 2.0 };
            sums.iter_mut().enumerate().for_each(|(m, sum)| *sum *= norm(m) / count);
        }
        sums
    }

    /// The coefficients of `psf` beyond its inner `window`, with C = `tail_um`.
    fn fit(&self, psf: &[f32], window: f64, pitch_um: f64, tail_um: f64) -> Coefficients {
        let harmonics = self.harmonics(psf);
        let mut c = [[0.0; TERMS]; ORDERS];
        for (m, c) in c.iter_mut().enumerate().skip(1) {
            // Normal equations of the relative errors: of f = t/b₀ by 1 and g = b₁/b₀.
            let (mut n, mut g1, mut g2, mut f1, mut fg) = (0.0, 0.0, 0.0, 0.0, 0.0);
            for (row, basis) in harmonics.iter().zip(&self.basis) {
                let (f, g) = (row[m] / basis[0], basis[1] / basis[0]);
                (n, g1, g2, f1, fg) = (n + 1.0, g1 + g, g2 + g * g, f1 + f, fg + f * g);
            }
            let determinant = n * g2 - g1 * g1;
            *c = [(f1 * g2 - fg * g1) / determinant, (n * fg - g1 * f1) / determinant];
        }
        let inside = within(&squares(psf, 2 * self.half + 1), window);
        let a = self.inner;
        let [plain, fourth] = BEYOND.map(|[third, fifth]| [third / a, fifth / a.powi(3)]);
        c[0][0] = tail_um / pitch_um;
        let others = c[0][0] * plain[0] + c[4][0] * fourth[0] + c[4][1] * fourth[1];
        c[0][1] = (1.0 - inside - others) / plain[1];
        // Beyond the field of a design, where the pupil's edge is barely sampled, C alone may be more than all light: then without the fit.
        if light(&c, a) < 0.0 {
            c[0][1] = 0.0;
        }
        // From samples to mm.
        let mm = 1e-3 * pitch_um;
        c.map(|[third, fifth]| [third * mm, fifth * mm.powi(3)])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::design::prescription::system::System;
    use crate::design::pupil::test_lenses::lens;
    use crate::design::rays::ray::Tracer;

    /// Rings of PSFs by another program (SOURCES.md): lens, wavelength in µm, height in mm, half a window, C and the blur of edge rays in µm, then means
    /// of r³ I in µm over rings from 0.8 to 1.25 times 1, 1.5, 2, 3, 5 and 8 half windows.
    const RINGS_OF_LENSES: &str = include_str!("../../../tests/data/tail_rings.csv");
    const AT: [f64; 6] = [1.0, 1.5, 2.0, 3.0, 5.0, 8.0];

    #[test]
    fn far_tails_are_those_of_independent_sums() {
        let (mut lenses, mut cases) = (std::collections::BTreeSet::new(), 0);
        for line in RINGS_OF_LENSES.lines().skip(1) {
            let fields: Vec<&str> = line.split(',').collect();
            let number = |i: usize| fields[i].parse::<f64>().ok();
            let [um, height, half_um, c, blur] = [1, 2, 3, 4, 5].map(|i| number(i).unwrap());
            let system = match fields[0] {
                "double-gauss-28" => System::double_gauss_28(),
                name => lens(name),
            };
            let tracer = Tracer::new(&system, um).unwrap();
            let last = if height == 0.0 { 1.0 } else { height };
            let heights = [0.0, 0.5 * last, last];
            let pupils = Pupils::new(&tracer, &heights).unwrap();
            let k = if height == 0.0 { 0 } else { 2 };
            let f = pupils.at(heights[k]);
            let edge = f.edge(tracer.surfaces());
            let pitch_um = 0.9 * f.nyquist_um();
            let window = (2.0 * half_um / pitch_um) as usize | 1;
            let edges = heights.map(|h| pupils.at(h).edge(tracer.surfaces()));
            let tail = power_laws(&pupils, (&heights, &edges), (window, pitch_um)).unwrap();
            let [third, fifth] = tail.coefficients[k][0].map(|v| 1e3 * v);
            assert!((edge.tail_um / c - 1.0).abs() < 3e-3, "{line}: C {}", edge.tail_um);
            assert!((edge.blur_um - blur).abs() < 0.03 * blur + 0.3, "{line}: blur {}", edge.blur_um);
            assert!((third / edge.tail_um - 1.0).abs() < 1e-12);
            let mut errors = Vec::new();
            for (i, at) in AT.iter().enumerate().skip(1) {
                let Some(expected) = number(6 + i) else { continue };
                let (a, b) = (0.8e-3 * at * half_um, 1.25e-3 * at * half_um);
                let found = third
                    + fifth * 2.0 * crate::real::log10(b / a) * std::f64::consts::LN_10 / (b * b - a * a);
                errors.push(found / expected - 1.0);
                let tolerance = if *at < 3.0 { 0.12 } else { 0.03 };
                assert!((found / expected - 1.0).abs() < tolerance, "{line}: {found} at {at} half windows");
            }
            let errors: Vec<String> = errors.iter().map(|e| format!("{:+.2} %", 100.0 * e)).collect();
            println!("{line}: C {:+.2} %, rings {}", 100.0 * (edge.tail_um / c - 1.0), errors.join(", "));
            lenses.insert(fields[0]);
            cases += 1;
        }
        assert_eq!((lenses.len(), cases), (5, 30));
    }

    #[test]
    fn a_tail_has_no_negative_light() {
        let (window, pitch_um) = (101.0, 1.0);
        let rings = Rings::new(151, 50.5);
        let mut psf = vec![0.0; 303 * 303];
        psf[303 * 303 / 2] = 1.0;
        // All light is inside the window, whatever the edge of the pupil says.
        let c = rings.fit(&psf, window, pitch_um, 0.1);
        assert!(c[0][0] > 0.0 && c[0][1] == 0.0 && light(&c, 50.5e-3) > 0.0, "{c:?}");
        let without = rings.fit(&psf, window, pitch_um, 0.0);
        assert_eq!(light(&without, 50.5e-3), 0.0);
    }
}
