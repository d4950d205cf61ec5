//! Computation of a [`RingOperator`] from traced paths.
//!
//! Geometry is traced at multiples of 60 nm, each band at the nearest: landings move by less than a ring, while the reflectance of a coating may change tenfold, so that the light along
//! each ray is computed at the band's own wavelength. A band's operator thus depends on its own wavelength alone, not on the other bands that are traced with it.
//!
//! From each ring of the scene the rays of each path are interpolated to about 10,000 points, as many in each cell of its window that lets light through, at places of the R2 sequence
//! (Roberts 2018). Their light is collected over rings and azimuths of the film and transformed to azimuthal orders.

use rayon::prelude::*;

use super::apertures::Apertures;
use super::cell::Cell;
use super::group::{Group, geometry_nm};
use super::heights::PathHeights;
use super::light_tables::{LANES, LightTables};
use super::options::GhostOptions;
use super::report::{PathReport, sort};
use super::rings::RingOperator;
use super::sums::RingSums;
use crate::design::prescription::error::DesignError;
use crate::design::prescription::system::System;

/// Version of the operators' values.
pub const GHOSTS_VERSION: u32 = 3;
/// Paths whose rays are in memory at a time.
pub(super) const PATHS: usize = 16;
/// Points of half a window from which light is sent.
const POINTS: usize = 5000;
/// Points of a cell of the window.
const CELL_POINTS: (usize, usize) = (4, 200);
/// Times as many of a cell that a rim crosses.
const RIM_POINTS: usize = 4;
/// Steps of the R2 sequence: powers of the inverse of the plastic number.
const R2: (f64, f64) = (0.754_877_666_246_693, 0.569_840_290_998_053);
/// Steps of its start from cell to cell.
const FIRST: (f64, f64) = (0.618_033_988_749_895, 0.414_213_562_373_095);

/// The ghosts of a band.
#[derive(Clone, Debug, PartialEq)]
pub struct BandGhosts {
    /// Wavelength, nm.
    pub wavelength_nm: f64,
    /// The operator.
    pub operator: RingOperator,
    /// Its paths, the largest share on the axis first.
    pub paths: Vec<PathReport>,
}

/// The ghosts of `system` at `wavelengths_nm`, ascending.
///
/// # Errors
/// A lens without coatings; a wavelength outside the tables of a glass, a coating or the film's reflectance; a corner that the lens does not reach.
pub fn trace_ghosts(
    system: &System,
    wavelengths_nm: &[f64],
    options: &GhostOptions,
) -> Result<Vec<BandGhosts>, DesignError> {
    let apertures = Apertures::new(system, options.corner_mm)?;
    let mut bands = Vec::with_capacity(wavelengths_nm.len());
    let groups =
        wavelengths_nm.chunk_by(|a, b| geometry_nm(*a) == geometry_nm(*b)).flat_map(|g| g.chunks(LANES));
    for group in groups {
        match Group::new(system, geometry_nm(group[0]), group, options, &apertures) {
            Ok(group) => bands.extend(group.trace()),
            // A glass or a coating without values there: each band at its own wavelength.
            Err(DesignError::Wavelength { .. } | DesignError::Coating { .. }) => {
                for nm in group {
                    bands.extend(Group::new(system, *nm, &[*nm], options, &apertures)?.trace());
                }
            }
            Err(error) => return Err(error),
        }
    }
    Ok(bands)
}

impl Group<'_> {
    fn trace(&self) -> Vec<BandGhosts> {
        let lens = &self.lens;
        let ways = self.ways();
        let tables = LightTables::new(&self.lights, ways.iter().map(Vec::as_slice));
        let reference = LightTables::new(&self.reference, ways.iter().map(Vec::as_slice));
        let windows = self.windows(&ways);
        let mut reports = self.reports(&ways, &windows, &tables);
        let is_kept = |k: &usize| reports.iter().any(|band| band[*k].is_kept);
        let kept: Vec<usize> = (0..ways.len()).filter(is_kept).collect();
        // Of each ring of the scene and band: order, ring of the film.
        let orders = vec![0.0; (self.sizes.orders() + 1) * self.sizes.rings];
        let mut columns = vec![vec![orders; self.lights.len()]; self.sizes.source_rings];
        for some in kept.chunks(PATHS) {
            let found: Vec<(usize, PathHeights)> = some
                .par_iter()
                .filter_map(|k| {
                    let way = &ways[*k];
                    let along = (&tables.along(way), self.lights.len());
                    let reference = &reference.along(way);
                    Some((*k, PathHeights::trace(lens, way, windows[*k]?, &self.fields, along, reference)))
                })
                .collect();
            columns.par_iter_mut().enumerate().for_each(|(ring, columns)| {
                let mut sums = RingSums::new(self.sizes, self.lights.len());
                for (k, heights) in &found {
                    let scales: Vec<f64> = reports
                        .iter()
                        .zip(&self.flux)
                        .map(|(band, flux)| if band[*k].is_kept { 1.0 / flux } else { 0.0 })
                        .collect();
                    self.collect(heights, ring, &scales, &mut sums);
                }
                columns.iter_mut().enumerate().for_each(|(band, column)| sums.add_orders(band, column));
            });
        }
        let band = |(band, nm): (usize, &f64)| {
            let columns: Vec<&[f64]> = columns.iter().map(|c| c[band].as_slice()).collect();
            let mut paths = std::mem::take(&mut reports[band]);
            sort(&mut paths);
            BandGhosts { wavelength_nm: *nm, operator: RingOperator::of_columns(self.sizes, &columns), paths }
        };
        self.wavelengths_nm.iter().enumerate().map(band).collect()
    }

    /// Adds the light of a path from `ring` to `sums`, times the scale of each band.
    fn collect(&self, path: &PathHeights, ring: usize, scales: &[f64], sums: &mut RingSums) {
        let tan = self.fields.rings[ring];
        let grid = path.at(tan, Some(ring));
        let (along, across) = path.window.cells;
        let cells: Vec<Cell<'_>> = (0..along)
            .flat_map(|i| (0..across).map(move |j| (i, j)))
            .filter_map(|(i, j)| grid.cell((along, across), (i, j)))
            .collect();
        if cells.is_empty() {
            return;
        }
        let usual = POINTS.div_ceil(cells.len()).clamp(CELL_POINTS.0, CELL_POINTS.1);
        // Both halves of the window.
        let area = 2.0 * path.window.cell_area_mm2() * self.lens.obliquity(tan);
        let mut weights = vec![0.0; scales.len()];
        for cell in cells {
            let points = if cell.has_rim { RIM_POINTS * usual } else { usual };
            let start = (ring * along + cell.at.0) as f64 * FIRST.0 + cell.at.1 as f64 * FIRST.1;
            for point in 0..points {
                let at = ((start + point as f64 * R2.0).fract(), (start + point as f64 * R2.1).fract());
                if !cell.is_open(at) {
                    continue;
                }
                for (band, weight) in weights.iter_mut().enumerate() {
                    *weight = cell.light(band, at) * area * scales[band] / points as f64;
                }
                sums.add(cell.landing(at), &weights);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::options::Reflectance;
    use super::super::rings::RingPower;
    use super::super::test_lenses::*;
    use super::*;
    use crate::design::prescription::coating::Coating;
    use crate::real;

    fn options(corner_mm: f64, film: f64) -> GhostOptions {
        GhostOptions { corner_mm, rings: 64, film_reflectance: Reflectance(vec![(550.0, film)]) }
    }

    #[test]
    fn operator_of_a_band_does_not_depend_on_the_bands_beside_it() {
        let system = singlet();
        let small = GhostOptions { rings: 16, ..options(3.0, 0.1) };
        let alone = trace_ghosts(&system, &[550.0], &small).unwrap();
        let beside = trace_ghosts(&system, &[430.0, 540.0, 550.0, 560.0], &small).unwrap();
        assert_eq!(alone[0], beside[2]);
        assert_eq!(alone[0].paths.len(), 3);
    }

    /// Σ_j G_0(j, i) is the light of the traced rays that land on the film.
    #[test]
    fn light_of_the_operator_is_that_of_rays() {
        let system = singlet();
        let sizes = options(3.0, 0.1);
        let apertures = Apertures::new(&system, sizes.corner_mm).unwrap();
        let group = Group::new(&system, 550.0, &[550.0], &sizes, &apertures).unwrap();
        let band = &group.trace()[0];
        let last = group.sizes.radius_mm(group.sizes.rings - 1);
        for ring in [0, 20, 63] {
            let mut direct = 0.0;
            direct_rays(&group, group.fields.rings[ring], 200, |(x, y), weight| {
                // Shared between the rings about it: the last ring has light from beyond it.
                let over = (((x * x + y * y).sqrt() - last) / group.sizes.ring_mm).clamp(0.0, 1.0);
                direct += weight * (1.0 - over);
            });
            let found = band.operator.share(ring);
            assert!((found / direct - 1.0).abs() < 6e-3, "ring {ring}: {found:e} {direct:e}");
        }
    }

    /// Calls `land` with the landing on the film and the share Γ of each ray of all paths: `rays` along each side of a window.
    fn direct_rays(group: &Group<'_>, tan: f64, rays: usize, mut land: impl FnMut((f64, f64), f64)) {
        let lens = &group.lens;
        for path in &group.paths {
            let way = lens.crossings(Some(*path));
            let Some(window) = lens.window(&way, group.fields.last) else { continue };
            let lit = |k: usize, n: usize, cells: usize| (k as f64 + 0.5) * cells as f64 / n as f64;
            let (x0, x1) = window.x_mm;
            let area =
                2.0 * (x1 - x0) * window.y_mm / (rays * rays) as f64 * lens.obliquity(tan) / group.flux[0];
            for i in 0..rays {
                for j in 0..rays {
                    // Both halves, in turn.
                    let (x, y) =
                        window.place(lit(i, rays, window.cells.0), lit(j, rays, window.cells.1), tan);
                    let y = if (i + j) % 2 == 0 { y } else { -y };
                    let Some(ray) = lens.ray(Some(*path), &group.lights[0], tan, (x, y)) else { continue };
                    if ray.landing.overshoot <= 0.0 {
                        land((ray.landing.x, ray.landing.y), area * ray.weight);
                    }
                }
            }
        }
    }

    /// L1 difference of the ghosts of two sources from a direct sum over rays, in cells of 1/24 of the corner, and the ratio of their powers.
    fn difference_from_rays(system: &System, sizes: &GhostOptions, rays: usize) -> (f64, f64) {
        let apertures = Apertures::new(system, sizes.corner_mm).unwrap();
        let group = Group::new(system, 550.0, &[550.0], sizes, &apertures).unwrap();
        let operator = &group.trace()[0].operator;
        let rings = group.sizes;
        let mut scene = RingPower::dark(rings.source_rings, rings.azimuths());
        // On rings, so that only the ghosts are compared, 17 and 130 degrees from x.
        let sources = [(18, 0.3, 1.0), (39, 2.27, 2.0)];
        let cells = 48_usize;
        let side = 2.0 * sizes.corner_mm / cells as f64;
        let mut direct = vec![0.0; cells * cells];
        for (ring, azimuth, power) in sources {
            let (radius, (sin, cos)) = (rings.radius_mm(ring), real::sin_cos(azimuth));
            scene.add(&rings, (radius * cos, radius * sin), power);
            direct_rays(&group, group.fields.rings[ring], rays, |(x, y), weight| {
                let (x, y) = (x * cos - y * sin, x * sin + y * cos);
                let cell = |v: f64| ((v + sizes.corner_mm) / side).floor();
                let (i, j) = (cell(x), cell(y));
                let is_inside = |v: f64| v >= 0.0 && v < cells as f64;
                if is_inside(i) && is_inside(j) && x * x + y * y < (sizes.corner_mm - side).powi(2) {
                    direct[j as usize * cells + i as usize] += power * weight;
                }
            });
        }
        let film = operator.apply(&scene);
        let (mut l1, mut sum, mut all) = (0.0, 0.0, 0.0);
        for (at, expected) in direct.iter().enumerate() {
            let mut found = 0.0;
            for k in 0..16 {
                let place =
                    |cell: usize, k: usize| (cell as f64 + (k as f64 + 0.5) / 4.0) * side - sizes.corner_mm;
                let (x, y) = (place(at % cells, k % 4), place(at / cells, k / 4));
                if x * x + y * y < (sizes.corner_mm - side).powi(2) {
                    found += film.density(&rings, (x, y)) * side * side / 16.0;
                }
            }
            l1 += (found - expected).abs();
            sum += found;
            all += expected;
        }
        (l1 / all, sum / all)
    }

    #[test]
    fn scene_of_two_sources_equals_a_direct_sum_over_rays() {
        // Nearer than its focus the film has wide ghosts.
        let mut system = singlet();
        system.surfaces[2].thickness_mm = 9.0;
        let (l1, power) = difference_from_rays(&system, &options(6.0, 0.1), 400);
        assert!(l1 < 0.06 && (power - 1.0).abs() < 1e-3, "{l1} {power}");
    }

    /// 55 paths, 230,000 rays each: 30 core seconds.
    #[test]
    #[ignore = "long: 260 core seconds"]
    fn scene_of_two_sources_equals_a_direct_sum_over_rays_of_a_double_gauss() {
        for coating in [Coating::Bare, Coating::quarter_wave("MgF2", 1.38, 0.55)] {
            for rings in [64, 128] {
                let sizes = GhostOptions { rings, ..options(24.57, 0.1) };
                let (l1, power) = difference_from_rays(&double_gauss(coating.clone()), &sizes, 480);
                println!("{rings} rings: L1 {l1:.4}, power {power:.5}");
                // Direct sums over 480² and 700² rays differ by up to 10⁻³ for a single path.
                assert!(l1 < 0.05 && (power - 1.0).abs() < 1e-3, "{rings} rings: {l1} {power}");
            }
        }
    }
}
