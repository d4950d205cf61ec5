//! Bands whose ghosts are traced together: the same rays, light of each band's own wavelength.

use rayon::prelude::*;

use super::apertures::Apertures;
use super::heights::Fields;
use super::light::GhostLight;
use super::light_tables::LightTables;
use super::options::GhostOptions;
use super::path::{Crossing, GhostLens, GhostPath, ghost_paths};
use super::report::{PathReport, leave_out};
use super::rings::RingSizes;
use super::share::PathLight;
use super::window::Window;
use crate::design::prescription::error::DesignError;
use crate::design::prescription::system::System;

/// Spacing of the wavelengths at which geometry is traced, nm.
const GEOMETRY_NM: f64 = 60.0;

/// Wavelength at which the geometry of the band at `nm` is traced.
pub fn geometry_nm(nm: f64) -> f64 {
    (nm / GEOMETRY_NM).round() * GEOMETRY_NM
}

/// Bands that share their geometry.
pub(super) struct Group<'a> {
    pub(super) lens: GhostLens<'a>,
    pub(super) wavelengths_nm: Vec<f64>,
    pub(super) sizes: RingSizes,
    pub(super) fields: Fields,
    pub(super) paths: Vec<GhostPath>,
    pub(super) lights: Vec<GhostLight>,
    /// Axial flux of each band.
    pub(super) flux: Vec<f64>,
    /// Light at the wavelength of the geometry, for the number of heights.
    pub(super) reference: [GhostLight; 1],
}

impl<'a> Group<'a> {
    pub(super) fn new(
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

    pub(super) fn ways(&self) -> Vec<Vec<Crossing<'_>>> {
        self.paths.iter().map(|path| self.lens.crossings(Some(*path))).collect()
    }

    pub(super) fn windows(&self, ways: &[Vec<Crossing<'_>>]) -> Vec<Option<Window>> {
        ways.par_iter().map(|way| self.lens.window(way, self.fields.last)).collect()
    }

    /// The paths of each band, as `ways`.
    pub(super) fn reports(
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
            let [axis, half, corner] = [0, 1, 2].map(|field| lights[k][field][band]);
            let first_order = self.lens.first_order(self.paths[k], &self.lights[band]);
            PathReport { path: self.paths[k], axis, half, corner, first_order, is_kept: true }
        };
        let of_band = |band: usize| {
            let mut reports: Vec<PathReport> = (0..ways.len()).map(|k| report((k, band))).collect();
            leave_out(&mut reports);
            reports
        };
        (0..self.lights.len()).map(of_band).collect()
    }
}
