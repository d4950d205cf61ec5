//! `lenscube lens export --as psf-…`: effective PSFs on a grid of places of the film ([`pipeline::figures::effective_psf`]).
//!
//! A design is traced over the film as for `lenscube run`, so that its PSFs are those of the films. One band is in memory at a time.

use super::psf_film::PsfFilm;
use super::psf_lens::PsfLens;
use crate::args::{LensExportArgs, ModelArg};
use crate::commands::lens::trace::wavelengths;
use crate::failure::usage;
use crate::job::lens::JobLens;
use crate::machine::threads;
use crate::outputs::{check_absent, check_absent_in};
use crate::progress::{log_line, number, print, short_number};
use anyhow::{Context, Result, anyhow};
use formats::durable::finish_together;
use formats::psf_grid::npy::{NpyWriter, json_path};
use formats::psf_grid::zarr::ZarrWriter;
use formats::psf_grid::{BandPsfs, PsfGrid, fits};
use pipeline::design::trace::with_threads;
use pipeline::figures::effective_psf::{EffectivePsfs, window_px};
use pipeline::lens::LensBand;
use rayon::prelude::*;
use serde_json::json;
use std::path::{Path, PathBuf};

/// Maximum bytes of the PSFs of a band.
const MAX_BYTES: usize = 1 << 29;

/// Wavelengths of `args` as they are given, nm, ascending; empty: none is.
///
/// # Errors
/// Usage: no list of wavelengths.
pub fn given_nm(args: &LensExportArgs) -> Result<Vec<f64>> {
    match (&args.wavelengths, args.band) {
        (Some(text), _) => wavelengths(text),
        (None, band) => Ok(band.into_iter().collect()),
    }
}

/// The file of a wavelength in the folder of several.
fn file_name(nm: f64) -> String {
    format!("psf-{}nm.fits", number(nm))
}

/// The files of an export, as far as they follow from the arguments.
pub fn files(args: &LensExportArgs) -> Vec<PathBuf> {
    let Some(out) = &args.out else { return Vec::new() };
    match args.model {
        ModelArg::PsfNpy => vec![out.clone(), json_path(out)],
        ModelArg::PsfFits if args.wavelengths.is_some() => {
            given_nm(args).unwrap_or_default().iter().map(|nm| out.join(file_name(*nm))).collect()
        }
        _ => vec![out.clone()],
    }
}

/// Writes the PSFs of the lens of `args`.
///
/// # Errors
/// Usage: places that the lens does not have; PSFs too large. A file that cannot be written.
pub fn export(args: &LensExportArgs) -> Result<()> {
    let out = args.out.as_deref().context("checked before: OUT")?;
    check_out(args, out)?;
    let nm = given_nm(args)?;
    let lens = PsfLens::open(args)?;
    let nm = lens.wavelengths_nm(args, &nm)?;
    let film = PsfFilm::new(args, || lens.half_sides_mm(args))?;
    let lens = lens.traced(args, &film, &nm)?;
    lens.notes().iter().for_each(|note| log_line(format!("note: {note}")));
    let bands = nm.iter().map(|nm| band(&lens, *nm)).collect::<Result<Vec<usize>>>()?;
    let grid = grid(args, &lens, &film, nm, &bands)?;
    let source = Source { args, lens: &lens, film: &film, grid: &grid };
    let energy = write(args, out, &grid, &|i| source.band(bands[i]))?;
    report(args, &grid, &energy)?;
    log_line(format!("wrote {}", out.display()));
    Ok(())
}

/// Fails for an output of another ending, or one that exists.
fn check_out(args: &LensExportArgs, out: &Path) -> Result<()> {
    let ends_in = |endings: &[&str]| out.extension().is_some_and(|e| endings.iter().any(|known| e == *known));
    match args.model {
        ModelArg::PsfFits if args.wavelengths.is_some() => {
            let names = given_nm(args)?.into_iter().map(file_name);
            check_absent_in(out, names, args.overwrite)
        }
        ModelArg::PsfFits if !ends_in(&["fits", "fit", "fts"]) => Err(usage(format!(
            "OUT {}: expected a name ending in .fits, by which photutils knows the format",
            out.display()
        ))),
        ModelArg::PsfNpy if !ends_in(&["npy"]) => {
            Err(usage(format!("OUT {}: expected a name ending in .npy", out.display())))
        }
        _ => files(args).iter().try_for_each(|path| check_absent(path, args.overwrite)),
    }
}

/// The band of `lens` at `nm`.
///
/// # Errors
/// There is none.
pub fn band(lens: &JobLens, nm: f64) -> Result<usize> {
    let bands = &lens.lens().bands;
    let found = bands.iter().position(|band| (band.wavelength_nm - nm).abs() < 1e-5);
    found.with_context(|| format!("no band was traced at {nm} nm"))
}

/// What the PSFs are.
///
/// # Errors
/// Usage: they are too large, or have too few samples.
fn grid(
    args: &LensExportArgs,
    lens: &JobLens,
    film: &PsfFilm,
    nm: Vec<f64>,
    bands: &[usize],
) -> Result<PsfGrid> {
    let all = lens.lens();
    let window = |band: &usize| window_px(&all.bands[*band], all.psf_sample, film.pitch_um);
    let window_px = args.psf_window.or_else(|| bands.iter().map(window).max()).context("no wavelength")?;
    if args.model == ModelArg::PsfFits {
        film.check_side(window_px)?;
    }
    let grid = PsfGrid {
        lens: all.name.clone(),
        wavelengths_nm: nm,
        film: film.size,
        pitch_um: film.pitch_um,
        x_px: film.x_px.clone(),
        y_px: film.y_px.clone(),
        oversample: film.oversample,
        window_px,
        f_number: all.f_number,
        object_distance_mm: all.object_distance_mm,
    };
    let bytes = grid.side().saturating_pow(2).saturating_mul(4).saturating_mul(grid.places());
    match bytes <= MAX_BYTES {
        true => Ok(grid),
        false => Err(usage(format!(
            "{} PSFs of {} x {} samples are {:.1} GB a wavelength, more than {:.1} GB; give a smaller --grid, --psf-window or --oversample",
            grid.places(),
            grid.side(),
            grid.side(),
            1e-9 * bytes as f64,
            1e-9 * MAX_BYTES as f64
        ))),
    }
}

/// The PSFs of a lens on a film.
struct Source<'a> {
    args: &'a LensExportArgs,
    lens: &'a JobLens,
    film: &'a PsfFilm,
    grid: &'a PsfGrid,
}

impl Source<'_> {
    /// The PSFs of band `index` of the lens.
    fn band(&self, index: usize) -> Result<BandPsfs> {
        let (all, film) = (self.lens.lens(), self.film);
        let band: &LensBand = &all.bands[index];
        let samples = (film.oversample, self.grid.window_px);
        let psfs = EffectivePsfs::new(band, all.psf_sample, film.pitch_um, samples);
        let places = film.places_mm();
        if let Some([x, y]) = places.iter().find(|place| !psfs.covers(**place)) {
            return Err(usage(format!(
                "{}: the place ({x:.4}, {y:.4}) mm of the film lies beyond the PSFs of the lens at {} nm; give a smaller --film-size",
                self.args.lens,
                number(band.wavelength_nm)
            )));
        }
        let reader = self.lens.psf_reader(index, 1);
        let one =
            |place: &[f64; 2]| psfs.at(*place, |set| reader(0, set..set + 1)).map_err(|e| anyhow!("{e}"));
        let all = with_threads(threads(None), || places.par_iter().map(one).collect::<Result<Vec<_>>>())
            .with_context(|| format!("PSFs of {} at {} nm", self.args.lens, number(band.wavelength_nm)))?;
        let energy = all.iter().map(|(_, energy)| *energy).collect();
        Ok(BandPsfs { energy, samples: all.into_iter().flat_map(|(psf, _)| psf).collect() })
    }
}

/// Writes the bands that `band` computes; the share of light in each PSF.
fn write(
    args: &LensExportArgs,
    out: &Path,
    grid: &PsfGrid,
    band: &dyn Fn(usize) -> Result<BandPsfs>,
) -> Result<Vec<Vec<f64>>> {
    let count = grid.wavelengths_nm.len();
    let mut energy = Vec::with_capacity(count);
    match args.model {
        ModelArg::PsfNpy => {
            let mut writer = NpyWriter::new(out, grid)?;
            for i in 0..count {
                let psfs = band(i)?;
                writer.band(&psfs)?;
                energy.push(psfs.energy);
            }
            writer.finish()?;
        }
        ModelArg::PsfZarr => {
            let mut writer = ZarrWriter::new(out, grid)?;
            for i in 0..count {
                let psfs = band(i)?;
                writer.band(&psfs)?;
                energy.push(psfs.energy);
            }
            writer.finish()?;
        }
        _ => {
            let is_folder = args.wavelengths.is_some();
            if is_folder {
                std::fs::create_dir_all(out).with_context(|| format!("creating {}", out.display()))?;
            }
            let mut files = Vec::new();
            for (i, nm) in grid.wavelengths_nm.iter().enumerate() {
                let psfs = band(i)?;
                let path = if is_folder { out.join(file_name(*nm)) } else { out.to_owned() };
                files.push(fits::file(&path, grid, i, &psfs)?);
                energy.push(psfs.energy);
            }
            finish_together(files)?;
        }
    }
    Ok(energy)
}

fn report(args: &LensExportArgs, grid: &PsfGrid, energy: &[Vec<f64>]) -> Result<()> {
    let all = || energy.iter().flatten().copied();
    let (least, most) = (all().fold(f64::INFINITY, f64::min), all().fold(0.0, f64::max));
    if args.json {
        print(serde_json::to_string_pretty(&json!({
            "lens": args.lens,
            "as": args.model.name(),
            "wavelengths_nm": grid.wavelengths_nm,
            "width_px": grid.film.width,
            "height_px": grid.film.height,
            "film_pitch_um": grid.pitch_um,
            "places_x_mm": grid.x_mm(),
            "places_y_mm": grid.y_mm(),
            "oversample": grid.oversample,
            "window_px": grid.window_px,
            "side": grid.side(),
            "energy": energy,
        }))?);
        return Ok(());
    }
    let list: Vec<String> = grid.wavelengths_nm.iter().map(|nm| number(*nm).to_string()).collect();
    print(format!(
        "{} as {} at {} nm: {} x {} places of a film of {} px of {} µm, PSFs of {} px with {} samples a pixel, {} x {} samples; light in them {} to {}",
        args.lens,
        args.model.name(),
        list.join(", "),
        grid.x_px.len(),
        grid.y_px.len(),
        grid.film,
        grid.pitch_um,
        grid.window_px,
        grid.oversample,
        grid.side(),
        grid.side(),
        short_number(least),
        short_number(most),
    ));
    Ok(())
}
