//! `lenscube export`: writes a film, a chart or a region as a picture or as a data file for other programs.

mod data;
mod stdout;

use crate::args::{ExportArgs, ExportFormatArg};
use crate::failure::{code, usage};
use crate::job::chosen_bands;
use crate::machine::{default_limit, threads};
use crate::open::{self, Chart, ChartFlags};
use crate::outputs::check_absent;
use crate::progress::interrupt;
use crate::progress::{counting, log_line};
use anyhow::Result;
use formats::chart::NanPolicy;
use formats::durable::{fault_point, parent_of};
use formats::export::flat::envi_files;
use formats::picture::exposure::Exposure;
use formats::picture::grey::{GreyOptions, write_grey};
use formats::picture::preview::{PreviewOptions, White, write_preview};
use formats::picture::streamed::{ColourFile, write_streamed};
use formats::picture::{PictureSummary, View, nearest_band};
use pipeline::flow::{ChartSource, SourceSinkError};
use pipeline::geometry::{Rect, Size};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};

/// Memory of the program without buffers: code, stacks of the threads, allocator.
const PROGRAM_BYTES: usize = 48 << 20;
/// Share of the memory lost to fragmentation in the allocator.
const FRAGMENTATION: f64 = 0.08;
/// Default maximum side of a PNG, px.
const DEFAULT_PNG_SIDE: usize = 2048;
/// Memory per pixel of a picture held in memory: linear colour and display bytes.
const PICTURE_PIXEL_BYTES: usize = 15;

/// Runs the command and returns its exit code.
pub fn command(args: &ExportArgs) -> Result<u8> {
    match args.out == Path::new("-") {
        true => stdout::command(args),
        false => to_file(args, format_of(args)?),
    }
}

/// The files that are written; none to standard output.
///
/// # Errors
/// Usage: no format has the extension.
pub fn files(args: &ExportArgs) -> Result<Vec<PathBuf>> {
    match args.out == Path::new("-") {
        true => Ok(Vec::new()),
        false => Ok(files_of(args, format_of(args)?)),
    }
}

fn files_of(args: &ExportArgs, file: ExportFormatArg) -> Vec<PathBuf> {
    match file {
        ExportFormatArg::Envi => <[_; 2]>::from(envi_files(args.target())).to_vec(),
        _ => vec![args.target().to_owned()],
    }
}

/// Writes the file, or the two files, of [`ExportArgs::target`].
fn to_file(args: &ExportArgs, file: ExportFormatArg) -> Result<u8> {
    check_flags(args, file)?;
    files_of(args, file).iter().try_for_each(|path| check_absent(path, args.overwrite))?;
    let cancel = interrupt::cancel_flag_of_removable_output();
    match write(args, file, cancel) {
        Err(_) if cancel.load(Relaxed) => {
            log_line("interrupted: nothing was written");
            Ok(code::INTERRUPTED)
        }
        other => other.map(|()| 0),
    }
}

/// Format given by `--format` or by the extension.
fn format_of(args: &ExportArgs) -> Result<ExportFormatArg> {
    if let Some(format) = args.format {
        return Ok(format);
    }
    let extension = args.out.extension().map(|e| e.to_string_lossy().to_ascii_lowercase());
    Ok(match extension.as_deref() {
        Some("png") => ExportFormatArg::Png,
        Some("tif" | "tiff" | "btf") => ExportFormatArg::Tiff,
        Some("exr") => ExportFormatArg::Exr,
        Some("hdr" | "bsq" | "img") => ExportFormatArg::Envi,
        Some("npy") => ExportFormatArg::Npy,
        _ => {
            return Err(usage(format!(
                "{}: no format has this extension; use .png, .tif, .exr, .hdr or .npy, or give --format",
                args.out.display()
            )));
        }
    })
}

/// Fails on a flag that does not apply to the format.
fn check_flags(args: &ExportArgs, file: ExportFormatArg) -> Result<()> {
    let (exr, png) = (file == ExportFormatArg::Exr, file == ExportFormatArg::Png);
    let picture = png || file == ExportFormatArg::Tiff;
    let flags = [
        (args.half && !exr, "--half", "EXR"),
        (args.compression.is_some() && !exr, "--compression", "EXR"),
        (args.max_side.is_some() && !picture, "--max-side", "PNG and TIFF pictures"),
        (args.exposure != "auto" && !picture, "--exposure", "PNG and TIFF pictures"),
        (args.white != "D65" && !picture, "--white", "PNG and TIFF pictures"),
    ];
    match flags.into_iter().find(|(wrong, ..)| *wrong) {
        Some((_, flag, formats)) => {
            Err(usage(format!("{flag} applies to {formats} only, not to {}", args.out.display())))
        }
        None => Ok(()),
    }
}

/// Bands and region of an opened input.
struct Input {
    chart: Chart,
    bands: Vec<usize>,
    wavelengths_nm: Vec<f64>,
    region: Rect,
}

impl Input {
    fn new(args: &ExportArgs, cache_bytes: usize) -> Result<Self> {
        // Shards that do not exist yet are NaN and shown as missing.
        let flags = ChartFlags {
            wavelengths: args.wavelengths.as_deref(),
            var: args.var.as_deref(),
            axes: args.axes.as_ref(),
            nan: NanPolicy::Keep,
            cache_bytes,
            ..ChartFlags::default()
        };
        let chart = open::chart_with(&args.film, &flags)?;
        let all_nm = chart.wavelengths_nm()?;
        let bands = match (&args.bands, args.band) {
            (Some(text), _) => chosen_bands(text, &all_nm)?,
            (None, Some(nm)) => vec![nearest_band(&all_nm, nm)?],
            (None, None) => (0..all_nm.len()).collect(),
        };
        let region = args.crop.unwrap_or(chart.size().rect());
        if !chart.size().rect().contains(region) {
            return Err(usage(format!(
                "--crop {},{},{},{} is not inside the image of {}",
                region.x,
                region.y,
                region.width,
                region.height,
                chart.size()
            )));
        }
        let wavelengths_nm = bands.iter().map(|&b| all_nm[b]).collect();
        Ok(Self { chart, bands, wavelengths_nm, region })
    }

    fn source(&self, cancel: &'static AtomicBool) -> Selected<'_> {
        Selected { inner: self.chart.source(), bands: &self.bands, cancel }
    }
}

/// Selected bands of a source; reading fails after an interrupt.
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
        fault_point("export-reads");
        if self.cancel.load(Relaxed) {
            return Err("interrupted".into());
        }
        self.inner.read(self.bands[band], rect, out)
    }

    fn prefetch(&self, band: usize, rect: Rect) {
        self.inner.prefetch(self.bands[band], rect);
    }
}

/// Bytes of `--memory` that are left for buffers.
fn buffer_bytes(args: &ExportArgs) -> usize {
    let limit = args.memory.unwrap_or_else(default_limit) as f64;
    ((limit * (1.0 - FRAGMENTATION)) as usize).saturating_sub(PROGRAM_BYTES)
}

fn write(args: &ExportArgs, file: ExportFormatArg, cancel: &'static AtomicBool) -> Result<()> {
    match file {
        ExportFormatArg::Png => picture(args, ColourFile::Png, cancel),
        ExportFormatArg::Tiff => picture(args, ColourFile::Tiff, cancel),
        other => data::write(args, other, buffer_bytes(args), cancel),
    }
}

/// Writes a picture: all bands in colour, or one band in grey.
fn picture(args: &ExportArgs, file: ColourFile, cancel: &'static AtomicBool) -> Result<()> {
    let exposure: Exposure =
        args.exposure.parse().map_err(|e| usage(format!("--exposure {}: {e}", args.exposure)))?;
    let white: White = args.white.parse().map_err(|e| usage(format!("--white {}: {e}", args.white)))?;
    let memory = buffer_bytes(args);
    let mut input = Input::new(args, memory / 4)?;
    let threads = threads(args.threads);
    open::sort_by_band(&mut input.chart, &input.bands, parent_of(args.target()), threads)?;
    let region = input.region;
    let max_side = match file {
        ColourFile::Png => Some(args.max_side.unwrap_or(DEFAULT_PNG_SIDE)),
        ColourFile::Tiff => args.max_side,
    };
    let view = View { region: Some(region), max_side, threads };
    let (bar, progress) = counting("reading");
    let (source, nm) = (input.source(cancel), &input.wavelengths_nm);
    let longest = region.height.max(region.width);
    let scale = max_side.map_or(1.0, |m| (m as f64 / longest as f64).min(1.0));
    let pixels = region.size().pixels() as f64 * scale * scale;
    let fits_in_memory = pixels * PICTURE_PIXEL_BYTES as f64 <= memory as f64 / 2.0;
    let options = PreviewOptions { view, white, exposure };
    let shown = match args.band {
        Some(band_nm) => {
            let options = GreyOptions { view, exposure };
            write_grey(args.target(), &source, nm, band_nm, &options, file, &progress)?
        }
        None if fits_in_memory && file == ColourFile::Png => {
            write_preview(args.target(), &source, nm, &options, &progress)?
        }
        None => write_streamed(args.target(), &source, nm, &options, file, &progress)?,
    };
    bar.finish_and_clear();
    print_summary(&args.out, &shown);
    Ok(())
}

/// Nine significant digits: films in physical units have exposures of any size.
fn exposure_text(exposure: f64) -> String {
    let rounded: f64 = format!("{exposure:.8e}").parse().unwrap_or(exposure);
    if (1e-4..1e9).contains(&rounded) { rounded.to_string() } else { format!("{rounded:e}") }
}

fn print_summary(out: &Path, shown: &PictureSummary) {
    let exposure = exposure_text(shown.exposure);
    log_line(format!(
        "{}: {} px, exposure {exposure} (use `--exposure {exposure}` for a comparable picture)",
        out.display(),
        shown.size,
    ));
    if shown.missing_samples > 0 {
        log_line(format!(
            "note: {} samples are missing (shards not yet made); their pixels show a grey chequerboard",
            shown.missing_samples
        ));
    }
}
