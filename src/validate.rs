//! `lenscube validate`: films of test charts, made as any film is, against what the lens's own data say of them.

pub mod blame;
pub mod data;
pub mod distortion;
pub mod esf;
#[cfg(test)]
mod faults;
pub mod figures;
pub mod films;
pub mod local;
pub mod report;
pub mod require;
pub mod ri;
pub mod tables;
pub mod timing;
pub mod truth;

use crate::args::{ValidateArgs, check_directory};
use crate::failure::{Coded, code, other_job, usage};
use crate::job::threads;
use crate::lens::source::{Named, Source};
use crate::progress::say;
use anyhow::{Context, Result};
use blame::RunPsfs;
use distortion::Point;
use esf::Edge;
use films::Films;
use formats::durable::{Directory, WholeFile, create_directories, finish_together, sweep_entries};
use pipeline::band::{Options, PsfBetween};
use pipeline::field::Outside;
use pipeline::geometry::{Frame, Size};
use pipeline::psf::kernel::film_window;
use pipeline::remap::{Reading, Stages};
use pipeline::resample::{Interp, Surround};
use pipeline::simd::Simd;
use ri::Illumination;
use serde_json::Value;
use std::path::Path;
use truth::{BandTruth, Truth};

/// Bytes of a summary at most.
const MAX_SUMMARY: u64 = 64 << 20;

/// What is made and what it is compared with.
pub struct Setup {
    /// How films are made.
    pub films: Films,
    /// Side of the film, px.
    pub size: usize,
    /// Film pixel pitch, µm.
    pub pitch_um: f64,
    /// Optical axis (row, column) in film pixels, as the comparison takes it.
    pub axis_px: (f64, f64),
    /// Wavelengths of the films.
    pub wavelengths_nm: Vec<f64>,
    /// Side of the kernels of the lens that makes the films, film pixels, by band.
    pub windows_px: Vec<usize>,
    /// The lens that makes the films, ready for them.
    pub source: Source,
    /// The lens to compare with.
    pub truth: Truth,
}

impl Setup {
    /// Opens the lenses; what is to be traced for the films is traced now.
    pub fn new(args: &ValidateArgs) -> Result<Self> {
        let mut wavelengths_nm = crate::trace::wavelengths(&args.wavelengths)?;
        if let Some(text) = &args.bands {
            let chosen = crate::args::bands(text, wavelengths_nm.len());
            let chosen = chosen.map_err(|e| usage(format!("--bands {text}: {e}")))?;
            wavelengths_nm = chosen.into_iter().map(|b| wavelengths_nm[b]).collect();
        }
        let size = args.size as usize;
        let truth_name = args.against.as_ref().unwrap_or(&args.lens);
        let truth = Truth::open(truth_name)?;
        // Before any film is made.
        for &nm in &wavelengths_nm {
            truth.band(nm)?;
        }
        let threads = threads(args.threads);
        let film = Size::new(size, size);
        let frame = Frame::centred(film, film, args.film_pitch_um);
        let options = options();
        let source = Source::new(Named::open(&args.lens)?, &frame, &wavelengths_nm, &options, threads)?;
        let sample = source.lens().psf_sample;
        let window = |&nm: &f64| -> Result<usize> {
            let band = source.lens().bands.iter().find(|b| (b.wavelength_nm - nm).abs() < 1e-6);
            let band = band.with_context(|| format!("{} has no band at {nm} nm", args.lens))?;
            Ok(film_window(band.psf_size, band.psf_pitch_um, args.film_pitch_um, sample))
        };
        let windows_px = wavelengths_nm.iter().map(window).collect::<Result<_>>()?;
        create_directories(&args.out, true)?;
        // Films of a killed run.
        sweep_entries(&args.out)?;
        let films = Films {
            lens: args.lens.clone(),
            dir: args.out.clone(),
            full: args.full,
            bands: wavelengths_nm.len(),
            threads,
            memory: args.memory,
            device: args.device.clone(),
            engine: args.engine,
        };
        let axis_px = frame.axis_px;
        Ok(Self {
            films,
            size,
            pitch_um: args.film_pitch_um,
            axis_px,
            wavelengths_nm,
            windows_px,
            source,
            truth,
        })
    }

    /// A generated chart for this film.
    pub fn chart(&self, kind: &str, settings: &str) -> String {
        format!(
            "gen:{kind}?size={}&pitch_um={}&wavelengths={}{settings}",
            self.size,
            self.pitch_um,
            pipeline::wavelengths::format(&self.wavelengths_nm)
        )
    }

    /// The middle (row, column) of film and chart in film pixels.
    pub fn chart_middle(&self) -> (f64, f64) {
        let middle = (self.size as f64 - 1.0) / 2.0;
        (middle, middle)
    }

    /// Where on the film the chief ray of the chart's point (row, column; film pixels) lands.
    pub fn on_film(&self, truth: &BandTruth<'_>, chart_px: (f64, f64)) -> Result<(f64, f64)> {
        let middle = self.chart_middle();
        let (dy, dx) = (chart_px.0 - middle.0, chart_px.1 - middle.1);
        let ideal_mm = dy.hypot(dx) * self.pitch_um * 1e-3;
        if ideal_mm == 0.0 {
            return Ok(self.axis_px);
        }
        let m = truth.real_mm(ideal_mm)? / ideal_mm;
        Ok((self.axis_px.0 + dy * m, self.axis_px.1 + dx * m))
    }

    /// Moments of the PSF about the chief ray in the window that the film keeps of it, film pixels: first outwards, second
    /// outwards and across.
    pub fn moments_px(
        &self,
        truth: &BandTruth<'_>,
        band: usize,
        r_px: f64,
        azimuth_rad: f64,
    ) -> Result<[f64; 3]> {
        let height_mm = r_px * self.pitch_um * 1e-3;
        let pixels = truth.pixels(height_mm, azimuth_rad, self.windows_px[band], self.pitch_um)?;
        let (sin, cos) = azimuth_rad.sin_cos();
        Ok(pixels.iter().fold([0.0; 3], |[c, out, across], ((y, x), p)| {
            let (u, v) = (x * cos + y * sin, y * cos - x * sin);
            [c + p * u, out + p * u * u, across + p * v * v]
        }))
    }
}

fn options() -> Options {
    Options {
        stages: Stages { ri: true, distortion: true, svpsf: true },
        reading: Reading { interp: Interp::Bicubic, surround: Surround::Edge, outside: Outside::Error },
        azimuths: None,
        psf_window: None,
        between: PsfBetween::Error,
        simd: Simd::detect(),
    }
}

/// What was found in one band.
pub struct Band {
    /// Wavelength.
    pub nm: f64,
    /// Side of the film's kernels, px.
    pub window_px: usize,
    /// Relative illumination.
    pub illumination: Illumination,
    /// Points without the PSF.
    pub points: Vec<Point>,
    /// Points with it.
    pub psf_points: Vec<Point>,
    /// Edges.
    pub edges: Vec<Edge>,
}

/// An edge's name.
pub fn title(place: &esf::Place) -> String {
    format!("{}, {}", place.name, place.direction)
}

/// The films of all charts.
pub struct Shots {
    uniform: ri::Shots,
    points: distortion::Shots,
    psf_points: distortion::Shots,
    edges: Vec<esf::Shot>,
}

impl Shots {
    /// Makes the films.
    pub fn new(setup: &Setup, places: &[esf::Place]) -> Result<Self> {
        Ok(Self {
            uniform: ri::shoot(setup)?,
            points: distortion::shoot(setup, false)?,
            psf_points: distortion::shoot(setup, true)?,
            edges: esf::shoot(setup, places)?,
        })
    }
}

/// Measures one band of the films, and compares.
pub fn compare(setup: &Setup, shots: &Shots, band: usize) -> Result<Band> {
    let nm = setup.wavelengths_nm[band];
    let truth = setup.truth.band(nm)?;
    let run = RunPsfs::new(setup, band)?;
    let edge = |shot| esf::compare(setup, &truth, &run, band, shot);
    Ok(Band {
        nm,
        window_px: setup.windows_px[band],
        illumination: ri::compare(setup, &truth, band, &shots.uniform)?,
        points: distortion::compare(setup, &truth, band, &shots.points)?,
        psf_points: distortion::compare(setup, &truth, band, &shots.psf_points)?,
        edges: shots.edges.iter().map(edge).collect::<Result<_>>()?,
    })
}

/// Fails if the report would replace files that no validation wrote: its summary tells them from others.
fn check_out(out: &Path) -> Result<()> {
    let there = |name: &&str| out.join(name).symlink_metadata().is_ok();
    let Some(name) = ["summary.json", "report.html", "curves"].into_iter().find(there) else { return Ok(()) };
    let summary = Directory::new(out).read_at_most("summary.json", MAX_SUMMARY)?;
    let summary: Value = summary.and_then(|bytes| serde_json::from_slice(&bytes).ok()).unwrap_or_default();
    let program = summary["program"].as_str().unwrap_or_default();
    match program.starts_with("lenscube ") && summary.get("worst").is_some() {
        true => Ok(()),
        false => Err(other_job(format!(
            "{} exists and is not of an earlier validation; move it away, or choose another --out",
            out.join(name).display()
        ))),
    }
}

/// Runs the command; the exit code.
pub fn command(args: &ValidateArgs) -> Result<u8> {
    let times = timing::of(args.timing.as_deref())?;
    check_directory(&args.out)?;
    check_out(&args.out)?;
    let setup = Setup::new(args)?;
    let shots = Shots::new(&setup, &esf::places(setup.size))?;
    let mut bands = Vec::new();
    for band in 0..setup.wavelengths_nm.len() {
        let nm = setup.wavelengths_nm[band];
        let found = compare(&setup, &shots, band).with_context(|| format!("comparing {nm} nm"))?;
        let esf = found.edges.iter().map(|e| e.agreement.iou).fold(1.0, f64::min);
        say(format!(
            "{nm} nm: RI {:.6} %, distortion {:.5} px, ESF {:.4} % at least",
            100.0 * found.illumination.agreement.iou,
            distortion::mean_max(&found.points).0,
            100.0 * esf
        ));
        bands.push(found);
    }
    let missed = require::missed(&bands, &args.require);
    let mut files = data::curves(&args.out.join("curves"), &bands)?;
    let summary = data::summary(args, &setup, &bands, &missed, &times);
    let page = report::html(args, &setup, &bands, &missed, &times);
    let all = [("summary.json", serde_json::to_string_pretty(&summary)? + "\n"), ("report.html", page)];
    for (name, text) in all {
        files.push(WholeFile::with_text(&args.out.join(name), &text)?);
    }
    // The page last: no page shows figures of one run beside curves of another.
    finish_together(files)?;
    say(format!("{}", args.out.join("report.html").display()));
    match missed.is_empty() {
        true => Ok(0),
        false => {
            let message = format!(
                "--require is missed: {}; see {}",
                missed.join("; "),
                args.out.join("report.html").display()
            );
            Err(Coded { code: code::WRONG, message }.into())
        }
    }
}
