//! Relative illumination of a field at the nodes of its map.
//!
//! R = flat field / its value at the film's centre, or its largest value, of each band. A flat field at places of its own is
//! bilinear between them, and beyond them has the value of its edge.

use super::arrays::Loader;
use super::axis::{Axes, Axis};
use super::description::{Description, ShadingTable};
use super::map::tables;
use crate::import::ImportError;
use pipeline::bounds;
use std::path::Path;

/// R of each band at the nodes `map`, row by row.
pub(super) fn illumination(
    path: &Path,
    description: &Description,
    map: &Axes,
    loader: &mut Loader,
    notes: &mut Vec<String>,
) -> Result<Vec<Vec<f64>>, ImportError> {
    let bands = description.wavelengths_nm.len();
    let Some(shading) = &description.shading else { return Ok(vec![vec![1.0; map.count()]; bands]) };
    let own = match &shading.grid {
        None => None,
        Some(grid) => Some(Axes::load(path, grid, "[shading]", bounds::PSF_COLUMNS, loader)?),
    };
    let axes = own.as_ref().unwrap_or(map);
    let mut flats = tables(&shading.file, axes, bands, loader)?;
    for flat in &mut flats {
        normalise(flat, axes, shading)?;
    }
    if own.as_ref().is_some_and(|own| !covers(&own.x, &map.x) || !covers(&own.y, &map.y)) {
        notes.push("the map reaches beyond [shading]: there the value of its edge is used".to_owned());
    }
    if let Some(own) = own.filter(|own| own != map) {
        flats = flats.iter().map(|flat| at_nodes(flat, &own, map)).collect();
    }
    Ok((0..bands).map(|b| flats[b % flats.len()].clone()).collect())
}

fn normalise(flat: &mut [f64], axes: &Axes, shading: &ShadingTable) -> Result<(), ImportError> {
    if let Some(i) = flat.iter().position(|v| *v < 0.0) {
        let (x, y) = (axes.x.film_mm[i % axes.x.len()], axes.y.film_mm[i / axes.x.len()]);
        let v = flat[i];
        return Err(shading.file.error(format!("has {v} at the film place {x}, {y} mm, expected 0 or more")));
    }
    let one = match shading.largest_is_one {
        true => flat.iter().copied().fold(0.0, f64::max),
        false if holds(&axes.x, 0.0) && holds(&axes.y, 0.0) => bilinear(flat, axes, [0.0, 0.0]),
        false => {
            return Err(shading.file.error(
                "has no value at the film's centre, where R is 1; expected places on both sides of 0 mm, or normalise = \"largest\"",
            ));
        }
    };
    if one <= 0.0 {
        let at = if shading.largest_is_one { "as its largest value" } else { "at the film's centre" };
        return Err(shading.file.error(format!("has {one} {at}, expected a positive number")));
    }
    flat.iter_mut().for_each(|v| *v /= one);
    Ok(())
}

/// A slack for rounding, of the axis.
fn slack(axis: &Axis) -> f64 {
    1e-9 * (axis.film_mm[axis.len() - 1] - axis.film_mm[0])
}

fn holds(axis: &Axis, at: f64) -> bool {
    at >= axis.film_mm[0] - slack(axis) && at <= axis.film_mm[axis.len() - 1] + slack(axis)
}

fn covers(axis: &Axis, other: &Axis) -> bool {
    holds(axis, other.film_mm[0]) && holds(axis, other.film_mm[other.len() - 1])
}

fn at_nodes(flat: &[f64], own: &Axes, map: &Axes) -> Vec<f64> {
    let columns = map.x.len();
    (0..map.count())
        .map(|i| bilinear(flat, own, [map.x.film_mm[i % columns], map.y.film_mm[i / columns]]))
        .collect()
}

/// The table at a film place, mm; beyond its places the value of its edge.
fn bilinear(table: &[f64], axes: &Axes, [x, y]: [f64; 2]) -> f64 {
    let ((i, u), (j, v)) = (cell(&axes.x, x), cell(&axes.y, y));
    let columns = axes.x.len();
    let (next, below) = (usize::from(columns > 1), if axes.y.len() > 1 { columns } else { 0 });
    let row = |at: usize| (1.0 - u) * table[at] + u * table[at + next];
    let at = j * columns + i;
    (1.0 - v) * row(at) + v * row(at + below)
}

/// The cell of a place, and the share of its next node.
fn cell(axis: &Axis, at: f64) -> (usize, f64) {
    let last = axis.len() - 1;
    if last == 0 {
        return (0, 0.0);
    }
    let (first_mm, last_mm) = (axis.film_mm[0], axis.film_mm[last]);
    let along = ((at - first_mm) / (last_mm - first_mm) * last as f64).clamp(0.0, last as f64);
    let i = (along as usize).min(last - 1);
    (i, along - i as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bilinear_is_exact_for_bilinear_tables_and_constant_beyond() {
        let axes = Axes { x: Axis::of_film(vec![-1.0, 0.0, 1.0]), y: Axis::of_film(vec![0.0, 2.0]) };
        let of = |x: f64, y: f64| 3.0 + x - 0.5 * y + 0.25 * x * y;
        let table: Vec<f64> = [0.0, 2.0].iter().flat_map(|y| [-1.0, 0.0, 1.0].map(|x| of(x, *y))).collect();
        for at in [[-1.0, 0.0], [0.3, 1.7], [1.0, 2.0], [-0.6, 0.1]] {
            assert!((bilinear(&table, &axes, at) - of(at[0], at[1])).abs() < 1e-14, "{at:?}");
        }
        assert!((bilinear(&table, &axes, [5.0, -3.0]) - of(1.0, 0.0)).abs() < 1e-14);
        let one = Axes { x: Axis::of_film(vec![2.0]), y: Axis::of_film(vec![2.0]) };
        assert_eq!(bilinear(&[7.0], &one, [0.0, 0.0]), 7.0);
    }
}
