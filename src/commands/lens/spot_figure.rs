//! Spot diagrams of a design by field height and wavelength.

use super::aberrations::field_name;
use crate::job::lens::samples::evenly_spaced;
use crate::progress::short_number;
use anyhow::Result;
use formats::picture::figure::{Anchor, Figure, Stroke, Text};
use formats::picture::style::{Colour, Style};
use pipeline::design::System;
use pipeline::design::ray::Tracer;
use pipeline::geometry::Size;

/// Maximum number of wavelengths and heights.
const MAX_ROWS: usize = 6;
const MAX_COLUMNS: usize = 5;
/// Side of a diagram, and the gap between two, pixels of the figure.
const CELL: f64 = 120.0;
const GAP: f64 = 8.0;
/// Rings of rays, 6 k on the k-th.
const RINGS: i32 = 10;

/// Spots by field height (columns) and wavelength (rows), all at one scale, about the chief ray of the primary wavelength.
pub fn spot_figure(system: &System, nm: &[f64], heights_mm: &[f64], style: Style) -> Result<Figure> {
    let bands = evenly_spaced(nm.len(), MAX_ROWS);
    let heights = evenly_spaced(heights_mm.len(), MAX_COLUMNS);
    let primary = Tracer::new(system, system.primary_um())?;
    let mut columns = Vec::new();
    for &k in &heights {
        let tan = primary.field_of_height(heights_mm[k])?;
        let centre = primary.chief_height_mm(tan)?;
        let spots: Vec<Vec<(f64, f64)>> = bands
            .iter()
            .map(|&b| Ok(spot(&Tracer::new(system, nm[b] / 1e3)?, tan, centre)))
            .collect::<Result<_>>()?;
        columns.push((field_name(system, heights_mm[k], tan), spots));
    }
    // The scale of the spot at the ninth decile, so that one large spot does not shrink the others to dots.
    let mut extents: Vec<f64> = columns
        .iter()
        .flat_map(|c| &c.1)
        .map(|s| s.iter().map(|(x, y)| x.abs().max(y.abs())).fold(0.0, f64::max))
        .collect();
    extents.sort_by(f64::total_cmp);
    let extent = extents[(9 * (extents.len() - 1)) / 10].max(0.5);
    let step = 10f64.powf((2.0 * extent).log10().floor());
    let side_um = (2.2 * extent / step).ceil() * step;
    let (left, top) = (104.0, 84.0);
    let (right, below) =
        (left + columns.len() as f64 * (CELL + GAP), top + bands.len() as f64 * (CELL + GAP));
    let mut figure = Figure::new(Size::new(below as usize + 60, (right as usize + 24).max(560)), style);
    let title = format!("{}: spot diagrams", system.name);
    figure.text(Text {
        size: 17.0,
        max_width: right - 16.0,
        ..Text::new((16.0, 22.0), Anchor::Start, &title)
    });
    figure.text(Text {
        upwards: true,
        max_width: below,
        ..Text::new((18.0, 0.5 * (top + below - GAP)), Anchor::Middle, "wavelength (nm)")
    });
    for (row, &b) in bands.iter().enumerate() {
        let y = top + row as f64 * (CELL + GAP) + 0.5 * CELL;
        figure.text(Text::new((left - 10.0, y), Anchor::End, &short_number(nm[b])));
    }
    for (column, (name, spots)) in columns.iter().enumerate() {
        let x = left + column as f64 * (CELL + GAP);
        let label = Text::new((x + 0.5 * CELL, 66.0), Anchor::Middle, name);
        figure.text(Text { max_width: CELL + GAP, ..label });
        for (row, spot) in spots.iter().enumerate() {
            let y = top + row as f64 * (CELL + GAP);
            let frame = [(x, y), (x + CELL, y), (x + CELL, y + CELL), (x, y + CELL), (x, y)];
            figure.line(&frame, Stroke { colour: Colour::Muted, width: 1.0, dash: 0 });
            figure.clip([x, y, CELL, CELL]);
            let at =
                |(dx, dy): &(f64, f64)| (x + CELL * (0.5 + dx / side_um), y + CELL * (0.5 + dy / side_um));
            let dots: Vec<_> = spot.iter().map(at).collect();
            figure.dots(&dots, 0.9, Colour::Palette(row));
            figure.clip_end();
        }
    }
    let nm = short_number(system.primary_um() * 1e3);
    let notes = [
        format!("Each square: {side_um} µm × {side_um} µm about the chief ray at {nm} nm,"),
        "the direction away from the axis to the right".into(),
    ];
    for (row, note) in notes.iter().enumerate() {
        figure.text(Text::new((left, below + 16.0 + 22.0 * row as f64), Anchor::Start, note));
    }
    Ok(figure)
}

/// Rays of a hexapolar pattern in the film plane, µm from `centre_mm`; rays that are blocked or lost are left out.
fn spot(tracer: &Tracer<'_>, tan: f64, centre_mm: f64) -> Vec<(f64, f64)> {
    let mut points = Vec::new();
    for k in 0..=RINGS {
        let count = (6 * k).max(1);
        for i in 0..count {
            let (s, c) = (std::f64::consts::TAU * f64::from(i) / f64::from(count)).sin_cos();
            let rho = f64::from(k) / f64::from(RINGS);
            let (p, q) = (rho * c, rho * s);
            if !tracer.passes(tan, p, q) {
                continue;
            }
            if let Ok(ray) = tracer.ray(tan, p, q) {
                points.push((1e3 * (ray.x.v - centre_mm), 1e3 * ray.y.v));
            }
        }
    }
    points
}
