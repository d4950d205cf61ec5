//! `lenscube lens trace`: a lens pack from a prescription.

use crate::args::{ImagePlaneArg, TraceArgs};
use crate::failure::{other_job, usage};
use crate::progress::say;
use anyhow::{Context, Result};
use formats::lens::{LensPackError, LensPackWriter, PackAttributes};
use indicatif::{ProgressBar, ProgressStyle};
use pipeline::design::glass::GlassCatalog;
use pipeline::design::system::{ImagePlane, RayAiming, System};
use pipeline::design::trace::{Progress, PsfHeights, TraceOptions, TracedBand, trace_lens};
use pipeline::design::{agf, zmx};
use serde_json::json;
use std::path::Path;

/// The design inside the program.
const BUILTIN: &str = "double-gauss-28";

/// Runs the command.
pub fn command(args: &TraceArgs) -> Result<()> {
    let system = placed(args, system(args)?)?;
    for note in &system.notes {
        say(format!("note: {note}"));
    }
    let options = options(args)?;
    let mut pack = LensPackWriter::create(&args.out).map_err(|e| match e {
        LensPackError::Exists { .. } => other_job(e.to_string()),
        e => e.into(),
    })?;
    let style =
        ProgressStyle::with_template("{msg}  [{bar:32}] {pos}/{len} bands  {elapsed} gone, {eta} left");
    let bar =
        ProgressBar::new(options.wavelengths_nm.len() as u64).with_style(style.expect("a valid template"));
    let mut bounds = Vec::new();
    let mut progress = |p: Progress| {
        bar.set_position(p.band as u64);
        bar.set_message(format!("{} nm: {} ({} PSFs)", options.wavelengths_nm[p.band], p.step, p.psfs));
    };
    let result = trace_lens(&system, &options, &mut progress, |index, band: TracedBand| {
        let r = &band.report;
        let nodes: usize = band.tables.azimuth_count.iter().sum();
        let bound = r.psf_error.map_or("given".into(), |e| format!("{:.2} %", 100.0 * e));
        let line = format!(
            "{} nm: window {} px, light held {:.2} % at least, {} heights, {nodes} nodes, kernel error {bound}",
            r.wavelength_nm,
            r.window_px,
            100.0 * r.least_energy,
            band.tables.psf_height_mm.len(),
        );
        bar.suspend(|| say(line));
        bounds.push(json!({
            "wavelength_nm": r.wavelength_nm,
            "kernel_l1": r.psf_error,
            "least_energy": r.least_energy,
        }));
        pack.psf(index, &band.psf)
    });
    bar.finish_and_clear();
    let lens = result.with_context(|| format!("tracing {}", args.design))?;
    let attributes = PackAttributes {
        image_plane: Some(format!("{:?}", args.image_plane).to_lowercase()),
        defocus_mm: Some(args.defocus_mm),
        frame: Some("field point on +x, row down; heights real unless named ideal; mm".into()),
        psf_tolerance: Some(json!({ "asked_l1": options.psf_tolerance, "bands": bounds })),
        source: Some(json!({
            "program": concat!("lenscube ", env!("CARGO_PKG_VERSION")),
            "design": args.design,
            "film_pitch_um": options.film_pitch_um,
            "energy": options.energy,
            "aiming": format!("{:?}", system.aiming).to_lowercase(),
        })),
    };
    pack.finish(&lens, &attributes)?;
    say(format!(
        "{}: {} bands; use it with `lenscube run CHART FILM --lens {0}`",
        args.out.display(),
        lens.bands.len()
    ));
    Ok(())
}

fn read(path: &Path) -> Result<Vec<u8>> {
    std::fs::read(path).with_context(|| format!("reading {}", path.display()))
}

fn system(args: &TraceArgs) -> Result<System> {
    if args.design == BUILTIN {
        return Ok(System::double_gauss_28());
    }
    let mut glasses = GlassCatalog::schott();
    for path in &args.glass_catalog {
        glasses
            .extend(agf::parse(&read(path)?).with_context(|| format!("reading glasses {}", path.display()))?);
    }
    let path = Path::new(&args.design);
    if !path.exists() {
        return Err(usage(format!("design `{}` is neither a file nor the built-in {BUILTIN}", args.design)));
    }
    zmx::parse(&read(path)?, &glasses).with_context(|| format!("reading design {}", path.display()))
}

/// The system with the conjugate, image plane and aiming that were asked for.
fn placed(args: &TraceArgs, mut system: System) -> Result<System> {
    if let Some(distance) = args.object_distance_mm {
        system = system.with_object_distance(Some(distance))?;
    }
    let um = args.focus_nm.map_or(system.primary_um(), |nm| nm / 1e3);
    let plane = match args.image_plane {
        ImagePlaneArg::Design => ImagePlane::AsDesigned,
        ImagePlaneArg::Paraxial => ImagePlane::Paraxial(um),
        ImagePlaneArg::Rms => ImagePlane::BestRmsSpot(um),
        ImagePlaneArg::Strehl => ImagePlane::BestStrehl(um),
    };
    system = system.with_image_plane(plane, args.defocus_mm)?;
    if let Some(aiming) = args.aiming {
        system.aiming = match aiming {
            crate::args::AimingArg::Real => RayAiming::Real,
            crate::args::AimingArg::Paraxial => RayAiming::Paraxial,
        };
    }
    Ok(system)
}

fn options(args: &TraceArgs) -> Result<TraceOptions> {
    let wavelengths = pipeline::wavelengths::parse(&args.wavelengths);
    let mut wavelengths =
        wavelengths.map_err(|e| usage(format!("--wavelengths {}: {e}", args.wavelengths)))?;
    wavelengths.sort_by(f64::total_cmp);
    let mut options = TraceOptions::new(wavelengths, args.max_height_mm);
    options.energy = args.energy;
    options.psf_tolerance = args.psf_tolerance;
    options.psf_pitch_um = args.psf_pitch_um;
    options.film_pitch_um = args.film_pitch_um;
    if let Some(text) = &args.heights {
        let heights = heights(text).map_err(|e| usage(format!("--heights {text}: {e}")))?;
        options.heights = PsfHeights::Given(heights);
    }
    Ok(options)
}

/// `0:21:1` (both ends) or `0,3,7.5`: real image heights in mm.
fn heights(text: &str) -> Result<Vec<f64>, String> {
    let number =
        |t: &str| t.trim().parse::<f64>().ok().filter(|v| v.is_finite()).ok_or(format!("`{t}` is no height"));
    let fields: Vec<&str> = text.split(':').collect();
    let [first, last, step] = fields[..] else { return text.split(',').map(number).collect() };
    let (first, last, step) = (number(first)?, number(last)?, number(step)?);
    if !(step > 0.0 && last > first && (last - first) / step <= 10_000.0) {
        return Err("expected FIRST:LAST:STEP with at most 10000 steps".into());
    }
    Ok((0..=((last - first) / step + 1e-9) as usize).map(|i| first + i as f64 * step).collect())
}
