//! Memory and time of tracing the ghosts of a lens.

use super::grid::LIGHT;
use super::group::geometry_nm;
use super::light_tables::LANES;
use super::operator::PATHS;
use super::options::GhostOptions;
use super::path::ghost_paths;
use super::rings::RingSizes;
use super::sums::HALF_TURN;
use crate::design::prescription::system::System;

/// Nodes of the window of a usual path, for estimates of memory.
const WINDOW_NODES: usize = 640;
/// Core seconds of a path for each wavelength of the geometry, and for each band and half of 64 rings, for estimates of time.
const GEOMETRY_S: f64 = 0.04;
const LIGHT_S: f64 = 0.002;

/// Paths of `system`, the film's included if it reflects.
fn count_of_paths(system: &System, options: &GhostOptions) -> usize {
    ghost_paths(system, !options.film_reflectance.is_zero()).0.len()
}

/// Bytes while the ghosts of those of `wavelengths_nm` that share the geometry are traced on `threads` threads: grids of the rays of some paths, each at as many heights as there are rings,
/// sums over the rings of the film and their orders, and the operators.
pub fn ghost_memory_bytes(
    system: &System,
    options: &GhostOptions,
    wavelengths_nm: &[f64],
    threads: usize,
) -> usize {
    let sizes = RingSizes::new(options.corner_mm, options.rings);
    let together =
        |nm: &f64| wavelengths_nm.iter().filter(|other| geometry_nm(**other) == geometry_nm(*nm)).count();
    let bands = wavelengths_nm.iter().map(together).max().unwrap_or(0);
    let lanes = bands.min(LANES);
    let grid = 4 * (LIGHT + lanes) * WINDOW_NODES;
    let sums = 8 * lanes * sizes.rings * (HALF_TURN * sizes.rings + 1);
    let orders = 8 * lanes * (sizes.orders() + 1) * sizes.rings * sizes.source_rings;
    let operator = 4 * (sizes.orders() + 1) * sizes.rings * sizes.source_rings;
    count_of_paths(system, options).min(PATHS) * sizes.source_rings * grid
        + threads * sums
        + orders
        + (bands + lanes) * operator
}

/// Core seconds of tracing the ghosts of `system` at `wavelengths_nm`, on a 2.2 GHz Xeon: of spherical surfaces.
pub fn ghost_seconds(system: &System, options: &GhostOptions, wavelengths_nm: &[f64]) -> f64 {
    let groups = wavelengths_nm.chunk_by(|a, b| geometry_nm(*a) == geometry_nm(*b)).count() as f64;
    let paths = count_of_paths(system, options) as f64;
    let rings = options.rings as f64 / 64.0;
    paths * (groups * GEOMETRY_S + wavelengths_nm.len() as f64 * LIGHT_S * (1.0 + rings))
}
