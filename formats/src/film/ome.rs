//! The attribute `ome` of a film with a pyramid: OME-Zarr 0.5, `multiscales` and `omero`.
//!
//! `omero` is a hint for viewers: names of the bands, a range that clips at most 1 % of the last level, and three bands in red, green and blue, if
//! there are as many; the others are not shown.

use pipeline::geometry::Rect;
use serde_json::{Value, json};

use super::store::FilmStore;
use crate::picture::exposure::{Exposure, Levels};
use crate::pyramid::ome;

/// Wavelengths in nm that resemble the primaries of a display, and their colours.
const PRIMARIES: [(f64, &str); 3] = [(610.0, "FF0000"), (550.0, "00FF00"), (460.0, "0000FF")];

/// The attribute `ome`; `whites` are the white levels of the bands.
pub(super) fn ome_attribute(film: &FilmStore, whites: &[f64]) -> Value {
    let spec = film.spec();
    let multiscales: Vec<Value> = (0..spec.outputs.len()).map(|output| multiscale(film, output)).collect();
    let colours = colours(&spec.wavelengths_nm);
    let channel = |band: usize| {
        json!({
            "label": format!("{} nm", spec.wavelengths_nm[band]),
            "color": colours[band].unwrap_or("FFFFFF"),
            "active": colours[band].is_some(),
            "window": {"min": 0.0, "max": whites[band], "start": 0.0, "end": whites[band]},
        })
    };
    let channels: Vec<Value> = (0..spec.wavelengths_nm.len()).map(channel).collect();
    json!({"version": "0.5", "multiscales": multiscales, "omero": {"channels": channels}})
}

fn multiscale(film: &FilmStore, output: usize) -> Value {
    let (spec, Rect { y, x, .. }) = (film.spec(), film.spec().outputs[output].rect);
    let (rows, columns) = spec.outputs[output].axes();
    let pitch_mm = spec.pitch_um * 1e-3;
    let first_mm = |from_first_px: f64| {
        let mm = |first: i64, axis_px: f64| (first as f64 - axis_px + from_first_px) * pitch_mm;
        (mm(y, spec.axis_px.0), mm(x, spec.axis_px.1))
    };
    let axes = ["wavelength", &rows, &columns];
    let description = "mean over 2 x 2 pixels, missing ones left out";
    ome::multiscale(&film.pyramid(), output, axes, pitch_mm, first_mm, description)
}

/// Display colour of each band; `None` if it is not shown.
fn colours(wavelengths_nm: &[f64]) -> Vec<Option<&'static str>> {
    let mut colours = vec![None; wavelengths_nm.len()];
    let nearest = |nm: f64| {
        let away = |b: &usize| (wavelengths_nm[*b] - nm).abs();
        (0..wavelengths_nm.len()).min_by(|a, b| away(a).total_cmp(&away(b))).expect("a film has bands")
    };
    let bands = PRIMARIES.map(|(nm, colour)| (nearest(nm), colour));
    if bands[0].0 == bands[1].0 || bands[1].0 == bands[2].0 {
        colours[bands[1].0] = Some("FFFFFF");
    } else {
        bands.iter().for_each(|&(band, colour)| colours[band] = Some(colour));
    }
    colours
}

/// The white level of a band: it clips at most 1 % of `pixels`.
pub(super) fn white_level(pixels: &[f32]) -> f64 {
    let mut levels = Levels::default();
    pixels.iter().for_each(|&v| levels.add(v));
    1.0 / Exposure::Auto.factor(&levels)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn three_bands_are_shown_if_there_are_three() {
        let coloured =
            |nm: &[f64]| -> Vec<usize> { (0..nm.len()).filter(|&b| colours(nm)[b].is_some()).collect() };
        let all: Vec<f64> = (0..31).map(|b| 400.0 + 10.0 * f64::from(b)).collect();
        assert_eq!(coloured(&all), [6, 15, 21]);
        assert_eq!(coloured(&[450.0, 550.0, 650.0]), [0, 1, 2]);
        assert_eq!(coloured(&[900.0, 800.0]), [1]);
        assert_eq!(coloured(&[550.0]), [0]);
    }
}
