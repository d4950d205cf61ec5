//! Light is conserved: the power that passes the entrance pupil, less what coatings and glasses take, is the power on the film.
//!
//!     P = ∫ F(t) dA_object,  F = ∫∫ flux dp dq over the open pupil      against      ∫ G(0) R(h) 2π h dh over the film
//! for an object of radiance 1. The left side integrates chords of the pupil over the object side alone, without chief-ray heights; the
//! right side the tables of a traced band.

use std::f64::consts::PI;

use lenscube_pipeline::design::System;
use lenscube_pipeline::design::coating::{Coating, Spectrum};
use lenscube_pipeline::design::coatings::Coatings;
use lenscube_pipeline::design::glass::{Dispersion, Glass};
use lenscube_pipeline::design::illumination::irradiance_sr;
use lenscube_pipeline::design::quadrature::unit_interval;
use lenscube_pipeline::design::ray::Tracer;
use lenscube_pipeline::design::system::{Aperture, FieldKind, Medium, RayAiming, Surface};
use lenscube_pipeline::design::trace::{Azimuths, LensTrace, PsfHeights, TraceOptions};

fn glass(n: f64) -> Medium {
    if n == 1.0 {
        return Medium::Air;
    }
    Medium::Glass(Glass::new("n".to_owned(), Dispersion::constant(n), (0.0, 9.0)))
}

/// Surfaces as (radius or 0, thickness, index, clear radius or 0).
fn lens(rows: &[(f64, f64, f64, f64)], stop: usize, aperture: Aperture, object: Option<f64>) -> System {
    let surface = |&(radius, thickness, n, clear): &(f64, f64, f64, f64)| {
        let mut s = Surface::new(if radius == 0.0 { 0.0 } else { 1.0 / radius }, thickness, glass(n));
        s.aperture_mm = Some(clear).filter(|c| *c > 0.0);
        s
    };
    let mut surfaces: Vec<Surface> = rows.iter().map(surface).collect();
    surfaces.push(Surface::new(0.0, 0.0, Medium::Air));
    System {
        name: "lens".to_owned(),
        object_distance_mm: object,
        is_telecentric: false,
        surfaces,
        stop,
        aperture,
        field_kind: FieldKind::Angle,
        fields: vec![0.0],
        wavelengths_um: vec![(0.55, 1.0)],
        primary: 0,
        aiming: RayAiming::Real,
        notes: Vec::new(),
        asymmetry: None,
    }
}

/// Cooke triplet, 50 mm F/5.
fn triplet(front: f64) -> System {
    let rows = [
        (22.01359, 3.25896, 1.620, front),
        (-435.76044, 6.00755, 1.0, 0.0),
        (-22.21328, 0.99998, 1.620, 0.0),
        (20.29192, 4.75041, 1.0, 0.0),
        (79.68360, 2.95208, 1.620, 0.0),
        (-18.39533, 42.20778, 1.0, 0.0),
    ];
    lens(&rows, 3, Aperture::EntrancePupil(10.0), None)
}

/// Flux of the field point per unit of its object-side area element, by chords of the pupil.
fn power(tracer: &Tracer<'_>, tan: f64) -> f64 {
    let open = |p: f64, q: f64| tracer.passes(tan, p, q);
    let across = unit_interval(9);
    let rows = 160;
    let mut sum = 0.0;
    for i in 0..rows {
        // q = sin φ: the rows of a round pupil end smoothly.
        let (q, width) = (PI * (f64::from(i) + 0.5) / f64::from(2 * rows)).sin_cos();
        let inside: Vec<f64> =
            (0..=64).map(|k| width * (f64::from(k) / 32.0 - 1.0)).filter(|p| open(*p, q)).collect();
        let (Some(first), Some(last)) = (inside.first(), inside.last()) else { continue };
        let end = |from: f64, to: f64| {
            if open(to, q) {
                return to;
            }
            let (mut a, mut b) = (from, to);
            for _ in 0..40 {
                let middle = 0.5 * (a + b);
                if open(middle, q) { a = middle } else { b = middle }
            }
            a
        };
        let (low, high) = (end(*first, -width), end(*last, width));
        let chord: f64 =
            across.iter().map(|(u, w)| w * tracer.ray(tan, low + (high - low) * u, q).unwrap().flux).sum();
        sum += 2.0 * chord * (high - low) * width * PI / f64::from(2 * rows);
    }
    sum
}

fn check(name: &str, system: &System, height_mm: f64) {
    let mut options = TraceOptions::new(vec![550.0], height_mm);
    options.heights = PsfHeights::Given(vec![0.0, height_mm]);
    options.azimuths = Azimuths::Given(4);
    options.window_px = Some(3);
    let band = LensTrace::new(system, &options).unwrap().band(0, &mut |_| ()).unwrap().tables;
    let h = &band.image_height_mm;
    let film: f64 = (1..h.len())
        .map(|i| {
            let mean = 0.5 * (band.relative_illumination[i] + band.relative_illumination[i - 1]);
            PI * (h[i] * h[i] - h[i - 1] * h[i - 1]) * mean * band.solid_angle_sr * band.transmission
        })
        .sum();
    let tracer = Tracer::new(system, 0.55).unwrap();
    let last = tracer.field_of_height(height_mm).unwrap();
    let object: f64 = unit_interval(24)
        .iter()
        .map(|(u, w)| {
            let tan = last * u;
            let element = match system.object_distance_mm {
                None => (1.0 + tan * tan).powi(-2),
                Some(distance) => (distance + tracer.primary.entrance_pupil_mm).powi(2),
            };
            w * last * 2.0 * PI * tan * element * power(&tracer, tan)
        })
        .sum();
    println!("{name}: entrance {object:.6}, film {film:.6}, ratio - 1 = {:.1e}", film / object - 1.0);
    assert!((film / object - 1.0).abs() < 1e-4, "{name}: {film} against {object}");
}

#[test]
fn power_through_the_entrance_pupil_is_the_power_on_the_film() {
    check("Double Gauss, paraxial aiming", &System::double_gauss_28(), 24.5);
    check("triplet", &triplet(0.0), 17.0);
    check("triplet with vignetting", &triplet(7.0), 17.0);
    // Biconvex, far out of focus at the edge: here the solid angle at the film is 1.4 times too large.
    let singlet = [(0.0, 5.0, 1.0, 0.0), (50.0, 4.0, 1.5, 0.0), (-50.0, 48.0, 1.0, 0.0)];
    check("singlet", &lens(&singlet, 0, Aperture::EntrancePupil(8.0), None), 20.0);
    let macro_lens = [
        (60.0, 5.0, 1.6, 0.0),
        (-60.0, 3.0, 1.0, 0.0),
        (0.0, 3.0, 1.0, 0.0),
        (60.0, 5.0, 1.6, 0.0),
        (-60.0, 45.0, 1.0, 0.0),
    ];
    check("two lenses at 1:1", &lens(&macro_lens, 2, Aperture::EntrancePupil(8.0), Some(45.0)), 8.0);
}

fn coated(system: System, default: Coating) -> System {
    system.with_coatings(&Coatings { default, surfaces: Vec::new() }).unwrap()
}

fn without_absorption(mut system: System) -> System {
    for s in &mut system.surfaces {
        if let Medium::Glass(glass) = &mut s.medium {
            glass.absorption = None;
        }
    }
    system
}

/// Reflections and absorption take the same from both sides; the losses depend on field and pupil.
#[test]
fn power_that_is_left_behind_the_coatings_is_the_power_on_the_film() {
    let mgf2 = || Coating::quarter_wave("MgF2", 1.38, 0.55);
    check("Double Gauss, bare", &coated(System::double_gauss_28(), Coating::Bare), 24.5);
    check("triplet, quarter wave, vignetting", &coated(triplet(7.0), mgf2()), 17.0);
}

/// Means over the axial pupil of the Double Gauss without absorption: figures of a NumPy tracer with polarisation along each ray.
#[test]
fn transmission_of_the_double_gauss() {
    let reflecting =
        |r: f64| Coating::Reflectance(Spectrum { name: "r".to_owned(), entries: vec![(0.55, r)] });
    let mgf2 = || Coating::quarter_wave("MgF2", 1.38, 0.55);
    for (coating, um, expected) in [
        (Coating::Bare, 0.55, 0.633_766),
        (reflecting(0.002), 0.55, 0.984_064),
        (mgf2(), 0.40, 0.841_766),
        (mgf2(), 0.45, 0.910_004),
        (mgf2(), 0.55, 0.946_699),
        (mgf2(), 0.70, 0.900_239),
    ] {
        let lens = without_absorption(coated(System::double_gauss_28(), coating.clone()));
        let tracer = Tracer::new(&lens, um).unwrap();
        let light = |t: &Tracer<'_>| irradiance_sr(t, 0.0).unwrap();
        let transmission = light(&tracer) / light(&tracer.without_losses());
        assert!((transmission - expected).abs() < 1e-5, "{coating:?} at {um}: {transmission}");
    }
    // The glasses take 1 % in the green and 5 % at 400 nm: the axial path by the built-in table.
    for (um, expected) in [(0.4, 0.9515), (0.45, 0.9694), (0.55, 0.9892), (0.7, 0.9923)] {
        let lens = coated(System::double_gauss_28(), reflecting(0.0));
        let tracer = Tracer::new(&lens, um).unwrap();
        let flux = |t: &Tracer<'_>| t.ray(0.0, 0.0, 0.0).unwrap().flux;
        // The cements reflect.
        let without = without_absorption(lens.clone());
        let axial = flux(&tracer) / flux(&Tracer::new(&without, um).unwrap());
        assert!((axial - expected).abs() < 2e-4, "{um}: {axial}");
    }
}
