//! What is measured: a band of a film or chart, in its unit, or a colour plane of a raw, in electrons of light.
//!
//! ```text
//! e = (DN − black)/(g·K) − dark current · exposure
//! ```
//! g and K the gains of raw and converter, the dark current at the temperature of the raw where its dark noise is on.

use crate::camera::frame::Frame;
use crate::failure::usage;
use crate::open::Chart;
use crate::progress::number;
use anyhow::Result;
use pipeline::geometry::{Rect, Size};
use pipeline::sensor::NoiseSet;
use serde_json::{Value, json};

/// Name of what was measured.
#[derive(Clone, Debug, PartialEq)]
pub enum Name {
    /// A band, by its wavelength in nm.
    Band(f64),
    /// A plane of a raw.
    Plane(String),
}

impl std::fmt::Display for Name {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Band(nm) => write!(f, "{} nm", number(*nm)),
            Self::Plane(name) => write!(f, "plane {name}"),
        }
    }
}

impl Name {
    /// Its key and value in JSON.
    pub fn json(&self) -> (&'static str, Value) {
        match self {
            Self::Band(nm) => ("wavelength_nm", json!(nm)),
            Self::Plane(name) => ("plane", json!(name)),
        }
    }

    /// Its value in a CSV file.
    pub fn csv(&self) -> String {
        match self {
            Self::Band(nm) => nm.to_string(),
            Self::Plane(name) => name.clone(),
        }
    }

    /// Wavelength, nm; 0 of a plane.
    pub fn nm(&self) -> f64 {
        match self {
            Self::Band(nm) => *nm,
            Self::Plane(_) => 0.0,
        }
    }
}

/// Pixels that are measured.
pub enum Plane<'a> {
    /// A band of a film or chart.
    Band(&'a Chart, usize),
    /// A plane of a frame of a raw.
    Raw(&'a Frame, usize),
}

/// Pixels of a rectangle.
pub struct Pixels {
    rect: Rect,
    values: Vec<f32>,
    /// Which pixels belong to the plane; `None`: all.
    own: Option<Own>,
    /// Values from which on pixels are saturated.
    white: f32,
}

/// The places of a plane in the pattern of the filters, from the first pixel of the raw on.
struct Own {
    rows: usize,
    columns: usize,
    /// Row by row.
    belongs: Vec<bool>,
}

impl Plane<'_> {
    /// Size of the image.
    pub fn size(&self) -> Size {
        match self {
            Self::Band(chart, _) => chart.size(),
            Self::Raw(frame, _) => frame.rect.size(),
        }
    }

    /// Unit of its values.
    pub fn unit(&self) -> &'static str {
        match self {
            Self::Band(..) => "",
            Self::Raw(..) => " e-",
        }
    }

    /// The pixels of `rect`, which must be inside the image.
    ///
    /// # Errors
    /// Usage: `what` is outside. The film is not complete.
    pub fn read(&self, rect: Rect, what: &str) -> Result<Pixels> {
        let size = self.size();
        if !size.rect().contains(rect) {
            return Err(usage(format!("{what} needs {rect}, which is not inside the image of {size}")));
        }
        match self {
            Self::Band(chart, band) => {
                let values = read(chart, *band, rect, what, "another place")?;
                Ok(Pixels { rect, values, own: None, white: f32::INFINITY })
            }
            Self::Raw(frame, plane) => {
                let sensor = &frame.sensor;
                let (black_dn, white_dn) = frame.black_white_dn();
                let (per_e, dark_e) = (frame.gain * sensor.adc.gain_dn_per_e, dark_e(frame));
                let electrons = |dn: f64| ((dn - black_dn) / per_e - dark_e) as f32;
                let mut values = frame.read(rect)?;
                values.iter_mut().for_each(|v| *v = electrons(f64::from(*v)));
                let (of, p) = (sensor.plane_of_channels(), &sensor.pattern);
                let origin = (frame.rect.y as usize, frame.rect.x as usize);
                let places = (0..p.rows).flat_map(|i| (0..p.columns).map(move |j| (i, j)));
                let belongs = places.map(|(i, j)| of[p.channel(origin.0 + i, origin.1 + j)] == *plane);
                let own = Some(Own { rows: p.rows, columns: p.columns, belongs: belongs.collect() });
                Ok(Pixels { rect, values, own, white: electrons(white_dn) })
            }
        }
    }
}

/// Pixels of a rectangle of a band, which must be inside the film; `way_out`: what to give else.
///
/// # Errors
/// Usage: `what` is outside. The film is not complete.
pub fn read(chart: &Chart, band: usize, rect: Rect, what: &str, way_out: &str) -> Result<Vec<f32>> {
    let size = chart.size();
    if !size.rect().contains(rect) {
        return Err(usage(format!(
            "{what} needs {rect}, which is not inside the image of {size}; give {way_out}"
        )));
    }
    let mut pixels = vec![0f32; rect.size().pixels()];
    chart.source().read(band, rect, &mut pixels).map_err(anyhow::Error::from_boxed)?;
    match pixels.iter().position(|v| !v.is_finite()) {
        None => Ok(pixels),
        Some(i) => anyhow::bail!(
            "row {}, column {} is {}: the film is not complete; finish its run first",
            rect.y + (i / rect.width) as i64,
            rect.x + (i % rect.width) as i64,
            pixels[i]
        ),
    }
}

/// Mean dark charge of a frame, e-.
fn dark_e(frame: &Frame) -> f64 {
    let job = frame.attributes.get("provenance").map(|p| &p["job"]);
    let noise = job.and_then(|j| j["noise"].as_str()).and_then(|n| n.parse().ok()).unwrap_or(NoiseSet::ALL);
    match noise.has(NoiseSet::DARK) {
        false => 0.0,
        true => {
            let temperature_c = job.and_then(|j| j["temperature_c"].as_f64());
            frame.sensor.dark_current_e_per_s(temperature_c) * frame.exposure_s()
        }
    }
}

impl Pixels {
    /// Row, column and value of each pixel of the plane.
    pub fn values(&self) -> impl Iterator<Item = (i64, i64, f32)> + '_ {
        let place = move |i: usize| {
            (self.rect.y + (i / self.rect.width) as i64, self.rect.x + (i % self.rect.width) as i64)
        };
        let is_own = move |y: i64, x: i64| {
            let own = self.own.as_ref();
            own.is_none_or(|own| own.belongs[y as usize % own.rows * own.columns + x as usize % own.columns])
        };
        self.values.iter().enumerate().filter_map(move |(i, value)| {
            let (y, x) = place(i);
            is_own(y, x).then_some((y, x, *value))
        })
    }

    /// Whether `value` is that of a saturated pixel.
    pub fn is_saturated(&self, value: f32) -> bool {
        value >= self.white
    }
}
