//! Notes on a job, printed before it starts.

use super::bands::JobPlan;
use crate::args::{FilmUnits, RunArgs, Stage};
use crate::open::{Chart, is_builtin};
use anyhow::Result;
use pipeline::lens::PsfSample;
use std::path::Path;

/// Share of the light below which a note reports what the PSF windows hold.
const MIN_USUAL_ENERGY: f64 = 0.9;

/// Notes on lens and chart.
///
/// # Errors
/// The lens pack cannot be read.
pub fn notes(args: &RunArgs, chart: &Chart, plan: &JobPlan) -> Result<Vec<String>> {
    let mut notes = plan.lens.notes().to_vec();
    notes.extend(chart.notes());
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
                "the lens pack's PSF windows hold as little as {:.0} % of the light at some bands; the rest is \
                 normalised away (see `lenscube lens show`)",
                100.0 * min
            ));
        }
        notes.extend(rotation_note(plan)?);
    }
    if args.film_units != FilmUnits::Relative && chart.units().is_none_or(|u| !is_radiance(u)) {
        notes.push(format!(
            "--film-units {:?} takes the chart as spectral radiance in W m-2 sr-1 nm-1, but its units are {}",
            args.film_units,
            chart.units().unwrap_or("not given")
        ));
    }
    Ok(notes)
}

/// For integrated samples rotated by other than quarter turns: the estimated error at the primary wavelength.
fn rotation_note(plan: &JobPlan) -> Result<Option<String>> {
    let Some(pack) = plan.lens.pack() else { return Ok(None) };
    let tables = plan.lens.lens();
    let grids = plan.bands.iter().filter_map(|p| p.grid.as_ref());
    let rotated = grids.into_iter().any(|g| g.azimuths().iter().any(|&j| j > 4));
    if tables.psf_sample != PsfSample::Integrated || !rotated {
        return Ok(None);
    }
    Ok(crate::lens::rotation_error(pack)?.map(|error| {
        format!(
            "the lens pack's PSFs are integrated over their pitch: exact at quarter turns, rotated by cubic interpolation \
             between; estimated error there {:.0} % of the light (L1, worst height at {:.0} nm); a pack of point samples \
             has no such error",
            100.0 * error,
            tables.primary_wavelength_nm
        )
    }))
}

fn is_radiance(units: &str) -> bool {
    let u = units.replace(['^', '·', '*', ' '], "").to_lowercase();
    u.contains("sr-1") && u.contains("nm-1") && u.starts_with('w')
}
