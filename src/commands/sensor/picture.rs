//! `lenscube sensor FILM OUT.dng|.tif|.png`: one frame as a file.
//!
//! The frame is exposed into a raw beside the file, `OUT.raw.zarr`, so that an interrupted command resumes; when the file is complete, that
//! raw is removed. DNG holds the digital numbers; TIFF and PNG hold them as 16-bit grey, scaled so that 2^bits − 1 is 65535, or as they are
//! (`--keep-dn`).

use super::raw;
use super::resolve::RawJob;
use crate::args::ExposeArgs;
use crate::camera::frame::Frame;
use crate::camera::shading::gain_maps;
use crate::failure::{code, replacing_other_job, usage};
use crate::machine::threads;
use crate::outputs::check_absent;
use crate::progress::interrupt;
use crate::progress::{counting, log_line};
use anyhow::{Result, anyhow, bail};
use formats::developed::{Developed, write_png, write_tiff};
use formats::dng::{Dng, DngColour, write_dng};
use formats::durable::fault_point;
use formats::raw::{RawSpec, RawStore};
use pipeline::colour::Illuminant;
use pipeline::develop::{ColourMatrix, PlanePattern};
use pipeline::geometry::Rect;
use pipeline::sensor::{NoiseSet, Sensor};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
use std::sync::atomic::Ordering::Relaxed;

/// Rows of a strip.
const ROWS: usize = 64;
/// Pixels of 16 bits from which on a classic TIFF, of less than 4 GiB, is too small.
const MAX_DNG_PIXELS: usize = ((1 << 32) - (1 << 24)) / 2;

/// Greatest linear number of a DNG.
const MAX_DNG_DN: f64 = 65535.0;

/// Format of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FileFormat {
    /// Digital negative.
    Dng,
    /// 16-bit grey.
    Tiff,
    /// 16-bit grey.
    Png,
}

/// The format of an output that is one file; `None`: a raw.
pub fn format_of(out: &Path) -> Result<Option<FileFormat>> {
    let ending = out.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
    Ok(match ending.as_str() {
        "dng" => Some(FileFormat::Dng),
        "tif" | "tiff" => Some(FileFormat::Tiff),
        "png" => Some(FileFormat::Png),
        "exr" | "jpg" | "jpeg" | "npy" => {
            return Err(usage(format!(
                "{}: `lenscube sensor` writes .zarr, .dng, .tif and .png; pictures in colour are made by `lenscube develop`",
                out.display()
            )));
        }
        _ => None,
    })
}

/// The raw beside the file `out`.
pub fn temporary_raw(out: &Path) -> PathBuf {
    let mut name = out.as_os_str().to_owned();
    name.push(".raw.zarr");
    name.into()
}

/// Exposes one frame of `film` into `out`. With `--overwrite` a raw of the same job is resumed,
/// one of another job replaced.
pub fn command(args: &ExposeArgs, film: &str, (out, format): (&Path, FileFormat)) -> Result<u8> {
    let shown = out.display();
    let several =
        args.frames > 1 || args.roi.len() > 1 || args.exposure.as_deref().is_some_and(|e| e.contains(','));
    if several || args.keep_signal {
        return Err(usage(format!(
            "{shown} holds one frame: --frames, several exposures or --roi, and --keep-signal need a raw such as {}",
            out.with_extension("zarr").display()
        )));
    }
    check_absent(out, args.overwrite)?;
    let job = RawJob::new(args, film)?;
    let rect = job.outputs[0].rect;
    if format == FileFormat::Dng {
        check_dng(&job.sensor, rect, out)?;
    }
    let path = temporary_raw(out);
    let resuming = ExposeArgs { overwrite: false, ..args.clone() };
    let code = replacing_other_job(
        args.overwrite,
        || raw::expose(&resuming, &job, &path),
        || raw::remove(&path, args.take_over),
    )?;
    if code != 0 {
        return Ok(code);
    }
    let cancel = interrupt::cancel_flag();
    fault_point("file-begins");
    match convert(args, &job, &path, (out, format), cancel) {
        Err(_) if cancel.load(Relaxed) => {
            log_line(format!("interrupted: {shown} was not written; the same command resumes"));
            return Ok(code::INTERRUPTED);
        }
        converted => converted?,
    }
    RawStore::remove(&path)?;
    log_line(format!("wrote {shown}: {} px", rect.size()));
    Ok(0)
}

/// Fails for a sensor, numbers or a size that DNG cannot hold.
fn check_dng(sensor: &Sensor, rect: Rect, out: &Path) -> Result<()> {
    if sensor.planes().len() > 1 && dng_pattern(sensor, (0, 0)).is_none() {
        return Err(usage(format!(
            "{}: DNG holds Bayer and quad patterns of R, G and B, and monochrome raws; sensor {} has {} x {} pixels of {}; write .zarr",
            out.display(),
            sensor.name,
            sensor.pattern.rows,
            sensor.pattern.columns,
            sensor.planes().join(", ")
        )));
    }
    if sensor.adc.max_linear_dn() > MAX_DNG_DN {
        return Err(usage(format!(
            "{}: companding.linear_dn ends at {} DN, but the LinearizationTable of a DNG ends at {MAX_DNG_DN}; write .zarr and develop it",
            out.display(),
            sensor.adc.max_linear_dn()
        )));
    }
    if rect.size().pixels() >= MAX_DNG_PIXELS {
        return Err(usage(format!(
            "{}: {} pixels need 4 GiB or more, which DNG cannot hold; write .zarr, or a region with --roi",
            out.display(),
            rect.size()
        )));
    }
    Ok(())
}

/// Colours 0, 1, 2 over a period that begins at a pixel of the sensor; `None` for other patterns than Bayer and quad.
fn dng_pattern(sensor: &Sensor, (row, column): (usize, usize)) -> Option<Vec<Vec<u8>>> {
    let (p, of) = (&sensor.pattern, sensor.plane_of_channels());
    if sensor.planes() != ["R", "G", "B"] || p.rows != p.columns {
        return None;
    }
    let step = match p.rows {
        2 => 1,
        4 => 2,
        _ => return None,
    };
    let plane = |y: usize, x: usize| of[p.channel(y, x)];
    let quad = (0..4).all(|y| (0..4).all(|x| plane(y, x) == plane(y / step * step, x / step * step)));
    let planes = (0..4).map(|k| plane(step * (k / 2), step * (k % 2))).collect();
    let bayer = PlanePattern { rows: 2, columns: 2, planes, count: 3 };
    let period = |y: usize| (0..p.columns).map(|x| plane(row + y, column + x) as u8).collect();
    (quad && bayer.is_bayer()).then(|| (0..p.rows).map(period).collect())
}

/// Matrices and neutral of a sensor of three planes.
fn colour(sensor: &Sensor, light: Illuminant) -> Result<DngColour> {
    let of = sensor.plane_of_channels();
    let gains = |light| -> [f64; 3] {
        let gains = sensor.white_gains(light);
        let plane = |p: usize| {
            let own: Vec<f64> =
                std::iter::zip(&gains, &of).filter(|(_, q)| **q == p).map(|(g, _)| 1.0 / g).collect();
            own.len() as f64 / own.iter().sum::<f64>()
        };
        std::array::from_fn(plane)
    };
    let matrix = |light| -> Result<[[f64; 3]; 3]> {
        let fitted = ColourMatrix::fitted(sensor, light).map_err(|e| usage(e.to_string()))?;
        Ok(fitted.xyz_to_planes(light, gains(light)))
    };
    Ok(DngColour {
        matrices: [matrix(Illuminant::A)?, matrix(Illuminant::D65)?],
        neutral: gains(light).map(|g| 1.0 / g),
    })
}

/// Light of the neutral: the one given, else that of the film's chart, else D65, which a note says of a file in colour.
fn neutral_light(args: &ExposeArgs, frame: &Frame, out: &Path, coloured: bool) -> Illuminant {
    args.white.or_else(|| frame.light()).unwrap_or_else(|| {
        let light = Illuminant::default();
        if coloured {
            log_line(format!(
                "note: {}: the film does not record its chart's light; the neutral is that of {}; --white names another",
                out.display(),
                light.name()
            ));
        }
        light
    })
}

/// S and O of the noise profile: only of noises that are on, and of two conversion gains of the high one. The variance is S·x + O of x = (DN − black)/(white − black), which contains the
/// mean dark charge: S·x has its shot noise.
fn noise_profile(job: &RawJob, seconds: f64) -> (f64, f64) {
    let (s, e) = (&job.sensor, &job.exposure);
    let dark_e = e.noise.on(NoiseSet::DARK, s.dark_current_e_per_s(e.temperature_c) * seconds);
    let dark = s.noise_variance(e.noise, job.gain, dark_e, dark_e);
    let share_per_e = job.gain * s.adc.gain_dn_per_e / (s.white_dn(job.gain) - s.adc.black_dn);
    let offset_e2 = dark.frames_e2 + dark.rounding_e2 + dark.fixed_e2;
    (e.noise.on(NoiseSet::SHOT, share_per_e), share_per_e * share_per_e * offset_e2)
}

/// Linear numbers of all stored ones, where they differ; they are at most 16 bits ([`check_dng`]).
fn linearization(sensor: &Sensor) -> Option<Vec<u16>> {
    Some(sensor.adc.linear_table()?.iter().map(|v| (v + 0.5) as u16).collect())
}

/// Writes the file from the raw.
fn convert(
    args: &ExposeArgs,
    job: &RawJob,
    raw: &Path,
    (out, format): (&Path, FileFormat),
    cancel: &AtomicBool,
) -> Result<()> {
    let chunk = RawSpec::chunk_shape();
    let rect = job.outputs[0].rect;
    let cache = 2 * 4 * chunk.0 * (rect.width.div_ceil(chunk.1) * chunk.1);
    let name = raw.to_str().ok_or_else(|| anyhow!("{}: expected a UTF-8 name", raw.display()))?;
    let frame = Frame::open(name, 0, cache)?;
    let (sensor, threads) = (&frame.sensor, threads(args.threads));
    let (bar, progress) = counting("writing");
    let read = |rows: Range<usize>| {
        if cancel.load(Relaxed) {
            bail!("interrupted");
        }
        frame.read_stored(Rect::new(rows.start as i64, 0, rows.len(), rect.width))
    };
    let comment = format!(
        "lenscube {} sensor: {}, raw of job {}, {:.6e} s, gain {}, seed {}, die {}",
        env!("CARGO_PKG_VERSION"),
        sensor.name,
        &frame.job_digest()[..frame.job_digest().len().min(16)],
        frame.exposure_s(),
        frame.gain,
        args.seed,
        args.die
    );
    if format == FileFormat::Dng {
        let pattern = dng_pattern(sensor, (rect.y as usize, rect.x as usize));
        if pattern.as_ref().is_some_and(|p| p.len() == 4) {
            log_line(format!(
                "note: {}: raw developers may not know quad patterns (LibRaw 0.22 shows wrong colours); `lenscube develop` of a .zarr does",
                out.display()
            ));
        }
        let light = neutral_light(args, &frame, out, pattern.is_some());
        let dng = Dng {
            size: rect.size(),
            sensor: &sensor.name,
            colour: if pattern.is_some() { colour(sensor, light)? } else { DngColour::default() },
            pattern,
            black_white_dn: frame.black_white_dn(),
            noise: noise_profile(job, frame.exposure_s()),
            exposure_s: frame.exposure_s(),
            iso: sensor.adc.base_iso.map(|iso| iso * frame.gain),
            linear_dn: linearization(sensor),
            gain_maps: gain_maps(&frame)?,
            description: &comment,
        };
        let numbers = |rows| read(rows).map(|all| all.iter().map(|v| *v as u16).collect());
        write_dng(out, &dng, (ROWS, threads), &progress, numbers)?;
    } else {
        let (scale, meaning) = match args.keep_dn {
            true => (1.0, "values are DN".to_owned()),
            false => (65535.0 / sensor.adc.max_dn() as f32, format!("65535 is {} DN", sensor.adc.max_dn())),
        };
        if !args.keep_dn && sensor.adc.max_dn() < 65535.0 {
            log_line(format!(
                "note: {}: {meaning}; --keep-dn writes digital numbers as they are",
                out.display()
            ));
        }
        let picture = Developed {
            path: out,
            size: rect.size(),
            channels: 1,
            depth: 16,
            linear: true,
            comment: &format!("{comment}; {meaning}"),
            rows: ROWS,
            threads,
        };
        let codes = |rows| read(rows).map(|all| all.iter().map(|v| (v * scale + 0.5) as u16).collect());
        match format {
            FileFormat::Png => write_png(&picture, &progress, codes)?,
            _ => write_tiff(&picture, &progress, codes)?,
        }
    }
    bar.finish_and_clear();
    Ok(())
}
