//! Notes on a job, printed before it starts.

use super::bands::JobPlan;
use super::film::{chart_units, radiance_required};
use super::window_light;
use crate::args::{FilmUnits, RunArgs, size_order_note};
use crate::job::light_units;
use crate::open::{self, Chart, is_builtin};
use anyhow::Result;
use pipeline::lens::PsfSample;
use pipeline::stage::Stage;
use std::path::Path;

/// Share of the energy in the PSF windows below which a note is printed.
const MIN_USUAL_ENERGY: f64 = 0.9;

/// Notes on lens and chart.
///
/// # Errors
/// The lens pack cannot be read.
pub fn notes(args: &RunArgs, chart: &Chart, plan: &JobPlan) -> Result<Vec<String>> {
    let mut notes = plan.lens.notes().to_vec();
    notes.extend(open::notes(chart));
    notes.extend(args.placement.film_size.and_then(|size| size_order_note("--film-size", size)));
    notes.extend(window_light::pitch_note(args));
    notes.extend(scale_note(args, chart));
    if is_builtin(&args.lens) && Path::new(&args.lens).symlink_metadata().is_ok() {
        notes.push(format!(
            "--lens {0} is the built-in lens; for the file of that name, --lens ./{0}",
            args.lens
        ));
    }
    if args.stages.contains(&Stage::Svpsf) {
        let bands = &plan.lens.lens().bands;
        let min = bands.iter().flat_map(|b| &b.psf_energy).fold(f64::INFINITY, |m, e| m.min(*e));
        if min < MIN_USUAL_ENERGY {
            notes.push(format!(
                "the PSF windows of the lens pack contain only {:.0} % of the energy at some bands; each PSF is scaled to \
                 sum 1 (see `lenscube lens show`)",
                100.0 * min
            ));
        }
        notes.extend(rotation_note(plan)?);
    }
    if args.film_units != FilmUnits::Relative {
        notes.extend(radiance_note(args, chart));
        notes.extend(plan.lens.ideal_light().map(str::to_owned));
    }
    Ok(notes)
}

/// What multiplies the chart's samples, unless the chart's own note contains it.
fn scale_note(args: &RunArgs, chart: &Chart) -> Option<String> {
    let is_integer = chart.has_integer_samples();
    let samples = if is_integer { "the chart's samples are integers" } else { "the chart is scaled" };
    match args.chart_scale {
        Some(factor) if !chart.is_scaled_store() => {
            Some(format!("{samples}: values are multiplied by {factor} (--chart-scale)"))
        }
        None if is_integer && !chart.is_scaled() => {
            Some(format!("{samples}, whose values are used as they are; --chart-scale multiplies them"))
        }
        _ => None,
    }
}

/// For integrated samples rotated by other than multiples of 90°: the estimated error at the primary wavelength.
fn rotation_note(plan: &JobPlan) -> Result<Option<String>> {
    let Some(pack) = plan.lens.pack() else { return Ok(None) };
    let tables = plan.lens.lens();
    let grids = plan.bands.iter().filter_map(|p| p.grid.as_ref());
    let rotated = grids.into_iter().any(|g| g.azimuths().iter().any(|&j| j > 4));
    if tables.psf_sample != PsfSample::Integrated || !rotated {
        return Ok(None);
    }
    Ok(crate::job::lens::rotation_error(pack)?.map(|error| {
        format!(
            "the PSFs of the lens pack are integrated over their pitch: rotation by multiples of 90° is exact, other angles use \
             cubic interpolation (estimated L1 error {:.0} %, worst height at {:.0} nm). A pack with point samples avoids it",
            100.0 * error,
            tables.primary_wavelength_nm
        )
    }))
}

/// For films in physical units: what the chart lacks.
fn radiance_note(args: &RunArgs, chart: &Chart) -> Option<String> {
    let units = chart_units(args, chart);
    let is_known = units.and_then(light_units::parse).is_some();
    (!is_known).then(|| radiance_required(args, units, "name them with --chart-units if they are that"))
}
