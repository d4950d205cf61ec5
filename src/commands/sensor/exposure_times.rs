//! Exposure times and the scale of a relative film: given, found from the signal, or recorded by the raw.

use super::exposure::{MAX_SECONDS, Times};
use super::resolve::RawJob;
use super::signal::Measured;
use crate::failure::usage;
use anyhow::{Context, Result};
use formats::raw::RawStore;
use pipeline::sensor::Exposure;
use serde_json::Value;

/// What was found or given: the time of each frame and the scale of a relative film.
#[derive(Clone, Debug, PartialEq)]
pub struct ExposureTimes {
    /// Exposure of each frame, s.
    pub exposure_s: Vec<f64>,
    /// W m⁻² nm⁻¹ of a unit of a relative film; 1 for others.
    pub scale: f64,
}

impl RawJob {
    /// Times and scale, from the flags and what was measured.
    pub fn exposure_times(&self, measured: Option<&Measured>) -> Result<ExposureTimes> {
        let mean_lux = measured.and_then(|m| m.mean_lux);
        let given = match (self.film_lux, mean_lux) {
            (Some(lux), Some(mean)) if mean > 0.0 => Some(lux / mean),
            (Some(lux), _) => {
                return Err(usage(format!("--film-lux {lux}: the film is dark over the sensor")));
            }
            (None, _) => self.film_scale,
        };
        let (times, scale) = match &self.times {
            Times::Given(times) => (times.clone(), given.unwrap_or(1.0)),
            Times::Auto { fill, percentile } => {
                let histogram = &measured.context("automatic exposure without a signal")?.histogram;
                let seconds =
                    histogram.seconds(&self.sensor, self.gain, given.unwrap_or(1.0), *fill, *percentile);
                let seconds = seconds.ok_or_else(|| {
                    usage(format!(
                        "--exposure auto: the film is dark at the {percentile}th percentile; give a time"
                    ))
                })?;
                match (given, self.relative()) {
                    // Only the product of scale and time is known.
                    (None, true) => (vec![self.nominal_s], seconds / self.nominal_s),
                    _ if seconds > MAX_SECONDS => {
                        return Err(usage(format!(
                            "--exposure auto: the film needs {seconds:.3e} s, at most {MAX_SECONDS} s are allowed; give a time, a higher --gain, \
                             or a smaller share of saturation, e.g. --exposure auto:0.1"
                        )));
                    }
                    _ => (vec![seconds], given.unwrap_or(1.0)),
                }
            }
        };
        let exposure_s = times.iter().flat_map(|t| std::iter::repeat_n(*t, self.frames as usize)).collect();
        Ok(ExposureTimes { exposure_s, scale })
    }

    /// As a raw that was created records them.
    pub fn recorded_times(&self, store: &RawStore) -> Result<ExposureTimes> {
        let scale = store.attributes().get("film_scale").and_then(Value::as_f64);
        let scale = scale.with_context(|| {
            format!("{}: no attribute film_scale; replace it with --overwrite", store.path().display())
        })?;
        Ok(ExposureTimes { exposure_s: store.spec().exposure_s.clone(), scale })
    }

    /// What frame `frame` is taken with.
    pub fn frame(&self, times: &ExposureTimes, frame: usize) -> Exposure {
        let readout_s = self.size().height as f64 * self.sensor.row_time_s;
        let start_s: f64 = times.exposure_s[..frame].iter().map(|t| t.max(readout_s)).sum();
        Exposure {
            seconds: times.exposure_s[frame],
            flicker: self.exposure.flicker.map(|flicker| flicker.after(start_s)),
            scale: times.scale,
            frame: frame as u32,
            ..self.exposure
        }
    }
}
