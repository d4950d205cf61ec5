//! `lenscube chart motion`: a chart that moves while the shutter is open, as one chart.
//!
//! A film is linear in its chart, so the film of a chart that moves is that of the mean of its places: one chart, in place of a run for each moment. At the time t the chart is shifted by s(t) and then rotated
//! about its middle by θ(t); its mean over the exposure is [`pipeline::sensor::motion`] with the chart in place of the film, all rows at once, and with the number of moments that follows from its
//! error bound. Left out: rows of a shutter that begin one after another; parts of a chart that move by themselves.

use super::store;
use crate::args::MotionArgs;
use crate::commands::sensor::motion::{MAX_MARGIN_PX, MAX_STEPS, check_covers, shifted};
use crate::commands::sensor::time;
use crate::failure::usage;
use crate::job::depth::surfaces::SurfacePaths;
use crate::machine::{MAX_DEFAULT, MemoryLimit, threads};
use crate::open;
use crate::outputs::check_absent;
use crate::progress::{detail_line, log_line};
use anyhow::Result;
use formats::chart::{Chart, ChartMeta, NanPolicy, NewChart};
use formats::durable::{create_directories, is_url, parent_of};
use formats::sensor::{CameraMotion, camera_motion};
use pipeline::sensor::motion::{Motion, RowTimes};
use serde_json::{Map, json};

/// Side of the shards of a chart.
const SHARD_PX: u64 = 2048;
/// Bytes of decoded chunks of the chart that are kept.
const CACHE_BYTES: usize = 128 << 20;

/// Runs the command.
pub fn command(args: &MotionArgs) -> Result<()> {
    let exposure_s = time("--exposure", &args.exposure)?;
    if !is_url(&args.out) {
        check_absent(&args.out, args.overwrite)?;
    }
    let mut chart = open::chart(&args.chart, args.wavelengths.as_deref(), NanPolicy::Error, CACHE_BYTES)?;
    check_flat(args, &chart)?;
    let pitch_um = match (args.pitch_um, chart.pitch_um()) {
        (Some(given), _) => given,
        (None, Some(own)) => own,
        (None, None) => {
            return Err(usage(format!(
                "chart {} has no pixel pitch, which makes micrometres of motion pixels: give --film-pitch-um",
                args.chart
            )));
        }
    };
    let wavelengths_nm = chart.wavelengths_nm()?;
    let motion = motion(args, &chart, exposure_s, pitch_um)?;
    let bands: Vec<usize> = (0..chart.bands()).collect();
    let (chunks, reach) = (chart.chunk_memory(&bands), 2 * motion.margin_px() as u64);
    let side = SHARD_PX + reach;
    // What is read around a shard; the shard, and its bytes as they are encoded; the weights of a motion; chunks on their way.
    let thread_bytes = 4 * (side * side + 4 * SHARD_PX * SHARD_PX)
        + 8 * reach * reach
        + (chunks.decoding + chunks.values).max(chunks.rechunking) as u64;
    let limit = MemoryLimit::new(args.memory, MAX_DEFAULT);
    let left = limit.bytes.saturating_sub(CACHE_BYTES as u64);
    if left < thread_bytes {
        return Err(limit.too_small(format!(
            "a motion of {} pixels needs {} MiB",
            motion.margin_px(),
            (thread_bytes + CACHE_BYTES as u64).div_ceil(1 << 20)
        )));
    }
    let threads = threads(args.threads).min((left / thread_bytes) as usize);
    let parent = if is_url(&args.out) { std::env::temp_dir() } else { parent_of(&args.out).to_owned() };
    create_directories(&parent, true)?;
    open::notes(&chart).iter().for_each(|note| log_line(format!("note: {note}")));
    open::sort_by_band(&mut chart, &bands, &parent, threads)?;
    detail_line(format!("each pixel is the mean of {} moments", motion.steps()));
    let mut attributes = Map::new();
    attributes.insert("program".into(), concat!("lenscube ", env!("CARGO_PKG_VERSION")).into());
    attributes.insert("motion".into(), json!({ "exposure_s": exposure_s, "moments": motion.steps() }));
    attributes.extend(chart.light().map(|light| ("illuminant".to_owned(), json!(light))));
    let meta = ChartMeta {
        wavelengths_nm,
        pitch_um: Some(pitch_um),
        film_size: chart.film_size(),
        units: chart.units().map(str::to_owned),
        attributes,
    };
    let moved = motion.film(chart.source());
    let new = NewChart { source: &moved, meta: &meta, surfaces: &[] };
    store(&new, &args.out, args.codec, threads, args.overwrite)
}

/// Fails for a chart with distances: what moves in front of what is not in it.
fn check_flat(args: &MotionArgs, chart: &Chart) -> Result<()> {
    let has_distances =
        matches!(chart, Chart::Scene(_)) || !SurfacePaths::of_chart(&args.chart, chart)?.is_empty();
    match has_distances {
        false => Ok(()),
        true => Err(usage(format!(
            "chart {} has distances: expected a flat chart, for near and far surfaces move by different lengths and hide each other",
            args.chart
        ))),
    }
}

/// The motion of `--motion` over a chart.
fn motion(args: &MotionArgs, chart: &Chart, exposure_s: f64, pitch_um: f64) -> Result<Motion> {
    let path = args.motion.display();
    let table = match camera_motion(&args.motion).map_err(|e| usage(e.to_string()))? {
        CameraMotion::Shifts(table) => table,
        CameraMotion::Rates(_) => {
            return Err(usage(format!(
                "--motion {path} has the rates of a gyroscope, which move a camera: expected the columns time_s, x_um, y_um, rotation_deg"
            )));
        }
    };
    check_covers(&args.motion, &table, (0.0, exposure_s))?;
    let size = chart.size();
    let times = RowTimes { row_time_s: 0.0, exposure_s, rows: 1, first_px: 0.0, row_px: 1.0 };
    let middle = |n: usize| (n as f64 - 1.0) / 2.0;
    let place = (size, pitch_um, (middle(size.height), middle(size.width)));
    let motion = Motion::new(shifted(&table), times, place);
    match motion.steps() <= MAX_STEPS && motion.margin_px() <= MAX_MARGIN_PX {
        true => Ok(motion),
        false => Err(usage(format!(
            "--motion {path}: reads {} pixels on each side and {} moments, expected at most {MAX_MARGIN_PX} and {MAX_STEPS}: a shorter motion, or a chart of larger pixels",
            motion.margin_px(),
            motion.steps()
        ))),
    }
}
