//! One sample: picture → chart → film → raw → developed picture, and what is written of them.

use super::bands::Bands;
use super::camera::Camera;
use super::labels::{Labels, Warp};
use super::optics::Optics;
use super::pictures::{Picture, mask};
use crate::job::arrays::{ArrayLens, Placement};
use anyhow::{Context, Result, anyhow};
use formats::dataset::draw::{Draw, Draws};
use formats::dataset::encode::{Codes, npy, png, tiff};
use formats::dataset::recipe::{Format, Layout, Recipe};
use formats::dataset::store::{Item, Sample};
use formats::film::SampleType;
use pipeline::develop::{Quantizer, Tone};
use pipeline::geometry::{Rect, Size};
use serde_json::{Map, Value, json};
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

/// All that samples are made of.
pub struct Maker<'a> {
    /// The recipe.
    pub recipe: &'a Recipe,
    /// The recipe's folder.
    pub folder: &'a Path,
    /// Its pictures.
    pub pictures: &'a [PathBuf],
    /// What each sample is made of.
    pub draws: Draws<'a>,
    /// Bands and colours.
    pub bands: Bands,
    /// The lenses.
    pub optics: Optics<'a>,
    /// The sensors.
    pub camera: Option<Camera<'a>>,
    /// The labels.
    pub labels: Labels,
    /// Codes of 8 bits in sRGB, and of 16 bits, linear.
    pub quantizers: [Quantizer; 2],
}

impl<'a> Maker<'a> {
    /// Codes of pictures.
    pub fn quantizers() -> [Quantizer; 2] {
        [Quantizer::new(Tone::Srgb, 8), Quantizer::new(Tone::Linear, 16)]
    }

    /// Makes sample `number`. A picture that cannot be read makes a sample with an error and without items.
    ///
    /// # Errors
    /// Of the lens, the sensor, an interruption.
    pub fn make(&self, number: u64, cancel: &AtomicBool) -> Result<Sample> {
        let draw = self.draws.of(number);
        let path = &self.pictures[draw.picture];
        let mut line = Map::new();
        line.insert("picture".into(), json!(self.shown(path)));
        let chart = match self.chart(&draw) {
            Ok(chart) => chart,
            Err(error) => {
                line.insert("error".into(), json!(crate::failure::text(&error)));
                return Ok(Sample { number, line, items: Vec::new() });
            }
        };
        let context = || format!("sample {number} ({}, at {:?} mm)", path.display(), draw.center_mm);
        self.of_chart(&draw, &chart, &mut line, cancel).with_context(context)
    }

    /// A path as lines have it: from the recipe's folder.
    pub fn shown(&self, path: &Path) -> String {
        path.strip_prefix(self.folder).unwrap_or(path).to_string_lossy().into_owned()
    }

    /// The part of the picture that is the chart of a sample.
    fn chart(&self, draw: &Draw) -> Result<ChartPart> {
        let path = &self.pictures[draw.picture];
        let picture = Picture::open(path)?;
        let (size, margin) = (picture.size(), 2 * self.recipe.film.margin_px);
        let film = match self.recipe.pictures.size {
            Some([width, height]) => Size::new(height, width),
            None => Size::new(size.height.saturating_sub(margin), size.width.saturating_sub(margin)),
        };
        let chart = Size::new(film.height + margin, film.width + margin);
        if film.pixels() == 0 || chart.height > size.height || chart.width > size.width {
            return Err(anyhow!(
                "{}: expected at least {chart} px (pictures.size and twice film.margin_px), found {size}",
                path.display()
            ));
        }
        let place = |free: usize, u: f64| ((u * (free + 1) as f64) as usize).min(free) as i64;
        let (y, x) =
            (place(size.height - chart.height, draw.part.0), place(size.width - chart.width, draw.part.1));
        let part = Rect::new(y, x, chart.height, chart.width);
        let mask = match self.labels.mask_of(path) {
            None => None,
            Some(path) => Some(mask(&path, size, part)?),
        };
        let pixels = picture.bands(part, &self.bands).with_context(|| path.display().to_string())?;
        if let Some(value) = pixels.iter().find(|v| !v.is_finite()) {
            return Err(anyhow!("{}: expected finite numbers, found {value}", path.display()));
        }
        Ok(ChartPart { part, film, pixels, mask })
    }

    fn of_chart(
        &self,
        draw: &Draw,
        chart: &ChartPart,
        line: &mut Map<String, Value>,
        cancel: &AtomicBool,
    ) -> Result<Sample> {
        let nm = self.bands.wavelengths_nm()[self.bands.of_labels()];
        let lens = self.optics.lens(draw)?;
        let place = self.optics.placement(&lens, draw, chart.film, nm)?;
        self.describe((draw, chart), &lens, &place, line);
        let warp = Warp { lens: &lens, place: &place, part: chart.part, nm };
        if let Some(annotations) = self.labels.annotations(&self.pictures[draw.picture], &warp)? {
            line.insert("annotations".into(), json!(annotations));
        }
        let bands = self.bands.wavelengths_nm().len();
        let compute = |clean: bool| -> Result<Vec<f32>> {
            let film = self.optics.film(&lens, &place, clean)?;
            let mut pixels = vec![0.0; bands * place.film.pixels()];
            film.compute(&chart.pixels, &mut pixels, cancel)?;
            Ok(pixels)
        };
        let output = &self.recipe.output;
        let mut items = Vec::new();
        if output.film.is_some() || output.raw.is_some() || output.picture.is_some() {
            let film = compute(false)?;
            if let Some(format) = output.film {
                items.push(self.film_item("film", format, &film, place.film)?);
            }
            if let (Some(camera), true) = (&self.camera, output.raw.is_some() || output.picture.is_some()) {
                let raw = camera.expose(&film, place.film, draw)?;
                let e = &raw.exposure;
                line.insert("sensor".into(), json!(camera.name(draw.sensor)));
                line.insert("exposure_s".into(), json!(e.seconds));
                line.insert("film_scale".into(), json!(e.scale));
                line.insert("exposure_ev".into(), json!(draw.exposure_ev));
                line.insert("gain".into(), json!(e.gain));
                line.insert("noise_seed".into(), json!(e.seed));
                if let Some(format) = output.raw {
                    items.push(self.numbers_item("raw", format, &raw.numbers, raw.size, 16)?);
                }
                if let Some(format) = output.picture {
                    let (values, channels) = camera.develop(&raw, draw, &self.bands)?;
                    let size = Size::new(values.len() / channels / raw.size.width, raw.size.width);
                    items.push(self.picture_item("picture", format, &values, size, channels)?);
                }
            }
        }
        if let Some(format) = output.clean {
            items.push(self.film_item("clean", format, &compute(true)?, place.film)?);
        }
        if let Some((values, white)) = &chart.mask {
            let bits = if *white == 255 { 8 } else { 16 };
            let format = if output.layout == Layout::Zarr { Format::Npy } else { Format::Png };
            items.push(self.numbers_item("mask", format, &warp.mask(values)?, place.film, bits)?);
        }
        Ok(Sample { number: draw.sample, line: std::mem::take(line), items })
    }

    /// All that made the sample.
    fn describe(
        &self,
        (draw, chart): (&Draw, &ChartPart),
        lens: &ArrayLens,
        place: &Placement,
        line: &mut Map<String, Value>,
    ) {
        let Rect { x, y, width, height } = chart.part;
        line.insert("part".into(), json!([x, y, width, height]));
        line.insert("lens".into(), json!(self.optics.name(draw.lens)));
        if let Some(m) = draw.focus_m {
            // JSON has no infinity.
            let focus = if m.is_finite() { json!(m) } else { json!("inf") };
            line.insert("focus_m".into(), focus);
        }
        line.insert("center_mm".into(), json!(place.center_mm));
        line.insert("chart_center_mm".into(), json!(place.chart_center_mm));
        line.insert("run".into(), json!(self.optics.run_flags(lens, draw, place)));
    }

    /// A film, or the chart in register, as an item.
    fn film_item(&self, name: &str, format: Format, bands: &[f32], size: Size) -> Result<Item> {
        match format {
            Format::Npy => {
                let bytes: Vec<u8> = bands.iter().flat_map(|v| v.to_le_bytes()).collect();
                let shape = [bands.len() / size.pixels(), size.height, size.width];
                Ok(self.array_item(name, SampleType::F32, &shape, bytes))
            }
            _ => {
                let rgb = self.bands.rgb(bands, size.pixels(), self.recipe.output.white);
                self.picture_item(name, format, &rgb, size, 3)
            }
        }
    }

    /// Linear values, pixel by pixel, as an item.
    fn picture_item(
        &self,
        name: &str,
        format: Format,
        values: &[f32],
        size: Size,
        channels: usize,
    ) -> Result<Item> {
        let [srgb, linear] = &self.quantizers;
        let codes = |quantizer: &Quantizer| quantizer.codes(values);
        let bytes = match format {
            Format::Png => png(Codes { size, channels, values: &codes(srgb) }, 8, true)?,
            Format::Tif => tiff(Codes { size, channels, values: &codes(linear) })?,
            Format::Npy => {
                let channel = |c: usize| values.iter().skip(c).step_by(channels);
                let bytes = (0..channels).flat_map(|c| channel(c).flat_map(|v| v.to_le_bytes())).collect();
                return Ok(self.array_item(
                    name,
                    SampleType::F32,
                    &[channels, size.height, size.width],
                    bytes,
                ));
            }
        };
        Ok(Item { name: name.into(), ending: format.ending(), bytes })
    }

    /// Whole numbers as an item.
    fn numbers_item(&self, name: &str, format: Format, values: &[u16], size: Size, bits: u8) -> Result<Item> {
        let codes = Codes { size, channels: 1, values };
        let bytes = match format {
            Format::Png => png(codes, bits, false)?,
            Format::Tif => tiff(codes)?,
            Format::Npy => {
                let bytes = values.iter().flat_map(|v| v.to_le_bytes()).collect();
                return Ok(self.array_item(name, SampleType::U16, &[size.height, size.width], bytes));
            }
        };
        Ok(Item { name: name.into(), ending: format.ending(), bytes })
    }

    /// An array: a NumPy file, or the samples of a Zarr array.
    fn array_item(&self, name: &str, sample: SampleType, shape: &[usize], samples: Vec<u8>) -> Item {
        match self.recipe.output.layout {
            Layout::Zarr => Item { name: name.into(), ending: "array", bytes: samples },
            _ => Item { name: name.into(), ending: "npy", bytes: npy(sample, shape, &samples) },
        }
    }
}

/// The chart of a sample.
struct ChartPart {
    part: Rect,
    film: Size,
    pixels: Vec<f32>,
    /// Values of the mask, and the largest that its format has.
    mask: Option<(Vec<u16>, u16)>,
}
