//! `lenscube restore`: the chart of a film, by the lens that made it ([`pipeline::restore`]), tile by tile.
//!
//! ```text
//! film or raw, the film's record → lens → per band or colour plane: noise, λ, μ or iterations, figures (settings) → tiles with halos → chart
//! ```
//! All that depends on the picture is decided once a band, before its tiles, on a few small parts: tiles then differ by rounding and by what lies beyond their halos alone.
//! The chart appears at OUT when it is complete; a run that is stopped leaves nothing there. In memory: a shard of the chart, and some thirty arrays of a tile.

mod optics;
mod planes;
mod raw;
mod recorded;
mod report;
mod settings;
mod tails;
mod tile;

use crate::args::{RestoreArgs, RestoreMethod};
use crate::failure::{code, other_job, usage};
use crate::job::chosen_bands;
use crate::outputs::{Guard, check_absent};
use crate::progress::{counting, interrupt, log_line};
use anyhow::{Result, anyhow};
use formats::chart::{ChartMeta, Codec, NewChart, WriteError, write_surfaces};
use formats::durable::is_url;
use optics::Optics;
use pipeline::flow::{ChartSource, SourceSinkError};
use pipeline::geometry::{Rect, Size};
use pipeline::restore::blend::Tiles;
use recorded::Recorded;
use serde_json::{Map, json};
use settings::Settings;
use std::sync::Mutex;
use std::sync::atomic::Ordering::Relaxed;
use std::time::Instant;
use tile::{Counts, Solver, Strength};

/// Width of the overlap of tiles, px.
const OVERLAP_PX: usize = 32;

/// Runs the command; the exit code.
pub fn command(args: &RestoreArgs) -> Result<u8> {
    if args.iterations.is_some() && args.method != RestoreMethod::RichardsonLucy {
        return Err(usage("--iterations is for --method richardson-lucy; the others are solved to the end"));
    }
    if !is_url(&args.out) {
        check_absent(&args.out, args.overwrite)?;
    }
    let cancel = interrupt::cancel_flag_of_removable_output();
    match restore(args) {
        Err(_) if cancel.load(Relaxed) => {
            log_line("interrupted: nothing was written");
            Ok(code::INTERRUPTED)
        }
        other => other.map(|()| 0),
    }
}

fn restore(args: &RestoreArgs) -> Result<()> {
    let start = Instant::now();
    let film = Recorded::open(args)?;
    let lens = film.lens();
    Guard::default().reads_lens(&lens).writes("OUT", &args.out).check()?;
    let (grid, wavelengths_nm) =
        (film.grid(), film.planes().iter().map(|plane| plane.wavelength_nm).collect::<Vec<_>>());
    let planes = match &args.bands {
        None => (0..wavelengths_nm.len()).collect(),
        Some(text) => chosen_bands(text, &wavelengths_nm)?,
    };
    let whole = grid.size.rect();
    let roi = args.roi.unwrap_or(whole);
    if roi.is_empty() || !whole.contains(roi) {
        return Err(usage(format!(
            "--roi {},{},{},{} is not inside the film of {}",
            roi.x, roi.y, roi.width, roi.height, grid.size
        )));
    }
    let optics = Optics::open(&film)?;
    let (bar, progress) = counting("measuring");
    let mut settings = Vec::new();
    for (done, plane) in planes.iter().enumerate() {
        progress(done as u64, planes.len() as u64);
        settings.push(Settings::of_plane(args, &film, &optics, *plane)?);
    }
    bar.finish_and_clear();
    let picture = Picture {
        film: &film,
        optics: &optics,
        tiles: Tiles { picture: grid.size, side: args.tile as usize, overlap: OVERLAP_PX },
        roi,
        settings: &settings,
        counts: Mutex::default(),
    };
    let mut attributes = Map::new();
    attributes.insert("program".into(), concat!("lenscube ", env!("CARGO_PKG_VERSION")).into());
    attributes.insert("restored".into(), report::attributes(args, &film, roi, &settings));
    let meta = ChartMeta {
        wavelengths_nm: planes.iter().map(|plane| wavelengths_nm[*plane]).collect(),
        pitch_um: Some(grid.pitch_um),
        film_size: None,
        units: film.chart_units(),
        attributes,
    };
    let chart = NewChart { source: &picture, meta: &meta, surfaces: &[] };
    let (bar, progress) = counting("restoring");
    let written = write_surfaces(&args.out, &chart, Codec::default(), 1, args.overwrite, &progress);
    bar.finish_and_clear();
    written.map_err(|e| match e {
        WriteError::Exists { .. } => other_job(format!("{e}, or replace it with --overwrite")),
        e => e.into(),
    })?;
    let counts = *picture.counts.lock().expect("no panic while held");
    report::print_done(args, &film, (roi, &settings), counts, start.elapsed().as_secs_f64())
}

/// The restored picture; its bands are those of `settings`.
struct Picture<'a> {
    film: &'a Recorded,
    optics: &'a Optics,
    tiles: Tiles,
    roi: Rect,
    settings: &'a [Settings],
    counts: Mutex<Counts>,
}

impl Picture<'_> {
    /// Adds the tiles that reach `rect` of the film's grid to `out`, each by its weight.
    fn fill(&self, solver: &Solver, rect: Rect, out: &mut [f32]) -> Result<()> {
        out.fill(0.0);
        for core in self.tiles.reaching(rect) {
            let extent = self.tiles.extent(core);
            let (values, counts) = tile::restore(self.film, self.optics, solver, extent)?;
            self.counts.lock().expect("no panic while held").add(counts);
            self.tiles.add(core, &values, rect, out);
        }
        match out.iter().position(|v| !v.is_finite()) {
            None => Ok(()),
            Some(at) => Err(anyhow!("the restored value at pixel {at} of {rect} is not finite")),
        }
    }
}

impl ChartSource for Picture<'_> {
    fn size(&self) -> Size {
        self.roi.size()
    }

    fn read(&self, band: usize, rect: Rect, out: &mut [f32]) -> Result<(), SourceSinkError> {
        let of_film = Rect::new(rect.y + self.roi.y, rect.x + self.roi.x, rect.height, rect.width);
        Ok(self.fill(&self.settings[band].solver, of_film, out)?)
    }
}

/// Name of a method in reports.
fn method_name(method: RestoreMethod) -> &'static str {
    match method {
        RestoreMethod::Tikhonov => "tikhonov",
        RestoreMethod::TotalVariation => "total-variation",
        RestoreMethod::RichardsonLucy => "richardson-lucy",
    }
}

/// The record of a method's parameter.
fn parameter(settings: &Settings) -> (&'static str, serde_json::Value) {
    match settings.solver.strength {
        Strength::Lambda(lambda) => ("lambda", json!(lambda)),
        Strength::Mu(mu) => ("mu", json!(mu)),
        Strength::Iterations(count) => ("iterations", json!(count)),
    }
}
