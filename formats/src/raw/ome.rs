//! The attribute `ome` of a raw with a pyramid: OME-Zarr 0.5, `multiscales` and `omero`.
//!
//! Averaged over a period of the mosaic, the centres of the first pixels of a level lie as [`crate::pyramid::ome`] has it. `omero` names the
//! frames and their range from black to white, in the numbers that the arrays hold; the first is shown.

use serde_json::{Value, json};

use super::RawStore;
use crate::pyramid::ome;

/// The attribute `ome`.
pub(super) fn ome_attribute(raw: &RawStore) -> Value {
    let attributes = raw.attributes();
    let number = |key: &str, coded: &str, default: f64| {
        let stored = attributes.get("companding").map(|curve| &curve[coded]);
        stored.or(attributes.get(key)).and_then(Value::as_f64).unwrap_or(default)
    };
    let black = number("black_dn", "black_coded_dn", 0.0);
    let white = number("white_dn", "white_coded_dn", 65535.0);
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
    let (spec, rect) = (raw.spec(), raw.rect(output));
    let (rows, columns) = spec.outputs[output].axes();
    let pitch_mm = spec.pitch_um * 1e-3;
    let first_mm = |from_first_px: f64| {
        let mm = |first: i64, n: usize, centre_mm: f64| {
            (first as f64 - (n as f64 - 1.0) / 2.0 + from_first_px) * pitch_mm + centre_mm
        };
        let down = mm(rect.y, spec.sensor.height, spec.centre_mm.0);
        (down, mm(rect.x, spec.sensor.width, spec.centre_mm.1))
    };
    let description = "mosaic of half the resolution: mean over pixels of one filter in 2 x 2 periods";
    ome::multiscale(&raw.pyramid(), output, ["frame", &rows, &columns], pitch_mm, first_mm, description)
}
