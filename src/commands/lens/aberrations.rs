//! Plots of aberrations of a design: ray fans, OPD fans, field curvature, MTF through focus.
//!
//! *Ray fan*: x (tangential, rays through (p, 0)) or y (sagittal, rays through (0, q)) in the film plane less that of the chief ray, against the
//! pupil coordinate. *OPD*: the wavefront at the same rays, in wavelengths ([`pipeline::design::wavefront`]). *Field curvature*:
//! [`pipeline::design::field_curvature`]. *MTF through focus*: of the PSF with diffraction, the film moved, field points fixed. Blocked rays are
//! left out.

use super::curves::without_rounding;
use crate::progress::short_number;
use anyhow::Result;
use formats::picture::bands::{band_key, band_series};
use formats::picture::plot::{Axis, Plot, Series};
use formats::picture::style::Colour;
use pipeline::design::System;
use pipeline::design::field_curvature::foci;
use pipeline::design::field_psf::field_psf;
use pipeline::design::ray::{ImageRay, Tracer};
use pipeline::design::system::ImagePlane;
use pipeline::design::wavefront::ReferenceSphere;
use pipeline::figures::{Direction, PsfWindow};

/// Rays of a fan.
const FAN: i32 = 81;
/// Maximum panels of a figure of fans.
pub const MAX_PANELS: usize = 4;
/// Film positions of the MTF through focus.
const POSITIONS: i32 = 25;
/// Radii of a curve of the encircled energy.
const RADII: usize = 240;

const DIRECTIONS: Option<[&str; 2]> = Some(["tangential", "sagittal"]);

/// What a fan shows.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Fan {
    Ray,
    Path,
}

/// Fans at the heights `heights_mm` of the primary wavelength, one panel each, all wavelengths.
pub fn fans(system: &System, nm: &[f64], heights_mm: &[f64], fan: Fan) -> Result<Vec<Plot>> {
    let primary = Tracer::new(system, system.primary_um())?;
    let mut plots = Vec::new();
    for &height in heights_mm {
        let tan = primary.field_of_height(height)?;
        let mut series = Vec::new();
        for (b, nm_b) in nm.iter().enumerate() {
            let tracer = Tracer::new(system, nm_b / 1e3)?;
            let Ok(chief) = tracer.ray(tan, 0.0, 0.0) else { continue };
            for (dash, along) in [(0, true), (1, false)] {
                let points = without_rounding(fan_points(&tracer, tan, &chief, along, fan));
                series.push(band_series(nm, b, points).dashed(dash));
            }
        }
        let name = match fan {
            Fan::Ray => "ray error (µm)",
            Fan::Path => "OPD (waves)",
        };
        let title = field_name(system, height, tan);
        let (x, y) =
            (Axis::new("pupil coordinate", -1.0, 1.0), Axis::new(format!("{name}, {title}"), 0.0, 0.0));
        plots.push(Plot { series, key: band_key(nm), styles: DIRECTIONS, ..Plot::new(title, x, y) });
    }
    Ok(plots)
}

/// Height and, for an object at infinity, field angle.
pub fn field_name(system: &System, height_mm: f64, tan: f64) -> String {
    match system.object_distance_mm {
        None => format!("{height_mm:.1} mm, {:.1}°", tan.atan().to_degrees()),
        Some(_) => format!("{height_mm:.2} mm"),
    }
}

fn fan_points(tracer: &Tracer<'_>, tan: f64, chief: &ImageRay, along: bool, fan: Fan) -> Vec<(f64, f64)> {
    let Ok(sphere) = ReferenceSphere::new(tracer, tan) else { return Vec::new() };
    let point = |i: i32| {
        let at = 2.0 * f64::from(i) / f64::from(FAN - 1) - 1.0;
        let (p, q) = if along { (at, 0.0) } else { (0.0, at) };
        if !tracer.passes(tan, p, q) {
            return None;
        }
        let ray = tracer.ray(tan, p, q).ok()?;
        let value = match fan {
            Fan::Ray => 1e3 * if along { ray.x.v - chief.x.v } else { ray.y.v },
            Fan::Path => sphere.waves(&ray),
        };
        Some((at, value))
    };
    (0..FAN).filter_map(point).collect()
}

/// Tangential and sagittal focus against the height, whose axis is `x`, at each wavelength.
pub fn field_curvature(system: &System, nm: &[f64], max_mm: f64, x: Axis) -> Result<Plot> {
    let mut series = Vec::new();
    for (b, nm_b) in nm.iter().enumerate() {
        let tracer = Tracer::new(system, nm_b / 1e3)?;
        let foci = |i: i32| -> Option<(f64, f64, f64)> {
            let height = max_mm * f64::from(i) / 60.0;
            let foci = foci(&tracer, tracer.field_of_height(height).ok()?).ok()?;
            Some((height, foci.tangential_mm, foci.sagittal_mm))
        };
        let all: Vec<_> = (0..=60).filter_map(foci).collect();
        series.push(band_series(nm, b, all.iter().map(|f| (f.0, f.1)).collect()).dashed(0));
        series.push(band_series(nm, b, all.iter().map(|f| (f.0, f.2)).collect()).dashed(1));
    }
    let y = Axis::new("focus from the film (mm)", 0.0, 0.0);
    let title = format!("{}: field curvature and astigmatism", system.name);
    Ok(Plot { series, key: band_key(nm), styles: DIRECTIONS, ..Plot::new(title, x, y) })
}

/// MTF at `lp_mm` against the position of the film for the heights at the primary wavelength.
pub fn through_focus(system: &System, heights_mm: &[f64], lp_mm: f64) -> Result<Plot> {
    let um = system.primary_um();
    let tracer = Tracer::new(system, um)?;
    let na = 0.5 / tracer.primary.working_f_number();
    // Twice the defocus whose geometrical blur has the diameter of a period.
    let range_mm = 1.0 / (lp_mm * na);
    let mut series = Vec::new();
    for (i, &height) in heights_mm.iter().enumerate() {
        let tan = tracer.field_of_height(height)?;
        let mut curves = [Vec::new(), Vec::new()];
        for k in 0..POSITIONS {
            let z = range_mm * (2.0 * f64::from(k) / f64::from(POSITIONS - 1) - 1.0);
            let moved = system.with_image_plane(ImagePlane::AsDesigned, z)?;
            let Ok(psf) = field_psf(&Tracer::new(&moved, um)?, tan) else { continue };
            for (curve, direction) in curves.iter_mut().zip([Direction::Tangential, Direction::Sagittal]) {
                curve.push((z, psf.mtf(lp_mm, direction)));
            }
        }
        for (dash, curve) in curves.into_iter().enumerate() {
            let name = field_name(system, height, tan);
            series.push(Series::line(name, refined(&curve), Colour::Palette(i)).dashed(dash));
        }
    }
    let title = format!(
        "{}: MTF at {} lp/mm through focus, {} nm",
        system.name,
        short_number(lp_mm),
        short_number(um * 1e3)
    );
    let (x, y) = (Axis::new("film position (mm)", 0.0, 0.0), Axis::new("MTF", 0.0, 1.05));
    Ok(Plot { series, styles: DIRECTIONS, ..Plot::new(title, x, y) })
}

/// A curve through equally spaced points: on each interval the cubic through the four nearest; not below 0.
fn refined(points: &[(f64, f64)]) -> Vec<(f64, f64)> {
    const STEPS: usize = 8;
    if points.len() < 4 {
        return points.to_vec();
    }
    let at = |i: usize| {
        let t = i as f64 / STEPS as f64;
        let first = (t as usize).clamp(1, points.len() - 3) - 1;
        let u = t - first as f64;
        // Lagrange's weights for the nodes 0, 1, 2, 3.
        let weight = |k: usize| {
            let others = (0..4).filter(|j| *j != k);
            others.map(|j| (u - j as f64) / (k as f64 - j as f64)).product::<f64>()
        };
        let sum =
            |of: fn(&(f64, f64)) -> f64| (0..4).map(|k| weight(k) * of(&points[first + k])).sum::<f64>();
        (sum(|p| p.0), sum(|p| p.1).max(0.0))
    };
    (0..=(points.len() - 1) * STEPS).map(at).collect()
}

/// Share of the light within a radius of the centroid of the PSF, by height, at one wavelength.
pub fn encircled_energy(name: &str, psfs: &[(f64, &PsfWindow)], nm: f64) -> Plot {
    let series = psfs.iter().enumerate().map(|(i, (height, psf))| {
        Series::line(format!("{height:.2} mm"), encircled(psf), Colour::Palette(i))
    });
    let title = format!("{name}: encircled energy at {} nm", short_number(nm));
    let (x, y) =
        (Axis::new("radius about the centroid (µm)", 0.0, 0.0), Axis::new("share of the light", 0.0, 1.0));
    Plot { series: series.collect(), ..Plot::new(title, x, y) }
}

fn encircled(psf: &PsfWindow) -> Vec<(f64, f64)> {
    let edge = psf.pitch_um * (psf.size / 2) as f64;
    let curve = psf.encircled();
    (0..=RADII).map(|i| edge * i as f64 / RADII as f64).filter_map(|r| Some((r, curve.within(r)?))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fans_of_the_double_gauss_start_at_0_and_its_foci_meet_on_the_axis() {
        let system = System::double_gauss_28();
        for fan in [Fan::Ray, Fan::Path] {
            let plots = fans(&system, &[486.1, 587.6], &[0.0, 20.0], fan).unwrap();
            assert_eq!((plots.len(), plots[1].series.len()), (2, 4));
            for series in plots.iter().flat_map(|p| &p.series) {
                assert_eq!(series.points.len(), FAN as usize);
                assert!(series.points[FAN as usize / 2].1.abs() < 1e-9);
            }
        }
        let curvature = field_curvature(&system, &[587.6], 20.0, Axis::new("", 0.0, 0.0)).unwrap();
        let (t, s) = (&curvature.series[0].points, &curvature.series[1].points);
        assert!((t[0].1 - s[0].1).abs() < 1e-9 && (t[60].1 - s[60].1).abs() > 1e-3);
        // The paraxial focus is 0.1834 mm behind the film, as the design program prints.
        assert!((t[0].1 - 0.1834).abs() < 1e-3, "{:?}", t[0]);
    }

    #[test]
    fn refined_curve_has_its_points_and_cubics_between_them() {
        let cubic = |x: f64| 9.0 + x * (1.0 - x * (2.0 - 0.3 * x));
        let points: Vec<(f64, f64)> = (0..6).map(|i| 0.5 * f64::from(i)).map(|x| (x, cubic(x))).collect();
        let curve = refined(&points);
        assert_eq!(curve.len(), 41);
        assert!(curve.iter().all(|(x, y)| (y - cubic(*x)).abs() < 1e-12));
        assert_eq!(refined(&points[..2]), points[..2]);
    }

    /// Coddington's equations along the chief ray: n' cos²i'/t' = n cos²i/t + φ, n'/s' = n/s + φ, φ = c (n' cos i' − n cos i).
    #[test]
    fn foci_of_the_double_gauss_are_those_of_coddingtons_equations() {
        let (system, um) = (System::double_gauss_28(), 0.5876);
        let tracer = Tracer::new(&system, um).unwrap();
        let curvature = field_curvature(&system, &[587.6], 24.0, Axis::new("", 0.0, 0.0)).unwrap();
        for k in [0, 20, 40, 60] {
            let (height, tangential) = curvature.series[0].points[k];
            let path = tracer.path(tracer.field_of_height(height).unwrap(), 0.0, 50.0).unwrap();
            let step = |i: usize| {
                let (dz, dx) = (path[i + 1].0 - path[i].0, path[i + 1].1 - path[i].1);
                (dz / dz.hypot(dx), dx / dz.hypot(dx), dz.hypot(dx))
            };
            // Inverse distances to the tangential and sagittal focus.
            let (mut inverse, mut n, mut cosine) = ([0.0, 0.0], 1.0, 1.0);
            for (i, (surface, (vertex, _))) in system.surfaces.iter().zip(system.axis()).enumerate() {
                let c = surface.shape.curvature;
                let (z, x) = (path[i + 1].0 - vertex, path[i + 1].1);
                let before = step(i);
                cosine = before.0;
                if i == system.image() {
                    break;
                }
                let behind = step(i + 1);
                let cos = |d: (f64, f64, f64)| d.0 * (1.0 - c * z) - d.1 * c * x;
                let n2 = surface.medium.index(um).unwrap();
                let (a, b) = (cos(before), cos(behind));
                let power = c * (n2 * b - n * a);
                let t = (n * a * a * inverse[0] + power) / (n2 * b * b);
                let s = (n * inverse[1] + power) / n2;
                inverse = [t, s].map(|v| v / (1.0 - v * behind.2));
                n = n2;
            }
            for (found, inverse) in [tangential, curvature.series[1].points[k].1].into_iter().zip(inverse) {
                assert!(
                    (found - cosine / inverse).abs() < 1e-9,
                    "{height} mm: {found}, {}",
                    cosine / inverse
                );
            }
        }
    }
}
