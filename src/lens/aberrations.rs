//! Plots of aberrations of a design: ray fans, OPD fans, field curvature, MTF through focus.
//!
//! *Ray fan*: x (tangential, rays through (p, 0)) or y (sagittal, rays through (0, q)) in the film plane less that of the chief ray, against the
//! pupil coordinate. *OPD*: optical path of the same rays less that of the chief ray, at plane waves through the chief ray's
//! intersection with the film, in wavelengths. *Field curvature*: where rays infinitely near the chief ray cross it, tangential
//! z = −x_p / (L/N)_p, sagittal z = −y_q / (M/N)_q (subscripts: derivatives), along the axis from the film. *MTF through focus*: of the PSF with
//! diffraction, the film moved, field points fixed. Blocked rays are left out.

use super::curves::short_number;
use anyhow::Result;
use formats::picture::bands::{band_key, band_series};
use formats::picture::plot::{Axis, Plot, Series};
use formats::picture::style::Colour;
use pipeline::design::psf::{PsfGrid, PsfScratch, PupilFunction};
use pipeline::design::ray::{ImageRay, Tracer};
use pipeline::design::system::ImagePlane;
use pipeline::design::{DesignError, System};
use pipeline::figures::{Direction, PsfWindow};
use pipeline::lens::PsfSample;

/// Rays of a fan.
const FAN: i32 = 81;
/// Maximum panels of a figure of fans.
pub const MAX_PANELS: usize = 4;
/// Film positions of the MTF through focus.
const POSITIONS: i32 = 25;
/// Maximum half-width of its PSFs, samples.
const MAX_HALF: usize = 220;

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
                let points = fan_points(&tracer, tan, &chief, along, fan);
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
    let point = |i: i32| {
        let at = 2.0 * f64::from(i) / f64::from(FAN - 1) - 1.0;
        let (p, q) = if along { (at, 0.0) } else { (0.0, at) };
        if !tracer.passes(tan, p, q) {
            return None;
        }
        let ray = tracer.ray(tan, p, q).ok()?;
        let (dx, dy) = (ray.x.v - chief.x.v, ray.y.v);
        let value = match fan {
            Fan::Ray => 1e3 * if along { dx } else { dy },
            Fan::Path => {
                1e3 * (ray.path.v - chief.path.v - ray.l.v * dx - ray.m.v * dy) / tracer.wavelength_um
            }
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
            let ray = tracer.ray(tracer.field_of_height(height).ok()?, 0.0, 0.0).ok()?;
            // d(L/N) with L² + M² + N² = 1 and M = 0 on the meridian.
            let tangential = -ray.x.d[0] / (ray.l.d[0] / ray.n.powi(3));
            let sagittal = -ray.y.d[1] / (ray.m.d[1] / ray.n);
            Some((height, tangential, sagittal))
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
            let Ok(psf) = psf(&moved, um, tan) else { continue };
            for (curve, direction) in curves.iter_mut().zip([Direction::Tangential, Direction::Sagittal]) {
                curve.push((z, psf.mtf(lp_mm, direction)));
            }
        }
        for (dash, curve) in curves.into_iter().enumerate() {
            series
                .push(Series::line(field_name(system, height, tan), curve, Colour::Palette(i)).dashed(dash));
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

/// PSF of the field point at `tan` in a window of at most [`MAX_HALF`] samples at 0.9 of the Nyquist pitch.
fn psf(system: &System, um: f64, tan: f64) -> Result<PsfWindow, DesignError> {
    let tracer = Tracer::new(system, um)?;
    let f = PupilFunction::trace(&tracer, tan)?;
    let grid = PsfGrid::new(MAX_HALF, 0.9 * f.nyquist_um());
    let samples = grid.psf(&f, 0.0, &mut PsfScratch::default());
    let energy: f64 = samples.iter().sum();
    Ok(PsfWindow {
        size: grid.size(),
        pitch_um: grid.pitch_um(),
        sample: PsfSample::Point,
        energy,
        samples: samples.iter().map(|v| (v / energy) as f32).collect(),
    })
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
    let n = psf.size;
    let at = |i: usize| (i as f64 - (n / 2) as f64) * psf.pitch_um;
    let values = || psf.samples.iter().enumerate().map(|(i, v)| (at(i % n), at(i / n), f64::from(*v)));
    let sum: f64 = values().map(|v| v.2).sum();
    let (cx, cy) = values().fold((0.0, 0.0), |c, (x, y, v)| (c.0 + x * v / sum, c.1 + y * v / sum));
    // Radii up to the edge of the window; rings of one sample.
    let rings = n / 2;
    let mut light = vec![0.0; rings + 1];
    for (x, y, v) in values() {
        let ring = ((x - cx).hypot(y - cy) / psf.pitch_um).ceil() as usize;
        if ring <= rings {
            light[ring] += v / sum;
        }
    }
    let mut inside = 0.0;
    let curve = light.iter().enumerate().map(|(i, v)| {
        inside += v;
        (i as f64 * psf.pitch_um, inside * psf.energy)
    });
    curve.collect()
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
    fn encircled_energy_of_a_point_is_all_of_its_light() {
        let mut samples = vec![0.0; 121];
        samples[60] = 1.0;
        let psf = PsfWindow { size: 11, pitch_um: 2.0, sample: PsfSample::Point, energy: 0.9, samples };
        let curve = encircled(&psf);
        assert_eq!(curve[0], (0.0, 0.9));
        assert_eq!(curve.last(), Some(&(10.0, 0.9)));
    }
}
