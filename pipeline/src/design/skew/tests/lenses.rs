//! Lenses of the tests.

use std::f64::consts::PI;

use crate::design::prescription::glass::{Dispersion, Glass};
use crate::design::prescription::system::{Aperture, Medium, RayAiming, Surface, System};
use crate::design::skew::deviation::Deviation;

/// The wavelength of the model's tests, µm.
pub(in crate::design::skew) const UM: f64 = 0.587_561_8;

pub(in crate::design::skew) const ARCMIN: f64 = PI / 180.0 / 60.0;

/// The rear doublet of the Double Gauss, and its last singlet.
pub(in crate::design::skew) const REAR: [usize; 2] = [6, 8];
pub(in crate::design::skew) const LAST: [usize; 2] = [9, 10];

/// The Double Gauss with the primary wavelength of the model.
pub(in crate::design::skew) fn double_gauss(aiming: RayAiming) -> System {
    System { aiming, wavelengths_um: vec![(UM, 1.0)], primary: 0, ..System::double_gauss_28() }
}

/// Surfaces of (curvature, thickness, index behind) and a film, the stop at `stop`, the entrance pupil of radius `radius_mm`.
pub(in crate::design::skew) fn lens(rows: &[(f64, f64, f64)], stop: usize, radius_mm: f64) -> System {
    let surface = |&(curvature, thickness, n): &(f64, f64, f64)| {
        let glass = || Glass::new("n".to_owned(), Dispersion::constant(n), (0.0, 9.0));
        Surface::new(curvature, thickness, if n == 1.0 { Medium::Air } else { Medium::Glass(glass()) })
    };
    let mut surfaces: Vec<Surface> = rows.iter().map(surface).collect();
    surfaces.push(Surface::new(0.0, 0.0, Medium::Air));
    System {
        surfaces,
        stop,
        aperture: Aperture::EntrancePupil(2.0 * radius_mm),
        ..double_gauss(RayAiming::Real)
    }
}

/// Surfaces that are decentred along x and y and tilted about x and y, about the first vertex.
pub(in crate::design::skew) fn moved(
    surfaces: [usize; 2],
    decentre_mm: [f64; 2],
    [tx, ty]: [f64; 2],
) -> Deviation {
    Deviation::element(surfaces[0], surfaces[1], decentre_mm, [tx, ty, 0.0])
}

/// The film, tilted.
pub(in crate::design::skew) fn film(tilt_rad: [f64; 2]) -> Deviation {
    Deviation::Film { decentre_mm: [0.0; 2], tilt_rad, shift_mm: 0.0 }
}

/// `ERRORS` of the model's tests.
pub(in crate::design::skew) fn few_errors() -> Vec<Deviation> {
    vec![
        moved(REAR, [0.05, 0.0], [0.0, 2.0 * ARCMIN]),
        moved([4, 4], [0.0; 2], [ARCMIN, 0.0]),
        film([0.0, 5.0 * ARCMIN]),
    ]
}

/// Built lens 0 of the model: drawn(1, 0, "element 1-2/decentre_x", -0.02, 0.02, "normal") etc., wedges and tilts within 1', film
/// 3'.
pub(in crate::design::skew) fn lens_0() -> Vec<Deviation> {
    let element = |surfaces, [dx, dy, tx, ty, wx, wy]: [f64; 6]| Deviation::Element {
        surfaces,
        decentre_mm: [dx, dy],
        tilt_rad: [tx, ty, 0.0],
        wedge_rad: [wx, wy],
        shift_mm: 0.0,
        pivot: None,
    };
    let gap = |after, thickness_mm| Deviation::Gap { after, thickness_mm, absorb: None };
    let first = [
        -0.006541132937508693,
        0.012091038223415276,
        0.00021641661974770342,
        0.00010280892539889603,
        0.00017319408480666844,
        0.0002094754969056524,
    ];
    let second = [
        0.005141216384725941,
        -0.012145854151378366,
        8.26630373585459e-05,
        3.4026025618202905e-06,
        -1.7581890854095973e-05,
        0.0002891153373162722,
    ];
    let third = [
        -0.005096478809657736,
        0.005514150868204674,
        -9.996645715292635e-05,
        -3.501412041861208e-05,
        0.00018568528951814716,
        -8.811013620878924e-05,
    ];
    let fourth = [
        0.014888377351852822,
        -0.016186115011628085,
        0.00017580397657222018,
        -0.0001386665360494698,
        4.830397570811446e-05,
        -2.1057066038911276e-05,
    ];
    vec![
        element([0, 1], first),
        element([2, 4], second),
        element(REAR, third),
        element(LAST, fourth),
        gap(1, 0.00676217812869991),
        gap(4, 0.013218538781320562),
        gap(8, 0.0074209086727863695),
        film([-0.00021229929043374928, 0.000635314653888372]),
    ]
}
