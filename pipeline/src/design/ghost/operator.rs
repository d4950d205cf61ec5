//! Computation of a [`RingOperator`] from traced paths.
//!
//! Geometry is traced at multiples of 60 nm, each band at the nearest: landings move by less than a ring, while the reflectance of a coating may change tenfold, so that the light along
//! each ray is computed at the band's own wavelength. A band's operator thus depends on its own wavelength alone, not on the other bands that are traced with it.
//!
//! From each ring of the scene the rays of each path are interpolated to about 10,000 points, as many in each cell of its window that lets light through, at places of the R2 sequence
//! (Roberts 2018). Their light is collected over rings and azimuths of the film and transformed to azimuthal orders.
//!
//! Paths with little light are left out of a band: the weakest, as long as they have together less than 1 % of all and each a density below 1 % of the largest.

use std::f64::consts::PI;

use rayon::prelude::*;

use super::apertures::Apertures;
use super::first_order::FirstOrder;
use super::grid::{LIGHT, OVERSHOOT, X, Y};
use super::heights::{Fields, PathHeights};
use super::light::GhostLight;
use super::light_tables::{LANES, LightTables};
use super::path::{Crossing, GhostLens, GhostPath, ghost_paths};
use super::rings::{RingOperator, RingSizes, jackson};
use super::share::PathLight;
use super::window::Window;
use crate::design::prescription::error::DesignError;
use crate::design::prescription::system::System;
use crate::real;

/// Spacing of the wavelengths at which geometry is traced, nm.
const GEOMETRY_NM: f64 = 60.0;
/// Nodes of the window of a usual path, and its heights, for estimates of memory.
const WINDOW_NODES: usize = 640;
const HEIGHTS: usize = 65;
/// Core seconds of a path for each wavelength of the geometry, and for each band and half of 64 rings, for estimates of time.
const GEOMETRY_S: f64 = 0.04;
const LIGHT_S: f64 = 0.002;
/// Points of half a window from which light is sent.
const POINTS: usize = 5000;
/// Points of a cell of the window.
const CELL_POINTS: (usize, usize) = (4, 200);
/// Steps of the R2 sequence: powers of the inverse of the plastic number.
const R2: (f64, f64) = (0.754_877_666_246_693, 0.569_840_290_998_053);
/// Steps of its start from cell to cell.
const FIRST: (f64, f64) = (0.618_033_988_749_895, 0.414_213_562_373_095);
/// Azimuths over half a turn per ring, for the light that is collected.
const HALF_TURN: usize = 4;
/// Share of the light that paths may have that are left out, and their density over the largest.
const LEFT_OUT: f64 = 0.01;

/// What the ghosts of a film are computed with.
#[derive(Clone, Debug, PartialEq)]
pub struct GhostOptions {
    /// Real image height of the film's corner, mm.
    pub corner_mm: f64,
    /// Rings to the corner.
    pub rings: usize,
    /// Reflectance of the film.
    pub film_reflectance: Reflectance,
}

/// A reflectance over the wavelength: nm, ascending, and value; linear between entries, one holds at all wavelengths.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Reflectance(pub Vec<(f64, f64)>);

impl Reflectance {
    /// The value at `nm`, 0 without entries.
    ///
    /// # Errors
    /// [`DesignError::Option`] outside the entries.
    pub fn at(&self, nm: f64) -> Result<f64, DesignError> {
        let entries = &self.0;
        let (Some(first), Some(last)) = (entries.first(), entries.last()) else { return Ok(0.0) };
        if entries.len() == 1 {
            return Ok(first.1);
        }
        if nm < first.0 - 1e-6 || nm > last.0 + 1e-6 {
            return Err(DesignError::Option {
                option: "sensor reflectance",
                value: format!("given for {}..{} nm", first.0, last.0),
                expected: "values at all wavelengths of the film",
            });
        }
        let i = entries.partition_point(|e| e.0 <= nm).clamp(1, entries.len() - 1);
        let ((a, low), (b, high)) = (entries[i - 1], entries[i]);
        Ok(low + ((nm - a) / (b - a)).clamp(0.0, 1.0) * (high - low))
    }

    /// Whether it is 0 at all wavelengths.
    pub fn is_zero(&self) -> bool {
        self.0.iter().all(|e| e.1 == 0.0)
    }
}

/// A path in the operator of a band.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PathReport {
    /// The path.
    pub path: GhostPath,
    /// Its light from the axis.
    pub axis: PathLight,
    /// From half of the film's corner.
    pub half: PathLight,
    /// First-order figures.
    pub first_order: FirstOrder,
    /// Share of the source whose ghost is largest, of the axis, half of the corner and the corner.
    largest: PathLight,
    /// Whether the operator has it.
    pub is_kept: bool,
}

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

/// Wavelength at which the geometry of the band at `nm` is traced.
pub fn geometry_nm(nm: f64) -> f64 {
    (nm / GEOMETRY_NM).round() * GEOMETRY_NM
}

/// Paths of `system`, the film's included if it reflects.
fn count_of_paths(system: &System, options: &GhostOptions) -> usize {
    ghost_paths(system, !options.film_reflectance.is_zero()).0.len()
}

/// Bytes while the ghosts of `bands` bands that share their geometry are traced on `threads` threads, without those of paths whose heights are doubled twice: grids of the rays of each path, sums
/// over the rings of the film, and the operators.
pub fn ghost_memory_bytes(system: &System, options: &GhostOptions, bands: usize, threads: usize) -> usize {
    let sizes = RingSizes::new(options.corner_mm, options.rings);
    let lanes = bands.min(LANES);
    let grid = 4 * (LIGHT + lanes) * WINDOW_NODES;
    let sums = 8 * lanes * sizes.rings * (HALF_TURN * sizes.rings + 1);
    let operator = 4 * (sizes.orders() + 1) * sizes.rings * sizes.source_rings;
    count_of_paths(system, options) * HEIGHTS * grid
        + threads * sums
        + (bands.div_ceil(lanes).max(2) * lanes) * operator
}

/// Core seconds of tracing the ghosts of `system` at `wavelengths_nm`, on a 2.2 GHz Xeon: of spherical surfaces.
pub fn ghost_seconds(system: &System, options: &GhostOptions, wavelengths_nm: &[f64]) -> f64 {
    let groups = wavelengths_nm.chunk_by(|a, b| geometry_nm(*a) == geometry_nm(*b)).count() as f64;
    let paths = count_of_paths(system, options) as f64;
    let rings = options.rings as f64 / 64.0;
    paths * (groups * GEOMETRY_S + wavelengths_nm.len() as f64 * LIGHT_S * (1.0 + rings))
}

/// The ghost paths of a lens at one wavelength.
#[derive(Clone, Debug, PartialEq)]
pub struct GhostTable {
    /// The paths, the largest share on the axis first.
    pub paths: Vec<PathReport>,
    /// Width of a ring, mm.
    pub ring_mm: f64,
    /// Surfaces whose clear radius is that of image rays, from 0.
    pub radii_of_rays: Vec<usize>,
    /// Paths between whose reflections a mirror lies, which are left out.
    pub across_mirrors: usize,
}

/// The ghost paths of `system` at `nm`.
///
/// # Errors
/// As [`trace_ghosts`].
pub fn ghost_table(system: &System, nm: f64, options: &GhostOptions) -> Result<GhostTable, DesignError> {
    let apertures = Apertures::new(system, options.corner_mm)?;
    let group = Group::new(system, nm, &[nm], options, &apertures)?;
    let ways = group.ways();
    let tables = LightTables::new(&group.lights, ways.iter().map(Vec::as_slice));
    let mut paths = group.reports(&ways, &group.windows(&ways), &tables).swap_remove(0);
    sort(&mut paths);
    Ok(GhostTable {
        paths,
        ring_mm: group.sizes.ring_mm,
        radii_of_rays: apertures.of_rays,
        across_mirrors: ghost_paths(system, !options.film_reflectance.is_zero()).1,
    })
}

fn sort(paths: &mut [PathReport]) {
    paths.sort_by(|a, b| b.axis.share.total_cmp(&a.axis.share));
}

/// Bands that share their geometry.
struct Group<'a> {
    lens: GhostLens<'a>,
    wavelengths_nm: Vec<f64>,
    sizes: RingSizes,
    fields: Fields,
    paths: Vec<GhostPath>,
    lights: Vec<GhostLight>,
    /// Axial flux of each band.
    flux: Vec<f64>,
    /// Light at the wavelength of the geometry, for the number of heights.
    reference: [GhostLight; 1],
}

impl<'a> Group<'a> {
    fn new(
        system: &'a System,
        geometry_nm: f64,
        wavelengths_nm: &[f64],
        options: &GhostOptions,
        apertures: &Apertures,
    ) -> Result<Self, DesignError> {
        let lens = GhostLens::new(system, geometry_nm / 1e3, apertures)?;
        let sizes = RingSizes::new(options.corner_mm, options.rings);
        let tan_per_mm = 1.0 / lens.tracer().ideal_scale_mm();
        let fields = Fields {
            last: sizes.source_rings as f64 * sizes.ring_mm * tan_per_mm,
            rings: (0..sizes.source_rings).map(|i| sizes.radius_mm(i) * tan_per_mm).collect(),
            ring_mm: sizes.ring_mm,
        };
        let (mut lights, mut flux) = (Vec::new(), Vec::new());
        for nm in wavelengths_nm {
            lights.push(GhostLight::new(system, nm / 1e3, options.film_reflectance.at(*nm)?)?);
            flux.push(GhostLens::new(system, nm / 1e3, apertures)?.axial_flux()?);
        }
        let (paths, _) = ghost_paths(system, !options.film_reflectance.is_zero());
        let reference = [GhostLight::new(system, geometry_nm / 1e3, 1.0)?];
        Ok(Self {
            lens,
            wavelengths_nm: wavelengths_nm.to_vec(),
            sizes,
            fields,
            paths,
            lights,
            flux,
            reference,
        })
    }

    fn ways(&self) -> Vec<Vec<Crossing<'_>>> {
        self.paths.iter().map(|path| self.lens.crossings(Some(*path))).collect()
    }

    fn windows(&self, ways: &[Vec<Crossing<'_>>]) -> Vec<Option<Window>> {
        ways.par_iter().map(|way| self.lens.window(way, self.fields.last)).collect()
    }

    fn trace(&self) -> Vec<BandGhosts> {
        let lens = &self.lens;
        let ways = self.ways();
        let tables = LightTables::new(&self.lights, ways.iter().map(Vec::as_slice));
        let reference = LightTables::new(&self.reference, ways.iter().map(Vec::as_slice));
        let windows = self.windows(&ways);
        let mut reports = self.reports(&ways, &windows, &tables);
        let is_kept = |k: &usize| reports.iter().any(|band| band[*k].is_kept);
        let found: Vec<(usize, PathHeights)> = (0..ways.len())
            .into_par_iter()
            .filter(is_kept)
            .filter_map(|k| {
                let way = &ways[k];
                let along = (&tables.along(way), self.lights.len());
                let heights =
                    PathHeights::trace(lens, way, windows[k]?, &self.fields, along, &reference.along(way));
                Some((k, heights))
            })
            .collect();
        let columns: Vec<Vec<Vec<f32>>> = (0..self.sizes.source_rings)
            .into_par_iter()
            .map(|ring| {
                let mut sums = RingSums::new(self.sizes, self.lights.len());
                for (k, heights) in &found {
                    let scales: Vec<f64> = reports
                        .iter()
                        .zip(&self.flux)
                        .map(|(band, flux)| if band[*k].is_kept { 1.0 / flux } else { 0.0 })
                        .collect();
                    self.collect(heights, ring, &scales, &mut sums);
                }
                (0..self.lights.len()).map(|band| sums.orders(band)).collect()
            })
            .collect();
        let band = |(band, nm): (usize, &f64)| {
            let columns: Vec<&[f32]> = columns.iter().map(|c| c[band].as_slice()).collect();
            let mut paths = std::mem::take(&mut reports[band]);
            sort(&mut paths);
            BandGhosts { wavelength_nm: *nm, operator: RingOperator::of_columns(self.sizes, &columns), paths }
        };
        self.wavelengths_nm.iter().enumerate().map(band).collect()
    }

    /// The paths of each band, as `ways`.
    fn reports(
        &self,
        ways: &[Vec<Crossing<'_>>],
        windows: &[Option<Window>],
        tables: &LightTables<'_>,
    ) -> Vec<Vec<PathReport>> {
        let corner = self.sizes.rings as f64 * self.sizes.ring_mm / self.lens.tracer().ideal_scale_mm();
        let dark = PathLight { share: 0.0, x_mm: 0.0, spread_mm: 0.0 };
        let lights: Vec<[Vec<PathLight>; 3]> = (0..ways.len())
            .into_par_iter()
            .map(|k| {
                [0.0, 0.5 * corner, corner].map(|tan| match &windows[k] {
                    None => vec![dark; self.lights.len()],
                    Some(window) => {
                        self.lens.path_lights(&ways[k], window, tan, &tables.along(&ways[k]), &self.flux)
                    }
                })
            })
            .collect();
        let report = |(k, band): (usize, usize)| {
            let [axis, half, edge] = [0, 1, 2].map(|field| lights[k][field][band]);
            let largest =
                [axis, half, edge].into_iter().max_by(|a, b| a.share.total_cmp(&b.share)).unwrap_or(axis);
            let first_order = self.lens.first_order(self.paths[k], &self.lights[band]);
            PathReport { path: self.paths[k], axis, half, first_order, largest, is_kept: true }
        };
        let of_band = |band: usize| {
            let mut reports: Vec<PathReport> = (0..ways.len()).map(|k| report((k, band))).collect();
            leave_out(&mut reports);
            reports
        };
        (0..self.lights.len()).map(of_band).collect()
    }

    /// Adds the light of a path from `ring` to `sums`, times the scale of each band.
    fn collect(&self, path: &PathHeights, ring: usize, scales: &[f64], sums: &mut RingSums) {
        let tan = self.fields.rings[ring];
        let grid = path.at(tan, Some(ring));
        let (along, across) = path.window.cells;
        let stride = grid.stride;
        let corners = |i: usize, j: usize| {
            [0, 1, across + 1, across + 2]
                .map(|k| &grid.values[(i * (across + 1) + j + k) * stride..][..stride])
        };
        let is_lit = |(i, j): &(usize, usize)| {
            let corners = corners(*i, *j);
            let least = corners.iter().map(|c| c[OVERSHOOT]).fold(f32::INFINITY, f32::min);
            corners.iter().all(|c| !c[OVERSHOOT].is_nan()) && least <= 0.0
        };
        let cells = || (0..along).flat_map(|i| (0..across).map(move |j| (i, j)));
        let lit = cells().filter(is_lit).count();
        if lit == 0 {
            return;
        }
        let points = POINTS.div_ceil(lit).clamp(CELL_POINTS.0, CELL_POINTS.1);
        // Both halves of the window.
        let area = 2.0 * path.window.cell_area_mm2() * self.lens.obliquity(tan) / points as f64;
        let mut weights = vec![0.0; scales.len()];
        for (i, j) in cells().filter(is_lit) {
            let corners = corners(i, j);
            let mix = |k: usize, shares: &[f64; 4]| -> f64 {
                corners.iter().zip(shares).map(|(c, share)| share * f64::from(c[k])).sum()
            };
            let start = (ring * along + i) as f64 * FIRST.0 + j as f64 * FIRST.1;
            for point in 0..points {
                let u = (start + point as f64 * R2.0).fract();
                let v = (start + point as f64 * R2.1).fract();
                let shares = [(1.0 - u) * (1.0 - v), (1.0 - u) * v, u * (1.0 - v), u * v];
                if mix(OVERSHOOT, &shares) > 0.0 {
                    continue;
                }
                for (band, weight) in weights.iter_mut().enumerate() {
                    *weight = mix(LIGHT + band, &shares) * area * scales[band];
                }
                sums.add((mix(X, &shares), mix(Y, &shares)), &weights);
            }
        }
    }
}

/// Leaves out the weakest paths of a band.
fn leave_out(paths: &mut [PathReport]) {
    let all: f64 = paths.iter().map(|p| p.largest.share).sum();
    let densest = paths.iter().map(|p| p.largest.density()).filter(|d| d.is_finite()).fold(0.0, f64::max);
    let mut order: Vec<usize> = (0..paths.len()).collect();
    order.sort_by(|a, b| paths[*a].largest.share.total_cmp(&paths[*b].largest.share));
    let mut left_out = 0.0;
    for k in order {
        let path = &mut paths[k];
        // A point has no finite density.
        let density = path.largest.density();
        let is_dense = path.largest.share > 0.0 && (!density.is_finite() || density >= LEFT_OUT * densest);
        if left_out + path.largest.share >= LEFT_OUT * all {
            break;
        }
        if !is_dense {
            left_out += path.largest.share;
            path.is_kept = false;
        }
    }
}

/// Light that lands on the rings of the film from one ring of the scene, for several bands, over half a turn: rays are given with their mirror image.
pub(super) struct RingSums {
    sizes: RingSizes,
    bands: usize,
    /// Ring, azimuth from 0 to half a turn, band.
    sums: Vec<f64>,
}

impl RingSums {
    pub(super) fn new(sizes: RingSizes, bands: usize) -> Self {
        Self { sizes, bands, sums: vec![0.0; sizes.rings * (HALF_TURN * sizes.rings + 1) * bands] }
    }

    /// Adds a ray and its mirror image, of the light `weights` together.
    pub(super) fn add(&mut self, (x, y): (f64, f64), weights: &[f64]) {
        let steps = HALF_TURN * self.sizes.rings;
        let (ring, share) = self.sizes.about((x * x + y * y).sqrt());
        if ring >= self.sizes.rings {
            return;
        }
        let turn = real::atan2(y.abs(), x) / PI * steps as f64;
        let azimuth = (turn as usize).min(steps - 1);
        let part = turn - azimuth as f64;
        for (ring, share) in [(ring, 1.0 - share), (ring + 1, share)] {
            if ring >= self.sizes.rings {
                continue;
            }
            let at = (ring * (steps + 1) + azimuth) * self.bands;
            let (low, high) = self.sums[at..at + 2 * self.bands].split_at_mut(self.bands);
            for ((low, high), weight) in low.iter_mut().zip(high).zip(weights) {
                *low += weight * share * (1.0 - part);
                *high += weight * share * part;
            }
        }
    }

    /// Azimuthal orders of a band: order, ring.
    pub(super) fn orders(&self, band: usize) -> Vec<f32> {
        let RingSizes { rings, .. } = self.sizes;
        let steps = HALF_TURN * rings;
        let cosines: Vec<f64> = (0..2 * steps).map(|k| real::cos(PI * k as f64 / steps as f64)).collect();
        let damping = jackson(self.sizes.orders());
        let mut orders = vec![0.0_f32; damping.len() * rings];
        for ring in 0..rings {
            let row = &self.sums[ring * (steps + 1) * self.bands..][..(steps + 1) * self.bands];
            let lit: Vec<(usize, f64)> = row[band..]
                .iter()
                .step_by(self.bands)
                .copied()
                .enumerate()
                .filter(|(_, v)| *v != 0.0)
                .collect();
            for (m, g) in damping.iter().enumerate() {
                let sum: f64 = lit.iter().map(|(k, v)| v * cosines[k * m % (2 * steps)]).sum();
                orders[m * rings + ring] = (g * sum) as f32;
            }
        }
        orders
    }
}

#[cfg(test)]
mod tests {
    use super::super::test_lenses::*;
    use super::*;
    use crate::design::ghost::rings::RingPower;
    use crate::design::prescription::coating::Coating;

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
            direct_rays(&group, group.fields.rings[ring], 40, |(x, y), weight| {
                // Shared between the rings about it: the last ring has light from beyond it.
                let over = (((x * x + y * y).sqrt() - last) / group.sizes.ring_mm).clamp(0.0, 1.0);
                direct += weight * (1.0 - over);
            });
            let found = band.operator.share(ring);
            assert!((found / direct - 1.0).abs() < 0.02, "ring {ring}: {found:e} {direct:e}");
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
        assert!(l1 < 0.06 && (power - 1.0).abs() < 0.01, "{l1} {power}");
    }

    /// 55 paths, 230,000 rays each: 30 core seconds.
    #[test]
    #[ignore = "long: 30 core seconds"]
    fn scene_of_two_sources_equals_a_direct_sum_over_rays_of_a_double_gauss() {
        for coating in [Coating::Bare, Coating::quarter_wave("MgF2", 1.38, 0.55)] {
            for rings in [64, 128] {
                let sizes = GhostOptions { rings, ..options(24.57, 0.1) };
                let (l1, power) = difference_from_rays(&double_gauss(coating.clone()), &sizes, 480);
                println!("{rings} rings: L1 {l1:.4}, power {power:.5}");
                // 0.968 (64 rings, MgF2) to 0.985 was found: the operator loses 2 to 3 % of the light, the cause is not known.
                assert!(l1 < 0.06 && (power - 1.0).abs() < 0.04, "{rings} rings: {l1} {power}");
            }
        }
    }
}
