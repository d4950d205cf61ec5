//! The noise of a frame's pixels, of the noises that its raw was made with.

use super::frame::Frame;
use pipeline::sensor::NoiseSet;

/// Noises that are on, and the temperature (°C) of the sensor, if it is not the reference's.
fn settings(frame: &Frame) -> (NoiseSet, Option<f64>) {
    let job = frame.attributes.get("provenance").map(|p| &p["job"]);
    let noise = job.and_then(|j| j["noise"].as_str()).and_then(|n| n.parse().ok()).unwrap_or(NoiseSet::ALL);
    (noise, job.and_then(|j| j["temperature_c"].as_f64()))
}

/// Standard deviation of a pixel of some mean charge over frames and dies, e-: of the noises that are on, rounding included.
pub fn sigma_e(frame: &Frame, mean_e: f64) -> f64 {
    let (s, (noise, temperature_c)) = (&frame.sensor, settings(frame));
    let dark_e = noise.on(NoiseSet::DARK, s.dark_current_e_per_s(temperature_c) * frame.exposure_s());
    // The mean contains the dark charge.
    s.noise_variance(noise, frame.gain, mean_e.max(0.0), dark_e).total_e2().sqrt()
}

/// Variance of a dark pixel over frames at no exposure, e-².
pub fn dark_variance_e2(frame: &Frame) -> f64 {
    frame.sensor.noise_variance(settings(frame).0, frame.gain, 0.0, 0.0).temporal_e2()
}
