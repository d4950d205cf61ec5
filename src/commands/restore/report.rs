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
    let mut record = json!({
        "film": film.film_path().display().to_string(),
        "film_job_digest": film.job_digest(),
        "lens": film.lens(),
        "lens_digest": film.lens_digest(),
        "method": method_name(args.method),
        "film_rectangle": [roi.x, roi.y, roi.width as i64, roi.height as i64],
        "bands": settings.iter().map(|s| band(film, s)).collect::<Vec<_>>(),
    });
    if let Some(raw) = film.raw() {
        record["raw"] = args.film.display().to_string().into();
        record["raw_job_digest"] = raw.job_digest().into();
        record["frame"] = raw.frame().into();
    }
    record
}

fn band(film: &Recorded, settings: &Settings) -> Value {
    let mut value = json!({
        "wavelength_nm": film.planes()[settings.solver.plane].wavelength_nm,
        "noise": settings.solver.noise,
        "noise_is_estimated": settings.is_estimated,
        "mean_square_residual_of_noise": settings.residual,
        "halo_px": settings.solver.halo_px,
    });
    let (name, strength) = parameter(settings);
    value[name] = strength;
    let plane = &film.planes()[settings.solver.plane];
    if let Some(name) = &plane.name {
        value["plane"] = name.as_str().into();
    }
    if film.raw().is_some() {
        let share = |(band, share): &(usize, f64)| json!([film.film_wavelengths_nm()[*band], share]);
        value["film_bands"] = plane.bands.iter().map(share).collect();
    }
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
        "note: at {} the film of the restored chart differs from the film by {times:.1} times the noise, so that the picture has more noise and rings than it need have: the film's noise is \
         larger, or the film has what this lens does not make; --noise {:.1e} restores what agrees within that",
        label(film, settings),
        times * settings.solver.noise
    )
}

/// Wavelength of what is restored, with the name of a colour plane.
fn label(film: &Recorded, settings: &Settings) -> String {
    let plane = &film.planes()[settings.solver.plane];
    match &plane.name {
        None => format!("{} nm", number(plane.wavelength_nm)),
        Some(name) => format!("{name} ({} nm)", number(plane.wavelength_nm)),
    }
}

fn print_band(film: &Recorded, settings: &Settings) {
    let (name, strength) = parameter(settings);
    let strength = match settings.solver.strength {
        Strength::Lambda(strength) | Strength::Mu(strength) => format!("{strength:.2e}"),
        Strength::Iterations(_) => strength.to_string(),
    };
    let source = match (settings.is_estimated, film.raw()) {
        (true, _) => "estimated",
        (false, Some(_)) => "of the sensor",
        (false, None) => "given",
    };
    print(format!(
        "{}: noise {:.3e} ({source}), {name} {strength}, mean square residual {:.3} of the noise's, halo {} px",
        label(film, settings),
        settings.solver.noise,
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
