//! The noise of a raw's pixels: that of its sensor, of the noises that it was made with.

use pipeline::develop::merge::LowGain;
use pipeline::sensor::{NoiseSet, Sensor};
use serde_json::{Map, Value};

/// What a raw's noise was made with.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RawNoise {
    on: NoiseSet,
    /// °C; the reference's if none.
    temperature_c: Option<f64>,
}

impl RawNoise {
    /// As the attributes of a raw record it; all noises, if they do not.
    pub fn recorded(attributes: &Map<String, Value>) -> Self {
        let job = attributes.get("provenance").map(|p| &p["job"]);
        let on = job.and_then(|j| j["noise"].as_str()).and_then(|n| n.parse().ok());
        let temperature_c = job.and_then(|j| j["temperature_c"].as_f64());
        Self { on: on.unwrap_or(NoiseSet::ALL), temperature_c }
    }

    /// Mean dark charge of a pixel, e-.
    pub fn dark_e(self, sensor: &Sensor, seconds: f64) -> f64 {
        self.on.on(NoiseSet::DARK, sensor.dark_current_e_per_s(self.temperature_c) * seconds)
    }

    /// Standard deviation of a pixel over frames and dies, e-, by its mean charge, of which dark charge is a part: of the noises that are on, rounding included, for an exposure of `seconds`.
    pub fn sigma_e(self, sensor: &Sensor, gain: f64, seconds: f64) -> impl Fn(f64) -> f64 {
        let dark_e = self.dark_e(sensor, seconds);
        move |mean_e| sensor.noise_variance(self.on, gain, mean_e.max(0.0), dark_e).total_e2().sqrt()
    }

    /// Variance of a dark pixel over frames at no exposure, e-².
    pub fn dark_variance_e2(self, sensor: &Sensor, gain: f64) -> f64 {
        sensor.noise_variance(self.on, gain, 0.0, 0.0).temporal_e2()
    }

    /// The low one of two conversion gains; none where pixels are read with one.
    pub fn low_gain(self, sensor: &Sensor, gain: f64) -> Option<LowGain> {
        let transition_dn = sensor.adc.dual_gain?.transition_dn;
        let charge_e = (transition_dn.1 - sensor.adc.black_dn) / (gain * sensor.adc.gain_dn_per_e);
        let above = sensor.noise_variance(self.on, gain, charge_e.next_up(), 0.0);
        Some(LowGain { transition_dn, dark_variance_e2: above.frames_e2 + above.rounding_e2 })
    }
}
