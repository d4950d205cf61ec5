//! Maps of a field: ideal points by band, with relative illumination.

use super::arrays::{ArrayName, Loader};
use super::axis::{Axes, Axis};
use super::brown::Brown;
use super::description::Description;
use super::map_table::MapTable;
use super::shading;
use super::windows::Windows;
use crate::import::ImportError;
use crate::lens::MAP_NUMBERS;
use pipeline::bounds;
use pipeline::lens::planar::PlanarMap;
use std::path::Path;

/// Columns and rows of a map without distortion, which any number represents.
const IDENTITY_NODES: usize = 5;
/// Columns and rows of the map of a Brown model: of a film of 4000 × 3000 px with k = (−0.2, 0.05, 0.01), f = 3000 px, its
/// spline is within 5.3e-5 px of the
/// model, with 65 within 6.9e-4 px.
const BROWN_NODES: usize = 129;
/// Film pixels beside half a window by which the map of a Brown model reaches beyond the film.
const MARGIN_PX: f64 = 2.0;

/// The maps of all bands.
pub(super) struct Maps {
    pub maps: Vec<PlanarMap>,
    pub notes: Vec<String>,
}

/// The maps of the description `path`.
pub(super) fn maps(
    path: &Path,
    description: &Description,
    windows: &Windows,
    loader: &mut Loader,
) -> Result<Maps, ImportError> {
    let bands = description.wavelengths_nm.len();
    let (nodes, shading_grid) =
        (bounds::MAP_NODES, description.shading.as_ref().and_then(|s| s.grid.as_ref()));
    let axes = match (&description.map, shading_grid) {
        (MapTable::Ideal { grid, .. } | MapTable::Displacement { grid, .. }, _) => {
            Axes::load(path, grid, "[map]", nodes, loader)?
        }
        (MapTable::Brown(brown), _) => brown_axes(brown, windows.half_side_mm()),
        (MapTable::Identity, Some(grid)) => Axes::load(path, grid, "[shading]", nodes, loader)?,
        (MapTable::Identity, None) => identity_axes(windows.axes(), description.distortion_focal_length_mm),
    };
    if let Err(e) = MAP_NUMBERS.check_product(&[bands, axes.y.len(), axes.x.len()]) {
        return Err(ImportError::file(path, format!("[map] {e}; use fewer nodes")));
    }
    let points = ideal_points(path, &description.map, &axes, bands, loader)?;
    let mut notes = Vec::new();
    let illumination = shading::illumination(path, description, &axes, loader, &mut notes)?;
    let map = |(b, illumination): (usize, Vec<f64>)| {
        let [ideal_x_mm, ideal_y_mm] = points[b % points.len()].clone();
        let (x_mm, y_mm) = (axes.x.film_mm.clone(), axes.y.film_mm.clone());
        PlanarMap { x_mm, y_mm, ideal_x_mm, ideal_y_mm, relative_illumination: illumination }
    };
    Ok(Maps { maps: illumination.into_iter().enumerate().map(map).collect(), notes })
}

/// X and Y of the ideal points at the nodes, mm, one entry a band or one of all.
fn ideal_points(
    path: &Path,
    map: &MapTable,
    axes: &Axes,
    bands: usize,
    loader: &mut Loader,
) -> Result<Vec<[Vec<f64>; 2]>, ImportError> {
    let film = film_points(axes);
    match map {
        MapTable::Identity => Ok(vec![film]),
        MapTable::Brown(brown) => {
            let points = film[0].iter().zip(&film[1]).map(|(x, y)| {
                brown.ideal_mm([*x, *y]).ok_or_else(|| {
                    let problem = format!(
                        "[map] brown has no ideal point at ({x:.3}, {y:.3}) mm of the film and half a window: its distortion turns back; \
                         check the order and the signs of k and p, or use a smaller film"
                    );
                    ImportError::file(path, problem)
                })
            });
            let points: Vec<[f64; 2]> = points.collect::<Result<_, _>>()?;
            Ok(vec![[0, 1].map(|axis| points.iter().map(|p| p[axis]).collect())])
        }
        MapTable::Ideal { x, y, grid } => {
            let sign = if grid.y_up { -1.0 } else { 1.0 };
            let (x, y) = (tables(x, axes, bands, loader)?, tables(y, axes, bands, loader)?);
            let flipped = |t: &Vec<f64>| t.iter().map(|v| sign * v).collect();
            Ok((0..bands).map(|b| [x[b % x.len()].clone(), flipped(&y[b % y.len()])]).collect())
        }
        MapTable::Displacement { x, y, grid, pitch_um } => {
            let sign = if grid.y_up { -1.0 } else { 1.0 };
            let (x, y) = (tables(x, axes, bands, loader)?, tables(y, axes, bands, loader)?);
            let minus = |film: &Vec<f64>, px: &Vec<f64>, scale: f64| {
                film.iter().zip(px).map(|(film, px)| film - scale * px).collect()
            };
            let mm = pitch_um * 1e-3;
            let point = |b: usize| {
                [minus(&film[0], &x[b % x.len()], mm), minus(&film[1], &y[b % y.len()], sign * mm)]
            };
            Ok((0..bands).map(point).collect())
        }
    }
}

/// Film coordinates of the nodes, row by row, mm.
fn film_points(axes: &Axes) -> [Vec<f64>; 2] {
    let (columns, count) = (axes.x.len(), axes.count());
    let of = |point: &dyn Fn(usize) -> f64| (0..count).map(point).collect();
    [of(&|i| axes.x.film_mm[i % columns]), of(&|i| axes.y.film_mm[i / columns])]
}

/// Tables (My, Mx), or (B, My, Mx), in the order of the film.
pub(super) fn tables(
    name: &ArrayName,
    axes: &Axes,
    bands: usize,
    loader: &mut Loader,
) -> Result<Vec<Vec<f64>>, ImportError> {
    let array = loader.load(name)?;
    let (rows, columns) = (axes.y.len(), axes.x.len());
    if !matches!(array.shape[..], [r, c] if [r, c] == [rows, columns])
        && !matches!(array.shape[..], [b, r, c] if [b, r, c] == [bands, rows, columns])
    {
        let shape = &array.shape;
        return Err(name.error(format!(
            "has shape {shape:?}, expected ({rows}, {columns}) or ({bands}, {rows}, {columns}): {rows} places of y_mm and {columns} of x_mm"
        )));
    }
    if let Some(i) = array.values.iter().position(|v| !v.is_finite()) {
        let (row, column) = (i / columns % rows, i % columns);
        let (x, y) = (axes.x.film_mm[axes.x.source(column)], axes.y.film_mm[axes.y.source(row)]);
        let v = array.values[i];
        return Err(name.error(format!(
            "has {v} at row {row}, column {column} (film place {x}, {y} mm), expected a finite number"
        )));
    }
    Ok(array.values.chunks_exact(rows * columns).map(|table| axes.oriented(table)).collect())
}

/// The film and half a window beyond.
fn brown_axes(brown: &Brown, half_window_mm: f64) -> Axes {
    let axis = |axis: usize| {
        let last = brown.half_side_mm(axis) + half_window_mm + MARGIN_PX * brown.pitch_um * 1e-3;
        uniform(-last, last, BROWN_NODES)
    };
    Axes { x: axis(0), y: axis(1) }
}

/// The places of the PSFs and a step beyond; about a single one f, field angles of 45°.
fn identity_axes(psfs: &Axes, f_mm: f64) -> Axes {
    let axis = |axis: &Axis| {
        let (first, last) = (axis.film_mm[0], axis.film_mm[axis.len() - 1]);
        let beyond = if axis.len() > 1 { (last - first) / (axis.len() - 1) as f64 } else { f_mm };
        let bound = bounds::FILM_POINT_MM;
        uniform((first - beyond).max(bound.min), (last + beyond).min(bound.max), IDENTITY_NODES)
    };
    Axes { x: axis(&psfs.x), y: axis(&psfs.y) }
}

fn uniform(first: f64, last: f64, count: usize) -> Axis {
    Axis::of_film((0..count).map(|i| first + (last - first) * i as f64 / (count - 1) as f64).collect())
}
