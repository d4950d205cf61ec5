//! Export of unconverted samples: EXR, TIFF of bands, ENVI, NPY.

use super::{Input, Selected};
use crate::args::{ExportArgs, ExportFormatArg};
use crate::failure::usage;
use crate::machine::peak_resident;
use crate::machine::threads;
use crate::open;
use crate::progress::{counting, data_size, log_line, plural};
use anyhow::Result;
use formats::durable::parent_of;
use formats::export::exr::{ExrOptions, write_exr};
use formats::export::flat::{write_envi, write_npy};
use formats::export::regions::Regions;
use formats::export::tiff::write_bands;
use formats::export::{Samples, Written};
use pipeline::geometry::Size;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

/// Rows per read of the formats that are written band by band.
const ROWS_PER_READ: usize = 512;

/// Writes the file with at most `memory` bytes of buffers.
pub(super) fn write(
    args: &ExportArgs,
    file: ExportFormatArg,
    memory: usize,
    cancel: &'static AtomicBool,
) -> Result<()> {
    let start = Instant::now();
    let first = Input::new(args, 0)?;
    let threads = threads(args.threads);
    let description = format!("lenscube {}, {} of {}", env!("CARGO_PKG_VERSION"), first.region, args.film);
    let regions = (file == ExportFormatArg::Exr)
        .then(|| {
            let source = first.source(cancel);
            let samples = samples(&first, &source, &description, threads);
            Regions::plan(&samples, ExrOptions::sample_bytes(args.half), memory)
                .map_err(|e| usage(format!("--memory: {e}")))
        })
        .transpose()?;
    let cache = match regions {
        Some(regions) => regions.cache_bytes,
        None => first.chart.cache_for_rows(ROWS_PER_READ).min(memory / 2),
    };
    // Opened again with the cache size now known; the first time only metadata were read.
    drop(first);
    let mut input = Input::new(args, cache)?;
    open::sort_by_band(&mut input.chart, &input.bands, parent_of(args.target()), threads)?;
    let source = input.source(cancel);
    let samples = samples(&input, &source, &description, threads);
    let (bar, progress) = counting("writing");
    let written = match (file, regions) {
        (ExportFormatArg::Exr, Some(regions)) => {
            print_plan(&regions, samples.chunk);
            let compression = args.compression.unwrap_or_default();
            let options = ExrOptions { half: args.half, compression, regions };
            write_exr(args.target(), &samples, &options, &progress)?
        }
        (ExportFormatArg::TiffBands, _) => write_bands(args.target(), &samples, &progress)?,
        (ExportFormatArg::Envi, _) => write_envi(args.target(), &samples, &progress)?,
        _ => write_npy(args.target(), &samples, &progress)?,
    };
    bar.finish_and_clear();
    print_summary(args, &samples, written, start.elapsed().as_secs_f64());
    Ok(())
}

fn samples<'a>(
    input: &'a Input,
    source: &'a Selected<'a>,
    description: &'a str,
    threads: usize,
) -> Samples<'a> {
    Samples {
        source,
        wavelengths_nm: &input.wavelengths_nm,
        rect: input.region,
        chunk: input.chart.chunk_size(),
        units: input.chart.units(),
        pitch_um: input.chart.pitch_um(),
        description,
        threads,
    }
}

fn print_plan(regions: &Regions, chunk: Size) {
    let decoding = match chunk.pixels() {
        1 => String::new(),
        _ => format!("; each chunk is decoded {:.2} times on average", regions.decoded),
    };
    log_line(format!("reading blocks of {} px of all bands, column by column{decoding}", regions.region));
    if regions.is_short_of_memory() {
        log_line("note: with more --memory chunks are decoded fewer times");
    }
}

fn print_summary(args: &ExportArgs, samples: &Samples<'_>, written: Written, seconds: f64) {
    let pixels = (samples.bands() * samples.rect.size().pixels()) as f64;
    let peak = peak_resident().map_or(String::new(), |p| format!(", peak memory {} MiB", p >> 20));
    log_line(format!(
        "{}: {} of {} px, {} in {seconds:.1} s, {:.1} Mpx/s{peak}",
        args.out.display(),
        plural(samples.bands(), "band"),
        samples.rect.size(),
        data_size(written.bytes),
        pixels / seconds * 1e-6,
    ));
    if written.missing > 0 {
        log_line(format!(
            "note: {} samples are missing (shards not yet made) and are NaN in the file",
            written.missing
        ));
    }
}
