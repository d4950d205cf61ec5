//! Veiling glare and flare: light of bright places where the scene is dark.

use super::measurement::Measurement;
use super::plane::{Name, Plane};
use super::quality::Remark;
use crate::failure::usage;
use anyhow::Result;
use formats::picture::image::Image;
use formats::picture::style::inferno;
use pipeline::geometry::{Rect, Size};
use pipeline::measure::flare::Flare;
use serde_json::{Map, Value, json};

/// Percentiles of normalised flare.
const PERCENTS: [f64; 3] = [50.0, 95.0, 99.9];
/// Rows that are read at a time.
const ROWS: usize = 512;
/// Largest side of the map, px.
const MAP_PX: usize = 1600;
/// Decades of normalised flare that the map shows.
const MAP_DECADES: f64 = 6.0;

/// Ratio of signals in dB; `None` of none.
fn attenuation_db(ratio: f64) -> Option<f64> {
    (ratio > 0.0).then(|| -20.0 * ratio.log10())
}

/// Mean, standard deviation and saturated share of the pixels of `rect`.
fn statistics(plane: &Plane<'_>, rect: Rect, what: &str) -> Result<(f64, f64, f64)> {
    let pixels = plane.read(rect, what)?;
    let values: Vec<f32> = pixels.values().map(|(_, _, value)| value).collect();
    if values.is_empty() {
        return Err(usage(format!("{what}, {rect}, has no pixel of this colour; give a larger one")));
    }
    let n = values.len() as f64;
    let mean = values.iter().map(|v| f64::from(*v)).sum::<f64>() / n;
    let variance = values.iter().map(|v| (f64::from(*v) - mean).powi(2)).sum::<f64>() / n;
    let saturated = values.iter().filter(|value| pixels.is_saturated(**value)).count() as f64 / n;
    Ok((mean, variance.sqrt(), saturated))
}

/// Mean of the white area, and a remark if it is saturated.
fn white(plane: &Plane<'_>, area: Rect) -> Result<(f64, f64, Option<Remark>)> {
    let (mean, deviation, saturated) = statistics(plane, area, "the white area")?;
    if mean <= 0.0 {
        anyhow::bail!("--white-area {area}: its mean is {mean}, expected light");
    }
    Ok((mean, deviation, saturation("white area", saturated)))
}

/// A remark on saturated pixels.
fn saturation(what: &str, share: f64) -> Option<Remark> {
    (share > 0.0).then(|| {
        let text = format!(
            "{:.1} % of the pixels of the {what} are saturated: the ratio is too large; expose less",
            100.0 * share
        );
        Remark::new("saturated", text)
    })
}

/// Veiling glare index: the mean of a black area over that of a white one, ISO 9358; of raws in electrons of light, ISO 18844. In dB as a ratio of signals, 20 log₁₀.
pub fn glare(plane: &Plane<'_>, name: Name, (black, white_area): (Rect, Rect)) -> Result<Measurement> {
    let (of_black, black_deviation, _) = statistics(plane, black, "the black area")?;
    let (of_white, white_deviation, saturated) = white(plane, white_area)?;
    let index = of_black / of_white;
    let in_db = attenuation_db(index);
    let shown = in_db.map_or(String::new(), |db| format!(" ({:.2} dB)", 0.0 - db));
    let unit = plane.unit();
    let remarks: Vec<Remark> = saturated.into_iter().collect();
    Ok(Measurement {
        name,
        summary: format!(
            "veiling glare index {:.4} %{shown}: black {of_black:.6e}{unit}, standard deviation {black_deviation:.2e}; white {of_white:.6e}{unit}, {white_deviation:.2e}",
            100.0 * index
        ),
        figures: json!({
            "veiling_glare_index": index, "attenuation_db": in_db,
            "black": of_black, "black_deviation": black_deviation,
            "white": of_white, "white_deviation": white_deviation,
            "remarks": super::quality::names(&remarks),
        }),
        remarks,
        curve: Vec::new(),
        mtf: Vec::new(),
    })
}

/// A lamp's image: centre (row, column) and radius, px.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lamp {
    /// Centre.
    pub centre_px: (f64, f64),
    /// Radius.
    pub radius_px: f64,
}

/// Normalised flare of a lamp, by its own image or by a white area; and, if it is asked for, its map.
pub fn flare(
    plane: &Plane<'_>,
    name: Name,
    lamp: Lamp,
    white_area: Option<Rect>,
    mut map: Option<&mut FlareMap>,
) -> Result<Measurement> {
    let size = plane.size();
    let mut remarks = Vec::new();
    let reference = match white_area {
        None => None,
        Some(area) => {
            let (mean, _, saturated) = white(plane, area)?;
            remarks.extend(saturated);
            Some(mean)
        }
    };
    let inside = |at: f64, n: usize| at - lamp.radius_px >= -0.5 && at + lamp.radius_px <= n as f64 - 0.5;
    if !(inside(lamp.centre_px.0, size.height) && inside(lamp.centre_px.1, size.width)) {
        return Err(usage(format!(
            "--flare: the lamp of radius {} px at {},{} is not inside the image of {size}",
            lamp.radius_px, lamp.centre_px.1, lamp.centre_px.0
        )));
    }
    let mut flare = Flare::new(lamp.centre_px, lamp.radius_px, size);
    let mut saturated = 0u64;
    for top in (0..size.height).step_by(ROWS) {
        let rect = Rect::new(top as i64, 0, ROWS.min(size.height - top), size.width);
        let pixels = plane.read(rect, "the flare")?;
        for (y, x, value) in pixels.values() {
            let is_lamp = flare.add(y as f64, x as f64, value);
            saturated += u64::from(is_lamp && pixels.is_saturated(value));
            if let Some(map) = &mut map {
                map.add(y as usize, x as usize, value);
            }
        }
    }
    let (of_lamp, others) = flare.pixels();
    let figures = flare.figures(reference, &PERCENTS).ok_or_else(|| match of_lamp.min(others) {
        0 => usage(format!("--flare: {of_lamp} pixels of this colour in the lamp and {others} beside it; give another radius")),
        _ => anyhow::anyhow!("--flare: the mean within the lamp's radius is not positive, expected light; give the place of the lamp"),
    })?;
    if reference.is_none() {
        remarks.extend(saturation("lamp", saturated as f64 / of_lamp as f64));
    }
    let unit = reference.unwrap_or(figures.lamp);
    if let Some(map) = map {
        map.unit = unit;
    }
    let percentiles: Vec<String> = figures
        .percentiles
        .iter()
        .map(|(percent, value)| {
            let db = attenuation_db(*value).map_or(String::new(), |db| format!(" ({:.1} dB)", 0.0 - db));
            format!("{percent} % below {value:.3e}{db}")
        })
        .collect();
    let key = |percent: f64| format!("p{percent}").replace('.', "_");
    let values: Map<String, Value> = figures.percentiles.iter().map(|(p, v)| (key(*p), json!(v))).collect();
    let in_db: Map<String, Value> =
        figures.percentiles.iter().map(|(p, v)| (key(*p), json!(attenuation_db(*v)))).collect();
    let of = if reference.is_some() { "of the white area" } else { "of the lamp" };
    Ok(Measurement {
        name,
        summary: format!(
            "normalised flare {of}, {unit:.6e}{}: {}; light outside over light inside {:.4e}",
            plane.unit(),
            percentiles.join(", "),
            figures.outside_over_inside
        ),
        figures: json!({
            "lamp": figures.lamp,
            "reference": unit,
            "normalised_flare": values,
            "attenuation_db": in_db,
            "outside_over_inside": figures.outside_over_inside,
            "remarks": super::quality::names(&remarks),
        }),
        remarks,
        curve: figures.profile,
        mtf: Vec::new(),
    })
}

/// Map of normalised flare: means over squares of pixels.
pub struct FlareMap {
    size: Size,
    block: usize,
    sums: Vec<(f64, u32)>,
    /// What it is normalised by.
    unit: f64,
}

impl FlareMap {
    /// Of an image of `size`.
    pub fn new(size: Size) -> Self {
        let block = size.height.max(size.width).div_ceil(MAP_PX);
        let size = Size::new(size.height.div_ceil(block), size.width.div_ceil(block));
        Self { size, block, sums: vec![(0.0, 0); size.pixels()], unit: 1.0 }
    }

    fn add(&mut self, y: usize, x: usize, value: f32) {
        let sum = &mut self.sums[y / self.block * self.size.width + x / self.block];
        *sum = (sum.0 + f64::from(value), sum.1 + 1);
    }

    /// The picture.
    pub fn image(&self) -> Image {
        let mut image = Image::new(self.size, inferno(0.0));
        for (y, sums) in self.sums.chunks_exact(self.size.width).enumerate() {
            for (pixel, (sum, n)) in std::iter::zip(image.row_mut(y), sums) {
                let flare = sum / f64::from((*n).max(1)) / self.unit;
                let shown = if flare > 0.0 { 1.0 + flare.log10() / MAP_DECADES } else { 0.0 };
                *pixel = inferno(shown.clamp(0.0, 1.0));
            }
        }
        image
    }

    /// What it shows.
    pub fn caption(&self) -> String {
        format!(
            "normalised flare, mean of {n} x {n} pixels, logarithmic: from 1e-{MAP_DECADES} (black) to 1 (brightest)",
            n = self.block
        )
    }
}
