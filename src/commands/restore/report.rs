//! The report of a restoration: attributes of the chart, and what is printed.

use super::recorded::Recorded;
use super::settings::Settings;
use super::tile::{Counts, Strength};
use super::{method_name, parameter};
use crate::args::RestoreArgs;
use crate::progress::{log_line, number, plural, print};
use anyhow::Result;
use pipeline::geometry::Rect;
use serde_json::{Value, json};

/// Mean square residual, of the noise's, from which there is a note.
const MAX_RESIDUAL: f64 = 1.3;

/// The attribute `restored` of the chart.
pub fn attributes(args: &RestoreArgs, film: &Recorded, roi: Rect, settings: &[Settings]) -> Value {
    json!({
        "film": film.path().display().to_string(),
        "film_job_digest": film.job_digest(),
        "lens": film.lens(),
        "lens_digest": film.lens_digest(),
        "method": method_name(args.method),
        "film_rectangle": [roi.x, roi.y, roi.width as i64, roi.height as i64],
        "bands": settings.iter().map(|s| band(film, s)).collect::<Vec<_>>(),
    })
}

fn band(film: &Recorded, settings: &Settings) -> Value {
    let mut value = json!({
        "wavelength_nm": film.spec().wavelengths_nm[settings.solver.band],
        "noise": settings.noise,
        "noise_is_estimated": settings.is_estimated,
        "mean_square_residual_of_noise": settings.residual,
        "halo_px": settings.solver.halo_px,
    });
    let (name, strength) = parameter(settings);
    value[name] = strength;
    for figures in &settings.figures {
        value[figures.name] = json!({
            "noise_gain": figures.noise_gain,
            "mtf50_film_cy_px": figures.film.mtf50,
            "mtf50_restored_cy_px": figures.restored.mtf50,
            "edge_overshoot": figures.restored.overshoot,
        });
    }
    value
}

/// Prints the report.
pub fn print_done(
    args: &RestoreArgs,
    film: &Recorded,
    (roi, settings): (Rect, &[Settings]),
    counts: Counts,
    seconds: f64,
) -> Result<()> {
    if args.json {
        let mut report = attributes(args, film, roi, settings);
        report["tiles"] = counts.tiles.into();
        report["max_iterations"] = counts.max_iterations.into();
        report["unconverged_tiles"] = counts.unconverged.into();
        print(serde_json::to_string_pretty(&report)?);
    } else {
        settings.iter().for_each(|s| print_band(film, s));
    }
    for settings in settings.iter().filter(|s| args.iterations.is_none() && s.residual > MAX_RESIDUAL) {
        log_line(note_on_residual(film, settings));
    }
    if counts.unconverged > 0 {
        log_line(format!(
            "note: {} of {} ended before the solver's tolerance was reached",
            counts.unconverged,
            plural(counts.tiles, "tile")
        ));
    }
    log_line(format!(
        "{}: {} of {} px restored in {seconds:.1} s, {}, at most {}",
        args.out.display(),
        plural(settings.len(), "band"),
        roi.size(),
        plural(counts.tiles, "tile"),
        plural(counts.max_iterations, "iteration"),
    ));
    Ok(())
}

/// That a film does not agree with any chart within its noise.
fn note_on_residual(film: &Recorded, settings: &Settings) -> String {
    let times = settings.residual.sqrt();
    format!(
        "note: at {} nm the film of the restored chart differs from the film by {times:.1} times the noise, so that the picture has more noise and rings than it need have: the film's noise is \
         larger, or the film has what this lens does not make; --noise {:.1e} restores what agrees within that",
        number(film.spec().wavelengths_nm[settings.solver.band]),
        times * settings.noise
    )
}

fn print_band(film: &Recorded, settings: &Settings) {
    let (name, strength) = parameter(settings);
    let strength = match settings.solver.strength {
        Strength::Lambda(lambda) => format!("{lambda:.2e}"),
        Strength::Iterations(_) => strength.to_string(),
    };
    let source = if settings.is_estimated { "estimated" } else { "given" };
    print(format!(
        "{} nm: noise {:.3e} ({source}), {name} {strength}, mean square residual {:.3} of the noise's, halo {} px",
        number(film.spec().wavelengths_nm[settings.solver.band]),
        settings.noise,
        settings.residual,
        settings.solver.halo_px
    ));
    for figures in &settings.figures {
        print(format!(
            "  {:<7} noise gain {:.2}, MTF50 {:.3} cy/px (film {:.3}), overshoot of an edge {:.1} %",
            format!("{}:", figures.name),
            figures.noise_gain,
            figures.restored.mtf50,
            figures.film.mtf50,
            1e2 * figures.restored.overshoot
        ));
    }
}
