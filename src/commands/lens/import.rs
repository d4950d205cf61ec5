//! `lenscube lens import`: converts exports of a lens design program to a lens pack.

use crate::args::{ImportArgs, band_indices};
use crate::failure::{other_job, usage};
use crate::progress::{log_line, plural};
use anyhow::Result;
use formats::import::{ImportError, ImportOptions};
use formats::lens::LensPackError;

/// Runs the command.
pub fn command(args: &ImportArgs) -> Result<()> {
    let options = options(args)?;
    let classify = |e: ImportError| match e {
        e if e.is_usage() => usage(e.to_string()),
        ImportError::Pack(e @ LensPackError::Exists { .. }) => other_job(e.to_string()),
        e => e.into(),
    };
    if args.out.symlink_metadata().is_ok() {
        return Err(classify(LensPackError::Exists { path: args.out.clone() }.into()));
    }
    let imported = formats::import::open(&args.source, &options).map_err(classify)?;
    for note in imported.notes() {
        log_line(format!("note: {note}"));
    }
    let nm: Vec<f64> = imported.lens().bands.iter().map(|b| b.wavelength_nm).collect();
    let heights: Vec<f64> =
        imported.lens().bands.iter().map(|b| b.image_height_mm[b.image_height_mm.len() - 1]).collect();
    formats::import::write(&args.out, imported, |b, stack| {
        log_line(format!(
            "{} nm: image heights up to {:.3} mm, {} PSFs, {} samples a side at {} µm pitch",
            nm[b],
            heights[b],
            stack.heights(),
            stack.size,
            stack.pitch_um
        ));
    })
    .map_err(classify)?;
    log_line(format!(
        "{}: {}; show it with `lenscube lens show {0}`",
        args.out.display(),
        plural(nm.len(), "band")
    ));
    Ok(())
}

fn options(args: &ImportArgs) -> Result<ImportOptions> {
    // The number of wavelengths is not known yet, so ranges must have an end.
    let chosen = args.bands.as_deref().map(|text| {
        match text.split(',').any(|part| part.trim().ends_with(':') || part.contains("::")) {
            true => Err(format!("`{text}`: every range must have an end")),
            false => band_indices(text, 4096),
        }
    });
    let chosen = chosen.transpose().map_err(|e| usage(format!("--bands: {e}")))?;
    Ok(ImportOptions {
        format: args.from,
        name: args.name.clone(),
        sample: args.psf_sample,
        even_window: args.even_window,
        rows: args.psf_rows,
        outward: args.psf_outward,
        symmetric: args.symmetric_psf,
        without_psf: args.without_psf,
        bands: chosen,
        psf_heights: args.psf_heights.clone(),
        azimuths: args.azimuths,
        distortion_focal_length_mm: args.distortion_focal_mm,
        effective_focal_length_mm: args.efl_mm,
        f_number: args.f_number,
        entrance_pupil_mm: args.entrance_pupil_mm,
        primary_wavelength_nm: args.primary_nm,
        ..ImportOptions::default()
    })
}
