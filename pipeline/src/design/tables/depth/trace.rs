//! PSFs of a lens at several object distances, on one film plane.
//!
//! Each depth node is a trace of its own ([`LensTrace`]) with the object at the node's vergence and a window of its own. Windows, heights and azimuths are
//! chosen at some nodes; others of a similar blur take those of the last chosen one as long as their errors are about the same
//! (`adopt` of the choice of nodes, design/grid.rs): most of the PSFs that a trace computes serve that choice. Their windows grow as those that rays give.
//! PSFs of a blur radius of 4 film px and more are sampled up to 1.5 times coarser, as those whose kernels are compared: pixels then average over at least two
//! samples a side, and the light at frequencies between the two Nyquist limits is little.
//! The tables of the band are those of an object at infinity (heights) and of the vergence in focus (light), see [`crate::lens::depth`]:
//!
//! ```text
//! δ(r) = (h(r, V)/h(r, 0) − 1)·1000/V            at the last node; 0 with paraxial aiming
//! G(r, V)/G(r, V_f)                              G of [`crate::design::illumination`], on the object side
//! ```
//! The vergence in focus is a node, if it lies in the range.

use super::nodes::{NodeOptions, Placement, estimated, place};
use crate::design::prescription::error::DesignError;
use crate::design::prescription::system::{RayAiming, System};
use crate::design::rays::paraxial::Paraxial;
use crate::design::rays::ray::Tracer;
use crate::design::tables::dense::transmission;
use crate::design::tables::grid::Chosen;
use crate::design::tables::sampled::Sampling;
use crate::design::tables::trace::{BandReport, LensTrace, OnProgress, TraceOptions, TracedBand};
use crate::design::tables::window::Windows;
use crate::lens::depth::{BandDepth, DepthNode, LensDepth};
use crate::lens::{Lens, LensBand, PsfStack, linear};

/// Range of object distances and accuracy between them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DepthOptions {
    /// Vergence in focus, 1/m.
    pub focus: f64,
    /// Farthest and nearest vergence, 1/m.
    pub range: (f64, f64),
    /// Maximum L1 error of a kernel half-way between nodes.
    pub tolerance: f64,
    /// Whether wide PSFs are sampled for films of the trace's pitch and coarser ones only, up to 1.5 times coarser.
    pub is_for_film: bool,
}

/// A band traced at its depth nodes, without PSFs.
#[derive(Clone, Debug, PartialEq)]
pub struct TracedDepth {
    /// Tables of the band; its PSF tables are those of the node nearest to focus.
    pub tables: LensBand,
    /// Its nodes.
    pub nodes: BandDepth,
    /// Errors half-way between nodes.
    pub placement: Placement,
    /// Report of every node.
    pub reports: Vec<BandReport>,
}

impl TracedDepth {
    /// The lens of this band alone, with the heads of lens and nodes, and the report of the node nearest to focus.
    pub fn into_lens(self, (mut lens, mut depth): (Lens, LensDepth)) -> (Lens, BandReport) {
        let report = self.reports[self.nodes.nearest(depth.focus())];
        lens.bands.push(self.tables);
        depth.bands.push(self.nodes);
        lens.depth = Some(depth);
        (lens, report)
    }
}

/// Head of the depth nodes of `system`, whose film is in focus at `options.focus`; without bands.
///
/// # Errors
/// No first-order properties.
pub fn header(system: &System, options: &DepthOptions) -> Result<LensDepth, DesignError> {
    let primary = Paraxial::new(system, system.primary_um())?;
    let radius_mm = primary.entrance_radius_mm;
    Ok(LensDepth {
        focus_distance_m: 1.0 / options.focus,
        blur_per_dioptre_um: radius_mm * primary.distortion_focal_length_mm.abs(),
        entrance_pupil_mm: primary.entrance_pupil_mm,
        entrance_pupil_diameter_mm: 2.0 * radius_mm,
        tolerance: options.tolerance,
        bands: Vec::new(),
    })
}

/// Blur radii that differ by no more than this, px, or this share of the one where heights and azimuths were chosen, are similar.
const SIMILAR: (f64, f64) = (6.0, 0.3);
/// Blur radii that differ by no more than this share of one where the errors of heights and azimuths were measured have the same errors.
const SAME: f64 = 0.1;
/// Blur radius from which on PSFs are sampled as coarsely as kernels that are compared, px.
pub(super) const COARSE_PX: f64 = 4.0;
/// Share of the light that a window from rays may leave out beyond that of the window where nodes were chosen.
const LIGHT: f64 = 2e-3;

/// What nodes of a similar blur share.
#[derive(Clone, Debug)]
struct Reference {
    /// Blur radius where heights and azimuths were chosen, px, positive for what is nearer than the focus.
    blur_px: f64,
    /// Blur radius where their errors were last measured, px.
    measured_px: f64,
    chosen: Chosen,
    /// Windows there, and those that rays give there.
    windows: (Windows, Windows),
    /// Least share of the light in them.
    light: f64,
}

impl Reference {
    /// Windows of the blur whose rays give `expected`, in windows of at most `most_px`.
    fn windows(&self, expected: Windows, most_px: usize) -> Windows {
        let (found, there) = self.windows;
        let moved = |found: usize, there: usize, here: usize| (found + here).saturating_sub(there).max(3);
        let px = moved(found.px, there.px, expected.px).min(most_px);
        Windows { px, core_px: moved(found.core_px, there.core_px, expected.core_px).min(px) }
    }
}

/// Traces band `index` of `trace` at the depth nodes `placement` ([`nodes`], or some of them) and passes the PSFs of each node to `sink`.
///
/// # Errors
/// A ray that does not reach the image; an object too near; [`DesignError::Sink`] for an error of `sink`.
pub fn band<E: std::fmt::Display>(
    system: &System,
    trace: &TraceOptions,
    index: usize,
    (options, placement): (&DepthOptions, Placement),
    on_progress: OnProgress<'_>,
    mut sink: impl FnMut(usize, &PsfStack) -> Result<(), E>,
) -> Result<TracedDepth, DesignError> {
    let nm = trace.wavelengths_nm[index];
    let blur_px = header(system, options)?.blur_per_dioptre_um / trace.film_pitch_um;
    let mut reference: Option<Reference> = None;
    let far = Dense::new(&system.at_vergence(0.0)?, trace, nm)?;
    let focused = Dense::new(&system.at_vergence(options.focus)?, trace, nm)?;
    let in_focus: Vec<f64> = far.real.iter().map(|r| linear(&focused.real, &focused.light, *r)).collect();
    let (mut list, mut reports, mut shift) = (Vec::new(), Vec::new(), vec![0.0; far.real.len()]);
    for (d, v) in placement.vergence.iter().enumerate() {
        let moved = system.at_vergence(*v)?;
        let blur = blur_px * (v - options.focus);
        let lens = LensTrace::new(&moved, trace)?.with_base_nodes();
        reference =
            reference.filter(|r| (blur - r.blur_px).abs() <= SIMILAR.0.max(SIMILAR.1 * r.blur_px.abs()));
        let traced = node(lens, index, (blur, options.is_for_film), &mut reference, on_progress)?;
        sink(d, &traced.psf).map_err(|e| DesignError::Sink { wavelength_nm: nm, problem: e.to_string() })?;
        let t = traced.tables;
        let axis = t.solid_angle_sr * t.transmission;
        let light: Vec<f64> = t.relative_illumination.iter().map(|r| r * axis).collect();
        let ratio = |(r, in_focus): (&f64, &f64)| linear(&t.image_height_mm, &light, *r) / in_focus;
        let etendue_ratio = std::iter::zip(&far.real, &in_focus).map(ratio).collect();
        if d + 1 == placement.vergence.len() && *v > 0.0 && system.aiming == RayAiming::Real {
            let moved = |(r, h): (&f64, &f64)| linear(&t.image_height_mm, &t.ideal_height_mm, *r) / h - 1.0;
            let pairs = std::iter::zip(&far.real, &far.ideal).skip(1);
            shift = std::iter::once(0.0).chain(pairs.map(|p| moved(p) * 1e3 / v)).collect();
        }
        reports.push(traced.report);
        list.push(DepthNode {
            psf_height_mm: t.psf_height_mm,
            azimuth_count: t.azimuth_count,
            psf_energy: t.psf_energy,
            psf_size: t.psf_size,
            psf_pitch_um: t.psf_pitch_um,
            etendue_ratio,
        });
    }
    let nodes = BandDepth { vergence: placement.vergence.clone(), nodes: list, pupil_shift_mm: shift };
    let mut tables = LensBand {
        wavelength_nm: nm,
        relative_illumination: in_focus.iter().map(|g| g / in_focus[0]).collect(),
        ideal_height_mm: far.ideal,
        image_height_mm: far.real,
        psf_height_mm: Vec::new(),
        azimuth_count: Vec::new(),
        psf_size: 1,
        psf_pitch_um: 1.0,
        kernel_pitch_um: None,
        psf_energy: Vec::new(),
        solid_angle_sr: in_focus[0] / focused.transmission,
        transmission: focused.transmission,
        tail: None,
        cones: None,
        planar: None,
    };
    nodes.set_psfs(&mut tables, nodes.nearest(options.focus));
    Ok(TracedDepth { tables, nodes, placement, reports })
}

/// Traces band `index` of `lens`, whose object has a blur radius of `blur_px`, with the windows, heights and azimuths of `reference` where their errors are about
/// the same, else with its own, which become the reference.
fn node(
    lens: LensTrace<'_>,
    index: usize,
    (blur_px, is_for_film): (f64, bool),
    reference: &mut Option<Reference>,
    on_progress: OnProgress<'_>,
) -> Result<TracedBand, DesignError> {
    let trace = lens.options();
    let is_coarse = is_for_film && blur_px.abs() >= COARSE_PX;
    let expected = match trace.window_px {
        Some(px) => Windows { px, core_px: px },
        None => lens.expected_windows(index)?,
    };
    if let Some(known) = reference.as_mut() {
        let windows = known.windows(expected, trace.max_window_px);
        let lens = lens.clone().sampled_as(Sampling { windows: Some(windows), is_coarse });
        let mut is_adopted = true;
        let traced = lens.band_at(index, None, on_progress, |sampled, report| {
            if (blur_px - known.measured_px).abs() <= SAME * known.measured_px.abs() {
                return Ok(known.chosen.clone());
            }
            if let Some(adopted) = lens.adopt(sampled, &known.chosen, report)? {
                known.measured_px = blur_px;
                return Ok(adopted);
            }
            is_adopted = false;
            let found = lens.choose(sampled, report)?;
            (known.blur_px, known.measured_px, known.chosen) = (blur_px, blur_px, found.clone());
            Ok(found)
        })?;
        let light = traced.report.min_energy;
        if trace.window_px.is_some() || light >= known.light.min(trace.energy) - LIGHT {
            if !is_adopted {
                (known.windows, known.light) = ((windows, expected), light);
            }
            return Ok(traced);
        }
    }
    let lens = lens.sampled_as(Sampling { windows: None, is_coarse });
    let mut found = None;
    let traced = lens.band_at(index, None, on_progress, |sampled, report| {
        let chosen = lens.choose(sampled, report)?;
        found = Some((chosen.clone(), sampled.windows()));
        Ok(chosen)
    })?;
    *reference = found.map(|(chosen, windows)| Reference {
        blur_px,
        measured_px: blur_px,
        chosen,
        windows: (windows, expected),
        light: traced.report.min_energy,
    });
    Ok(traced)
}

/// Depth nodes of band `index` of `trace` over the range of `options`, those on either side of focus apart.
///
/// # Errors
/// A ray that does not reach the image; an object too near.
pub fn nodes(
    system: &System,
    trace: &TraceOptions,
    index: usize,
    options: &DepthOptions,
) -> Result<Placement, DesignError> {
    let of = |range| {
        let (um, heights, options) = placing(system, trace, index, options, range)?;
        place(system, um, &heights, &options)
    };
    let (first, last) = options.range;
    if !(first < options.focus && options.focus < last) {
        return of((first, last));
    }
    let (far, near) = (of((first, options.focus))?, of((options.focus, last))?);
    let vergence = far.vergence.iter().chain(&near.vergence[1..]).copied().collect();
    Ok(Placement { vergence, l1: far.l1.max(near.l1), esf: far.esf.max(near.esf) })
}

/// About as many nodes as [`nodes`] places, in a second or two ([`super::nodes::estimated`]).
///
/// # Errors
/// A ray that does not reach the image; an object too near.
pub fn estimated_nodes(
    system: &System,
    trace: &TraceOptions,
    index: usize,
    options: &DepthOptions,
) -> Result<Vec<f64>, DesignError> {
    let of = |range| {
        let (um, heights, options) = placing(system, trace, index, options, range)?;
        estimated(system, um, &heights, &options)
    };
    let (first, last) = options.range;
    if !(first < options.focus && options.focus < last) {
        return of((first, last));
    }
    let (far, near) = (of((first, options.focus))?, of((options.focus, last))?);
    Ok(far.iter().chain(&near[1..]).copied().collect())
}

/// Wavelength in µm, field points and options of placing nodes over `range`.
fn placing(
    system: &System,
    trace: &TraceOptions,
    index: usize,
    options: &DepthOptions,
    range: (f64, f64),
) -> Result<(f64, [f64; 2], NodeOptions), DesignError> {
    let node_options = NodeOptions {
        range,
        focus: options.focus,
        l1_tolerance: options.tolerance,
        film_pitch_um: trace.film_pitch_um,
        blur_px: header(system, options)?.blur_per_dioptre_um / trace.film_pitch_um,
        max_window_px: trace.max_window_px,
    };
    Ok((trace.wavelengths_nm[index] / 1e3, [0.0, trace.max_height_mm], node_options))
}

/// Dense tables of a conjugate.
struct Dense {
    ideal: Vec<f64>,
    real: Vec<f64>,
    /// G, sr.
    light: Vec<f64>,
    transmission: f64,
}

impl Dense {
    fn new(system: &System, trace: &TraceOptions, nm: f64) -> Result<Self, DesignError> {
        let tracer = Tracer::new(system, nm / 1e3)?;
        let [ideal, real, light] = LensTrace::new(system, trace)?.dense(&tracer)?;
        let transmission = transmission(&tracer, light[0])?;
        Ok(Self { ideal, real, light, transmission })
    }
}
