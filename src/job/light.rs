//! Share of the light in the PSF windows: a job whose windows hold almost none is an error, most likely of the film's pitch.

use crate::args::RunArgs;
use crate::failure::usage;
use anyhow::Result;
use pipeline::band::BandPlan;

/// Share of the light, mean over heights, below which a film says nothing about the lens.
const MIN_LIGHT: f64 = 0.1;
/// Film pitch below which it was probably given in mm: no sensor has smaller pixels.
const MIN_USUAL_PITCH_UM: f64 = 0.1;

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
                plan.lens.wavelength_nm,
                100.0 * mean
            )));
        }
    }
    Ok(())
}

/// `error` of a band's plan, with the likely unit if `--film-pitch-um` is not the pitch of a sensor.
pub fn with_likely_pitch(args: &RunArgs, error: anyhow::Error) -> anyhow::Error {
    match args.placement.film_pitch_um.and_then(likely_pitch) {
        Some(cause) => usage(format!("{error}; {cause}")),
        None => error,
    }
}

fn likely_pitch(pitch_um: f64) -> Option<String> {
    let usual_um = (pitch_um * 1e6).round() / 1e3;
    (pitch_um < MIN_USUAL_PITCH_UM).then(|| {
        format!(
            "--film-pitch-um {pitch_um} is in µm: was it meant in mm? Then give `--film-pitch-um {usual_um}`"
        )
    })
}

#[cfg(test)]
mod tests {
    #[test]
    fn pitch_in_mm_is_converted_and_a_usual_one_has_no_remark() {
        assert!(super::likely_pitch(0.005).unwrap().contains("`--film-pitch-um 5`"));
        assert_eq!(super::likely_pitch(0.8), None);
    }
}
