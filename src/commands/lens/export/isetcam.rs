//! `lenscube lens export --as isetcam`: tables and PSFs of a lens for ISETCam's ray-trace model ([`formats::isetcam`]).
//!
//! ```text
//! field heights   h_i = i·h/(n − 1), IDEAL; h: the smallest over the wavelengths of the ideal height of the film's outermost pixels
//! PSF             the kernel at (r(h_i, λ), 0) on a film whose pitch is the spacing of the samples, sum 1
//! ```

use super::psf_film::PsfFilm;
use super::psf_lens::PsfLens;
use super::psfs::{band, given_nm};
use crate::args::LensExportArgs;
use crate::failure::usage;
use crate::job::lens::JobLens;
use crate::machine::threads;
use crate::outputs::check_absent;
use crate::progress::{log_line, number, print, short_number};
use anyhow::{Context, Result, anyhow};
use formats::isetcam::RayTraceOptics;
use pipeline::design::trace::with_threads;
use pipeline::figures::effective_psf::window_px;
use pipeline::figures::on_film::BandOnFilm;
use pipeline::lens::{LensBand, linear};
use rayon::prelude::*;
use serde_json::json;
use std::f64::consts::PI;

/// Wavelengths by default, nm.
const WAVELENGTHS: &str = "400:700:50";
/// Field heights by default; ISETCam fits polynomials of degree 8 to them.
const HEIGHTS: usize = 21;
const MIN_HEIGHTS: usize = 10;
const MAX_HEIGHTS: usize = 200;
/// Maximum bytes of the PSFs, as f32.
const MAX_BYTES: usize = 1 << 29;

/// Writes the optics of the lens of `args`.
///
/// # Errors
/// Usage: a lens without rotational symmetry; PSFs too large. A file that cannot be written.
pub fn export(args: &LensExportArgs) -> Result<()> {
    let out = args.out.as_deref().context("checked before: OUT")?;
    if out.extension().is_none_or(|e| e != "mat") {
        return Err(usage(format!("OUT {}: expected a name ending in .mat", out.display())));
    }
    check_absent(out, args.overwrite)?;
    let heights = args.grid.map_or(HEIGHTS, |grid| grid.width);
    if !(MIN_HEIGHTS..=MAX_HEIGHTS).contains(&heights) {
        return Err(usage(format!(
            "--grid {heights}: isetcam has field heights, expected {MIN_HEIGHTS} to {MAX_HEIGHTS} of them"
        )));
    }
    let lens = PsfLens::open(args)?;
    lens.require_symmetric(args)?;
    let nm = match given_nm(args)? {
        nm if nm.is_empty() => lens.all_or(WAVELENGTHS)?,
        nm => lens.wavelengths_nm(args, &nm)?,
    };
    let film = PsfFilm::new(args, || lens.half_sides_mm(args))?;
    let lens = lens.traced(args, &film, &nm)?;
    lens.notes().iter().for_each(|note| log_line(format!("note: {note}")));
    let bands = nm.iter().map(|nm| band(&lens, *nm)).collect::<Result<Vec<usize>>>()?;
    let optics = optics(args, &lens, &film, &bands, heights)?;
    let line = report(args, &optics)?;
    optics.write(out)?;
    print(line);
    log_line(format!("wrote {}", out.display()));
    Ok(())
}

fn optics(
    args: &LensExportArgs,
    lens: &JobLens,
    film: &PsfFilm,
    bands: &[usize],
    heights: usize,
) -> Result<RayTraceOptics> {
    let all = lens.lens();
    let of = |b: &usize| &all.bands[*b];
    let last_mm = film.corner_mm();
    if let Some(short) = bands.iter().map(of).find(|band| band.reach_mm() < last_mm) {
        return Err(usage(format!(
            "{}: the film's corner at {last_mm:.4} mm lies beyond the PSFs of the lens at {} nm, which end at {:.4} mm; give a smaller --film-size",
            args.lens,
            number(short.wavelength_nm),
            short.reach_mm()
        )));
    }
    let ideal_mm = bands.iter().map(|b| of(b).ideal_height_at(last_mm)).fold(f64::INFINITY, f64::min);
    let field_height_mm: Vec<f64> =
        (0..heights).map(|i| ideal_mm * i as f64 / (heights - 1) as f64).collect();
    let spacing_um = film.pitch_um / film.oversample as f64;
    let films: Vec<BandOnFilm<'_>> = bands.iter().map(|b| BandOnFilm::new(of(b), spacing_um)).collect();
    let real_mm = |band: &LensBand, ideal: f64| match ideal > 0.0 {
        true => linear(&band.ideal_height_mm, &band.image_height_mm, ideal),
        false => 0.0,
    };
    let image_height_mm: Vec<f64> =
        bands.iter().flat_map(|b| field_height_mm.iter().map(move |h| real_mm(of(b), *h))).collect();
    let relative_illumination = image_height_mm
        .iter()
        .enumerate()
        .map(|(i, mm)| if *mm > 0.0 { of(&bands[i / heights]).illumination_at(*mm) } else { 1.0 });
    let relative_illumination = relative_illumination.collect();
    let side = side(args, film, bands, lens, image_height_mm.len())?;
    let kernel = |(i, mm): (usize, &f64)| {
        let reader = lens.psf_reader(bands[i / heights], 1);
        let read = |set| reader(0, set..set + 1).map_err(|e| anyhow!("{e}"));
        let (size, kernel) = films[i / heights].kernel([*mm, 0.0], all.psf_sample, read)?;
        Ok::<_, anyhow::Error>(centred(&kernel, size, side))
    };
    let psfs = with_threads(threads(None), || {
        image_height_mm.par_iter().enumerate().map(kernel).collect::<Result<Vec<_>>>()
    })
    .with_context(|| format!("PSFs of {}", args.lens))?;
    let nearest = |a: &&LensBand, b: &&LensBand| {
        let distance = |band: &LensBand| (band.wavelength_nm - all.primary_wavelength_nm).abs();
        distance(a).total_cmp(&distance(b))
    };
    let primary = bands.iter().map(of).min_by(nearest).context("no wavelength")?;
    let field_mm = *field_height_mm.last().context("no height")?;
    Ok(RayTraceOptics {
        name: all.name.clone(),
        reference_nm: all.primary_wavelength_nm,
        object_distance_mm: all.object_distance_mm,
        magnification: all.magnification,
        f_number: all.f_number,
        effective_f_number: (PI / (4.0 * primary.solid_angle_sr)).sqrt(),
        focal_length_mm: all.effective_focal_length_mm,
        half_field_deg: (field_mm / all.distortion_focal_length_mm.abs()).atan().to_degrees(),
        field_height_mm,
        wavelengths_nm: bands.iter().map(|b| number(of(b).wavelength_nm)).collect(),
        image_height_mm,
        relative_illumination,
        psf_side: side,
        spacing_mm: 1e-3 * spacing_um,
        psfs: psfs.into_iter().flatten().collect(),
    })
}

/// Samples a side of the PSFs, even: one more than the widest kernel has, or than --psf-window has.
fn side(
    args: &LensExportArgs,
    film: &PsfFilm,
    bands: &[usize],
    lens: &JobLens,
    count: usize,
) -> Result<usize> {
    let (all, spacing_um) = (lens.lens(), film.pitch_um / film.oversample as f64);
    let window = |b: &usize| window_px(&all.bands[*b], all.psf_sample, spacing_um);
    let widest = bands.iter().map(window).max().context("no wavelength")?;
    let odd = args.psf_window.map_or(widest, |px| (px * film.oversample) | 1);
    let side = odd + 1;
    match side.saturating_pow(2).saturating_mul(4).saturating_mul(count) <= MAX_BYTES {
        true => Ok(side),
        false => Err(usage(format!(
            "{count} PSFs of {side} x {side} samples are {:.1} GB as doubles, more than {:.1} GB; give fewer --wavelengths or heights (--grid), a smaller \
             --psf-window or --oversample",
            8e-9 * (side as f64).powi(2) * count as f64,
            2e-9 * MAX_BYTES as f64
        ))),
    }
}

/// A kernel of `size` × `size`, odd, in a window of `side`, even, rows fastest: its middle on sample side/2 − 1 from 0. What lies beyond the window is cut, and
/// the rest scaled to sum 1.
fn centred(kernel: &[f32], size: usize, side: usize) -> Vec<f32> {
    let mut out = vec![0.0; side * side];
    let at = |k: usize| (k + side / 2).checked_sub(1 + size / 2).filter(|at| *at < side);
    for (y, row) in kernel.chunks_exact(size).enumerate() {
        let Some(y) = at(y) else { continue };
        for (x, v) in row.iter().enumerate() {
            if let Some(x) = at(x) {
                out[x * side + y] = *v;
            }
        }
    }
    let sum: f64 = out.iter().map(|v| f64::from(*v)).sum();
    out.iter_mut().for_each(|v| *v = (f64::from(*v) / sum) as f32);
    out
}

fn report(args: &LensExportArgs, optics: &RayTraceOptics) -> Result<String> {
    let list: Vec<String> = optics.wavelengths_nm.iter().map(f64::to_string).collect();
    let (heights, side) = (&optics.field_height_mm, optics.psf_side);
    let last_mm = heights.last().copied().unwrap_or_default();
    Ok(match args.json {
        true => serde_json::to_string_pretty(&json!({
            "lens": args.lens,
            "as": args.model.name(),
            "wavelengths_nm": optics.wavelengths_nm,
            "field_heights_mm": heights,
            "image_heights_mm": optics.image_height_mm.chunks(heights.len()).collect::<Vec<_>>(),
            "relative_illumination": optics.relative_illumination.chunks(heights.len()).collect::<Vec<_>>(),
            "sample_spacing_um": 1e3 * optics.spacing_mm,
            "side": side,
            "half_field_deg": optics.half_field_deg,
        }))?,
        false => format!(
            "{} as {} at {} nm: {} field heights to {} mm ({} deg), PSFs of {side} x {side} samples of {} µm",
            args.lens,
            args.model.name(),
            list.join(", "),
            heights.len(),
            short_number(last_mm),
            short_number(optics.half_field_deg),
            1e3 * optics.spacing_mm,
        ),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kernels_lie_on_the_sample_where_the_support_is_zero() {
        // Column 2 of row 0, and the middle.
        let kernel = [0.0, 0.0, 1.0, 0.0, 2.0, 0.0, 0.0, 0.0, 1.0];
        let out = centred(&kernel, 3, 4);
        let at = |y: usize, x: usize| out[x * 4 + y];
        assert_eq!((at(1, 1), at(0, 2), at(2, 2)), (0.5, 0.25, 0.25));
        assert_eq!(out.iter().sum::<f32>(), 1.0);
        // Cut to the middle pixel and what is beside it.
        assert_eq!(centred(&kernel, 3, 2), [2.0 / 3.0, 0.0, 0.0, 1.0 / 3.0]);
        // In a larger window.
        assert_eq!(centred(&[1.0], 1, 6)[2 * 6 + 2], 1.0);
    }
}
