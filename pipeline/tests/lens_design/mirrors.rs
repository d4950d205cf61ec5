//! The pupil and PSF of an obscured lens compared with closed forms.

use std::f64::consts::PI;

use crate::design_cases::{bessel_j1_over_x, system};
use lenscube_pipeline::design::glass::{Dispersion, Glass};
use lenscube_pipeline::design::illumination::numerical_aperture;
use lenscube_pipeline::design::psf::{PsfGrid, PsfScratch, PupilFunction};
use lenscube_pipeline::design::pupil::Pupil;
use lenscube_pipeline::design::ray::Tracer;
use lenscube_pipeline::design::shape::Shape;
use lenscube_pipeline::design::system::{Medium, Surface};

/// A disc of radius 3 at 20 mm before a stop of radius 5: the open area is that of the stop less the overlap of the two discs.
#[test]
fn open_area_behind_a_disc_is_that_of_overlapping_circles() {
    let mut disc = Surface::new(0.0, 20.0, Medium::Air);
    disc.obscuration_mm = Some(3.0);
    let plane = |t| Surface::new(0.0, t, Medium::Air);
    let system = system(vec![disc, plane(50.0), plane(0.0)], 1, 10.0);
    let tracer = Tracer::new(&system, 0.55).unwrap();
    for tan in [0.0, 0.05, 0.15, 0.25, 0.35, 0.5] {
        let (stop, hidden, d): (f64, f64, f64) = (5.0, 3.0, 20.0 * tan);
        let overlap = if d >= stop + hidden {
            0.0
        } else if d <= stop - hidden {
            PI * hidden * hidden
        } else {
            let angle = |r: f64, s: f64| ((d * d + r * r - s * s) / (2.0 * d * r)).acos();
            let root = (stop + hidden - d) * (d + stop - hidden) * (d - stop + hidden) * (d + stop + hidden);
            stop * stop * angle(stop, hidden) + hidden * hidden * angle(hidden, stop) - 0.5 * root.sqrt()
        };
        let nodes = Pupil::new(&tracer, tan).unwrap().nodes(&tracer, tan, 7, 9);
        let area = 2.0 * stop * stop * nodes.iter().map(|n| n.weight).sum::<f64>();
        let expected = PI * stop * stop - overlap;
        assert!((area / expected - 1.0).abs() < 1e-6, "tan {tan}: {area} against {expected}");
    }
}

/// PSF of an annulus of inner radius ε: (2 J₁(x)/x − ε² 2 J₁(εx)/(εx))² of the open lens's peak (Born & Wolf, 8.6.2).
#[test]
fn obscured_lens_gives_the_pattern_of_an_annulus() {
    let (n, f, hidden): (f64, f64, f64) = (1.5, 100.0, 0.4);
    let glass = Glass::new("n".to_owned(), Dispersion::constant(n), (0.0, 9.0));
    let mut front = Surface::new(0.0, 2.0, Medium::Glass(glass));
    front.obscuration_mm = Some(0.5 * hidden);
    let mut back = Surface::new(0.0, f, Medium::Air);
    back.shape = Shape { curvature: -1.0 / ((n - 1.0) * f), conic: -n * n, ..Shape::default() };
    let system = system(vec![front, back, Surface::new(0.0, 0.0, Medium::Air)], 0, 1.0);
    let tracer = Tracer::new(&system, 0.55).unwrap();
    let pupil = PupilFunction::trace(&tracer, 0.0).unwrap();
    let (half, pitch) = (40, 7.0);
    let psf = PsfGrid::new(half, pitch).psf(&pupil, 0.0, &mut PsfScratch::default());
    let na = numerical_aperture(&tracer).unwrap();
    let size = 2 * half + 1;
    // Peak as a share of the energy of the annulus.
    let peak = PI * (na / 0.55).powi(2) * (1.0 - hidden * hidden) * pitch * pitch;
    let mut worst = 0.0_f64;
    for (i, v) in psf.iter().enumerate() {
        let at = |i: usize| (i as f64 - half as f64) * pitch;
        let x = 2.0 * PI / 0.55 * na * at(i % size).hypot(at(i / size));
        let amplitude = 2.0 * bessel_j1_over_x(x) - hidden * hidden * 2.0 * bessel_j1_over_x(hidden * x);
        let expected = (amplitude / (1.0 - hidden * hidden)).powi(2);
        worst = worst.max((v / peak - expected).abs());
    }
    assert!(worst < 1e-4, "{worst:.2e} of the peak");
}
