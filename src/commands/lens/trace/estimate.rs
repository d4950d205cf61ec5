//! What a trace needs, estimated from rays before it begins.

use crate::failure::usage;
use crate::job::lens::depth_nodes::SAMPLES_PER_S;
use crate::progress::plural;
use anyhow::Result;
use formats::lens::MAX_ARRAY_SAMPLES;
use pipeline::design::System;
use pipeline::design::trace::{Estimate, LensTrace, TraceOptions, node_wavelengths};
use std::time::Instant;

/// Time for the rays of a band over that for the rays of its estimate. With it the estimates of 31 bands are 0.4 to 2.4 of the time that the
/// built-in lenses take (scripts/bench/2026-11-22-trace).
const RAYS_PER_ESTIMATE: f64 = 30.0;

/// What a trace needs.
pub struct Needed {
    /// Time, s.
    pub seconds: f64,
    /// PSFs of all bands, MB uncompressed.
    pub psf_mb: f64,
    /// PSFs of the band of the largest ones, MB uncompressed.
    pub band_mb: f64,
    /// The same in words.
    pub text: String,
}

/// What the trace needs, from rays of up to five bands.
///
/// # Errors
/// As [`LensTrace::new`]; usage: the PSFs of a band are larger than a pack holds.
pub fn estimate(system: &System, options: &TraceOptions) -> Result<Needed> {
    let trace = LensTrace::new(system, options)?;
    let last = options.wavelengths_nm.len() - 1;
    let mut bands: Vec<usize> = (0..=4).map(|i| i * last / 4).collect();
    bands.dedup();
    let start = Instant::now();
    let estimates = bands.iter().map(|&b| trace.estimate(b)).collect::<Result<Vec<Estimate>, _>>()?;
    let ray_seconds = RAYS_PER_ESTIMATE * start.elapsed().as_secs_f64() / bands.len() as f64;
    // The first and the last band stand for half as many bands as the others.
    let share = |i: usize| if i == 0 || i + 1 == bands.len() { 0.5 } else { 1.0 };
    let weighted = |value: &dyn Fn(&Estimate) -> f64| -> f64 {
        let shares: f64 = (0..bands.len()).map(share).sum();
        estimates.iter().enumerate().map(|(i, e)| share(i) * value(e)).sum::<f64>() / shares
    };
    let bands_count = (last + 1) as f64;
    let choices = node_wavelengths(&options.wavelengths_nm).len() as f64;
    let samples =
        bands_count * weighted(&|e| e.samples as f64) + choices * weighted(&|e| e.samples_of_choice as f64);
    let cores = std::thread::available_parallelism().map_or(1.0, |n| n.get() as f64);
    let seconds = bands_count * ray_seconds + samples / SAMPLES_PER_S / cores;
    let largest = |value: fn(&Estimate) -> usize| estimates.iter().map(value).max().unwrap_or(0);
    let band_bytes = largest(|e| e.max_bytes);
    // The reader of packs accepts no larger array.
    if band_bytes as u64 > 4 * MAX_ARRAY_SAMPLES {
        let max_gb = 4e-9 * MAX_ARRAY_SAMPLES as f64;
        return Err(usage(format!(
            "the PSFs of a band would have {:.1} GB, a pack holds at most {max_gb:.1} GB a band; give fewer `--heights`, a coarser \
             `--psf-pitch-um` or less `--energy`",
            band_bytes as f64 * 1e-9
        )));
    }
    let psf_mb = 1e-6 * bands_count * weighted(&|e| e.bytes as f64);
    let time = if seconds < 1.0 { "less than 1".into() } else { format!("about {seconds:.0}") };
    let text = format!(
        "{}, estimated from rays: {time} s; windows of {} to {} px with at least {:.1} % of the light, PSFs of up to {} \
         samples a side, at most {} nodes a band, about {psf_mb:.0} MB uncompressed in all",
        plural(last + 1, "band"),
        estimates.iter().map(|e| e.window_px).min().unwrap_or(0),
        largest(|e| e.window_px),
        100.0 * estimates.iter().map(|e| e.light).fold(1.0, f64::min),
        largest(|e| e.side),
        options.max_nodes,
    );
    let band_mb = 1e-6 * largest(|e| e.bytes) as f64;
    Ok(Needed { seconds, psf_mb, band_mb, text })
}
