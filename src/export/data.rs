//! Samples as they are: EXR, TIFF of bands, ENVI, NPY.

use super::Opened;
use crate::args::{ExportArgs, FileArg, PackingArg};
use crate::failure::usage;
use crate::job::threads;
use crate::memory::peak_resident;
use crate::progress::{counting, say};
use anyhow::Result;
use formats::durable::parent_of;
use formats::export::exr::{ExrOptions, Packing, write_exr};
use formats::export::flat::{write_envi, write_npy};
use formats::export::regions::Regions;
use formats::export::tiff::write_pages;
use formats::export::{Samples, Written};
use pipeline::geometry::Size;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

/// Rows that formats written band by band read at once.
const STRIP_ROWS: usize = 512;

/// Writes the file, in `memory` bytes of buffers.
pub(super) fn write(
    args: &ExportArgs,
    file: FileArg,
    memory: usize,
    cancel: &'static AtomicBool,
) -> Result<()> {
    let start = Instant::now();
    let first = Opened::new(args, 0)?;
    let threads = threads(args.threads);
    let words = format!("lenscube {}, {} of {}", env!("CARGO_PKG_VERSION"), first.window, args.film);
    let regions = (file == FileArg::Exr)
        .then(|| {
            let samples = samples(&first, &words, threads, cancel);
            Regions::plan(&samples.borrow(), ExrOptions::sample_bytes(args.half), memory)
                .map_err(|e| usage(format!("--memory: {e}")))
        })
        .transpose()?;
    let cache = match regions {
        Some(regions) => regions.cache_bytes,
        None => first.chart.cache_for_rows(STRIP_ROWS).min(memory / 2),
    };
    // Opened again now that the cache's size is known; the first time only metadata were read.
    drop(first);
    let mut opened = Opened::new(args, cache)?;
    opened.chart.lay_out(&opened.bands, parent_of(&args.out), threads)?;
    let held = samples(&opened, &words, threads, cancel);
    let samples = held.borrow();
    let (bar, progress) = counting("writing");
    let written = match (file, regions) {
        (FileArg::Exr, Some(regions)) => {
            tell_plan(&regions, samples.piece);
            let packing = match args.compression {
                None | Some(PackingArg::Zip) => Packing::Zip,
                Some(PackingArg::Piz) => Packing::Piz,
                Some(PackingArg::None) => Packing::None,
            };
            let options = ExrOptions { half: args.half, packing, regions };
            write_exr(&args.out, &samples, &options, &progress)?
        }
        (FileArg::TiffBands, _) => write_pages(&args.out, &samples, &progress)?,
        (FileArg::Envi, _) => write_envi(&args.out, &samples, &progress)?,
        _ => write_npy(&args.out, &samples, &progress)?,
    };
    bar.finish_and_clear();
    tell(args, &samples, written, start.elapsed().as_secs_f64());
    Ok(())
}

/// What [`Samples`] borrows.
struct Held<'a> {
    source: super::Selected<'a>,
    opened: &'a Opened,
    words: &'a str,
    threads: usize,
}

fn samples<'a>(opened: &'a Opened, words: &'a str, threads: usize, cancel: &'static AtomicBool) -> Held<'a> {
    Held { source: opened.source(cancel), opened, words, threads }
}

impl Held<'_> {
    fn borrow(&self) -> Samples<'_> {
        Samples {
            source: &self.source,
            wavelengths_nm: &self.opened.wavelengths_nm,
            window: self.opened.window,
            piece: self.opened.chart.piece(),
            units: self.opened.chart.units(),
            description: self.words,
            threads: self.threads,
        }
    }
}

fn tell_plan(regions: &Regions, piece: Size) {
    let Size { height, width } = regions.region;
    let times = match piece.pixels() {
        1 => String::new(),
        _ => format!("; each chunk is decoded {:.2} times in the mean", regions.decoded),
    };
    say(format!("reading all bands of {width}x{height} px at a time, down the columns{times}"));
    if regions.is_short_of_memory() {
        say("note: with more --memory chunks would be decoded less often");
    }
}

fn tell(args: &ExportArgs, samples: &Samples<'_>, written: Written, seconds: f64) {
    let pixels = (samples.bands() * samples.window.size().pixels()) as f64;
    let peak = peak_resident().map_or(String::new(), |p| format!(", peak memory {} MiB", p >> 20));
    say(format!(
        "{}: {} bands of {}x{} px, {:.2} GB in {seconds:.1} s, {:.1} Mpx/s{peak}",
        args.out.display(),
        samples.bands(),
        samples.window.width,
        samples.window.height,
        written.bytes as f64 * 1e-9,
        pixels / seconds * 1e-6,
    ));
    if written.missing > 0 {
        say(format!(
            "note: {} samples are missing (shards not yet made) and are NaN in the file",
            written.missing
        ));
    }
}
