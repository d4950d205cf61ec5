//! Where the light of a path enters the lens: a window in the plane of the first vertex that holds its rays to the film at all heights.
//!
//! The window moves in proportion to tan θ, so that the open part stays at about the same place in it: landings and light over the window are then smooth functions of the
//! height. Found by rays on a coarse grid, which is refined where few of them reach the film.

use super::path::{Crossing, GhostLens};

/// A window in the plane of the first vertex, symmetric about the meridian.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Window {
    /// Its shift per tangent of the field angle, mm.
    pub(super) shift_mm: f64,
    /// Ends along the meridian on the axis, mm.
    pub(super) x_mm: (f64, f64),
    /// End across it, mm.
    pub(super) y_mm: f64,
    /// Cells along and across half of it.
    pub(super) cells: (usize, usize),
}

/// Heights at which the light is sought, from the axis to the last one.
const HEIGHTS: u32 = 8;
/// Cells of the coarse grid along and across the half disc.
const COARSE: (usize, usize) = (32, 16);
/// Rays to the film that locate the light.
const ENOUGH: usize = 12;
/// Refinements of the coarse grid.
const ROUNDS: u32 = 3;
/// Cells of a window as large as the light.
const CELLS: (f64, f64) = (24.0, 12.0);
/// Largest number of cells, where the light moves within the window or changes its size.
const MOST_CELLS: (f64, f64) = (72.0, 36.0);

/// A rectangle: ends along x, end along y.
#[derive(Clone, Copy, Debug)]
struct Part {
    x: (f64, f64),
    y: (f64, f64),
}

impl GhostLens<'_> {
    /// The window of `crossings` for fields to the tangent `last`; none if no light reaches the film.
    pub(super) fn window(&self, crossings: &[Crossing<'_>], last: f64) -> Option<Window> {
        let found: Vec<(f64, Part)> = (0..=HEIGHTS)
            .map(|i| last * f64::from(i) / f64::from(HEIGHTS))
            .filter_map(|tan| Some((tan, self.open_part(crossings, tan)?)))
            .collect();
        if found.is_empty() {
            return None;
        }
        let count = found.len() as f64;
        let centre = |part: &Part| 0.5 * (part.x.0 + part.x.1);
        let (t0, c0) = (
            found.iter().map(|(t, _)| t).sum::<f64>() / count,
            found.iter().map(|(_, p)| centre(p)).sum::<f64>() / count,
        );
        let square: f64 = found.iter().map(|(t, _)| (t - t0) * (t - t0)).sum();
        let product: f64 = found.iter().map(|(t, p)| (t - t0) * (centre(p) - c0)).sum();
        let shift_mm = if square > 0.0 { product / square } else { 0.0 };
        let ends = |f: fn(f64, f64) -> f64, pick: fn(&Part) -> f64, start: f64| {
            found.iter().map(|(t, p)| pick(p) - shift_mm * t).fold(start, f)
        };
        let x_mm = (ends(f64::min, |p| p.x.0, f64::INFINITY), ends(f64::max, |p| p.x.1, f64::NEG_INFINITY));
        let y_mm = found.iter().map(|(_, p)| p.y.1).fold(0.0, f64::max);
        let median = |size: fn(&Part) -> f64| {
            let mut sizes: Vec<f64> = found.iter().map(|(_, p)| size(p)).collect();
            sizes.sort_by(f64::total_cmp);
            sizes[sizes.len() / 2]
        };
        let cells = |whole: f64, part: f64, cells: f64, most: f64| {
            (cells * whole / part).clamp(cells, most).ceil() as usize
        };
        let along = cells(x_mm.1 - x_mm.0, median(|p| p.x.1 - p.x.0), CELLS.0, MOST_CELLS.0);
        let across = cells(y_mm, median(|p| p.y.1), CELLS.1, MOST_CELLS.1);
        Some(Window { shift_mm, x_mm, y_mm, cells: (along, across) })
    }

    /// The part that lets light through to the film at `tan`, with a margin.
    fn open_part(&self, crossings: &[Crossing<'_>], tan: f64) -> Option<Part> {
        let radius = self.start_radius_mm(tan);
        let mut part = Part { x: (-radius, radius), y: (0.0, radius) };
        let mut meetings = Vec::with_capacity(crossings.len());
        for round in 0..=ROUNDS {
            let (dx, dy) = ((part.x.1 - part.x.0) / COARSE.0 as f64, (part.y.1 - part.y.0) / COARSE.1 as f64);
            let mut open: Vec<(f64, f64)> = Vec::new();
            let mut nearest: Option<(f64, f64, f64)> = None;
            for i in 0..=COARSE.0 {
                for j in 0..=COARSE.1 {
                    let (x, y) = (part.x.0 + i as f64 * dx, part.y.0 + j as f64 * dy);
                    let Some(landing) = self.follow(crossings, self.start(tan, x, y).0, &mut meetings) else {
                        continue;
                    };
                    if landing.overshoot <= 0.0 {
                        open.push((x, y));
                    }
                    if nearest.is_none_or(|n| landing.overshoot < n.0) {
                        nearest = Some((landing.overshoot, x, y));
                    }
                }
            }
            if open.is_empty() {
                let (_, x, y) = nearest.filter(|_| round < ROUNDS)?;
                open.push((x, y));
            } else if open.len() >= ENOUGH || round == ROUNDS {
                return Some(around(&open, dx, dy));
            }
            part = around(&open, dx, dy);
        }
        None
    }
}

/// The rectangle about `points`, one cell wider on each side.
fn around(points: &[(f64, f64)], dx: f64, dy: f64) -> Part {
    let range = |pick: fn(&(f64, f64)) -> f64| {
        points.iter().map(pick).fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)))
    };
    let ((x0, x1), (y0, y1)) = (range(|p| p.0), range(|p| p.1));
    Part { x: (x0 - dx, x1 + dx), y: ((y0 - dy).max(0.0), y1 + dy) }
}
