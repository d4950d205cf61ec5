//! Share of the light in the PSF windows: a job whose windows hold almost none is an error, most likely of the film's pitch.

use crate::args::RunArgs;
use crate::failure::{line, usage};
use crate::job::lens::UntracedLens;
use crate::progress::number;
use anyhow::Result;
use pipeline::band::BandPlan;
use pipeline::design::trace::{LensTrace, TraceOptions};
use pipeline::stage::Stage;

/// Share of the light, mean over heights, below which a film says nothing about the lens.
const MIN_LIGHT: f64 = 0.1;
/// Film pitch below which it was probably given in mm: no sensor has smaller pixels.
const MIN_USUAL_PITCH_UM: f64 = 0.1;
/// Film pitch above which it was probably given in nm.
const MAX_USUAL_PITCH_UM: f64 = 500.0;
/// Share of the light, as estimated from rays, below which a design is not traced for pixels that are too fine.
const MIN_ESTIMATED_LIGHT: f64 = 0.9;

/// Fails if the PSF windows of a band hold almost no light.
///
/// # Errors
/// Usage, with the likely unit.
pub fn check(args: &RunArgs, bands: &[BandPlan]) -> Result<()> {
    for plan in bands.iter().filter(|p| p.grid.is_some()) {
        let energy = &plan.lens.psf_energy;
        let mean = energy.iter().sum::<f64>() / energy.len() as f64;
        if mean < MIN_LIGHT {
            let cause =
                args.placement.film_pitch_um.and_then(likely_pitch).unwrap_or_else(|| {
                    "use a coarser --film-pitch-um, or a lens with wider windows (of a design --max-window-px)".into()
                });
            return Err(usage(format!(
                "at {} nm the PSF windows of the lens hold only {:.1} % of the light (mean over heights); {cause}",
                number(plan.lens.wavelength_nm),
                100.0 * mean
            )));
        }
    }
    Ok(())
}

/// `error` of a band's plan, with the likely unit if `--film-pitch-um` is not the pitch of a sensor.
pub fn with_likely_pitch(args: &RunArgs, error: anyhow::Error) -> anyhow::Error {
    match args.placement.film_pitch_um.and_then(likely_pitch) {
        Some(cause) => usage(format!("{}; {cause}", line(&error))),
        None => error,
    }
}

/// Fails before `lens` is traced if its PSFs are much wider than windows of pixels of the given pitch, which is finer than that of any sensor.
///
/// # Errors
/// Usage, with the likely unit.
pub fn check_pitch(args: &RunArgs, lens: &UntracedLens) -> Result<()> {
    let UntracedLens::Design(design) = lens else { return Ok(()) };
    if lens.asymmetric_design().is_some() {
        return Ok(());
    }
    let given = args.placement.film_pitch_um.filter(|um| *um < MIN_USUAL_PITCH_UM);
    let Some((pitch_um, cause)) = given.and_then(|um| Some((um, likely_pitch(um)?))) else { return Ok(()) };
    if !args.stages.contains(&Stage::Svpsf) {
        return Ok(());
    }
    let mut trace = TraceOptions::new(vec![design.system.primary_um() * 1e3], 1e-3);
    trace.film_pitch_um = pitch_um;
    trace.max_window_px = args.tracing.max_window_px.unwrap_or(trace.max_window_px);
    let estimate = LensTrace::new(&design.system, &trace)?.estimate(0)?;
    match estimate.light < MIN_ESTIMATED_LIGHT {
        true => Err(usage(format!(
            "PSF windows of at most {} pixels hold about {:.1} % of the light of {} on its axis; {cause}",
            trace.max_window_px,
            100.0 * estimate.light,
            design.name
        ))),
        false => Ok(()),
    }
}

/// A note on a pitch that is probably given in another unit.
pub fn pitch_note(args: &RunArgs) -> Option<String> {
    args.placement.film_pitch_um.and_then(likely_pitch)
}

/// The unit in which a pitch was probably meant; none if it is that of a sensor.
fn likely_pitch(pitch_um: f64) -> Option<String> {
    let (unit, usual_um) = match pitch_um {
        um if um < MIN_USUAL_PITCH_UM => ("mm", (um * 1e6).round() / 1e3),
        um if um > MAX_USUAL_PITCH_UM => ("nm", (um * 1e3).round() / 1e6),
        _ => return None,
    };
    Some(format!(
        "--film-pitch-um {pitch_um} is in µm: was it meant in {unit}? Then give `--film-pitch-um {usual_um}`"
    ))
}

#[cfg(test)]
mod tests {
    #[test]
    fn pitch_in_mm_or_nm_is_converted_and_a_usual_one_has_no_remark() {
        assert!(super::likely_pitch(0.005).unwrap().contains("`--film-pitch-um 5`"));
        assert!(super::likely_pitch(5000.0).unwrap().contains("in nm? Then give `--film-pitch-um 5`"));
        assert_eq!([0.8, 48.0].map(super::likely_pitch), [None, None]);
    }
}
