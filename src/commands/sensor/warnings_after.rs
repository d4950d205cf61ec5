//! Warnings and notes about the pixels of a raw that was made: clipping, a dark image, negative light.

use super::exposure::Times;
use super::exposure_times::ExposureTimes;
use super::resolve::RawJob;
use super::write::Done;
use crate::progress::log_line;
use pipeline::sensor::NoiseSet;

/// Shares of pixels that are warned of.
const CLIPPED: f64 = 0.01;
const NEGATIVE: f64 = 1e-3;

/// Prints what the pixels showed.
pub fn print(job: &RawJob, times: &ExposureTimes, done: &Done) {
    let share = |n: u64, all: u64| n as f64 / all.max(1) as f64;
    let negative = share(done.negative, done.pixels);
    if done.negative > 0 {
        let kind = if negative > NEGATIVE { "warning" } else { "note" };
        log_line(format!(
            "{kind}: {} pixels ({:.3} %) of negative light count as 0",
            done.negative,
            100.0 * negative
        ));
    }
    if done.numbers == 0 {
        return;
    }
    let white = share(done.white, done.numbers);
    let automatic = matches!(job.times, Times::Auto { .. });
    if white > CLIPPED {
        let way_out = match automatic {
            true => "a smaller share of saturation or a higher percentile, --exposure auto:FILL@PERCENTILE",
            false => "a shorter exposure, or --exposure auto",
        };
        log_line(format!("warning: {:.1} % of the pixels are clipped at white; {way_out}", 100.0 * white));
    }
    if done.lit == 0 {
        let way_out = match automatic {
            true => "a greater share of saturation, --exposure auto:FILL",
            false => "a longer exposure, a gain, or --exposure auto",
        };
        log_line(format!("warning: no pixel is above 10 % of white; {way_out}"));
    }
    let median = done.histogram.value_at(50.0) * times.scale;
    let dark = match job.exposure.noise.has(NoiseSet::DARK) {
        true => job.sensor.dark_current_e_per_s(job.exposure.temperature_c),
        false => 0.0,
    };
    if dark > median {
        log_line(format!(
            "warning: dark current of {dark:.3} e-/s exceeds the signal's median of {median:.3} e-/s"
        ));
    }
}
