//! A raw in the viewer: its mosaic, its development, and a pixel's numbers.
//!
//! Every level is a mosaic of the raw's pattern (`formats::raw`), so each is developed as `lenscube develop` does the raw, with its
//! default demosaicing and the fitted matrix. The mosaic is shown as (DN − black)/(white − black).

use crate::args::DevelopStyle;
use crate::camera::frame::{Frame, split_group};
use crate::camera::recipe;
use crate::failure::{line, usage};
use anyhow::{Result, anyhow};
use formats::chart::{ChartOptions, ChartStore};
use formats::group::GroupError;
use formats::pyramid::PyramidState;
use formats::raw::{Period, RawStore, SIGNAL};
use pipeline::colour::Illuminant;
use pipeline::develop::{Development, Recipe, Shading};
use pipeline::geometry::{Rect, Size};
use serde_json::{Value, json};
use std::path::Path;

/// Sensor and recipes of the raw that is shown.
pub struct Mosaic {
    frame: Frame,
    /// Rows and columns of the period of its pattern.
    pub period: Period,
    /// Of each illuminant: its recipe, or why there is none.
    recipes: Vec<(Illuminant, Result<Recipe, String>)>,
    /// Electrons per second, if they were kept.
    signal: Option<ChartStore>,
    /// Path of the raw.
    path: String,
    /// Paths in the raw of the levels of the array.
    levels: Vec<String>,
    /// State of the stored levels.
    pub state: PyramidState,
}

/// The recipe of a frame, if it can be developed.
fn recipe(frame: &Frame, style: &DevelopStyle) -> Result<Recipe> {
    let recipe = recipe::resolve(frame, style, 1)?.recipe;
    Development::new(recipe.clone(), (frame.rect.y as usize, frame.rect.x as usize))?;
    Ok(recipe)
}

impl Mosaic {
    /// The raw `PATH` or `PATH//array`; none if it is no raw.
    ///
    /// # Errors
    /// As [`Frame::open`], for any frame.
    pub fn open(spec: &str) -> Result<Option<Self>> {
        let (path, _) = split_group(spec);
        let raw = match RawStore::open(Path::new(path), true) {
            Err(GroupError::NotOfKind { .. }) => return Ok(None),
            other => other?,
        };
        let frames = raw.spec().exposure_s.len();
        let mut all = (0..frames).map(|f| Frame::open(spec, f, 0)).collect::<Result<Vec<_>>>()?;
        let frame = all.swap_remove(0);
        let output = raw.spec().outputs.iter().position(|o| o.rect == frame.rect && o.name == frame.array());
        let output = output.ok_or_else(|| usage(format!("{spec}: no such array")))?;
        let levels = formats::pyramid::level_sizes(frame.rect.size()).len();
        let recipes = Illuminant::ALL.map(|light| {
            let style = DevelopStyle { white: Some(light.name().into()), ..DevelopStyle::default() };
            (light, recipe(&frame, &style).map_err(|e| line(&e)))
        });
        let signal =
            raw.spec().signal.then(|| ChartStore::open_at(Path::new(path), SIGNAL, ChartOptions::default()));
        Ok(Some(Self {
            period: raw.period()?,
            recipes: recipes.into(),
            signal: signal.transpose()?,
            path: path.to_owned(),
            levels: (0..levels).map(|level| raw.pyramid().level_path(output, level)).collect(),
            state: raw.pyramid().state()?,
            frame,
        }))
    }

    /// Whether it can be developed under any light.
    pub fn is_developable(&self) -> bool {
        self.recipes.iter().any(|(_, recipe)| recipe.is_ok())
    }

    /// Opens a stored level with a cache of decoded chunks; its bands are the frames.
    pub fn level(&self, level: usize, cache_bytes: usize) -> Result<ChartStore> {
        let frames = self.frame.spec.exposure_s.len();
        let options = ChartOptions {
            cache_bytes,
            wavelengths_nm: Some((1..=frames).map(|f| f as f64).collect()),
            ..ChartOptions::default()
        };
        Ok(ChartStore::open_at(Path::new(&self.path), &self.levels[level], options)?)
    }

    /// The development of a level of `size` under a light.
    pub fn development(&self, size: Size, light: Illuminant) -> Result<Development> {
        let (_, recipe) =
            self.recipes.iter().find(|(l, _)| *l == light).ok_or_else(|| anyhow!("no such light"))?;
        let recipe = recipe.clone().map_err(|why| anyhow!("{why}"))?;
        let origin = (self.frame.rect.y as usize, self.frame.rect.x as usize);
        Ok(Development::new(Recipe { size, ..recipe }, origin)?)
    }

    /// Red, green and blue of the part `rect` from the stored numbers that the development needs, which become linear.
    pub fn develop(&self, development: &Development, raw: &mut [f32], rect: Rect) -> Vec<[f32; 3]> {
        self.frame.linearize(raw);
        let linear = development.develop(raw, Shading::None, rect);
        match development.channels() {
            1 => linear.iter().map(|v| [*v; 3]).collect(),
            _ => linear.as_chunks().0.to_vec(),
        }
    }

    /// Stored numbers as linear shares of the range from black to white.
    pub fn normalize(&self, counts: &mut [f32]) {
        self.frame.linearize(counts);
        let (black, white) = self.frame.black_white_dn();
        let (black, range) = (black as f32, (white - black) as f32);
        counts.iter_mut().for_each(|v| *v = (*v - black) / range);
    }

    /// What the page shows of the raw.
    pub fn describe(&self) -> Value {
        let (black, white) = self.frame.black_white_dn();
        let sensor = &self.frame.sensor;
        let lights: Vec<&str> =
            self.recipes.iter().filter(|(_, recipe)| recipe.is_ok()).map(|(light, _)| light.name()).collect();
        json!({
            "sensor": sensor.name,
            "exposure_s": self.frame.spec.exposure_s,
            "gain": self.frame.gain,
            "black_dn": black,
            "white_dn": white,
            "white": self.frame.light().unwrap_or_default().name(),
            "lights": lights,
        })
    }

    /// Pixel pitch in µm, and the optical axis (row, column) in pixels of the array.
    pub fn place(&self) -> (f64, (f64, f64)) {
        let (spec, rect) = (&self.frame.spec, self.frame.rect);
        let axis = |n: usize, centre_mm: f64, first: i64| {
            (n as f64 - 1.0) / 2.0 - centre_mm / (spec.pitch_um * 1e-3) - first as f64
        };
        let down = axis(spec.sensor.height, spec.centre_mm.0, rect.y);
        (spec.pitch_um, (down, axis(spec.sensor.width, spec.centre_mm.1, rect.x)))
    }

    /// What is known of a pixel whose stored numbers are `counts`, frame by frame: electrons e⁻ = (DN − black)/(g·K), and those of the
    /// signal without noise, if it was kept.
    pub fn pixel(&self, y: usize, x: usize, counts: &[f32]) -> Result<Value> {
        let (frame, sensor) = (&self.frame, &self.frame.sensor);
        let (black, white) = frame.black_white_dn();
        let (row, column) = (frame.rect.y as usize + y, frame.rect.x as usize + x);
        let filter = &sensor.channels[sensor.pattern.channel(row, column)];
        let signal = match &self.signal {
            None => None,
            Some(store) => {
                let mut value = [0.0];
                store.read_rect(0, Rect::new(y as i64, x as i64, 1, 1), &mut value)?;
                Some(f64::from(value[0])).filter(|v| v.is_finite())
            }
        };
        let scale = frame.attributes.get("film_scale").and_then(Value::as_f64).unwrap_or(1.0);
        let mut linear = counts.to_vec();
        frame.linearize(&mut linear);
        let numbers = std::iter::zip(counts, &linear);
        let frames = std::iter::zip(numbers, &frame.spec.exposure_s).map(|((&dn, &linear_dn), &seconds)| {
            json!({
                "dn": dn,
                "electrons": (f64::from(linear_dn) - black) / (frame.gain * sensor.adc.gain_dn_per_e),
                "clipped": f64::from(linear_dn) >= white,
                "signal_e": signal.map(|s| s.max(0.0) * scale * seconds),
            })
        });
        Ok(json!({
            "row": row,
            "column": column,
            "filter": filter.name,
            "plane": filter.plane,
            "signal_e_per_s": signal.map(|s| s * scale),
            "frames": frames.collect::<Vec<_>>(),
        }))
    }
}
