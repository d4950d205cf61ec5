//! Shares of ghosts by real rays over the windows of their paths.

use super::light::GhostLight;
use super::light_tables::{LANES, PathTables};
use super::path::{Crossing, GhostLens, GhostPath};
use super::trace::Landing;
use super::window::Window;
use crate::design::prescription::error::DesignError;
use crate::design::pupil::bundle::Bundle;

/// Light of a path from one object point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PathLight {
    /// Γ_p.
    pub share: f64,
    /// Mean place on the film, mm, with the image on +x.
    pub x_mm: f64,
    /// Root mean square distance from there, mm.
    pub spread_mm: f64,
}

impl PathLight {
    /// Diameter of an even disc of the same spread, mm.
    pub fn diameter_mm(&self) -> f64 {
        8.0_f64.sqrt() * self.spread_mm
    }

    /// Share per area of that disc, 1/mm².
    pub fn density(&self) -> f64 {
        self.share / (2.0 * std::f64::consts::PI * self.spread_mm * self.spread_mm)
    }
}

/// A ray on the film with its light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GhostRay {
    /// Where it lands.
    pub landing: Landing,
    /// Share of its light that is left.
    pub weight: f64,
}

/// Rays per cell of a window, along and across.
const RAYS: usize = 3;

impl GhostLens<'_> {
    /// The ray along `path` (the image's way: `None`) from the object point at tan(field angle) `tan` through (x, y) in mm in the plane of the first vertex. None if it ends on the way; a
    /// ray that a clear radius blocks has an overshoot above 0.
    pub fn ray(
        &self,
        path: Option<GhostPath>,
        light: &GhostLight,
        tan: f64,
        (x, y): (f64, f64),
    ) -> Option<GhostRay> {
        let crossings = self.crossings(path);
        let mut meetings = Vec::with_capacity(crossings.len());
        let landing = self.follow(&crossings, self.start(tan, x, y).0, &mut meetings)?;
        Some(GhostRay { landing, weight: light.weight(&crossings, &meetings) })
    }

    /// Flux of the image's bundle on the axis: mm² of the pupil for an object at infinity, else in direction cosines at the object; with losses.
    ///
    /// # Errors
    /// A ray of the pupil that does not reach the image.
    pub fn axial_flux(&self) -> Result<f64, DesignError> {
        let bundle = Bundle::trace(&self.tracer, 0.0, 7, 9)?;
        Ok(bundle.rays.iter().map(|(weight, ray)| 2.0 * weight * ray.flux).sum())
    }

    /// Radius of the disc in the plane of the first vertex that holds all rays to the clear part of the first surface from the field at `tan`, mm.
    pub(super) fn start_radius_mm(&self, tan: f64) -> f64 {
        let clear = self.apertures.clear_mm[0];
        let sag = self.system.surfaces[0].shape.sag_mm(clear).unwrap_or(clear);
        // From a near object rays to the rim are steeper than the chief ray.
        let spread = self.tracer.object_distance_mm().map_or(0.0, |d| clear / d);
        clear + sag.abs() * (tan.abs() + spread)
    }

    /// Light of the path of `crossings`, whose window is `window`, from the object point at tan(field angle) `tan`, for each wavelength of `tables` with its [`GhostLens::axial_flux`].
    pub(super) fn path_lights(
        &self,
        crossings: &[Crossing<'_>],
        window: &Window,
        tan: f64,
        tables: &PathTables<'_, '_>,
        axial_flux: &[f64],
    ) -> Vec<PathLight> {
        let (along, across) = (window.cells.0 * RAYS, window.cells.1 * RAYS);
        let [mut power, mut first, mut second] = [[0.0; LANES]; 3];
        let mut meetings = Vec::with_capacity(crossings.len());
        for i in 0..along {
            for j in 0..across {
                let place = |k: usize| (k as f64 + 0.5) / RAYS as f64;
                let (x, y) = window.place(place(i), place(j), tan);
                let (start, flux) = self.start(tan, x, y);
                let Some(landing) = self.follow(crossings, start, &mut meetings) else { continue };
                if landing.overshoot > 0.0 {
                    continue;
                }
                for (lane, weight) in tables.weights(&meetings).into_iter().enumerate() {
                    let w = flux * weight;
                    power[lane] += w;
                    first[lane] += w * landing.x;
                    second[lane] += w * (landing.x * landing.x + landing.y * landing.y);
                }
            }
        }
        let area = 2.0 * window.cell_area_mm2() / (RAYS * RAYS) as f64;
        let light = |(lane, flux): (usize, &f64)| {
            let total = if power[lane] > 0.0 { power[lane] } else { 1.0 };
            let (x_mm, square) = (first[lane] / total, second[lane] / total);
            PathLight {
                share: power[lane] * area * self.obliquity(tan) / flux,
                x_mm,
                spread_mm: (square - x_mm * x_mm).max(0.0).sqrt(),
            }
        };
        axial_flux.iter().enumerate().map(light).collect()
    }

    /// Solid angle of an element of the ideal plane over that on the axis, times the cosine of the beam: cos⁴θ for an object at infinity, else 1.
    pub(super) fn obliquity(&self, tan: f64) -> f64 {
        self.tracer.object_distance_mm().map_or((1.0 + tan * tan).powi(-2), |_| 1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::super::light_tables::LightTables;
    use super::super::path::ghost_paths;
    use super::super::test_lenses::*;
    use super::*;
    use crate::design::prescription::coating::Coating;
    use crate::design::prescription::system::System;
    use crate::real;

    /// Landing and weight of one ray, clear radii ignored.
    fn ray(
        lens: &GhostLens<'_>,
        path: Option<GhostPath>,
        light: &GhostLight,
        (tan, x, y): (f64, f64, f64),
    ) -> Option<(Landing, f64)> {
        lens.ray(path, light, tan, (x, y)).map(|ray| (ray.landing, ray.weight))
    }

    fn near(found: f64, expected: f64, tolerance: f64) {
        assert!((found - expected).abs() <= tolerance, "{found} instead of {expected}");
    }

    #[test]
    fn ghost_of_a_plate_is_shifted_and_has_its_share() {
        let (t, n, tan, film_mm) = (3.0, 1.5, 0.2_f64, 10.0);
        // An ideal lens without power of its own to speak of makes the plate a lens.
        let mut system = lens(&[(0.0, t, n, 9.0), (0.0, film_mm, 1.0, 9.0)], 0);
        system.surfaces[0].shape.curvature = 1e-300;
        let apertures = Apertures { clear_mm: vec![9.0; 3], hidden_mm: vec![None; 3], of_rays: Vec::new() };
        let lens = GhostLens::new(&system, 0.55, &apertures).unwrap();
        let light = GhostLight::new(&system, 0.55, 0.1).unwrap();
        let sine = real::sin(real::atan(tan)) / n;
        let cos = real::cos(real::atan(tan));
        let cos_inside = (1.0 - sine * sine).sqrt();
        let rs = ((cos - n * cos_inside) / (cos + n * cos_inside)).powi(2);
        let rp = ((n * cos - cos_inside) / (n * cos + cos_inside)).powi(2);
        for (x, y) in [(0.0, 0.0), (0.7, -0.3)] {
            let at = (tan, x, y);
            let (image, w) = ray(&lens, None, &light, at).unwrap();
            near(w, ((1.0 - rs).powi(2) + (1.0 - rp).powi(2)) / 2.0, 1e-12);
            let inside = GhostPath { first: 1, second: 0 };
            let (ghost, w) = ray(&lens, Some(inside), &light, at).unwrap();
            let sign = lens.tracer().image_sign();
            near(sign * (ghost.x - image.x), 2.0 * t * sine / cos_inside, 1e-12);
            near(ghost.y, image.y, 1e-12);
            let share = |r: f64| (1.0 - r).powi(2) * r * r;
            near(w, (share(rs) + share(rp)) / 2.0, 1e-12);
            // Film and plate: a gap g away, 2 g tan θ.
            let film = GhostPath { first: 2, second: 1 };
            let (ghost, w) = ray(&lens, Some(film), &light, at).unwrap();
            near(sign * (ghost.x - image.x), 2.0 * film_mm * tan, 1e-12);
            near(w, 0.1 * ((1.0 - rs).powi(2) * rs + (1.0 - rp).powi(2) * rp) / 2.0, 1e-12);
        }
    }

    #[test]
    fn traced_ghosts_equal_first_order_near_the_axis() {
        let system = double_gauss(Coating::Bare);
        let apertures = Apertures::new(&system, 24.57).unwrap();
        let lens = GhostLens::new(&system, 0.5875618, &apertures).unwrap();
        let light = GhostLight::new(&system, 0.5875618, 1.0).unwrap();
        let (paths, left_out) = ghost_paths(&system, true);
        assert_eq!((paths.len(), left_out), (55, 0));
        let pupil = lens.tracer().primary.entrance_pupil_mm;
        for path in paths {
            let first = lens.first_order(path, &light);
            let (tan, x, y) = (1e-5, 1e-3, -5e-4);
            let (landing, _) = ray(&lens, Some(path), &light, (tan, x, y)).unwrap();
            let u0 = lens.tracer().image_sign() * tan;
            let expected = first.height_per_pupil * (x + u0 * pupil) + first.height_per_tan * u0;
            let size = first.height_per_pupil.abs().max(first.height_per_tan.abs() * 1e-2);
            near(landing.x, expected, 3e-7 * size);
            near(landing.y, first.height_per_pupil * y, 3e-7 * size);
        }
    }

    /// T and R of surfaces in a row without absorption, all reflections, powers added.
    fn incoherent(reflectances: &[f64]) -> (f64, f64) {
        // (forward, backward) before a surface from those behind it.
        let mut m = [[1.0, 0.0], [0.0, 1.0]];
        for r in reflectances {
            let s = [[1.0 / (1.0 - r), -r / (1.0 - r)], [r / (1.0 - r), (1.0 - 2.0 * r) / (1.0 - r)]];
            m = [0, 1].map(|i| [0, 1].map(|j| m[i][0] * s[0][j] + m[i][1] * s[1][j]));
        }
        (1.0 / m[0][0], m[1][0] / m[0][0])
    }

    #[test]
    fn energy_of_image_and_ghosts_balances_on_the_axis() {
        let um = 0.5875618;
        let expected = [(6.8874e-2, 0.63583), (1.4847e-3, 0.94239), (1.1199e-4, 0.98406)];
        for (coating, (ghosts, transmission)) in coatings().into_iter().zip(expected) {
            let system = double_gauss(coating);
            let apertures = Apertures::new(&system, 24.57).unwrap();
            let lens = GhostLens::new(&system, um, &apertures).unwrap();
            let light = GhostLight::new(&system, um, 0.0).unwrap();
            let near_axis = |path| ray(&lens, path, &light, (0.0, 1e-4, 0.0)).unwrap().1;
            let image = near_axis(None);
            let (paths, _) = ghost_paths(&system, false);
            assert_eq!(paths.len(), 45);
            let two: f64 = paths.iter().map(|path| near_axis(Some(*path))).sum();
            let reflectances: Vec<f64> = crate::design::light::surface_light(&system, um * 1e3)
                .unwrap()
                .iter()
                .map(|s| {
                    assert!((s.reflectance + s.transmittance - 1.0).abs() < 1e-13);
                    s.reflectance
                })
                .collect();
            near(image, reflectances.iter().map(|r| 1.0 - r).product(), 1e-9);
            let (total, back) = incoherent(&reflectances);
            near(total + back, 1.0, 1e-13);
            let rest = total - image - two;
            assert!(rest > 0.0 && rest < 2.5 * two * two / image, "{rest}");
            near(image, transmission, 1e-5);
            near(two / image / ghosts, 1.0, 1e-4);
        }
    }

    #[test]
    fn share_of_a_clipped_ghost_is_near_its_first_order() {
        let system = double_gauss(Coating::Bare);
        let apertures = Apertures::new(&system, 24.57).unwrap();
        let um = 0.5875618;
        let lens = GhostLens::new(&system, um, &apertures).unwrap();
        let light = GhostLight::new(&system, um, 0.1).unwrap();
        let axial = lens.axial_flux().unwrap();
        let lights = [light.clone()];
        let real = |path: Option<GhostPath>| {
            let way = lens.crossings(path);
            let window = lens.window(&way, 0.3).unwrap();
            let tables = LightTables::new(&lights, [way.as_slice()].into_iter());
            lens.path_lights(&way, &window, 0.0, &tables.along(&way), &[axial])[0]
        };
        // The bundle of the image fills the paraxial pupil, the clear radius of the stop lets a little more through.
        near(real(None).share, 1.0, 1e-2);
        for ((first, second), share) in [((10, 8), 2.83e-3), ((6, 4), 2.94e-3), ((11, 9), 5.02e-3)] {
            let path = GhostPath { first, second };
            let order = lens.first_order(path, &light);
            near(order.share / share, 1.0, 0.02);
            near(real(Some(path)).share / share, 1.0, 0.02);
        }
    }

    #[test]
    fn telescope_of_mirrors_keeps_both_reflections_between_two_mirrors() {
        let mut system = System::double_gauss_28();
        for s in &mut system.surfaces {
            s.coating = Some(Coating::Bare);
        }
        // A mirror between the halves: pairs across it are left out.
        system.surfaces[5].is_mirror = true;
        let (paths, left_out) = ghost_paths(&system, true);
        assert_eq!((paths.len(), left_out), (10 + 15, 5 * 6));
    }
}
