//! Pupil functions of a band at the heights of its PSFs, from which the PSFs are computed when they are needed.
//!
//! The PSFs of a fast lens have gigabytes, the pupil functions, which are smooth, a hundredth of that. The PSFs are the same: a trace computes
//! them from the same values with the same sums ([`super::PsfGrid`]), each scaled to sum 1.
//! A pupil has one segment, or several where surfaces limit it ([`crate::design::pupil`]). The values of a segment are at Chebyshev points of the first kind,
//!
//! ```text
//! ρ_i = (1 − cos(π (i + ½)/rings))/2,    θ_j = from + (to − from) (1 − cos(π (j + ½)/spokes))/2,    ρ as the slow index,
//! ```
//! as rows of W in µm, L, M, √(Φ J / N) · B², and Φ / N · B²; the last two are negative where an obscuration hides the light.
//! Of lenses with rotational symmetry they are of the upper half of the pupil, θ in [0, π]. Of others ([`crate::design::skew`]) they are of the
//! whole pupil, θ in [−π, π], and stand for the PSFs as they are stored, in the frames turned by their azimuths.

use std::f64::consts::{PI, TAU};

use thiserror::Error;

use super::huygens::{PsfGrid, PsfScratch};
use crate::design::pupil::function::{Patch, PupilFunction};
use crate::design::pupil::{Pupil, Segment};
use crate::lens::{PsfSample, PsfStack};
use crate::parts::for_each_part;

/// Numbers that describe a segment: index of its height, rings, spokes, first and last angle in rad, the surface whose aperture is its rim (−1: none),
/// centre of its domain on the meridian in pupil coordinates, and 1 or −1 for a part that an obscuration hides.
pub const SEGMENT_NUMBERS: usize = 8;
/// Numbers that describe a segment of a whole pupil: those above with both coordinates of the centre, along and across the meridian.
pub const WHOLE_SEGMENT_NUMBERS: usize = 9;
/// Rows of values of a segment.
pub const VALUE_ROWS: usize = 5;
/// Maximum of rings and of spokes; the trace has fewer than 100.
const MAX_POINTS: f64 = 256.0;
/// Maximum of segments of a PSF; 8 are the most of the built-in lenses.
const MAX_SEGMENTS: usize = 64;
/// Maximum of nodes of the quadrature of a PSF: over its samples (the PSFs of the built-in lenses have 0.1 to 0.2), and in addition.
const MAX_NODES: (f64, f64) = (4.0, 1e5);

/// Pupil functions of the PSFs of a band.
#[derive(Clone, Debug, PartialEq)]
pub struct PupilStack {
    size: usize,
    pitch_um: f64,
    functions: Vec<PupilFunction>,
}

/// Index of the number of a segment that only whole pupils have.
const ACROSS: usize = 7;

/// The values do not describe a pupil.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[error("segment {segment} {problem}")]
pub struct PupilError {
    /// Index of the segment.
    pub segment: usize,
    /// The violation.
    pub problem: String,
}

impl PupilStack {
    pub(in crate::design) fn new(grid: &PsfGrid, functions: Vec<PupilFunction>) -> Self {
        Self { size: grid.size(), pitch_um: grid.pitch_um(), functions }
    }

    /// Samples a side of the PSFs.
    pub fn size(&self) -> usize {
        self.size
    }

    /// Sample pitch of the PSFs, µm.
    pub fn pitch_um(&self) -> f64 {
        self.pitch_um
    }

    /// Number of heights, or of PSFs where they are of whole pupils.
    pub fn heights(&self) -> usize {
        self.functions.len()
    }

    /// Whether the segments are of whole pupils: [`whole_parts`](Self::whole_parts), not [`parts`](Self::parts), describe them.
    pub fn is_whole(&self) -> bool {
        self.functions.first().is_some_and(|f| f.is_whole)
    }

    /// Computes the PSFs, each of sum 1, on `threads` threads.
    ///
    /// # Errors
    /// Directions of a pupil whose Nyquist pitch is below that of the samples.
    pub fn psfs(&self, threads: usize) -> Result<PsfStack, PupilError> {
        let n = self.size;
        let grid = PsfGrid::new(n / 2, self.pitch_um);
        let mut samples = vec![0.0; n * n * self.functions.len()];
        let one = |scratch: &mut (PsfScratch, Vec<f32>),
                   (k, (f, out)): (usize, (&PupilFunction, &mut [f32]))| {
            if !grid.resolved_into(f, &mut scratch.0, &mut scratch.1) {
                let segment = self.functions[..k].iter().map(|f| f.patches.len()).sum();
                let problem = format!("has directions finer than samples of {} µm resolve", self.pitch_um);
                return Err(PupilError { segment, problem });
            }
            normalise(&scratch.1, out);
            Ok(())
        };
        let psfs = self.functions.iter().zip(samples.chunks_exact_mut(n * n)).enumerate();
        for_each_part(threads, psfs, <(PsfScratch, Vec<f32>)>::default, one)?;
        Ok(PsfStack { size: n, pitch_um: self.pitch_um, sample: PsfSample::Point, samples })
    }

    /// [`SEGMENT_NUMBERS`] of every segment, and their values: segments × [`VALUE_ROWS`] × width, the width that of the segment of most points, NaN
    /// after the points of the others.
    pub fn parts(&self) -> (Vec<[f64; SEGMENT_NUMBERS]>, Vec<f64>) {
        let (numbers, values) = self.whole_parts();
        let half = |n: [f64; WHOLE_SEGMENT_NUMBERS]| std::array::from_fn(|i| n[i + usize::from(i >= ACROSS)]);
        (numbers.into_iter().map(half).collect(), values)
    }

    /// [`WHOLE_SEGMENT_NUMBERS`] of every segment, the index that of the PSF, and their values as those of [`parts`](Self::parts).
    pub fn whole_parts(&self) -> (Vec<[f64; WHOLE_SEGMENT_NUMBERS]>, Vec<f64>) {
        let patches =
            || self.functions.iter().enumerate().flat_map(|(k, f)| f.patches.iter().map(move |p| (k, p)));
        let width = patches().map(|(_, p)| p.rings * p.spokes).max().unwrap_or(0);
        let numbers = patches().map(|(k, p)| {
            let s = &p.segment;
            let limit = s.limit.map_or(-1.0, |surface| surface as f64);
            [k as f64, p.rings as f64, p.spokes as f64, s.from, s.to, limit, s.centre, s.across, s.sign]
        });
        let values = patches().flat_map(|(_, p)| &p.tables).flat_map(|table| {
            table.iter().copied().chain(std::iter::repeat_n(f64::NAN, width - table.len()))
        });
        (numbers.collect(), values.collect())
    }

    /// The inverse of [`parts`](Self::parts), for PSFs at `heights_mm` of `size` samples of `pitch_um` a side.
    ///
    /// # Errors
    /// A segment is out of order, out of bounds, has values that are not finite, or oscillates too much for any window of this size.
    pub fn from_parts(
        wavelength_nm: f64,
        heights_mm: &[f64],
        (size, pitch_um): (usize, f64),
        segments: &[[f64; SEGMENT_NUMBERS]],
        values: &[f64],
    ) -> Result<Self, PupilError> {
        let whole = |n: &[f64; SEGMENT_NUMBERS]| {
            std::array::from_fn(|i| if i == ACROSS { 0.0 } else { n[i - usize::from(i > ACROSS)] })
        };
        let segments: Vec<[f64; WHOLE_SEGMENT_NUMBERS]> = segments.iter().map(whole).collect();
        Self::build(wavelength_nm, (heights_mm, false), (size, pitch_um), &segments, values)
    }

    /// The inverse of [`whole_parts`](Self::whole_parts), for PSFs at `heights_mm`, one value each, of `size` samples of `pitch_um` a side.
    ///
    /// # Errors
    /// As [`from_parts`](Self::from_parts).
    pub fn from_whole_parts(
        wavelength_nm: f64,
        heights_mm: &[f64],
        samples: (usize, f64),
        segments: &[[f64; WHOLE_SEGMENT_NUMBERS]],
        values: &[f64],
    ) -> Result<Self, PupilError> {
        Self::build(wavelength_nm, (heights_mm, true), samples, segments, values)
    }

    /// Of the PSFs at `heights_mm`, from segments of whole pupils if `is_whole`.
    fn build(
        wavelength_nm: f64,
        (heights_mm, is_whole): (&[f64], bool),
        (size, pitch_um): (usize, f64),
        segments: &[[f64; WHOLE_SEGMENT_NUMBERS]],
        values: &[f64],
    ) -> Result<Self, PupilError> {
        let first = if is_whole { -PI } else { 0.0 };
        let width = values.len() / VALUE_ROWS / segments.len().max(1);
        let mut patches: Vec<Vec<Patch>> = vec![Vec::new(); heights_mm.len()];
        let mut before = 0.0;
        for (index, numbers) in segments.iter().enumerate() {
            let invalid = |problem: String| PupilError { segment: index, problem };
            let (segment, rings, spokes) = segment(numbers, first).map_err(invalid)?;
            let k = numbers[0];
            if k < before || k >= heights_mm.len() as f64 || patches[k as usize].len() >= MAX_SEGMENTS {
                return Err(invalid(format!(
                    "is of height index {k}, expected ascending indices below {}, each at most {MAX_SEGMENTS} times",
                    heights_mm.len()
                )));
            }
            before = k;
            let points = rings * spokes;
            if points > width {
                return Err(invalid(format!(
                    "has {rings} × {spokes} points, but its rows have {width} values"
                )));
            }
            let rows = &values[index * VALUE_ROWS * width..][..VALUE_ROWS * width];
            let tables = std::array::from_fn(|row| rows[row * width..][..points].to_vec());
            if let Some(v) = tables.iter().flatten().find(|v| !v.is_finite()) {
                return Err(invalid(format!("has the value {v}, expected finite numbers")));
            }
            patches[k as usize].push(Patch::new(segment, rings, spokes, tables));
        }
        if let Some(k) = patches.iter().position(Vec::is_empty) {
            let segment = segments.partition_point(|numbers| numbers[0] < k as f64);
            return Err(PupilError {
                segment,
                problem: format!("is not of height index {k}, which has none"),
            });
        }
        let most = MAX_NODES.0 * (size * size) as f64 + MAX_NODES.1;
        let function = |(k, patches): (usize, Vec<Patch>)| {
            let pupil = Pupil { segments: patches.iter().map(|p| p.segment).collect() };
            let f = PupilFunction::new(wavelength_nm / 1e3, (pupil, is_whole), patches, heights_mm[k]);
            let nodes = f.expected_nodes(pitch_um * (size / 2) as f64);
            match nodes <= most {
                true => Ok(f),
                false => {
                    let segment = segments.partition_point(|numbers| numbers[0] < k as f64);
                    let problem =
                        format!("oscillates too much: {nodes:.1e} rays, expected at most {most:.1e}");
                    Err(PupilError { segment, problem })
                }
            }
        };
        let functions = patches.into_iter().enumerate().map(function).collect::<Result<_, _>>()?;
        Ok(Self { size, pitch_um, functions })
    }
}

/// The sum of `psf`, its share of the energy.
pub(in crate::design) fn energy(psf: &[f32]) -> f64 {
    psf.iter().map(|v| f64::from(*v)).sum()
}

/// `psf` divided by its sum into `out`; the sum, its share of the energy.
pub(in crate::design) fn normalise(psf: &[f32], out: &mut [f32]) -> f64 {
    let sum = energy(psf);
    for (o, v) in out.iter_mut().zip(psf) {
        *o = rounded((f64::from(*v) / sum) as f32);
    }
    sum
}

/// `v` rounded to 16 significant bits, a relative error of at most 2⁻¹⁷: of an f32 the last byte is 0, which is worth a third of a compressed pack.
/// The L1 difference of PSFs is 6e-6.
fn rounded(v: f32) -> f32 {
    f32::from_bits((v.to_bits() + 0x80) & !0xff)
}

/// The segment of `numbers`, its rings and spokes; angles are from `first` on.
fn segment(numbers: &[f64; WHOLE_SEGMENT_NUMBERS], first: f64) -> Result<(Segment, usize, usize), String> {
    let &[height, rings, spokes, from, to, limit, centre, across, sign] = numbers;
    let is_whole = |v: f64| v.fract() == 0.0;
    if !(is_whole(height) && height >= 0.0 && is_whole(limit) && (-1.0..=1e6).contains(&limit)) {
        return Err(format!(
            "is of height index {height} and limited by surface {limit}, expected whole numbers"
        ));
    }
    let is_count = |v: f64| is_whole(v) && (2.0..=MAX_POINTS).contains(&v);
    if !(is_count(rings) && is_count(spokes)) {
        return Err(format!("has {rings} rings and {spokes} spokes, expected 2 to {MAX_POINTS}"));
    }
    if !(first <= from && from < to && to <= PI) {
        let first = if first < 0.0 { "-π" } else { "0" };
        return Err(format!("is from {from} to {to} rad, expected ascending angles from {first} to π"));
    }
    if !(sign.abs() == 1.0 && centre.abs() <= 1.0) {
        return Err(format!("has sign {sign} and centre {centre}, expected 1 or -1, and -1 to 1"));
    }
    if across.is_nan() || across.abs() > 1.0 {
        return Err(format!("has the centre {across} across the meridian, expected -1 to 1"));
    }
    let limit = (limit >= 0.0).then_some(limit as usize);
    Ok((Segment { from, to, limit, centre, across, sign }, rings as usize, spokes as usize))
}

impl PupilFunction {
    /// Number of nodes of the quadrature for a window of ± `reach_um` in x and y, about.
    fn expected_nodes(&self, reach_um: f64) -> f64 {
        let k = TAU / self.wavelength_um;
        let corner = std::f64::consts::SQRT_2 * reach_um;
        let of_patch = |patch: &Patch| {
            let (rho, theta) = patch.change(0.0, 1.0);
            let periods = |(lm, w): (f64, f64), span: f64| k * (corner * lm + w) * span / TAU + 8.0;
            periods(rho, 1.0) * periods(theta, patch.segment.to - patch.segment.from)
        };
        self.patches.iter().map(of_patch).sum()
    }
}
