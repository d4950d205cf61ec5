//! `lenscube export`: a film, a chart or a region of interest as a picture or as a file for other programs.

mod data;

use crate::args::{ExportArgs, FileArg, bands};
use crate::failure::{code, other_job, usage};
use crate::job::threads;
use crate::memory::default_limit;
use crate::open::Chart;
use crate::progress::{counting, say};
use crate::run::interrupt;
use anyhow::Result;
use formats::chart::NanPolicy;
use formats::durable::parent_of;
use formats::export::flat::envi_files;
use formats::picture::exposure::Exposure;
use formats::picture::grey::{GreyOptions, write_grey};
use formats::picture::preview::{PreviewOptions, White, write_preview};
use formats::picture::streamed::{ColourFile, write_streamed};
use formats::picture::{Shown, View};
use pipeline::flow::{ChartSource, SourceSinkError};
use pipeline::geometry::{Rect, Size};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};

/// The program itself, its threads' stacks, the allocator's slack; and the share kept for what it holds back between sizes.
const BASE: usize = 48 << 20;
const SLACK: f64 = 0.08;
/// Longest side of a PNG unless asked for.
const PNG_SIDE: usize = 2048;
/// Bytes that a pixel of a picture takes while it is made whole: linear colour and display bytes.
const PICTURE_PIXEL: usize = 15;

/// Runs the command; the exit code.
pub fn command(args: &ExportArgs) -> Result<u8> {
    let file = format_of(args)?;
    check_flags(args, file)?;
    let outputs = match file {
        FileArg::Envi => <[_; 2]>::from(envi_files(&args.out)).to_vec(),
        _ => vec![args.out.clone()],
    };
    if let Some(there) = outputs.iter().find(|p| p.symlink_metadata().is_ok()).filter(|_| !args.overwrite) {
        return Err(other_job(format!("{} exists already; replace it with --overwrite", there.display())));
    }
    let cancel = interrupt::leave_nothing();
    let written = write(args, file, cancel);
    match written {
        Err(_) if cancel.load(Relaxed) => {
            say("interrupted: nothing was written");
            Ok(code::INTERRUPTED)
        }
        other => other.map(|()| 0),
    }
}

/// The format: as asked, or by the extension.
fn format_of(args: &ExportArgs) -> Result<FileArg> {
    if let Some(format) = args.format {
        return Ok(format);
    }
    let extension = args.out.extension().map(|e| e.to_string_lossy().to_ascii_lowercase());
    Ok(match extension.as_deref() {
        Some("png") => FileArg::Png,
        Some("tif" | "tiff" | "btf") => FileArg::Tiff,
        Some("exr") => FileArg::Exr,
        Some("hdr" | "bsq" | "img") => FileArg::Envi,
        Some("npy") => FileArg::Npy,
        _ => {
            return Err(usage(format!(
                "{}: its extension tells no format; use .png, .tif, .exr, .hdr or .npy, or say --format",
                args.out.display()
            )));
        }
    })
}

/// Flags that a format knows nothing of are a mistake.
fn check_flags(args: &ExportArgs, file: FileArg) -> Result<()> {
    let (exr, png) = (file == FileArg::Exr, file == FileArg::Png);
    let picture = png || file == FileArg::Tiff;
    let wrong = [
        (args.half && !exr, "--half", "EXR"),
        (args.compression.is_some() && !exr, "--compression", "EXR"),
        (args.band.is_some() && !png, "--band", "PNG"),
        (args.max_side.is_some() && !picture, "--max-side", "PNG and TIFF pictures"),
        (args.exposure != "auto" && !picture, "--exposure", "PNG and TIFF pictures"),
    ];
    match wrong.into_iter().find(|w| w.0) {
        Some((_, flag, formats)) => {
            Err(usage(format!("{flag} is for {formats}, and {} is another format", args.out.display())))
        }
        None => Ok(()),
    }
}

/// What to export, opened.
struct Opened {
    chart: Chart,
    bands: Vec<usize>,
    wavelengths_nm: Vec<f64>,
    window: Rect,
}

impl Opened {
    fn new(args: &ExportArgs, cache_bytes: usize) -> Result<Self> {
        // Shards not yet made read as NaN: they are shown as missing, not refused.
        let chart = Chart::open(&args.film, args.wavelengths.as_deref(), NanPolicy::Keep, cache_bytes)?;
        let all_nm = chart.wavelengths_nm()?;
        let bands = match &args.bands {
            None => (0..all_nm.len()).collect(),
            Some(text) => bands(text, all_nm.len()).map_err(|e| usage(format!("--bands {text}: {e}")))?,
        };
        let window = args.crop.unwrap_or(chart.size().rect());
        if !chart.size().rect().contains(window) {
            return Err(usage(format!(
                "--crop {},{},{},{} leaves the image of {} (rows x columns)",
                window.x,
                window.y,
                window.width,
                window.height,
                chart.size()
            )));
        }
        let wavelengths_nm = bands.iter().map(|&b| all_nm[b]).collect();
        Ok(Self { chart, bands, wavelengths_nm, window })
    }

    fn source(&self, cancel: &'static AtomicBool) -> Selected<'_> {
        Selected { inner: self.chart.source(), bands: &self.bands, cancel }
    }
}

/// Some bands of a source, until they are not wanted any more.
struct Selected<'a> {
    inner: &'a dyn ChartSource,
    bands: &'a [usize],
    cancel: &'static AtomicBool,
}

impl ChartSource for Selected<'_> {
    fn size(&self) -> Size {
        self.inner.size()
    }

    fn read(&self, band: usize, rect: Rect, out: &mut [f32]) -> Result<(), SourceSinkError> {
        if self.cancel.load(Relaxed) {
            return Err("interrupted".into());
        }
        self.inner.read(self.bands[band], rect, out)
    }

    fn prefetch(&self, band: usize, rect: Rect) {
        self.inner.prefetch(self.bands[band], rect);
    }
}

/// Bytes for buffers out of `--memory`.
fn usable(args: &ExportArgs) -> usize {
    let limit = args.memory.unwrap_or_else(default_limit) as f64;
    ((limit * (1.0 - SLACK)) as usize).saturating_sub(BASE)
}

fn write(args: &ExportArgs, file: FileArg, cancel: &'static AtomicBool) -> Result<()> {
    match file {
        FileArg::Png => picture(args, ColourFile::Png, cancel),
        FileArg::Tiff => picture(args, ColourFile::Tiff, cancel),
        other => data::write(args, other, usable(args), cancel),
    }
}

/// A picture: all bands in colour, or one in grey.
fn picture(args: &ExportArgs, file: ColourFile, cancel: &'static AtomicBool) -> Result<()> {
    let exposure = match args.exposure.as_str() {
        "auto" => Exposure::Auto,
        factor => match factor.parse::<f64>() {
            Ok(f) if f.is_finite() && f > 0.0 => Exposure::Factor(f),
            _ => return Err(usage(format!("--exposure {factor}: expected `auto` or a factor above 0"))),
        },
    };
    let white: White = args.white.parse().map_err(|e| usage(format!("--white {}: {e}", args.white)))?;
    let memory = usable(args);
    let mut opened = Opened::new(args, memory / 4)?;
    let threads = threads(args.threads);
    opened.chart.lay_out(&opened.bands, parent_of(&args.out), threads)?;
    let window = opened.window;
    let max_side = match file {
        ColourFile::Png => Some(args.max_side.unwrap_or(PNG_SIDE)),
        ColourFile::Tiff => args.max_side,
    };
    let view = View { window: Some(window), max_side, threads };
    let (bar, progress) = counting("reading");
    let (source, nm) = (opened.source(cancel), &opened.wavelengths_nm);
    let longest = window.height.max(window.width);
    let share = max_side.map_or(1.0, |m| (m as f64 / longest as f64).min(1.0));
    let pixels = window.size().pixels() as f64 * share * share;
    let whole = pixels * PICTURE_PIXEL as f64 <= memory as f64 / 2.0;
    let options = PreviewOptions { view, white, exposure };
    let shown = match args.band {
        Some(wanted) => {
            write_grey(&args.out, &source, nm, wanted, &GreyOptions { view, exposure }, &progress)?
        }
        None if whole && file == ColourFile::Png => {
            write_preview(&args.out, &source, nm, &options, &progress)?
        }
        None => write_streamed(&args.out, &source, nm, &options, file, &progress)?,
    };
    bar.finish_and_clear();
    tell(&args.out, &shown);
    Ok(())
}

fn tell(out: &Path, shown: &Shown) {
    say(format!(
        "{}: {}x{} px, exposure {:.6} (give `--exposure {:.6}` to make another picture comparable)",
        out.display(),
        shown.size.width,
        shown.size.height,
        shown.exposure,
        shown.exposure
    ));
    if shown.missing_samples > 0 {
        say(format!(
            "note: {} samples are missing (shards not yet made) and show as a grey chequer",
            shown.missing_samples
        ));
    }
}
