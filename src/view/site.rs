//! What is on view: the film, the chart laid over it, the lens; and what the page is told of them.

use super::lens::Lens;
use super::stack::{Stack, TILE, film_of};
use crate::args::ViewArgs;
use crate::failure::line;
use crate::memory::default_limit;
use crate::progress::say;
use anyhow::Result;
use formats::film::FilmSpec;
use formats::picture::style::wavelength_colour;
use pipeline::geometry::Rect;
use serde_json::{Map, Value, json};
use std::sync::atomic::AtomicBool;

/// Most memory for caches, bytes.
const MAX_MEMORY: u64 = 1 << 30;

/// All that is on view.
pub struct Site {
    /// The film, or a chart alone.
    pub film: Stack,
    /// What it was made of.
    pub chart: Option<Stack>,
    /// What the film tells of itself; `None` for a chart.
    told: Option<Told>,
    /// The lens, or why there is none.
    pub lens: Result<Lens, String>,
}

struct Told {
    spec: FilmSpec,
    provenance: Map<String, Value>,
    rect: Rect,
}

impl Site {
    /// Opens all that `args` name.
    pub fn open(args: &ViewArgs) -> Result<Self> {
        let memory = usize::try_from(default_limit().min(MAX_MEMORY)).unwrap_or(usize::MAX);
        let film = if args.film.starts_with("gen:") { None } else { film_of(&args.film)? };
        let told = film.map(|(store, output)| Told {
            spec: store.spec().clone(),
            provenance: store.provenance().clone(),
            rect: store.spec().outputs[output].rect,
        });
        let drawn = told.as_ref().and_then(|t| t.provenance.get("job")?["chart"]["drawn"].as_str());
        let chart = args.chart.clone().or_else(|| drawn.map(|spec| format!("gen:{spec}")));
        let share = memory / if chart.is_some() { 2 } else { 1 };
        let film = Stack::open(&args.film, args.wavelengths.as_deref(), None, share)?;
        let chart = match chart {
            None => None,
            Some(spec) => match Stack::open(&spec, None, Some(&film.wavelengths_nm), share) {
                Ok(chart) => Some(chart),
                // Nobody asked for it.
                Err(e) if args.chart.is_none() => {
                    say(format!("note: the chart is not shown: {}", line(&e)));
                    None
                }
                Err(e) => return Err(e),
            },
        };
        let lens = match &told {
            None => Err("only a film has a lens".to_owned()),
            Some(told) => Lens::open(args.lens.as_deref(), &told.provenance).map_err(|e| line(&e)),
        };
        if let (Err(why), true) = (&lens, args.lens.is_some()) {
            anyhow::bail!("opening the lens: {why}");
        }
        Ok(Self { film, chart, told, lens })
    }

    /// A stack by its name in addresses.
    pub fn stack(&self, name: &str) -> Option<&Stack> {
        match name {
            "film" => Some(&self.film),
            "chart" => self.chart.as_ref(),
            _ => None,
        }
    }

    /// What the page is told once.
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
            "colour": film.has_colour(),
            "units": film.units(),
            "pyramid": film.pyramid.name(),
            "film": self.told.is_some(),
            "pitch_um": self.told.as_ref().map(|t| t.spec.pitch_um),
            "axis": self.axis().map(|(y, x)| [y, x]),
            "chart": self.chart.as_ref().map(|chart| json!({
                "name": chart.name,
                "size": [chart.size().height, chart.size().width],
                "levels": chart.sizes.len(),
                "units": chart.units(),
                "pyramid": chart.pyramid.name(),
                "place": self.chart_place(),
                "same_exposure": self.same_values(),
            })),
            "lens": lens,
        })
    }

    /// Whether chart and film values mean the same, so that one exposure shows both.
    pub fn same_values(&self) -> bool {
        let relative = self.told.as_ref().and_then(|t| t.provenance.get("job")?["film_units"].as_str());
        relative.is_none_or(|units| units == "relative")
    }

    /// The optical axis (row, column) in pixels of what is shown.
    fn axis(&self) -> Option<(f64, f64)> {
        let t = self.told.as_ref()?;
        Some((t.spec.axis_px.0 - t.rect.y as f64, t.spec.axis_px.1 - t.rect.x as f64))
    }

    /// Where the chart lies on what is shown: left and upper edge, and width and height, in pixels. Edges lie half a pixel
    /// before the centre of the first pixel, at 0.
    pub fn chart_place(&self) -> Option<[f64; 4]> {
        let size = self.chart.as_ref()?.size();
        let (height, width) = (size.height as f64, size.width as f64);
        let Some((t, axis)) = self.told.as_ref().zip(self.axis()) else {
            return Some([0.0, 0.0, width, height]);
        };
        let job = t.provenance.get("job").cloned().unwrap_or_default();
        let of = |key: &str, axis: &str, none: f64| job[key][axis].as_f64().unwrap_or(none);
        let pitch_mm = t.spec.pitch_um * 1e-3;
        let (w, h) = (width * of("scale", "x", 1.0), height * of("scale", "y", 1.0));
        let x = axis.1 + 0.5 + of("center_mm", "x", 0.0) / pitch_mm - w / 2.0;
        let y = axis.0 + 0.5 + of("center_mm", "y", 0.0) / pitch_mm - h / 2.0;
        Some([x, y, w, h])
    }

    /// REAL image height in mm and azimuth in degrees of a pixel.
    pub fn field_point(&self, y: usize, x: usize) -> Option<(f64, f64)> {
        let (cy, cx) = self.axis()?;
        let pitch_mm = self.told.as_ref()?.spec.pitch_um * 1e-3;
        let (dy, dx) = ((y as f64 - cy) * pitch_mm, (x as f64 - cx) * pitch_mm);
        Some((dy.hypot(dx), dy.atan2(dx).to_degrees()))
    }

    /// What the page is told of a pixel.
    pub fn pixel(&self, y: usize, x: usize, stop: &AtomicBool) -> Result<Value> {
        let film = self.film.spectrum(y, x, stop)?;
        let chart = match self.chart.as_ref().zip(self.chart_place()) {
            None => None,
            Some((chart, [left, top, width, height])) => {
                let size = chart.size();
                let column = ((x as f64 + 0.5 - left) / width * size.width as f64).floor();
                let row = ((y as f64 + 0.5 - top) / height * size.height as f64).floor();
                let inside =
                    (0.0..size.width as f64).contains(&column) && (0.0..size.height as f64).contains(&row);
                inside.then(|| chart.spectrum(row as usize, column as usize, stop)).transpose()?
            }
        };
        let place = self.field_point(y, x);
        Ok(json!({
            "y": y,
            "x": x,
            "height_mm": place.map(|p| p.0),
            "azimuth_deg": place.map(|p| p.1),
            "film": film,
            "chart": chart,
        }))
    }
}
