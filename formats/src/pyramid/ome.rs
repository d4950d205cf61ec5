//! Entries of `multiscales`, the attribute `ome` of a group with a pyramid: OME-Zarr 0.5.
//!
//! Axes have the names of the arrays' dimensions, as version 0.5 requires. A pixel of level n is 2ⁿ pixels of the array wide, and the
//! centre of its first pixel is (2ⁿ − 1)/2 pixels from that of the array's: scale and translation in mm from the optical axis.

use serde_json::{Value, json};

use super::{Pyramid, level_sizes};

/// The entry of array `output` with dimensions `axes` (the first one of bands or frames). `first_mm`: centre (y, x) of the first pixel of a
/// level in mm, given its distance from that of the array's in pixels; `description` of the halving.
pub(crate) fn multiscale(
    pyramid: &Pyramid<'_>,
    output: usize,
    axes: [&str; 3],
    pitch_mm: f64,
    first_mm: impl Fn(f64) -> (f64, f64),
    description: &str,
) -> Value {
    let (name, size) = pyramid.arrays()[output];
    let dataset = |level: usize| {
        let side = 2f64.powi(level as i32);
        let (y_mm, x_mm) = first_mm((side - 1.0) / 2.0);
        json!({
            "path": pyramid.level_path(output, level),
            "coordinateTransformations": [
                {"type": "scale", "scale": [1.0, side * pitch_mm, side * pitch_mm]},
                {"type": "translation", "translation": [0.0, y_mm, x_mm]},
            ],
        })
    };
    json!({
        "name": name,
        "axes": [
            {"name": axes[0], "type": "channel"},
            {"name": axes[1], "type": "space", "unit": "millimeter"},
            {"name": axes[2], "type": "space", "unit": "millimeter"},
        ],
        "datasets": (0..level_sizes(size).len()).map(dataset).collect::<Vec<_>>(),
        "type": "mean",
        "metadata": {"description": description},
    })
}
