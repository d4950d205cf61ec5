//! `lenscube lens export`: the distortion of a lens as the camera model of another program, or its PSFs.
//!
//! [`pipeline::camera_model`] and [`pipeline::figures::effective_psf`] have the equations.

mod film;
mod fit;
mod isetcam;
mod opened;
mod psf_film;
mod psf_lens;
mod psfs;

pub use psfs::files;

use crate::args::{Bands, LensExportArgs, ModelArg};
use crate::failure::{Coded, code, usage};
use crate::outputs::check_absent;
use crate::progress::{given_number, log_line, number, print};
use anyhow::{Context, Result};
use film::Film;
use fit::{Fit, Fitted};
use formats::durable::AtomicFile;
use opened::Opened;
use pipeline::camera_model::field_map::FieldSource;
use pipeline::camera_model::target::{Residual, Target};
use serde_json::{Value, json};

/// Default wavelengths of red, green and blue, nm.
const BANDS: Bands = [620.0, 540.0, 460.0];

/// Runs the command.
pub fn command(args: &LensExportArgs) -> Result<()> {
    check(args)?;
    if args.model.has_psfs() {
        return match args.model {
            ModelArg::IsetCam => isetcam::export(args),
            _ => psfs::export(args),
        };
    }
    if let Some(out) = &args.out {
        check_absent(out, args.overwrite)?;
    }
    let opened = Opened::new(args)?;
    let context = || format!("{} as {}", args.lens, args.model.name());
    let nm = wavelengths_nm(args, &opened)?;
    let sources: Vec<FieldSource<'_>> = nm.iter().map(|nm| opened.source(*nm)).collect::<Result<_>>()?;
    let film = Film::new(args, &opened, &sources)?;
    let target = Target::new(&sources[sources.len() / 2], &film.area, film.pitch_mm).with_context(context)?;
    let fitted = Fitted { opened: &opened, film: &film, sources: &sources, target: &target };
    let fit = fitted.fit(args).with_context(context)?;
    let text = text(args, &fitted, &fit, &nm);
    let max_px = fit.residuals.iter().map(|(_, r)| r.max).fold(0.0, f64::max);
    if let Some(limit) = args.max_residual.filter(|limit| max_px.is_nan() || max_px > *limit) {
        log_line(text);
        let message = format!(
            "{}: the residual of {} px exceeds --max-residual {}; nothing is written",
            context(),
            digits(max_px),
            given_number(limit)
        );
        return Err(Coded { code: code::WRONG, message }.into());
    }
    if let Some(out) = &args.out {
        AtomicFile::with_text(out, &fit.text)?.finish()?;
    }
    match (args.json, &args.out) {
        (true, _) => print(serde_json::to_string_pretty(&json(args, &fitted, &fit, &nm))?),
        (false, Some(_)) => print(text),
        (false, None) => {
            print(fit.text.trim_end());
            log_line(text);
        }
    }
    if let Some(out) = &args.out {
        log_line(format!("wrote {}", out.display()));
    }
    Ok(())
}

/// Fails for flags that the model does not have.
fn check(args: &LensExportArgs) -> Result<()> {
    let is_lensfun = args.model == ModelArg::Lensfun;
    let of_psfs = [
        ("--wavelengths", args.wavelengths.is_some()),
        ("--grid", args.grid.is_some()),
        ("--oversample", args.oversample.is_some()),
        ("--psf-window", args.psf_window.is_some()),
    ];
    if let Some((flag, _)) = of_psfs.iter().find(|(_, is_given)| *is_given && !args.model.has_psfs()) {
        return Err(usage(format!(
            "{flag} is for PSFs (--as psf-fits, psf-npy, psf-zarr, isetcam), not for {}",
            args.model.name()
        )));
    }
    match () {
        () if is_lensfun && args.band.is_some() => {
            Err(usage("--band: lensfun has red, green and blue; give --bands R,G,B"))
        }
        () if args.model.has_psfs() && args.bands.is_some() => {
            Err(usage(format!("--bands is for lensfun; give --wavelengths for {}", args.model.name())))
        }
        () if !is_lensfun && args.bands.is_some() => {
            Err(usage(format!("--bands: {} has one wavelength; give --band", args.model.name())))
        }
        () if args.model.has_psfs() && args.max_residual.is_some() => Err(usage(format!(
            "--max-residual is for models that are fitted; {} has PSFs",
            args.model.name()
        ))),
        () if args.model.has_psfs() && args.out.is_none() => Err(usage(format!(
            "{} is written to a file: give its name, `lenscube lens export {} OUT --as {0}`",
            args.model.name(),
            args.lens
        ))),
        () => Ok(()),
    }
}

/// The wavelength of the fit; of lensfun red, green and blue.
fn wavelengths_nm(args: &LensExportArgs, opened: &Opened) -> Result<Vec<f64>> {
    let exact = |nm: f64| opened.exact_nm(&args.lens, nm);
    if args.model != ModelArg::Lensfun {
        return Ok(vec![match args.band {
            Some(nm) => exact(nm)?,
            None => opened.nearest_nm(number(opened.lens().primary_wavelength_nm)),
        }]);
    }
    match args.bands {
        Some(bands) => bands.iter().map(|nm| exact(*nm)).collect(),
        None => {
            let nm: Vec<f64> = BANDS.iter().map(|nm| opened.nearest_nm(*nm)).collect();
            match nm[0] > nm[1] && nm[1] > nm[2] {
                true => Ok(nm),
                false => Err(usage(format!(
                    "{}: lensfun needs three bands, next to {BANDS:?} nm; the pack has {} of them",
                    args.lens,
                    opened.lens().bands.len()
                ))),
            }
        }
    }
}

/// A number of pixels.
fn digits(px: f64) -> String {
    if px < 1e-3 { format!("{px:.1e}") } else { format!("{px:.4}") }
}

fn text(args: &LensExportArgs, fitted: &Fitted<'_>, fit: &Fit, nm: &[f64]) -> String {
    let (film, last) = (fitted.film, fitted.target.last());
    let list: Vec<String> = nm.iter().map(|nm| number(*nm).to_string()).collect();
    let mut out = format!(
        "{} as {} at {} nm: focal length {:.6} mm ({:.3} px), film {} px of {} µm, fitted up to {:.3} mm ({:.2} deg)",
        args.lens,
        args.model.name(),
        list.join(", "),
        fitted.target.focal_mm,
        fitted.target.focal_mm / film.pitch_mm,
        film.size,
        args.film_pitch_um,
        last.real_mm,
        last.angle_rad.to_degrees(),
    );
    for (what, Residual { max, at_mm, rms }) in &fit.residuals {
        let (max, rms) = (digits(*max), digits(*rms));
        out += &format!("\nresidual of {what}: max {max} px at {at_mm:.3} mm, rms {rms} px");
    }
    if let Some(error) = fit.illumination_error {
        out += &format!("\nresidual of relative illumination: max {error:.5}");
    }
    out
}

fn json(args: &LensExportArgs, fitted: &Fitted<'_>, fit: &Fit, nm: &[f64]) -> Value {
    let (film, last) = (fitted.film, fitted.target.last());
    let residual = |(what, r): &(&'static str, Residual)| {
        let value = json!({ "max_px": r.max, "at_mm": r.at_mm, "rms_px": r.rms });
        (what.replace(' ', "_"), value)
    };
    let residuals: serde_json::Map<String, Value> = fit.residuals.iter().map(residual).collect();
    json!({
        "lens": args.lens,
        "as": args.model.name(),
        "wavelengths_nm": nm,
        "width_px": film.size.width,
        "height_px": film.size.height,
        "film_pitch_um": args.film_pitch_um,
        "focal_length_mm": fitted.target.focal_mm,
        "focal_length_px": fitted.target.focal_mm / film.pitch_mm,
        "principal_point_px": fit.principal_point,
        "object_distance_mm": fitted.opened.lens().object_distance_mm,
        "fitted_to_mm": last.real_mm,
        "fitted_to_deg": last.angle_rad.to_degrees(),
        "coefficients": fit.coefficients,
        "residuals": residuals,
        "relative_illumination_error": fit.illumination_error,
    })
}
