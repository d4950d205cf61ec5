//! `lenscube develop`: raw → picture, in strips of rows.
//!
//! A strip is read with its halo, developed, converted to codes and encoded on one thread, and appended in order (`formats::developed`), so
//! memory holds a strip per thread and the decoded chunks that two successive strips share.

use crate::args::{DevelopArgs, DevelopStyle, ToneArg};
use crate::camera::Developer;
use crate::camera::frame::Frame;
use crate::failure::{code, usage};
use crate::machine::threads;
use crate::machine::{default_limit, peak_resident};
use crate::outputs::check_absent;
use crate::progress::interrupt;
use crate::progress::mib;
use crate::progress::{counting, log_line};
use anyhow::{Result, bail};
use formats::developed::{Developed, write_exr, write_png, write_tiff};
use formats::raw::RawSpec;
use pipeline::develop::{Quantizer, Tone};
use pipeline::geometry::Rect;
use std::ops::Range;
use std::path::Path;
use std::sync::atomic::Ordering::Relaxed;
use std::time::Instant;

/// The program, its threads' stacks, the allocator.
const BASE: usize = 48 << 20;
/// Default limit of memory, at most.
const DEFAULT_MEMORY: u64 = 1 << 30;
/// Rows of a strip, and the least.
const ROWS: [usize; 3] = [64, 32, 16];
/// Bytes of a strip per pixel: digital numbers, values, padded values, linear values, codes, filtered and encoded bytes.
const STRIP_PIXEL_BYTES: usize = 4 * 3 + 12 + 6 + 6 + 6;

/// Format of the picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Format {
    Png,
    Tiff,
    Exr,
}

/// Runs the command and returns its exit code.
pub fn command(args: &DevelopArgs) -> Result<u8> {
    let format = format_of(&args.out)?;
    check_flags(&args.style, format, &args.out)?;
    check_absent(&args.out, args.overwrite)?;
    let cancel = interrupt::cancel_flag_of_removable_output();
    match write(args, format) {
        Err(_) if cancel.load(Relaxed) => {
            log_line("interrupted: nothing was written");
            Ok(code::INTERRUPTED)
        }
        other => other.map(|()| 0),
    }
}

fn format_of(out: &Path) -> Result<Format> {
    let ending = out.extension().map(|e| e.to_string_lossy().to_ascii_lowercase());
    match ending.as_deref() {
        Some("png") => Ok(Format::Png),
        Some("tif" | "tiff") => Ok(Format::Tiff),
        Some("exr") => Ok(Format::Exr),
        _ => Err(usage(format!("{}: expected a picture, .png, .tif or .exr", out.display()))),
    }
}

fn check_flags(style: &DevelopStyle, format: Format, out: &Path) -> Result<()> {
    if format == Format::Exr && style.depth.is_some() {
        return Err(usage(format!("--depth is for PNG and TIFF; {} holds 32-bit floats", out.display())));
    }
    if format == Format::Exr && style.tone == Some(ToneArg::Srgb) {
        return Err(usage(format!("--tone srgb is for PNG and TIFF; {} holds linear light", out.display())));
    }
    Ok(())
}

fn write(args: &DevelopArgs, format: Format) -> Result<()> {
    let start = Instant::now();
    let threads = threads(args.threads);
    let open = |cache| {
        let frame = Frame::open(&args.raw, args.frame, cache)?;
        let frame = if args.correct_defects { frame.without_defects() } else { frame };
        if args.merge { frame.merged() } else { Ok(frame) }
    };
    let first = open(0)?;
    let width = args.crop.map_or(first.rect.width, |c| c.width * usize::from(args.style.bin));
    let limit = args.memory.unwrap_or_else(|| default_limit().min(DEFAULT_MEMORY));
    let raws = first.reads() + usize::from(args.style.shading != "none");
    let memory = Memory::plan(limit, threads, width, raws)?;
    // One cache for all frames of the raw.
    let frame = open(memory.cache * first.reads())?;
    drop(first);
    let developer = Developer::new(frame, &args.style, memory.threads, memory.cache)?;
    let all = developer.rect();
    let region = args.crop.unwrap_or(all);
    if !all.contains(region) {
        return Err(usage(format!(
            "--crop {},{},{},{} is not inside the picture of {}",
            region.x,
            region.y,
            region.width,
            region.height,
            all.size()
        )));
    }
    let comment = comment(args, &developer);
    log_line(&comment);
    let linear = format == Format::Exr || args.style.tone == Some(ToneArg::Linear);
    let picture = Developed {
        path: &args.out,
        size: region.size(),
        channels: developer.channels(),
        depth: args.style.depth.unwrap_or(8),
        linear,
        comment: &comment,
        rows: memory.rows,
        threads: memory.threads,
    };
    let cancel = interrupt::cancel_flag();
    let values = |rows: Range<usize>| {
        if cancel.load(Relaxed) {
            bail!("interrupted");
        }
        let part = Rect::new(region.y + rows.start as i64, region.x, rows.len(), region.width);
        developer.linear(part)
    };
    let (bar, progress) = counting("developing");
    if format == Format::Exr {
        write_exr(&picture, &progress, values)?;
    } else {
        let tone = if linear { Tone::Linear } else { Tone::Srgb };
        let quantizer = Quantizer::new(tone, picture.depth);
        let codes = |rows| values(rows).map(|all| quantizer.codes(&all));
        match format {
            Format::Png => write_png(&picture, &progress, codes)?,
            _ => write_tiff(&picture, &progress, codes)?,
        }
    }
    bar.finish_and_clear();
    let (seconds, pixels) = (start.elapsed().as_secs_f64(), region.size().pixels() as f64 * 1e-6);
    log_line(format!(
        "{}: {} px, {pixels:.1} Mpx in {seconds:.1} s, {:.1} Mpx/s, peak memory {}",
        args.out.display(),
        region.size(),
        pixels / seconds,
        peak_resident().map_or("unknown".into(), |b| mib(b as usize))
    ));
    Ok(())
}

/// What the picture was made of, for its header and the log.
fn comment(args: &DevelopArgs, developer: &Developer) -> String {
    let (frame, style) = (&developer.frame, &args.style);
    let digest = frame.job_digest();
    format!(
        "lenscube {} develop: raw of job {}, sensor {}, frame {} of {:.6e} s{}, gain {}; {}, shading {}, exposure {} EV{}",
        env!("CARGO_PKG_VERSION"),
        &digest[..digest.len().min(16)],
        frame.sensor.name,
        frame.number(),
        frame.exposure_s(),
        if args.merge { format!(" with all {}", frame.reads()) } else { String::new() },
        frame.gain,
        developer.description,
        style.shading,
        style.exposure,
        if args.correct_defects { ", defects corrected" } else { "" },
    )
}

/// How memory is spent.
struct Memory {
    rows: usize,
    threads: usize,
    /// Decoded chunks of each raw, bytes.
    cache: usize,
}

impl Memory {
    /// Within `limit` bytes, for rows of `width` pixels and `raws` raws.
    fn plan(limit: u64, threads: usize, width: usize, raws: usize) -> Result<Self> {
        let limit = usize::try_from(limit).unwrap_or(usize::MAX) / 16 * 15;
        let chunk = RawSpec::chunk_shape();
        // A row of chunks decoded once for all strips in it, and the next one where a strip crosses to it.
        let row = 4 * chunk.0 * (width.div_ceil(chunk.1) + 1) * chunk.1;
        let strip = |rows: usize| (rows + 16) * width * (STRIP_PIXEL_BYTES + 4 * (raws - 1)) + (4 << 20);
        let fit = |rows: usize, threads: usize| BASE + threads * strip(rows) + raws * row <= limit;
        let choices = ROWS.iter().flat_map(|rows| (1..=threads).rev().map(move |t| (*rows, t)));
        let Some((rows, threads)) = choices
            .clone()
            .find(|(rows, t)| *t == threads && fit(*rows, *t))
            .or_else(|| choices.clone().rev().find(|(rows, t)| fit(*rows, *t)))
        else {
            let least = (BASE + strip(16) + raws * row) / 15 * 16;
            return Err(usage(format!(
                "--memory: rows of {width} pixels need at least {}; give that much, or a --crop",
                mib(least)
            )));
        };
        let free = limit - BASE - threads * strip(rows);
        Ok(Self { rows, threads, cache: (2 * row).min(free / raws) })
    }
}

#[cfg(test)]
mod tests {
    use super::Memory;

    #[test]
    fn widest_sensor_fits_in_256_mib() {
        let memory = Memory::plan(256 << 20, 2, 14141, 1).unwrap();
        assert!(memory.threads == 2 && memory.cache >= 28 << 20);
        assert!(Memory::plan(64 << 20, 2, 14141, 1).is_err());
        let memory = Memory::plan(1 << 30, 2, 14141, 2).unwrap();
        assert_eq!((memory.rows, memory.threads), (64, 2));
    }
}
