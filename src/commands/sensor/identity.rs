//! What determines the pixels of a raw, readable; and its attributes.

use super::directions::Directions;
use super::film::Film;
use super::geometry::Geometry;
use crate::args::ExposeArgs;
use crate::film::digest;
use formats::object;
use pipeline::sensor::angle::{AngularResponse, Plate};
use pipeline::sensor::{Defects, NoiseSpectrum, Overflow, QuantumEfficiencyOf, Sensor};
use serde_json::{Map, Value, json};

/// Raised whenever the program gives other digital numbers for the same job.
const NUMERIC_VERSION: u32 = 1;

/// Noise figures that every identity has; later ones are in it where they are not 0, so that older raws keep theirs.
const FIRST_FIGURES: usize = 9;

/// What determines the signal: film, the optical part of the sensor, geometry.
pub fn of_signal(
    film: &Film,
    sensor: &Sensor,
    geometry: &Geometry,
    directions: Option<&Directions>,
) -> Value {
    let mut signal = json!({
        "film": film.identity,
        "film_factors": digest(&json!(film.factors)),
        "optics": optics(sensor),
        "geometry": geometry.identity(),
    });
    if let Some(directions) = directions {
        signal["directions"] = directions.identity();
    }
    signal
}

/// Digest of the optical parameters of a sensor.
pub fn optics(sensor: &Sensor) -> String {
    let curves: Vec<Value> =
        sensor.channels.iter().map(|c| json!([c.curve.wavelengths_nm, c.curve.values])).collect();
    let filters: Vec<Value> = sensor.filters.iter().map(|f| json!([f.wavelengths_nm, f.values])).collect();
    let p = &sensor.pixel;
    let mut optics = json!({
        "pitch_um": p.pitch_um,
        "aperture_um": p.aperture_um,
        "of_pixel": p.quantum_efficiency_of == QuantumEfficiencyOf::Pixel,
        "curves": curves,
        "per_energy": sensor.per_energy,
        "filters": filters,
        "pattern": [sensor.pattern.rows, sensor.pattern.columns],
        "channels": sensor.pattern.channels,
    });
    if sensor.depends_on_angles() {
        optics["angle"] = json!(sensor.angle.as_ref().map(AngularResponse::numbers));
        optics["plates"] = json!(sensor.plates.iter().map(Plate::numbers).collect::<Vec<_>>());
    }
    if let Some(crosstalk) = &sensor.crosstalk {
        optics["crosstalk"] = json!([crosstalk.wavelengths_nm, crosstalk.shares]);
    }
    digest(&optics)
}

/// Digest of the electronic parameters of a sensor.
fn electronics(sensor: &Sensor) -> String {
    let (p, a) = (&sensor.pixel, &sensor.adc);
    let noise: Vec<f64> = sensor.noise.rows().map(|(_, value)| value).collect();
    let later = sensor.noise.rows().skip(FIRST_FIGURES).filter(|(_, value)| *value != 0.0);
    let mut parts = vec![
        json!([p.full_well_e, p.dark_current_e_per_s, p.dark_reference_c, p.dark_doubling_k]),
        json!(noise[..6]),
        json!(noise[6..FIRST_FIGURES]),
        json!([f64::from(a.bits), a.gain_dn_per_e, a.black_dn]),
    ];
    parts.extend(later.map(|(row, value)| json!([row.field, value])));
    if sensor.defects != Defects::default() {
        let d = sensor.defects;
        let numbers = [d.hot_pixels, d.hot_dark_e_per_s, d.telegraph_pixels, d.telegraph_e];
        parts.push(json!(["defects", numbers]));
    }
    if sensor.row_time_s != 0.0 {
        parts.push(json!(["row_time_s", sensor.row_time_s]));
    }
    if p.overflow != Overflow::NONE {
        parts.push(json!(["overflow", p.overflow.knee, p.overflow.blooming]));
    }
    if sensor.noise_spectrum != NoiseSpectrum::default() {
        let spectrum = sensor.noise_spectrum;
        parts.push(json!(["noise_spectrum", spectrum.row_exponent, spectrum.column_exponent]));
    }
    if let Some(dual) = &a.dual_gain {
        let (first, last) = dual.transition_dn;
        let numbers = [dual.ratio, f64::from(dual.bits), dual.read_noise_e, first, last];
        parts.push(json!(["dual_gain", numbers]));
    }
    if let Some(curve) = &a.companding {
        parts.push(json!(["companding", curve.linear_dn, curve.coded_dn]));
    }
    digest(&Value::Array(parts))
}

/// All that changes pixels.
pub fn of_job(
    args: &ExposeArgs,
    signal: &Value,
    sensor: &Sensor,
    gain: f64,
    relative: bool,
) -> Map<String, Value> {
    let nominal = relative.then(|| args.nominal.clone());
    let mut identity = object! {
        "numeric_version": NUMERIC_VERSION,
        "signal": signal,
        "sensor": sensor.name,
        "electronics": electronics(sensor),
        "exposure": args.exposure,
        "frames": args.frames,
        "gain": gain,
        "seed": args.seed,
        "die": args.die,
        "noise": args.noise.to_string(),
        "temperature_c": args.temperature,
        "film_lux": args.film_lux,
        "film_scale": args.film_scale,
        "nominal": nominal,
        "keep_signal": args.keep_signal,
        "rois": args.roi.iter().map(|r| [r.x, r.y, r.width as i64, r.height as i64]).collect::<Vec<_>>(),
    };
    // Without it, raws of earlier versions keep their identity.
    if let Some(flicker) = &args.flicker {
        identity.insert("flicker".into(), flicker.clone().into());
    }
    identity
}
