//! Raws of different sensors side by side: no pixel of one is a pixel of the other, so each is measured by itself, in the same cells of the film plane.
//!
//! ```text
//! mean, σ         of the pixels of a plane, e-: σ from the noises of the sensor that are on, at the cell's mean
//! SNR             mean/σ of a pixel
//! SNR of 100 µm²  mean/σ · √(100 µm² · share of the plane's pixels / pitch²): of the light of one area, whatever the size of its pixels
//! ```
//! Cells divide the part of the film plane that both sensors see, in mm from the optical axis; a pixel belongs to the cell of its centre.

use super::regions::electrons;
use super::report::{NAMES, page};
use crate::args::CompareArgs;
use crate::camera::frame::Frame;
use crate::failure::usage;
use crate::machine::threads;
use crate::outputs::page::table;
use crate::progress::print;
use anyhow::Result;
use formats::durable::{AtomicFile, create_directories};
use formats::parallel;
use formats::picture::plot::{Axis, Plot, Series, stacked};
use formats::picture::series::Shape;
use formats::picture::style::Style;
use formats::picture::text::escape;
use pipeline::geometry::Rect;
use serde_json::{Value, json};
use std::fmt::Write;
use std::sync::Mutex;

/// Area for which sensors of different pixels are compared, µm².
const AREA_UM2: f64 = 100.0;

/// A plane of a raw in a cell.
#[derive(Clone, Debug)]
struct Cell {
    /// 0: the first raw.
    raw: usize,
    plane: String,
    /// Middle of the cell, mm from the axis: down, right.
    middle_mm: (f64, f64),
    pixels: u64,
    mean_e: f64,
    sigma_e: f64,
    /// SNR of 100 µm² over that of a pixel.
    of_area: f64,
}

impl Cell {
    fn snr_db(&self) -> f64 {
        20.0 * (self.mean_e / self.sigma_e).log10()
    }

    fn area_snr_db(&self) -> f64 {
        20.0 * (self.of_area * self.mean_e / self.sigma_e).log10()
    }

    fn height_mm(&self) -> f64 {
        self.middle_mm.0.hypot(self.middle_mm.1)
    }

    fn json(&self) -> Value {
        json!({
            "raw": NAMES[self.raw],
            "plane": self.plane,
            "middle_mm": { "x": self.middle_mm.1, "y": self.middle_mm.0 },
            "image_height_mm": self.height_mm(),
            "pixels": self.pixels,
            "mean_e": self.mean_e,
            "sigma_e": self.sigma_e,
            "snr_db": self.snr_db(),
            "snr_of_100_um2_db": self.area_snr_db(),
        })
    }
}

/// Files of a comparison of the raws `names` with `frames`.
///
/// # Errors
/// Usage: edges or patches; sensors that see no common part of the film plane.
pub fn compare(args: &CompareArgs, names: [&str; 2], frames: &[Frame; 2]) -> Result<Vec<AtomicFile>> {
    for (flag, is_given) in [("--edge", !args.edge.is_empty()), ("--patch", !args.patch.is_empty())] {
        if is_given {
            return Err(usage(format!(
                "{flag} is a place in pixels, and the sensors of {} and {} have no pixels in common: leave it out, or compare raws of one sensor",
                names[0], names[1]
            )));
        }
    }
    let extents = frames.each_ref().map(extent_mm);
    let common: [(f64, f64); 2] =
        [0, 1].map(|k| (extents[0][k].0.max(extents[1][k].0), extents[0][k].1.min(extents[1][k].1)));
    if common.iter().any(|(from, to)| from >= to) {
        return Err(usage(format!(
            "{} and {}: expected sensors that see a common part of the film plane, their places differ (see --center of `lenscube sensor`)",
            names[0], names[1]
        )));
    }
    let cells = measure(frames, common, args.grid as usize, threads(args.threads))?;
    let title = format!("A: {}   B: {}", names[0], names[1]);
    let figure = stacked(&title, &plots(&cells), Style::Light);
    create_directories(&args.out, true)?;
    let of_frame = |frame: &Frame| {
        let pitch = frame.spec.pitch_um;
        json!({ "sensor": frame.sensor.name, "pitch_um": pitch, "exposure_s": frame.exposure_s(), "gain": frame.gain })
    };
    let all = json!({
        "raws": names,
        "sensors": frames.each_ref().map(of_frame),
        "common_mm": { "x": common[1], "y": common[0] },
        "cells": cells.iter().map(Cell::json).collect::<Vec<_>>(),
    });
    let summary = summary(&cells);
    summary[1..].iter().for_each(|row| {
        print(format!(
            "{}, {}: mean {} e-, SNR of a pixel {} dB, of 100 µm² {} dB",
            row[0], row[1], row[2], row[3], row[4]
        ));
    });
    let described = |k: usize| {
        let frame = &frames[k];
        let (name, pitch, seconds) = (&frame.sensor.name, frame.spec.pitch_um, frame.exposure_s());
        format!(
            "{}: <b>{}</b>, {}, {pitch} µm, {seconds:.6} s, gain {}",
            NAMES[k],
            escape(names[k]),
            escape(name),
            frame.gain
        )
    };
    let body = format!(
        "<p>{}<br>{}</p><p>Sensors of different pixels: each raw by itself, in the same places of the film plane.</p>{}\
         <h2>Means over the common part</h2>{}",
        described(0),
        described(1),
        figure.to_svg_element(),
        table(summary),
    );
    let at = |name: &str| args.out.join(name);
    Ok(vec![
        figure.file(&at("figures.png"))?,
        AtomicFile::with_text(&at("regions.csv"), &csv(&cells))?,
        AtomicFile::with_text(&at("compare.json"), &(serde_json::to_string_pretty(&all)? + "\n"))?,
        AtomicFile::with_text(&at("report.html"), &page("Two sensors", &body))?,
    ])
}

/// First and last edge of the pixels of `frame` from the axis, mm: down, right.
fn extent_mm(frame: &Frame) -> [(f64, f64); 2] {
    let (spec, rect) = (&frame.spec, frame.rect);
    let pitch_mm = spec.pitch_um * 1e-3;
    let of = |first: i64, n: usize, side: usize, centre_mm: f64| {
        let from = (first as f64 - side as f64 / 2.0) * pitch_mm + centre_mm;
        (from, from + n as f64 * pitch_mm)
    };
    [
        of(rect.y, rect.height, spec.sensor.height, spec.centre_mm.0),
        of(rect.x, rect.width, spec.sensor.width, spec.centre_mm.1),
    ]
}

/// Pixels of `frame` whose centres lie in cell `k` of `grid` along `axis` of `common`.
fn pixels(
    frame: &Frame,
    axis: usize,
    common: (f64, f64),
    (k, grid): (usize, usize),
) -> std::ops::Range<usize> {
    let (origin, end) = extent_mm(frame)[axis];
    let pitch_mm = frame.spec.pitch_um * 1e-3;
    let count = ((end - origin) / pitch_mm).round();
    let edge = |k: usize| {
        let mm = common.0 + (common.1 - common.0) * k as f64 / grid as f64;
        ((mm - origin) / pitch_mm - 0.5 - 1e-9).ceil().clamp(0.0, count) as usize
    };
    edge(k)..edge(k + 1)
}

fn measure(frames: &[Frame; 2], common: [(f64, f64); 2], grid: usize, threads: usize) -> Result<Vec<Cell>> {
    let count = 2 * grid * grid;
    let found: Mutex<Vec<Vec<Cell>>> = Mutex::new(vec![Vec::new(); count]);
    parallel::for_each::<anyhow::Error>(threads.min(count), count, &|_, _| (), |item| {
        let (raw, i, j) = (item / (grid * grid), item / grid % grid, item % grid);
        let frame = &frames[raw];
        let (rows, columns) =
            (pixels(frame, 0, common[0], (i, grid)), pixels(frame, 1, common[1], (j, grid)));
        if rows.is_empty() || columns.is_empty() {
            return Ok(());
        }
        let rect = Rect::new(rows.start as i64, columns.start as i64, rows.len(), columns.len());
        let middle =
            |k: usize, at: usize| common[k].0 + (common[k].1 - common[k].0) * (at as f64 + 0.5) / grid as f64;
        let cells = planes(frame, rect)?.into_iter().map(|(plane, pixels, mean_e)| {
            let share = pixels as f64 / rect.size().pixels() as f64;
            Cell {
                raw,
                plane,
                middle_mm: (middle(0, i), middle(1, j)),
                pixels,
                mean_e,
                sigma_e: frame.sigma_e(mean_e),
                of_area: (AREA_UM2 * share).sqrt() / frame.spec.pitch_um,
            }
        });
        found.lock().expect("no panic while held")[item] = cells.collect();
        Ok(())
    })?;
    Ok(found.into_inner().expect("no panic while held").into_iter().flatten().collect())
}

/// Name, pixels and mean electrons of each plane in `rect` of the array.
fn planes(frame: &Frame, rect: Rect) -> Result<Vec<(String, u64, f64)>> {
    let (of, pattern) = (frame.sensor.plane_of_channels(), &frame.sensor.pattern);
    let names = frame.sensor.planes();
    let mut sums = vec![(0u64, 0f64); names.len()];
    let values = electrons(frame, rect)?;
    for (i, line) in values.chunks_exact(rect.width).enumerate() {
        let row = (frame.rect.y + rect.y) as usize + i;
        for (x, v) in line.iter().enumerate() {
            let sum = &mut sums[of[pattern.channel(row, (frame.rect.x + rect.x) as usize + x)]];
            *sum = (sum.0 + 1, sum.1 + f64::from(*v));
        }
    }
    let of_plane = |(name, (n, sum)): (&&str, (u64, f64))| ((*name).to_owned(), n, sum / n.max(1) as f64);
    Ok(std::iter::zip(&names, sums).map(of_plane).filter(|plane| plane.1 > 0).collect())
}

/// Raws and planes that `cells` have, in their order.
fn rows_of(cells: &[Cell]) -> Vec<(usize, &str)> {
    let mut rows: Vec<(usize, &str)> = Vec::new();
    for cell in cells {
        if !rows.contains(&(cell.raw, &cell.plane)) {
            rows.push((cell.raw, &cell.plane));
        }
    }
    rows
}

fn plots(cells: &[Cell]) -> Vec<Plot> {
    let axis = || Axis::new("image height (mm)", 0.0, 0.0);
    let plot = |label: &str, value: &dyn Fn(&Cell) -> f64| {
        let mut plot = Plot::new("", axis(), Axis::new(label, 0.0, 0.0));
        for (k, (raw, plane)) in rows_of(cells).into_iter().enumerate() {
            let own = cells.iter().filter(|c| c.raw == raw && c.plane == plane);
            let points = own.map(|c| (c.height_mm(), value(c))).collect();
            let dots = Shape::Dots(if raw == 0 { 3.5 } else { 2.0 });
            plot.series.push(Series::distinct(format!("{plane} in {}", NAMES[raw]), points, k).shaped(dots));
        }
        plot
    };
    vec![plot("SNR of a pixel (dB)", &Cell::snr_db), plot("SNR of 100 µm² (dB)", &Cell::area_snr_db)]
}

/// Means over the cells of each raw and plane, weighted by their pixels; first the head.
fn summary(cells: &[Cell]) -> Vec<Vec<String>> {
    let head = ["raw", "plane", "mean (e-)", "SNR of a pixel (dB)", "SNR of 100 µm² (dB)"];
    let row = |(raw, plane): (usize, &str)| {
        let own: Vec<&Cell> = cells.iter().filter(|c| c.raw == raw && c.plane == plane).collect();
        let all: f64 = own.iter().map(|c| c.pixels as f64).sum();
        let mean =
            |value: &dyn Fn(&Cell) -> f64| own.iter().map(|c| value(c) * c.pixels as f64).sum::<f64>() / all;
        let figures = [mean(&|c| c.mean_e), mean(&Cell::snr_db), mean(&Cell::area_snr_db)];
        let texts = figures.map(|v| format!("{v:.2}"));
        [vec![NAMES[raw].to_owned(), plane.to_owned()], texts.to_vec()].concat()
    };
    [vec![head.map(String::from).to_vec()], rows_of(cells).into_iter().map(row).collect()].concat()
}

fn csv(cells: &[Cell]) -> String {
    let mut text =
        String::from("raw,plane,x_mm,y_mm,image_height_mm,pixels,mean_e,sigma_e,snr_db,snr_of_100_um2_db\n");
    for c in cells {
        let ((y, x), name) = (c.middle_mm, NAMES[c.raw]);
        // Writing to a String cannot fail.
        let _ = writeln!(
            text,
            "{name},{},{x:.4},{y:.4},{:.4},{},{:.3},{:.4},{:.3},{:.3}",
            c.plane,
            c.height_mm(),
            c.pixels,
            c.mean_e,
            c.sigma_e,
            c.snr_db(),
            c.area_snr_db()
        );
    }
    text
}
