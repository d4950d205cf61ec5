//! Shading by a lens or by a flat.

use super::frame::{Frame, split_group};
use crate::failure::usage;
use crate::job::default_options;
use crate::job::lens::{JobLens, UntracedLens};
use anyhow::{Context, Result};
use formats::dng::GainMaps;
use formats::raw::RawStore;
use pipeline::develop::shading::MIN_DIVISOR;
use pipeline::develop::{Development, Flat, LensShading, Shading};
use pipeline::geometry::{Frame as FilmFrame, Rect, Size};
use pipeline::sensor::response_map::ResponseMap;
use pipeline::sensor::{Channel, Sensor};
use serde_json::{Map, Value, json};
use std::path::Path;

/// Side of the middle of a flat that its values are relative to, pixels.
const MIDDLE_PX: usize = 64;

/// Key of a raw whose sensor responds to the angle of incidence: the response of each filter on a grid over the sensor.
pub const RESPONSE_MAP: &str = "response_map";

/// `map` of `sensor` as a raw records it.
pub fn recorded(map: &ResponseMap, sensor: &Sensor) -> Value {
    let filters: Map<String, Value> =
        sensor.channels.iter().zip(&map.filters).map(|(c, v)| (c.name.clone(), json!(v))).collect();
    json!({ "cells": [map.cells.0, map.cells.1], "filters": filters })
}

/// The response that the raw of `frame` records; none without. It is checked.
///
/// # Errors
/// A raw whose sensor has one, without it, or with a damaged one.
pub fn response_map(frame: &Frame) -> Result<Option<ResponseMap>> {
    if !frame.sensor.depends_on_angles() {
        return Ok(None);
    }
    let found = frame.attributes.get(RESPONSE_MAP).cloned().unwrap_or_default();
    let whole = |v: &Value| v.as_u64().map(|n| n as usize).filter(|n| (1..=4096).contains(n));
    let cells = whole(&found["cells"][0]).zip(whole(&found["cells"][1]));
    let of = |c: &Channel| {
        let (rows, columns) = cells?;
        let values = found["filters"][&c.name].as_array()?;
        let number = |v: &Value| v.as_f64().map(|v| v as f32).filter(|v| v.is_finite() && *v >= 0.0);
        let numbers: Vec<f32> = values.iter().map(number).collect::<Option<_>>()?;
        (numbers.len() == (rows + 1) * (columns + 1)).then_some(numbers)
    };
    let filters: Option<Vec<Vec<f32>>> = frame.sensor.channels.iter().map(of).collect();
    match cells.zip(filters) {
        Some((cells, filters)) => Ok(Some(ResponseMap { cells, size: frame.spec.sensor, filters })),
        None => Err(usage(format!(
            "the raw's sensor depends on the angle of incidence, but its attribute {RESPONSE_MAP} is missing or damaged"
        ))),
    }
}

/// Gains that undo the response that the raw of `frame` records; none without.
///
/// # Errors
/// As [`response_map`].
pub fn gain_maps(frame: &Frame) -> Result<Option<GainMaps>> {
    let Some(map) = response_map(frame)? else { return Ok(None) };
    let (rect, pattern) = (frame.rect, &frame.sensor.pattern);
    // The grid of the whole sensor, and at least two points.
    let (rows, columns) = (map.cells.0 + 1, map.cells.1 + 1);
    let gains = |place: usize| {
        let (row, column) =
            (rect.y as usize + place / pattern.columns, rect.x as usize + place % pattern.columns);
        let filter = pattern.channel(row, column);
        let at = |point: usize, points: usize, first: i64, n: usize| {
            first as f32 + n as f32 * (point as f32 / (points - 1) as f32) - 0.5
        };
        let gain = |y: usize, x: usize| {
            let place = (at(y, rows, rect.y, rect.height), at(x, columns, rect.x, rect.width));
            (1.0 / map.at(filter, place)).min(1.0 / MIN_DIVISOR)
        };
        (0..rows).flat_map(|y| (0..columns).map(move |x| (y, x))).map(|(y, x)| gain(y, x)).collect()
    };
    Ok(Some(GainMaps {
        period: (pattern.rows, pattern.columns),
        points: (rows, columns),
        gains: (0..pattern.rows * pattern.columns).map(gains).collect(),
    }))
}

/// What a development divides by.
pub enum ShadingSource {
    /// Nothing.
    None,
    /// A lens.
    Lens(Box<LensShading>),
    /// A raw of a uniform chart, and its values in the middle per filter.
    Flat(Box<Frame>, Vec<f32>),
}

impl ShadingSource {
    /// `--shading` for a frame.
    pub fn open(
        word: &str,
        frame: &Frame,
        development: &Development,
        bin: bool,
        threads: usize,
        cache: usize,
    ) -> Result<Self> {
        match word {
            "none" => Ok(Self::None),
            flat if RawStore::is_one(Path::new(split_group(flat).0)).unwrap_or(false) => {
                Self::flat(flat, frame, development, cache)
            }
            lens => Self::lens(lens, frame, bin, threads),
        }
    }

    /// Digital numbers of the flat under some pixels of the raw; empty without a flat.
    pub fn read(&self, rect: Rect) -> Result<Vec<f32>> {
        match self {
            Self::Flat(flat, _) => flat.read(rect),
            _ => Ok(Vec::new()),
        }
    }

    /// The shading with what [`ShadingSource::read`] gave.
    pub fn with<'a>(&'a self, raw: &'a [f32]) -> Shading<'a> {
        match self {
            Self::None => Shading::None,
            Self::Lens(lens) => Shading::Lens(lens),
            Self::Flat(flat, middle) => {
                Shading::Flat(Flat { raw, black_white_dn: flat.black_white_dn(), middle })
            }
        }
    }

    fn flat(word: &str, frame: &Frame, development: &Development, cache: usize) -> Result<Self> {
        let flat = Frame::open(word, 0, cache)?;
        if flat.rect != frame.rect || flat.sensor.pattern != frame.sensor.pattern {
            return Err(usage(format!(
                "--shading {word}: its pixels {} are not those of the raw, {}, or its pattern differs; expose the uniform chart with the same sensor",
                flat.rect, frame.rect
            )));
        }
        let size = development.size();
        let side = |n: usize| n.min(MIDDLE_PX);
        let (h, w) = (side(size.height), side(size.width));
        let part = Rect::new(((size.height - h) / 2) as i64, ((size.width - w) / 2) as i64, h, w);
        let needs = development.needs(part);
        let values = development.values(&flat.read(needs)?, needs, flat.black_white_dn());
        // Filters by place: the first pixel of `needs` may not begin a period.
        let bin = needs.width * needs.height / values.len().max(1) > 1;
        let step = if bin { 2 } else { 1 };
        let width = needs.width / step;
        let mut sums = vec![(0.0f64, 0u32); flat.sensor.channels.len()];
        for (k, v) in values.iter().enumerate() {
            let at = |first: i64, i: usize| first as usize / step + i;
            let of = &mut sums[development.filter(at(needs.y, k / width), at(needs.x, k % width))];
            *of = (of.0 + f64::from(*v), of.1 + 1);
        }
        let mut middle = Vec::new();
        for (c, (sum, n)) in sums.iter().enumerate() {
            let mean = sum / f64::from((*n).max(1));
            if mean.is_nan() || mean <= 0.0 {
                return Err(usage(format!(
                    "--shading {word}: its middle is dark behind {}; expose it longer",
                    flat.sensor.channels[c].name
                )));
            }
            middle.push(mean as f32);
        }
        Ok(Self::Flat(Box::new(flat), middle))
    }

    fn lens(name: &str, frame: &Frame, bin: bool, threads: usize) -> Result<Self> {
        let (spec, nm) = (&frame.spec, frame.wavelengths_nm());
        let pitch_mm = spec.pitch_um * 1e-3;
        let reach = |n: usize, centre: f64| n as f64 / 2.0 * pitch_mm + centre.abs();
        let (down, across) =
            (reach(spec.sensor.height, spec.centre_mm.0), reach(spec.sensor.width, spec.centre_mm.1));
        let film_um = frame.attributes.get("film").and_then(|f| f["pitch_um"].as_f64());
        let film_um = film_um.filter(|p| *p > 0.0).unwrap_or(spec.pitch_um);
        let pixels = |mm: f64| (2.0 * mm / (film_um * 1e-3) - 1e-6).ceil().max(1.0) as usize;
        let film = Size::new(pixels(down), pixels(across));
        let lens = UntracedLens::open(name).with_context(|| {
            format!("--shading {name}: expected none, a lens, or a raw of a uniform chart")
        })?;
        let film = FilmFrame::centred(film, film, film_um);
        let lens = JobLens::new(lens, &film, &nm, &default_options(), threads, None)?;
        let sensor = &frame.sensor;
        let weights: Vec<Vec<f64>> =
            (0..sensor.channels.len()).map(|c| sensor.band_weights(c, &nm)).collect();
        // The axis in pixels of the array, then of the mosaic.
        let axis =
            |n: usize, centre: f64, first: i64| (n as f64 - 1.0) / 2.0 - centre / pitch_mm - first as f64;
        let step = if bin { 2.0 } else { 1.0 };
        let place = |at: f64, first: i64| match bin {
            true => (at - (first % 2) as f64 - 0.5) / 2.0,
            false => at,
        };
        let (y, x) = (frame.rect.y, frame.rect.x);
        let axis = (
            place(axis(spec.sensor.height, spec.centre_mm.0, y), y),
            place(axis(spec.sensor.width, spec.centre_mm.1, x), x),
        );
        let reach_px = pipeline::real::hypot(down, across) / (pitch_mm * step);
        let shading = LensShading::new(lens.lens(), &nm, &weights, (pitch_mm * step, axis, reach_px))
            .map_err(|e| usage(format!("--shading {name}: {e}")))?;
        // The sensor's pixel under the middle of the picture's first.
        let first = |first: i64| first as f64 + if bin { (first % 2) as f64 + 0.5 } else { 0.0 };
        Ok(Self::Lens(Box::new(match response_map(frame)? {
            None => shading,
            Some(map) => shading.with_angles(map, (first(y), first(x)), step),
        })))
    }
}
