//! Content of the page: film or raw, chart overlay and lens, and their descriptions in JSON.

use super::image_pyramid::{ImagePyramid, TILE, open_film};
use super::lens::Lens;
use super::mosaic::Mosaic;
use crate::args::ViewArgs;
use crate::failure::{line, usage};
use crate::machine::default_limit;
use crate::progress::log_line;
use anyhow::Result;
use formats::picture::style::wavelength_colour;
use serde_json::{Map, Value, json};
use std::sync::atomic::AtomicBool;

/// Maximum memory of the caches.
const MAX_MEMORY_BYTES: u64 = 1 << 30;

/// Film, chart and lens.
pub struct Content {
    /// The film or raw, or a chart alone.
    pub film: ImagePyramid,
    /// Chart that the film was made of.
    pub chart: Option<ImagePyramid>,
    /// Of a film or raw; none for a chart.
    metadata: Option<Metadata>,
    /// The lens, or the reason that none is available.
    pub lens: Result<Lens, String>,
}

struct Metadata {
    pitch_um: f64,
    /// Optical axis (row, column) in pixels of the shown array.
    axis: (f64, f64),
    /// Of a film; empty for a raw.
    provenance: Map<String, Value>,
}

impl Content {
    /// Opens film, chart and lens.
    pub fn open(args: &ViewArgs) -> Result<Self> {
        let memory = usize::try_from(default_limit().min(MAX_MEMORY_BYTES)).unwrap_or(usize::MAX);
        let film = if args.film.starts_with("gen:") { None } else { open_film(&args.film)? };
        let metadata = film.map(|(store, output)| {
            let (spec, rect) = (store.spec(), store.spec().outputs[output].rect);
            Metadata {
                pitch_um: spec.pitch_um,
                axis: (spec.axis_px.0 - rect.y as f64, spec.axis_px.1 - rect.x as f64),
                provenance: store.provenance().clone(),
            }
        });
        let drawn = metadata.as_ref().and_then(|m| m.provenance.get("job")?["chart"]["drawn"].as_str());
        let chart = args.chart.clone().or_else(|| drawn.map(|spec| format!("gen:{spec}")));
        let share = memory / if chart.is_some() { 2 } else { 1 };
        let film =
            ImagePyramid::open(&args.film, (args.wavelengths.as_deref(), args.axes.as_ref()), None, share)?;
        if let Some(mosaic) = &film.mosaic {
            for (flag, given) in [
                ("--chart", args.chart.is_some()),
                ("--lens", args.lens.is_some()),
                ("--wavelengths", args.wavelengths.is_some()),
            ] {
                if given {
                    return Err(usage(format!("{flag} is for films; {} is a raw: view its film", args.film)));
                }
            }
            let (pitch_um, axis) = mosaic.place();
            let metadata = Some(Metadata { pitch_um, axis, provenance: Map::new() });
            return Ok(Self {
                film,
                chart: None,
                metadata,
                lens: Err("a raw has no lens; view its film".into()),
            });
        }
        let chart = match chart {
            None => None,
            Some(spec) => {
                match ImagePyramid::open(&spec, (None, args.axes.as_ref()), Some(&film.wavelengths_nm), share)
                {
                    Ok(chart) => Some(chart),
                    // The user did not request it.
                    Err(e) if args.chart.is_none() => {
                        log_line(format!("note: the chart is not shown: {}", line(&e)));
                        None
                    }
                    Err(e) => return Err(e),
                }
            }
        };
        let lens = match &metadata {
            None => Err("a chart has no lens, only a film".to_owned()),
            Some(m) => Lens::open(args.lens.as_deref(), &m.provenance).map_err(|e| line(&e)),
        };
        if let (Err(why), true) = (&lens, args.lens.is_some()) {
            anyhow::bail!("opening the lens: {why}");
        }
        Ok(Self { film, chart, metadata, lens })
    }

    /// Image by its name in addresses: `film` or `chart`.
    pub fn pyramid(&self, name: &str) -> Option<&ImagePyramid> {
        match name {
            "film" => Some(&self.film),
            "chart" => self.chart.as_ref(),
            _ => None,
        }
    }

    /// Description that the page loads first.
    pub fn describe(&self) -> Value {
        let film = &self.film;
        let bands: Vec<Value> = film
            .wavelengths_nm
            .iter()
            .map(|&nm| {
                let [r, g, b] = wavelength_colour(nm);
                json!({"nm": nm, "ink": format!("#{r:02x}{g:02x}{b:02x}")})
            })
            .collect();
        let lens = match &self.lens {
            Ok(lens) => json!({"name": lens.name(), "note": lens.note}),
            Err(why) => json!({"error": why}),
        };
        json!({
            "name": film.name,
            "size": [film.size().height, film.size().width],
            "levels": film.sizes.len(),
            "tile": TILE,
            "bands": bands,
            "colour": film.mosaic.as_ref().map_or_else(|| film.has_colour(), Mosaic::is_developable),
            "units": film.units(),
            "pyramid": film.stored_levels.name(),
            "film": self.metadata.is_some(),
            "raw": film.mosaic.as_ref().map(Mosaic::describe),
            "pitch_um": self.metadata.as_ref().map(|m| m.pitch_um),
            "axis": self.axis().map(|(y, x)| [y, x]),
            "chart": self.chart.as_ref().map(|chart| json!({
                "name": chart.name,
                "size": [chart.size().height, chart.size().width],
                "levels": chart.sizes.len(),
                "units": chart.units(),
                "pyramid": chart.stored_levels.name(),
                "place": self.chart_rect(),
                "same_exposure": self.same_values(),
            })),
            "lens": lens,
        })
    }

    /// Whether chart and film have the same units, so that one exposure suits both.
    pub fn same_values(&self) -> bool {
        let units = self.metadata.as_ref().and_then(|m| m.provenance.get("job")?["film_units"].as_str());
        units.is_none_or(|units| units == "relative")
    }

    /// Optical axis (row, column) in pixels of the shown region.
    fn axis(&self) -> Option<(f64, f64)> {
        self.metadata.as_ref().map(|m| m.axis)
    }

    /// Rectangle of the chart in pixels of the shown region: left, top, width, height. The left and top edges of the first pixel
    /// are at 0, half a pixel before its centre.
    fn chart_rect(&self) -> Option<[f64; 4]> {
        let size = self.chart.as_ref()?.size();
        let (height, width) = (size.height as f64, size.width as f64);
        let Some((metadata, axis)) = self.metadata.as_ref().zip(self.axis()) else {
            return Some([0.0, 0.0, width, height]);
        };
        let job = metadata.provenance.get("job").cloned().unwrap_or_default();
        let value = |key: &str, axis: &str, default: f64| job[key][axis].as_f64().unwrap_or(default);
        let pitch_mm = metadata.pitch_um * 1e-3;
        let (w, h) = (width * value("scale", "x", 1.0), height * value("scale", "y", 1.0));
        let x = axis.1 + 0.5 + value("center_mm", "x", 0.0) / pitch_mm - w / 2.0;
        let y = axis.0 + 0.5 + value("center_mm", "y", 0.0) / pitch_mm - h / 2.0;
        Some([x, y, w, h])
    }

    /// REAL image height in mm and azimuth in degrees of a pixel; none for a chart.
    pub fn height_and_azimuth(&self, y: usize, x: usize) -> Option<(f64, f64)> {
        let (cy, cx) = self.axis()?;
        let pitch_mm = self.metadata.as_ref()?.pitch_um * 1e-3;
        let (dy, dx) = ((y as f64 - cy) * pitch_mm, (x as f64 - cx) * pitch_mm);
        Some((dy.hypot(dx), dy.atan2(dx).to_degrees()))
    }

    /// Spectra of film and chart at a pixel, and its field point.
    pub fn pixel(&self, y: usize, x: usize, cancel: &AtomicBool) -> Result<Value> {
        let film = self.film.spectrum(y, x, cancel)?;
        let raw = self.film.mosaic.as_ref().map(|mosaic| mosaic.pixel(y, x, &film)).transpose()?;
        let chart = match self.chart.as_ref().zip(self.chart_rect()) {
            None => None,
            Some((chart, [left, top, width, height])) => {
                let size = chart.size();
                let column = ((x as f64 + 0.5 - left) / width * size.width as f64).floor();
                let row = ((y as f64 + 0.5 - top) / height * size.height as f64).floor();
                let inside =
                    (0.0..size.width as f64).contains(&column) && (0.0..size.height as f64).contains(&row);
                inside.then(|| chart.spectrum(row as usize, column as usize, cancel)).transpose()?
            }
        };
        let field_point = self.height_and_azimuth(y, x);
        Ok(json!({
            "y": y,
            "x": x,
            "height_mm": field_point.map(|p| p.0),
            "azimuth_deg": field_point.map(|p| p.1),
            "film": film,
            "chart": chart,
            "raw": raw,
        }))
    }
}
