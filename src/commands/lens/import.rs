//! `lenscube lens import`: converts exports of a lens design program, and measured fields, to a lens pack.

use crate::args::{ImportArgs, band_indices, check_directory};
use crate::failure::{other_job, usage};
use crate::progress::{log_line, number, plural};
use anyhow::{Context, Result};
use formats::durable::{AtomicFile, create_directories, finish_together};
use formats::import::{ImportError, ImportOptions, TEMPLATE, field};
use formats::lens::LensPackError;
use std::io::Write;
use std::path::Path;

/// Runs the command.
pub fn command(args: &ImportArgs) -> Result<()> {
    if let Some(directory) = &args.template {
        return write_template(directory);
    }
    let (Some(source), Some(out)) = (&args.source, &args.out) else {
        return Err(usage("expected SOURCE and OUT.lens.zarr, or --template DIR"));
    };
    let options = options(args)?;
    if out.symlink_metadata().is_ok() {
        return Err(classify(LensPackError::Exists { path: out.clone() }.into()));
    }
    if args.from.is_none() && field::is_description(source) {
        return import_field(args, &options, source, out);
    }
    let imported = formats::import::open(source, &options).map_err(classify)?;
    for note in imported.notes() {
        log_line(format!("note: {note}"));
    }
    let nm: Vec<f64> = imported.lens().bands.iter().map(|b| b.wavelength_nm).collect();
    let heights: Vec<f64> =
        imported.lens().bands.iter().map(|b| b.image_height_mm[b.image_height_mm.len() - 1]).collect();
    formats::import::write(out, imported, |b, stack| {
        log_line(format!(
            "{} nm: image heights up to {:.3} mm, {} PSFs, {} samples a side at {} µm pitch",
            number(nm[b]),
            heights[b],
            stack.heights(),
            stack.size,
            stack.pitch_um
        ));
    })
    .map_err(classify)?;
    log_written(out, nm.len());
    Ok(())
}

/// Imports the field of a description.
fn import_field(args: &ImportArgs, options: &ImportOptions, source: &Path, out: &Path) -> Result<()> {
    let plain = ImportOptions { name: options.name.clone(), ..ImportOptions::default() };
    if *options != plain {
        let problem = "a description (.toml) states how its arrays are to be read: of the flags that say so only --name is used with it";
        return Err(usage(format!("{}: {problem}; remove the others", source.display())));
    }
    let mut imported = field::open(source).map_err(classify)?;
    if let Some(name) = &args.name {
        imported.rename(name);
    }
    for note in imported.notes() {
        log_line(format!("note: {note}"));
    }
    let bands = imported.lens().bands.clone();
    field::write(out, imported, |b, stack| {
        let nm = number(bands[b].wavelength_nm);
        let (count, side, pitch_um) = (stack.heights(), stack.size, stack.pitch_um);
        log_line(format!("{nm} nm: {count} PSFs, {side} samples a side at {pitch_um} µm pitch"));
    })
    .map_err(classify)?;
    log_written(out, bands.len());
    Ok(())
}

fn classify(e: ImportError) -> anyhow::Error {
    match e {
        e if e.is_usage() => usage(e.to_string()),
        ImportError::Pack(e @ LensPackError::Exists { .. }) => other_job(e.to_string()),
        e => e.into(),
    }
}

fn log_written(out: &Path, bands: usize) {
    log_line(format!("{}: {}; show it with `lenscube lens show {0}`", out.display(), plural(bands, "band")));
}

/// Writes the files of [`TEMPLATE`] into `directory`, which is created; existing files are kept.
///
/// # Errors
/// One of them exists (exit code 3); the disk.
fn write_template(directory: &Path) -> Result<()> {
    check_directory(directory)?;
    for (name, _) in TEMPLATE {
        let path = directory.join(name);
        if path.symlink_metadata().is_ok() {
            return Err(other_job(format!("{} already exists; choose another directory", path.display())));
        }
    }
    create_directories(directory, true)?;
    let mut files = Vec::new();
    for (name, bytes) in TEMPLATE {
        let file = AtomicFile::create(&directory.join(name))?;
        file.writer().write_all(bytes).with_context(|| format!("writing {name}"))?;
        files.push(file);
    }
    finish_together(files)?;
    log_line(format!(
        "{0}: tables of an invented lens, explained in README.md; `lenscube lens import {0} OUT.lens.zarr` reads them",
        directory.display()
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
