//! The attribute `ome` of a raw with a pyramid: OME-Zarr 0.5, `multiscales` and `omero`.
//!
//! A pixel of level n is 2ⁿ sensor pixels wide; averaged over a period of the mosaic, the centre of its first pixels is (2ⁿ − 1)/2 sensor
//! pixels from that of the raw's: scale and translation in mm from the optical axis. `omero` names the frames and their range from black
//! to white; the first is shown.

use serde_json::{Value, json};

use crate::film::level_sizes;
use crate::raw::{RawSpec, RawStore};

/// The attribute `ome`.
pub(super) fn ome_attribute(raw: &RawStore) -> Value {
    let number =
        |key: &str, default: f64| raw.attributes().get(key).and_then(Value::as_f64).unwrap_or(default);
    let (black, white) = (number("black_dn", 0.0), number("white_dn", 65535.0));
    let channel = |(frame, seconds): (usize, &f64)| {
        json!({
            "label": format!("frame {frame}, {seconds} s"),
            "color": "FFFFFF",
            "active": frame == 0,
            "window": {"min": 0.0, "max": 65535.0, "start": black, "end": white},
        })
    };
    let channels: Vec<Value> = raw.spec().exposure_s.iter().enumerate().map(channel).collect();
    let multiscales: Vec<Value> =
        (0..raw.spec().outputs.len()).map(|output| multiscale(raw, output)).collect();
    json!({"version": "0.5", "multiscales": multiscales, "omero": {"channels": channels}})
}

fn multiscale(raw: &RawStore, output: usize) -> Value {
    let spec = raw.spec();
    let (name, rect) = (&spec.outputs[output].name, spec.outputs[output].rect);
    let (rows, columns) = RawSpec::axes(name);
    let pitch_mm = spec.pitch_um * 1e-3;
    let dataset = |level: usize| {
        let side = 2f64.powi(level as i32);
        let first = |first: i64, n: usize, centre_mm: f64| {
            (first as f64 - (n as f64 - 1.0) / 2.0 + (side - 1.0) / 2.0) * pitch_mm + centre_mm
        };
        let down = first(rect.y, spec.sensor.height, spec.centre_mm.0);
        let right = first(rect.x, spec.sensor.width, spec.centre_mm.1);
        json!({
            "path": raw.level_path(output, level),
            "coordinateTransformations": [
                {"type": "scale", "scale": [1.0, side * pitch_mm, side * pitch_mm]},
                {"type": "translation", "translation": [0.0, down, right]},
            ],
        })
    };
    json!({
        "name": name,
        "axes": [
            {"name": "frame", "type": "channel"},
            {"name": rows, "type": "space", "unit": "millimeter"},
            {"name": columns, "type": "space", "unit": "millimeter"},
        ],
        "datasets": (0..level_sizes(rect.size()).len()).map(dataset).collect::<Vec<_>>(),
        "type": "mean",
        "metadata": {"description": "mosaic of half the resolution: mean over pixels of one filter in 2 x 2 periods"},
    })
}
