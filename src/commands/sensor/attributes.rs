//! What a raw records, and what a run prints before the first pixel.

use super::exposure_times::ExposureTimes;
use super::resolve::{RawJob, Source, empty};
use crate::camera::shading::RESPONSE_MAP;
use crate::film::digest;
use crate::progress::mib;
use crate::progress::{log_line, plural};
use formats::object;
use formats::raw::RawSpec;
use pipeline::colour::Illuminant;
use pipeline::develop::ColourMatrix;
use pipeline::sensor::Sensor;
use serde_json::{Map, Value, json};

/// Matrix from balanced planes to linear sRGB and its ΔE2000 of the ColorChecker; null for planes that determine none.
fn matrix(sensor: &Sensor, light: Illuminant) -> Value {
    match ColourMatrix::fitted(sensor, light) {
        Ok(m) if sensor.planes().len() > 1 => json!({
            "rows": m.rows,
            "planes": sensor.planes(),
            "delta_e_2000_mean": m.mean_delta_e(),
            "delta_e_2000_max": m.max_delta_e(),
        }),
        _ => Value::Null,
    }
}

impl RawJob {
    /// The layout of the raw.
    pub fn spec(&self, times: &ExposureTimes) -> RawSpec {
        let (pitch_um, centre_mm) = match &self.source {
            Source::Film(_, geometry) => (geometry.rows.pitch_um, geometry.centre_mm),
            Source::Kept(kept) => (kept.spec.pitch_um, kept.spec.centre_mm),
        };
        RawSpec {
            outputs: self.outputs.clone(),
            sensor: self.size(),
            pitch_um,
            centre_mm,
            exposure_s: times.exposure_s.clone(),
            signal: self.keep_signal,
            ..empty()
        }
    }

    /// All that the raw records; nothing that differs from run to run.
    pub fn attributes(&self, times: &ExposureTimes) -> Map<String, Value> {
        let (s, layout) = (&self.sensor, layout());
        let names: Vec<&str> = s.channels.iter().map(|c| c.name.as_str()).collect();
        let pattern: Vec<Vec<&str>> = s
            .pattern
            .channels
            .chunks(s.pattern.columns)
            .map(|row| row.iter().map(|&c| names[c]).collect())
            .collect();
        let planes: Map<String, Value> =
            s.channels.iter().map(|c| (c.name.clone(), json!(c.plane))).collect();
        let by_name = |values: Vec<f64>| -> Value {
            std::iter::zip(&names, values)
                .map(|(n, v)| ((*n).to_owned(), json!(v)))
                .collect::<Map<_, _>>()
                .into()
        };
        let identity = Value::Object(self.identity.clone());
        let (film, wavelengths_nm) = match &self.source {
            Source::Film(film, geometry) => (
                json!({
                    "identity": film.identity,
                    "units": film.units,
                    "relative": film.relative,
                    "light": film.light,
                    "factors": film.factors,
                    "pitch_um": film.plane.pitch_um,
                    "pixels_per_sensor_pixel": geometry.rows.ratio(),
                }),
                film.wavelengths_nm.clone(),
            ),
            Source::Kept(kept) => (kept.film.clone(), kept.wavelengths_nm.clone()),
        };
        let weights: Map<String, Value> = names
            .iter()
            .enumerate()
            .map(|(c, n)| ((*n).to_owned(), json!(s.band_weights(c, &wavelengths_nm))))
            .collect();
        let mut attributes = object! {
            "provenance": json!({
                "program": concat!("lenscube ", env!("CARGO_PKG_VERSION")),
                "job_digest": digest(&identity),
                "job": identity,
                "layout_digest": digest(&layout),
                "layout": layout,
            }),
            "sensor": self.file.record(),
            "bits": s.adc.bits,
            "black_dn": s.adc.black_dn,
            "white_dn": s.white_dn(self.gain),
            "gain": self.gain,
            "dn_per_e": self.gain * s.adc.gain_dn_per_e,
            "cfa": json!({ "pattern": pattern, "planes": planes }),
            "white_gains": json!({
                "D65": by_name(s.white_gains(Illuminant::D65)),
                "A": by_name(s.white_gains(Illuminant::A)),
            }),
            "matrices": json!({
                "D65": matrix(s, Illuminant::D65),
                "A": matrix(s, Illuminant::A),
            }),
            "film_wavelengths_nm": wavelengths_nm,
            "band_weights_nm_per_j": weights,
            "area_m2": s.area_m2(),
            "film": film,
            "film_scale": times.scale,
            "signal_identity": self.signal_identity,
        };
        if let Some(curve) = &s.adc.companding {
            // black_dn and white_dn are linear numbers; an array of the raw holds coded ones.
            let coded = |linear_dn: f64| s.adc.stored_dn(linear_dn);
            let companding = json!({
                "linear_dn": curve.linear_dn,
                "coded_dn": curve.coded_dn,
                "black_coded_dn": coded(s.adc.black_dn),
                "white_coded_dn": coded(s.white_dn(self.gain)),
            });
            attributes.insert("companding".into(), companding);
        }
        let response_map = self.response_map();
        if !response_map.is_null() {
            attributes.insert(RESPONSE_MAP.into(), response_map);
        }
        attributes
    }

    /// Prints what is known before any pixel.
    pub fn log_warnings(&self) {
        self.warnings.iter().for_each(log_line);
    }

    /// Prints what is about to be done.
    pub fn log_start(&self, spec: &RawSpec, times: &ExposureTimes) {
        let s = &self.sensor;
        let centre = spec.centre_mm;
        log_line(format!(
            "{}: {} px of {} µm, middle {:.4}, {:.4} mm (down, right) from the axis; {}, gain {}; seed {}, die {}, noise {}; {}, memory {}",
            s.name,
            spec.sensor,
            spec.pitch_um,
            centre.0,
            centre.1,
            plural(spec.exposure_s.len(), "frame"),
            self.gain,
            self.exposure.seed,
            self.exposure.die,
            self.exposure.noise,
            plural(self.memory.threads, "thread"),
            mib(self.memory.limit),
        ));
        let mut seconds = times.exposure_s.clone();
        seconds.dedup();
        let seconds: Vec<String> = seconds.iter().map(|t| format!("{t:.6e} s")).collect();
        let scale = if self.relative() {
            format!(", film scale {:.6e} W m-2 nm-1", times.scale)
        } else {
            String::new()
        };
        log_line(format!("exposure {}{scale}", seconds.join(", ")));
    }
}

/// Shards of a raw as they are laid out by this program.
fn layout() -> Value {
    serde_json::json!({ "shard": RawSpec::LAYOUT.0, "chunk": RawSpec::LAYOUT.1, "codec": "zstd" })
}
