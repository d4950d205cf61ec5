//! Light beside the image: veiling glare, scatter and their energy against closed forms, transmission and ghosts against other rays.
//!
//! Films of the middle band, drawn without PSF and surroundings of the chart's edge:
//!
//! ```text
//! glare g of nine black discs in white    index g (1 − f)/(1 − g f), f their share of the film
//! scatter a in a black disc in white      a (1 − M(ρ)/M(r)),  M(r) = (1 + r²/r₀²)^(1 − s/2) − 1, ρ its radius, r the reach
//! uniform field, glare and scatter        unchanged
//! energy of a lamp's scatter              sum of the layer = a · light of the chart
//! ```
//! Of a design, with the coatings that are given, else with a quarter wave of MgF2: its transmission by 25 x 33 rays of the pupil, and the five largest ghosts from the axis as integrals over
//! 4000 radii of the first surface, where the program has 63 rays and windows of the open part.

use super::setup::Setup;
use crate::args::{CoatingsArg, ScatterAmount, ScatterArg, ValidateArgs, VeilArgs};
use crate::job::lens::UntracedLens;
use crate::open;
use crate::progress::number;
use anyhow::Result;
use formats::chart::NanPolicy;
use formats::design::coatings::mgf2;
use pipeline::design::bundle::Bundle;
use pipeline::design::coatings::Coatings;
use pipeline::design::ghost::apertures::Apertures;
use pipeline::design::ghost::light::GhostLight;
use pipeline::design::ghost::options::{GhostOptions, Reflectance};
use pipeline::design::ghost::table::ghost_table;
use pipeline::design::ghost::{GhostLens, GhostPath};
use pipeline::design::illumination::axial_transmission;
use pipeline::design::ray::Tracer;
use pipeline::design::{DesignError, System};
use pipeline::geometry::Rect;
use pipeline::stage::Stage;
use std::f64::consts::PI;

/// Side of a measured square, px.
const SQUARE_PX: usize = 16;
/// Share of glare, and of scatter in a disc.
const GLARE: f64 = 0.02;
const SCATTER: f64 = 0.03;
/// Slope of the scatter.
const SLOPE: f64 = 2.5;
/// Ghosts that are compared, and radii of the first surface.
const GHOSTS: usize = 5;
const RADII: usize = 4000;
/// The first surface over its clear radius.
const BEYOND: f64 = 1.3;

/// A quantity of the program beside its expected value.
#[derive(Clone, Debug, PartialEq)]
pub struct Check {
    /// What it is.
    pub name: String,
    /// Of the program.
    pub found: f64,
    /// Expected.
    pub expected: f64,
    /// Their difference, relative unless 0 is expected.
    pub difference: f64,
    /// What the difference should not exceed.
    pub limit: f64,
}

impl Check {
    fn new(name: impl Into<String>, found: f64, expected: f64, limit: f64) -> Self {
        let unit = if expected == 0.0 { 1.0 } else { expected };
        let difference = ((found - expected) / unit).abs();
        Self { name: name.into(), found, expected, difference, limit }
    }

    /// The difference over its limit.
    pub fn of_limit(&self) -> f64 {
        self.difference / self.limit
    }
}

/// The worst check, by its difference over its limit; a NaN is worse than any number.
pub fn worst(checks: &[Check]) -> Option<&Check> {
    checks.iter().reduce(|a, b| if b.of_limit() > a.of_limit() || b.of_limit().is_nan() { b } else { a })
}

/// All checks: of the films, and of the lens if it is a design.
///
/// # Errors
/// A film cannot be made; rays of the design cannot be traced.
pub fn checks(setup: &Setup, args: &ValidateArgs) -> Result<Vec<Check>> {
    let mut all = vec![glare(setup)?, scatter(setup)?, uniform(setup)?, energy(setup)?];
    if let UntracedLens::Design(design) = UntracedLens::open_coated(&args.lens, &args.coatings)? {
        let (coated, name) = match &args.coatings {
            CoatingsArg::Ideal => {
                let coatings = Coatings { default: mgf2(None), surfaces: Vec::new() };
                (design.system.with_coatings(&coatings)?, "MgF2".to_owned())
            }
            given => (design.system, format!("--coatings {given}")),
        };
        all.extend(of_design(&coated, &name, setup.corner_mm())?);
    }
    Ok(all)
}

/// The square about a place (row, column) relative to the middle of the film, px.
fn square(setup: &Setup, (row, column): (i64, i64)) -> Rect {
    let first = (setup.size as i64 - SQUARE_PX as i64) / 2;
    Rect::new(first + row, first + column, SQUARE_PX, SQUARE_PX)
}

fn mean(pixels: &[f32]) -> f64 {
    pixels.iter().map(|v| f64::from(*v)).sum::<f64>() / pixels.len() as f64
}

/// Scatter with `share` and a shoulder of `shoulder_px` and reach of `reach_px` film pixels.
fn scattered(setup: &Setup, share: f64, shoulder_px: f64, reach_px: f64) -> VeilArgs {
    let scatter = ScatterArg {
        amount: ScatterAmount::Share(share),
        shoulder_um: shoulder_px * setup.pitch_um,
        slope: SLOPE,
        reach_mm: Some(reach_px * setup.pitch_um * 1e-3),
    };
    VeilArgs { scatter: Some(scatter), ..VeilArgs::default() }
}

/// Value of a chart at a place (row, column), which it has without overscan.
fn drawn(setup: &Setup, chart: &str, (row, column): (usize, usize)) -> Result<f64> {
    let chart = open::chart(&format!("{chart}&overscan=0"), None, NanPolicy::Keep, 0)?;
    let mut pixel = [0f32];
    let rect = Rect::new(row as i64, column as i64, 1, 1);
    chart.source().read(setup.light_band(), rect, &mut pixel).map_err(anyhow::Error::from_boxed)?;
    Ok(f64::from(pixel[0]))
}

fn glare(setup: &Setup) -> Result<Check> {
    // Between the middle spot and the next.
    let rects = [square(setup, (0, 0)), square(setup, (0, setup.size as i64 / 6))];
    let veil = VeilArgs { veiling_glare: Some(GLARE), ..VeilArgs::default() };
    let chart = setup.chart("black-spots", "&spots=9&diameter=0.05");
    let film = setup.veiled(&chart, &[], veil, &rects)?;
    let share = 9.0 * PI * 0.025 * 0.025;
    let expected = GLARE * (1.0 - share) / (1.0 - GLARE * share);
    Ok(Check::new(
        "glare of 2 %, index of black spots",
        mean(&film.regions[0]) / mean(&film.regions[1]),
        expected,
        1e-5,
    ))
}

fn scatter(setup: &Setup) -> Result<Check> {
    let (radius_px, reach_px) = (0.05 * setup.size as f64, 0.45 * setup.size as f64);
    let shoulder_px = (radius_px / 15.0).max(1.0 / setup.pitch_um);
    let chart = setup.chart("black-spots", "&spots=1&diameter=0.1");
    let veil = scattered(setup, SCATTER, shoulder_px, reach_px);
    let film = setup.veiled(&chart, &[Stage::Distortion], veil, &[square(setup, (0, 0))])?;
    let mass = |r_px: f64| (1.0 + (r_px / shoulder_px).powi(2)).powf(1.0 - SLOPE / 2.0) - 1.0;
    let expected = SCATTER * (1.0 - mass(radius_px) / mass(reach_px));
    let white = drawn(setup, &chart, (0, 0))?;
    Ok(Check::new("scatter of 3 %, in a black disc", mean(&film.regions[0]) / white, expected, 0.01))
}

fn uniform(setup: &Setup) -> Result<Check> {
    let edge = setup.size as i64 / 2 - SQUARE_PX as i64;
    let rects = [square(setup, (0, 0)), square(setup, (edge, edge)), square(setup, (-edge, 0))];
    let veil = VeilArgs {
        veiling_glare: Some(0.04),
        ..scattered(setup, 0.06, 10.0 / setup.pitch_um, 0.45 * setup.size as f64)
    };
    let film = setup.veiled(&setup.chart("uniform", "&value=1"), &[Stage::Distortion], veil, &rects)?;
    let departure = |value: &f32| (f64::from(*value) - 1.0).abs();
    let largest = film.regions.iter().flatten().map(departure).fold(0.0, f64::max);
    Ok(Check::new("uniform field with glare and scatter of 10 %, largest departure", largest, 0.0, 2e-6))
}

fn energy(setup: &Setup) -> Result<Check> {
    let (share, radius_px) = (0.05, 0.02 * setup.size as f64);
    let chart = setup.chart("lamp", &format!("&radius={radius_px}"));
    let veil = scattered(setup, share, (10.0 / setup.pitch_um).max(1.0), 0.2 * setup.size as f64);
    let film = setup.veiled(&chart, &[], veil, &[square(setup, (0, 0))])?;
    let middle = (setup.size / 2, setup.size / 2);
    let (lamp, ground) = (drawn(setup, &chart, middle)?, drawn(setup, &chart, (0, 0))?);
    let light = (lamp - ground) * PI * radius_px * radius_px + ground * film.layer_px2;
    Ok(Check::new("energy of the scatter of a lamp", film.layer_sum, share * light, 1e-4))
}

/// Transmission and ghosts of a design with coatings that are called `coatings`, for a film to `corner_mm`.
fn of_design(system: &System, coatings: &str, corner_mm: f64) -> Result<Vec<Check>> {
    let um = system.primary_um();
    let tracer = Tracer::new(system, um)?;
    let flux = |tracer: &Tracer<'_>| -> Result<f64, DesignError> {
        Ok(Bundle::trace(tracer, 0.0, 25, 33)?.rays.iter().map(|(weight, ray)| weight * ray.flux).sum())
    };
    let expected = flux(&tracer)? / flux(&tracer.without_losses())?;
    let nm = um * 1e3;
    let name = format!("transmission with {coatings} at {} nm", number(nm));
    let mut all = vec![Check::new(name, axial_transmission(system, um)?, expected, 1e-4)];
    let options = GhostOptions { corner_mm, rings: 64, film_reflectance: Reflectance::default() };
    let table = ghost_table(system, nm, &options)?;
    let apertures = Apertures::new(system, corner_mm)?;
    let lens = GhostLens::new(system, um, &apertures)?;
    let light = GhostLight::new(system, um, 0.0)?;
    let axial = lens.axial_flux()?;
    let lit = table.paths.iter().filter(|path| path.axis.share > 0.0);
    for path in lit.take(GHOSTS) {
        let GhostPath { first, second } = path.path;
        let name = format!("ghost {}-{} with {coatings}, share on the axis", first + 1, second + 1);
        let expected = integral(&lens, path.path, &light, BEYOND * apertures.clear_mm[0]) / axial;
        all.push(Check::new(name, path.axis.share, expected, 0.02));
    }
    Ok(all)
}

/// Light of `path` from the axis: ∫ w 2π r dr over the first surface out to `end_mm`, per solid angle of a near object.
fn integral(lens: &GhostLens<'_>, path: GhostPath, light: &GhostLight, end_mm: f64) -> f64 {
    let step_mm = end_mm / RADII as f64;
    let distance_mm = lens.tracer().object_distance_mm();
    let of_radius = |k: usize| {
        let r = (k as f64 + 0.5) * step_mm;
        let ray = lens.ray(Some(path), light, 0.0, (r, 0.0)).filter(|ray| ray.landing.overshoot <= 0.0);
        let density = distance_mm.map_or(1.0, |d| d * d / (d * d + r * r).powi(2));
        ray.map_or(0.0, |ray| 2.0 * PI * r * step_mm * density * ray.weight)
    };
    (0..RADII).map(of_radius).sum()
}
