//! Vergences of depth nodes, chosen by the error of linear interpolation half-way between them.
//!
//! ```text
//! e(V, h) = (P(V − h) + P(V + h))/2 − P(V)         kernels integrated over film pixels, of sum 1 in a window that holds the blur and its rim
//! L1 = Σ |e|,   ESF = largest |running sum of e's rows or columns|      the worst of some field points
//! ```
//! Both are C·h² to the next order, also far from focus. C is measured at probing vergences, nodes are placed with a density of √(C/tolerance)/2 per
//! dioptre, cells are checked at their middle, and C there refines the density; a cell that still fails is halved. Of many cells (large blurs) some are
//! checked: C is a smooth function of V.
//! Executable form in f64: tests/golden/depth/depth_nodes.py.

use std::collections::BTreeMap;

use rayon::prelude::*;

use super::estimate::rim_px;
use crate::design::prescription::error::DesignError;
use crate::design::prescription::system::System;
use crate::design::psf::film_pixel::FilmPixels;
use crate::design::psf::{PsfGrid, PsfScratch, PupilFunction};
use crate::design::rays::ray::Tracer;
use crate::design::tables::difference::largest_sum;
use crate::design::tables::window::core_samples;
use crate::real;

/// Share of a tolerance that cells are placed for.
const MARGIN: f64 = 0.95;
/// Rounds of placing and measuring.
const ROUNDS: usize = 4;
/// Cells that are measured in a round; of more, this many evenly spaced ones.
const MEASURED: usize = 48;
/// Further rounds where not all cells are measured, each for less of the tolerance by this factor.
const STRICTER: (usize, f64) = (8, 0.85);
/// Rounds of measuring for an estimate after the probes, and cells of each.
const ESTIMATED: (usize, usize) = (1, 8);
/// Blur radius up to which an estimate measures, µm: a second or two of one core.
const MEASURED_UM: f64 = 120.0;
/// Share of the tolerances for which an estimate places nodes: the checks of a placement add a seventh of its nodes (five ranges of a Double Gauss).
const CHECKED: f64 = 0.75;
/// Probing vergences on either side of focus.
const PROBES: usize = 9;
/// Points at which the density is integrated.
const FINE: usize = 20_001;
/// Pixels up to which windows are multiples of 8 pixels, µm.
const FINE_UM: f64 = 2.0;
/// Largest ESF error half-way between nodes.
pub const ESF_TOLERANCE: f64 = 1e-3;

/// Range of vergences and accuracy of the nodes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NodeOptions {
    /// First and last vergence, 1/m.
    pub range: (f64, f64),
    /// Vergence in focus, 1/m.
    pub focus: f64,
    /// Maximum L1 error half-way between nodes.
    pub l1_tolerance: f64,
    /// Film pitch, µm.
    pub film_pitch_um: f64,
    /// Blur radius per dioptre, film px.
    pub blur_px: f64,
    /// Largest window, film px.
    pub max_window_px: usize,
}

/// Chosen nodes and their errors.
#[derive(Clone, Debug, PartialEq)]
pub struct Placement {
    /// Vergences, 1/m, ascending.
    pub vergence: Vec<f64>,
    /// Largest L1 error at the middle of a cell.
    pub l1: f64,
    /// Largest ESF error at the middle of a cell.
    pub esf: f64,
}

impl Placement {
    /// Its nodes of which `is_used` is true.
    #[must_use]
    pub fn only(self, is_used: &[bool]) -> Self {
        let used = std::iter::zip(self.vergence, is_used).filter(|(_, is_used)| **is_used);
        Self { vergence: used.map(|(v, _)| v).collect(), ..self }
    }
}

/// Middle and half width, 1/m.
type Cell = (f64, f64);
/// L1 and ESF error.
type Errors = [f64; 2];
/// Vergence as bits, and half the window, px.
type Key = (u64, usize);
/// Kernels of all field points.
type OfFields = Vec<Vec<f32>>;

/// Places nodes of `system` (its film in focus at `options.focus`) at `um` over the range, by the field points at REAL heights `heights_mm`.
///
/// # Errors
/// A ray that does not reach the image.
pub fn place(
    system: &System,
    um: f64,
    heights_mm: &[f64],
    options: &NodeOptions,
) -> Result<Placement, DesignError> {
    let mut kernels = Kernels::new(system, um, heights_mm, options)?;
    let (first, last) = options.range;
    if last - first < 1e-9 {
        return Ok(Placement { vergence: vec![first], l1: 0.0, esf: 0.0 });
    }
    let allowed = [options.l1_tolerance, ESF_TOLERANCE];
    let probes = probes(options, options.range);
    let found = kernels.errors(&probes)?;
    let mut constants: BTreeMap<u64, Errors> =
        std::iter::zip(&probes, &found).map(|((v, h), e)| (v.to_bits(), scaled(e, *h))).collect();
    let mut cells = Vec::new();
    let mut errors: Vec<Errors> = Vec::new();
    let fails = |e: &Errors| e[0] > allowed[0] || e[1] > allowed[1];
    for round in 0..ROUNDS + STRICTER.0 {
        let share = MARGIN * STRICTER.1.powi(round.saturating_sub(ROUNDS - 1) as i32);
        let vergence = nodes_by_density(&constants, allowed.map(|a| share * a), options.range);
        cells = vergence.windows(2).map(cell).collect();
        let measured = sample(&cells, MEASURED);
        errors = kernels.errors(&measured)?;
        if !errors.iter().any(fails) {
            if measured.len() < cells.len() {
                return Ok(Placement { vergence, l1: worst(&errors, 0), esf: worst(&errors, 1) });
            }
            break;
        }
        if measured.len() == cells.len() && round + 1 >= ROUNDS {
            break;
        }
        constants.extend(std::iter::zip(&measured, &errors).map(|((v, h), e)| (v.to_bits(), scaled(e, *h))));
    }
    if cells.len() > errors.len() {
        errors = kernels.errors(&cells)?;
    }
    while errors.iter().any(fails) {
        let halves = |(cell, e): (&(f64, f64), &Errors)| {
            let &(v, h) = cell;
            if fails(e) { vec![(v - h / 2.0, h / 2.0), (v + h / 2.0, h / 2.0)] } else { vec![(v, h)] }
        };
        cells = std::iter::zip(&cells, &errors).flat_map(halves).collect();
        errors = kernels.errors(&cells)?;
    }
    let vergence = std::iter::once(first).chain(cells.iter().map(|(v, h)| v + h)).collect();
    Ok(Placement { vergence, l1: worst(&errors, 0), esf: worst(&errors, 1) })
}

/// As many nodes as [`place`] needs, at about its vergences, without its checks: C is measured at the probing vergences and in some cells, where the blur
/// radius is at most 120 µm; beyond it the density of nodes is that of the last one.
///
/// # Errors
/// A ray that does not reach the image.
pub fn estimated(
    system: &System,
    um: f64,
    heights_mm: &[f64],
    options: &NodeOptions,
) -> Result<Vec<f64>, DesignError> {
    let (first, last) = options.range;
    if last - first < 1e-9 {
        return Ok(vec![first]);
    }
    let mut kernels = Kernels::new(system, um, heights_mm, options)?;
    let allowed = [options.l1_tolerance, ESF_TOLERANCE];
    let allowed = allowed.map(|a| CHECKED * MARGIN * a);
    let reach = MEASURED_UM / options.film_pitch_um / options.blur_px;
    let near_focus = |v: f64| v.clamp(options.focus - reach, options.focus + reach);
    let measured = match (near_focus(first), near_focus(last)) {
        (a, z) if z - a > 1e-9 => (a, z),
        // All surfaces are blurred more widely.
        (a, _) if a > last => ((last - 0.5 / options.blur_px).max(first), last),
        _ => (first, (first + 0.5 / options.blur_px).min(last)),
    };
    let mut constants: BTreeMap<u64, Errors> = BTreeMap::new();
    let mut cells = probes(options, measured);
    for round in 0..=ESTIMATED.0 {
        let errors = kernels.errors(&cells)?;
        constants.extend(std::iter::zip(&cells, &errors).map(|((v, h), e)| (v.to_bits(), scaled(e, *h))));
        if round < ESTIMATED.0 {
            let nodes = nodes_by_density(&constants, allowed, measured);
            let all: Vec<Cell> = nodes.windows(2).map(cell).collect();
            cells = sample(&all, ESTIMATED.1);
        }
    }
    Ok(nodes_by_density(&constants, allowed, options.range))
}

/// Cells of half a pixel of blur on either side, over `range`: closer to each other near focus, where C changes most.
fn probes(options: &NodeOptions, (first, last): (f64, f64)) -> Vec<Cell> {
    let blur = options.blur_px;
    let h = (0.5 / blur).min((last - first) / 2.0);
    let reach = (first - options.focus).abs().max((last - options.focus).abs()) * blur;
    let ratio = real::pow(reach.max(2.0), 1.0 / (PROBES - 2) as f64);
    // Where h is half of the range, the bounds of v ± h within it are equal but for rounding.
    let (low, high) = (first + h, (last - h).max(first + h));
    let side = (0..PROBES).map(|i| if i == 0 { 0.0 } else { ratio.powi(i as i32 - 1) / blur });
    let mut probes: Vec<f64> =
        side.flat_map(|s| [options.focus - s, options.focus + s]).map(|v| v.clamp(low, high)).collect();
    probes.sort_by(f64::total_cmp);
    probes.dedup_by(|a, b| (*a - *b).abs() < 1e-9);
    probes.into_iter().map(|v| (v, h)).collect()
}

/// The cell between two nodes.
fn cell(nodes: &[f64]) -> Cell {
    ((nodes[0] + nodes[1]) / 2.0, (nodes[1] - nodes[0]) / 2.0)
}

/// C of the errors of a cell of half width `h`.
fn scaled(errors: &Errors, h: f64) -> Errors {
    errors.map(|e| e / (h * h))
}

/// The largest error of kind `i`.
fn worst(errors: &[Errors], i: usize) -> f64 {
    errors.iter().map(|e| e[i]).fold(0.0, f64::max)
}

/// At most `count` of `all`, evenly spaced, with the first and the last.
fn sample<T: Copy>(all: &[T], count: usize) -> Vec<T> {
    match all.len() <= count {
        true => all.to_vec(),
        false => (0..count).map(|i| all[i * (all.len() - 1) / (count - 1)]).collect(),
    }
}

/// Nodes over `range` with the density that `constants` (C by vergence, 1/m as bits of positive numbers, which are ordered) require.
fn nodes_by_density(
    constants: &BTreeMap<u64, Errors>,
    allowed: [f64; 2],
    (first, last): (f64, f64),
) -> Vec<f64> {
    let known: Vec<(f64, f64)> = constants
        .iter()
        .map(|(v, c)| {
            let density = std::iter::zip(c, allowed).map(|(c, a)| (c / a).sqrt() / 2.0);
            (f64::from_bits(*v), density.fold(0.0, f64::max))
        })
        .collect();
    let density = |v: f64| {
        let i = known.partition_point(|k| k.0 <= v);
        match (i.checked_sub(1).map(|i| known[i]), known.get(i)) {
            (Some(a), Some(b)) => a.1 + (v - a.0) / (b.0 - a.0) * (b.1 - a.1),
            (Some(one), None) => one.1,
            (None, one) => one.map_or(0.0, |one| one.1),
        }
    };
    let step = (last - first) / (FINE - 1) as f64;
    let at = |i: usize| first + step * i as f64;
    let mut sums = vec![0.0];
    for i in 1..FINE {
        sums.push(sums[i - 1] + (density(at(i - 1)) + density(at(i))) / 2.0 * step);
    }
    let all = sums[FINE - 1];
    let count = (all.ceil() as usize).max(1);
    let node = |k: usize| {
        let sum = k as f64 * all / count as f64;
        let i = sums.partition_point(|s| *s < sum).clamp(1, FINE - 1);
        let span = sums[i] - sums[i - 1];
        at(i - 1) + if span > 0.0 { step * (sum - sums[i - 1]) / span } else { 0.0 }
    };
    (0..=count).map(|k| if k == count { last } else { node(k) }).collect()
}

/// Kernels by vergence and half window, of all field points.
struct Kernels<'a> {
    system: &'a System,
    um: f64,
    heights_mm: &'a [f64],
    options: &'a NodeOptions,
    pitch_um: f64,
    computed: BTreeMap<Key, OfFields>,
    /// Shares of samples in film pixels, by half the window, px.
    pixels: BTreeMap<usize, FilmPixels>,
}

impl<'a> Kernels<'a> {
    fn new(
        system: &'a System,
        um: f64,
        heights_mm: &'a [f64],
        options: &'a NodeOptions,
    ) -> Result<Self, DesignError> {
        let mut nyquist = f64::INFINITY;
        let focused = system.at_vergence(options.focus)?;
        let tracer = Tracer::new(&focused, um)?;
        for h in heights_mm {
            let pupil = PupilFunction::trace(&tracer, tracer.field_of_height(*h)?)?;
            nyquist = nyquist.min(pupil.nyquist_um());
        }
        let film = options.film_pitch_um;
        let pitch_um = film / (film / (0.9 * nyquist)).ceil();
        let (computed, pixels) = (BTreeMap::new(), BTreeMap::new());
        Ok(Self { system, um, heights_mm, options, pitch_um, computed, pixels })
    }

    /// Half a window that holds the blur at `v` with its rim, px; a multiple of 8, of 2 on coarse pixels, so that neighbours share kernels.
    fn half_px(&self, v: f64) -> usize {
        let radius = (v - self.options.focus).abs() * self.options.blur_px;
        let (rim, film) = (rim_px(self.options.film_pitch_um), self.options.film_pitch_um);
        let step = if film > FINE_UM { 2 } else { 8 };
        (step * ((1.2 * radius + rim) / step as f64).ceil() as usize).min(self.options.max_window_px / 2)
    }

    /// Errors half-way between v − h and v + h, for all `cells` (v, h).
    fn errors(&mut self, cells: &[(f64, f64)]) -> Result<Vec<Errors>, DesignError> {
        let half = |(v, h): &(f64, f64)| self.half_px(v - h).max(self.half_px(v + h));
        let keys = |cell: &(f64, f64)| {
            let (v, h) = *cell;
            [v - h, v, v + h].map(|v| (v.max(0.0).to_bits(), half(cell)))
        };
        let cell_keys: Vec<[Key; 3]> = cells.iter().map(keys).collect();
        let mut missing: Vec<Key> = cell_keys.concat();
        missing.sort_unstable();
        missing.dedup();
        missing.retain(|key| !self.computed.contains_key(key));
        let mut halves: Vec<usize> = missing.iter().map(|key| key.1).collect();
        halves.sort_unstable();
        halves.dedup();
        halves.retain(|half| !self.pixels.contains_key(half));
        let pixels: Vec<(usize, FilmPixels)> =
            halves.into_par_iter().map(|half| (half, self.film_pixels(half))).collect();
        self.pixels.extend(pixels);
        let computed: Vec<(Key, OfFields)> = missing
            .into_par_iter()
            .map(|key| Ok((key, self.kernels(f64::from_bits(key.0), key.1)?)))
            .collect::<Result<_, DesignError>>()?;
        self.computed.extend(computed);
        let errors = cell_keys.iter().map(|keys| self.error(*keys)).collect();
        // Neighbouring cells share kernels; those of another round lie elsewhere.
        self.computed.clear();
        Ok(errors)
    }

    /// Samples of PSFs whose kernels have `2 half_px + 1` film pixels.
    fn grid(&self, half_px: usize) -> PsfGrid {
        let (half, pitch_um) = core_samples(2 * half_px + 1, self.options.film_pitch_um, self.pitch_um);
        PsfGrid::new(half, pitch_um)
    }

    fn film_pixels(&self, half_px: usize) -> FilmPixels {
        let grid = self.grid(half_px);
        FilmPixels::new(grid.size(), grid.pitch_um(), 2 * half_px + 1, self.options.film_pitch_um)
    }

    fn error(&self, keys: [Key; 3]) -> Errors {
        let [far, middle, near] = keys.map(|key| &self.computed[&key]);
        let n = 2 * keys[0].1 + 1;
        (0..self.heights_mm.len()).fold([0.0; 2], |worst, i| {
            let e = differences(&far[i], &middle[i], &near[i], n);
            [worst[0].max(e[0]), worst[1].max(e[1])]
        })
    }

    /// Kernels of `2 half_px + 1` film pixels at vergence `v`, per field point.
    fn kernels(&self, v: f64, half_px: usize) -> Result<OfFields, DesignError> {
        let system = self.system.at_vergence(v)?;
        let tracer = Tracer::new(&system, self.um)?;
        let grid = self.grid(half_px);
        let pixels = &self.pixels[&half_px];
        let (mut scratch, mut psf) = (PsfScratch::default(), Vec::new());
        self.heights_mm
            .iter()
            .map(|height| {
                let pupil = PupilFunction::trace(&tracer, tracer.field_of_height(*height)?)?;
                grid.psf_into(&pupil, 0.0, &mut scratch, &mut psf);
                Ok(pixels.kernel(&psf))
            })
            .collect()
    }
}

/// L1 and ESF of (far + near)/2 − middle, windows of `n` × `n`.
fn differences(far: &[f32], middle: &[f32], near: &[f32], n: usize) -> Errors {
    let (mut l1, mut rows, mut columns) = (0.0, vec![0.0; n], vec![0.0; n]);
    for (i, ((a, b), c)) in far.iter().zip(near).zip(middle).enumerate() {
        let e = (f64::from(*a) + f64::from(*b)) / 2.0 - f64::from(*c);
        l1 += e.abs();
        rows[i / n] += e;
        columns[i % n] += e;
    }
    [l1, largest_sum(&rows).max(largest_sum(&columns))]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::design::prescription::system::ImagePlane;

    #[test]
    #[ignore = "long: some 700 PSFs of up to 200 px"]
    fn cells_that_are_not_measured_meet_the_tolerance() {
        let system = System::double_gauss_28();
        let system = system.focused_at(0.5, ImagePlane::Paraxial(system.primary_um()), 0.0).unwrap();
        let options = NodeOptions {
            range: (0.5, 0.58),
            focus: 0.5,
            l1_tolerance: 0.02,
            film_pitch_um: 2.0,
            blur_px: 868.8,
            max_window_px: 401,
        };
        let heights = [0.0, 8.0];
        let found = place(&system, 0.55, &heights, &options).unwrap();
        let cells: Vec<(f64, f64)> = found.vergence.windows(2).map(cell).collect();
        assert!(cells.len() > MEASURED, "{}", cells.len());
        assert!(found.l1 <= 0.02 && found.esf <= ESF_TOLERANCE, "{found:?}");
        let measured: Vec<u64> = sample(&cells, MEASURED).iter().map(|c| c.0.to_bits()).collect();
        let others: Vec<(f64, f64)> =
            cells.into_iter().filter(|c| !measured.contains(&c.0.to_bits())).step_by(4).collect();
        let errors = Kernels::new(&system, 0.55, &heights, &options).unwrap().errors(&others).unwrap();
        assert!(worst(&errors, 0) <= 1.05 * 0.02 && worst(&errors, 1) <= 1.05 * ESF_TOLERANCE, "{errors:?}");
    }

    #[test]
    fn samples_are_evenly_spaced_with_both_ends() {
        let all: Vec<usize> = (0..101).collect();
        assert_eq!(sample(&all, 5), [0, 25, 50, 75, 100]);
        assert_eq!(sample(&all[..5], 5), [0, 1, 2, 3, 4]);
    }
}
