//! `lenscube lens trace` of a lens without rotational symmetry: as built (`--tolerances`), or by design.

use super::writer::{Stopped, write_beside};
use super::{band_line, default_store, missed_tolerance, pupils_note, sealed, summary};
use crate::args::{Store, TraceArgs};
use crate::failure::usage;
use crate::job::lens::attributes::attributes;
use crate::job::lens::built::{map_range, recorded};
use crate::job::lens::drawn::DrawnLens;
use crate::progress::{TracingBar, log_line, number};
use anyhow::{Context, Result};
use formats::lens::{LensPackWriter, PackAttributes, ReferencePoint};
use pipeline::design::DesignError;
use pipeline::design::skew::error::SkewError;
use pipeline::design::skew::grid::GridTrace;
use pipeline::design::skew::image_cone::film_cones;
use pipeline::design::skew::map::FilmRange;
use pipeline::design::skew::system::BuiltLens;
use pipeline::design::skew::tables::{NominalNodes, SkewTrace};
use pipeline::design::trace::{BandReport, OnProgress, Progress, TraceOptions, TracedBand};
use pipeline::lens::cone_field::ConeField;
use pipeline::lens::{Lens, PsfStack};
use pipeline::real;
use std::f64::consts::FRAC_1_SQRT_2;
use std::time::Instant;

/// Margin about the corner of a film, mm: half a window of 177 pixels of 2 µm, along the diagonal.
const MARGIN_MM: f64 = 0.25;

/// Half the sides of the film of `args` (X, Y), mm; without one, of the square within the largest height.
fn half_film_mm(args: &TraceArgs, options: &TraceOptions) -> Result<[f64; 2]> {
    let Some(size) = args.film_size else { return Ok([options.max_height_mm * FRAC_1_SQRT_2; 2]) };
    let half = [size.width, size.height].map(|px| 0.5 * px as f64 * options.film_pitch_um * 1e-3);
    let corner_mm = real::hypot(half[0], half[1]);
    match corner_mm <= options.max_height_mm {
        true => Ok(half),
        false => Err(usage(format!(
            "--film-size {size}: its corner lies {corner_mm:.4} mm from the axis, expected at most --max-height-mm {:.4} mm",
            options.max_height_mm
        ))),
    }
}

/// Largest height without `--max-height-mm` of a design without rotational symmetry, mm: the corner of its film and half a window beyond.
///
/// # Errors
/// Usage: no film either.
pub fn max_height_mm(args: &TraceArgs) -> Result<f64> {
    let Some(size) = args.film_size else {
        return Err(usage(format!(
            "{} has no rotational symmetry: give the film that it is traced for, --film-size WxH (with --film-pitch-um), or --max-height-mm MM for a square",
            args.design
        )));
    };
    let half = [size.width, size.height].map(|px| 0.5 * px as f64 * args.film_pitch_um * 1e-3);
    Ok(real::hypot(half[0], half[1]) + MARGIN_MM)
}

/// Traces the pack of a lens as built.
///
/// # Errors
/// A lens that cannot be traced over the film.
pub fn trace(args: &TraceArgs, drawn: &DrawnLens, options: &TraceOptions, start: Instant) -> Result<()> {
    let half_mm = half_film_mm(args, options)?;
    let pack = LensPackWriter::create_planar(&args.out)?;
    let bar = TracingBar::new(options.wavelengths_nm.len());
    bar.step("focus of the lens as built".to_owned());
    let adjusted = drawn.compensated(real::hypot(half_mm[0], half_mm[1]))?;
    adjusted.notes.iter().for_each(|note| bar.suspend(|| log_line(format!("note: {note}"))));
    let film = map_range(half_mm, options.max_height_mm);
    let trace = SkewTrace::new(&adjusted.lens, options, film)?;
    let mut nodes = NominalNodes::default();
    Planar {
        args,
        options,
        pack,
        bar,
        what: format!("lens {} of {}", drawn.draw.1, args.design),
        header: trace.header()?,
        lens: (&adjusted.lens, film),
        band: &mut |index, progress| trace.band(index, &mut nodes, progress),
        record: &|attributes| recorded(attributes, drawn.record.clone(), &adjusted),
    }
    .write(start)
}

/// Traces the pack of `lens`, which has no rotational symmetry by design.
///
/// # Errors
/// As [`trace`].
pub fn trace_design(
    args: &TraceArgs,
    lens: &BuiltLens,
    options: &TraceOptions,
    start: Instant,
) -> Result<()> {
    check_flat(args)?;
    let half_mm = half_film_mm(args, options)?;
    let pack = LensPackWriter::create_planar(&args.out)?;
    let film = map_range(half_mm, options.max_height_mm);
    let trace = GridTrace::new(lens, options, film)?;
    Planar {
        args,
        options,
        pack,
        bar: TracingBar::new(options.wavelengths_nm.len()),
        what: args.design.clone(),
        header: trace.header()?,
        lens: (lens, film),
        band: &mut |index, progress| trace.band(index, progress),
        record: &|attributes| PackAttributes {
            reference_point: Some(ReferencePoint::ChiefRay),
            ..attributes
        },
    }
    .write(start)
}

/// Checks that no depth nodes are asked for.
///
/// # Errors
/// Usage: they are.
pub fn check_flat(args: &TraceArgs) -> Result<()> {
    match args.depths_m {
        None => Ok(()),
        Some(_) => Err(usage(format!(
            "--depths-m: expected a lens with rotational symmetry, {} has none",
            args.built.named(&args.design)
        ))),
    }
}

/// PSFs of `bands` bands of the size of `first`, MB uncompressed.
fn psf_mb(first: &PsfStack, bands: usize) -> f64 {
    1e-6 * (size_of_val(&first.samples[..]) * bands) as f64
}

/// A pack of a lens without rotational symmetry, and how its bands are traced.
struct Planar<'a> {
    args: &'a TraceArgs,
    options: &'a TraceOptions,
    pack: LensPackWriter,
    bar: TracingBar,
    what: String,
    header: Lens,
    /// The lens that is traced, and the film of its map.
    lens: (&'a BuiltLens, FilmRange),
    band: &'a mut dyn FnMut(usize, OnProgress<'_>) -> Result<TracedBand, SkewError>,
    record: &'a dyn Fn(PackAttributes) -> PackAttributes,
}

impl Planar<'_> {
    /// Traces the bands and writes the pack.
    fn write(self, start: Instant) -> Result<()> {
        let Self { args, options, pack, bar, what, header, lens: (built, film), band, record } = self;
        let mut reports: Vec<BandReport> = Vec::new();
        let mut stored = args.store;
        let result = write_beside(pack, |write| {
            let mut lens = header;
            for (index, nm) in options.wavelengths_nm.iter().enumerate() {
                let mut progress = |p: Progress| {
                    bar.set_bands(p.band);
                    bar.step(format!("{} nm: {} ({} PSFs)", number(*nm), p.step, p.psfs));
                };
                let mut band = band(index, &mut progress)?;
                if args.cones {
                    band.tables.cones = Some(ConeField::Planar(film_cones(built, nm * 1e-3, film)?));
                }
                bar.suspend(|| log_line(band_line(&band)));
                reports.push(band.report);
                lens.bands.push(band.tables.clone());
                let failed = |e: Stopped| DesignError::Sink { wavelength_nm: *nm, problem: e.to_string() };
                if missed_tolerance(args.psf_tolerance, &reports).is_some() {
                    Err(failed(Stopped))?;
                }
                // PSFs are largest at the shortest wavelength, which is the first: how many there are is known only then.
                let stored = *stored.get_or_insert_with(|| {
                    let psf_mb = psf_mb(&band.psf, options.wavelengths_nm.len());
                    let stored = sealed::stored(args, default_store(psf_mb, 0.0));
                    if stored == Store::Pupils {
                        bar.suspend(|| log_line(pupils_note(psf_mb)));
                    }
                    stored
                });
                write(index, band, stored).map_err(failed)?;
            }
            Ok::<_, SkewError>(lens)
        });
        bar.finish();
        if let Some(missed) = missed_tolerance(args.psf_tolerance, &reports) {
            return Err(missed);
        }
        let context = || format!("tracing {what}");
        let (traced, pack) = result.with_context(context)?;
        let lens = traced.with_context(context)?;
        let attributes = record(attributes(&args.design, &args.parameters, options, &reports));
        sealed::finish(args, pack, &lens, attributes)?;
        for line in summary(&args.out, options, &reports, start.elapsed().as_secs_f64()) {
            log_line(line);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use formats::lens::MAX_ARRAY_SAMPLES;
    use pipeline::lens::PsfSample;

    #[test]
    fn packs_of_more_psfs_than_are_read_have_pupil_functions() {
        let samples = |bytes: usize| PsfStack {
            size: 1,
            pitch_um: 1.0,
            sample: PsfSample::Point,
            samples: vec![0.0; bytes / 4],
        };
        assert_eq!(psf_mb(&samples(4000), 31), 0.124);
        // A band of the default store is one that can be read again.
        let most_mb = 4e-6 * MAX_ARRAY_SAMPLES as f64;
        assert_eq!(default_store(most_mb, 0.0), Store::Pupils);
        assert_eq!(default_store(psf_mb(&samples(4_000_000), 249), 0.0), Store::Psfs);
        assert_eq!(default_store(psf_mb(&samples(4_000_000), 251), 0.0), Store::Pupils);
    }
}
