//! Lenses whose pupils have no rim beside the stop's, one, four, or an obscuration: the built-in ones of these names (`formats/data/lenses`), z along the light.

use crate::design::prescription::model_glass::model_glass;
use crate::design::prescription::system::{Aperture, FieldKind, Medium, RayAiming, Surface, System};

/// Radius [mm] (0: a plane), thickness [mm], n_d, V_d (0: air), radius of the aperture [mm] (0: none).
type Row = [f64; 5];

/// Index of a surface, conic constant, coefficients of r⁴, r⁶, ….
type Asphere = (usize, f64, &'static [f64]);

const PHONE: [Row; 9] = [
    [0.0, 0.0, 0.0, 0.0, 0.0],
    [1.697, 0.9, 1.583, 59.3, 0.0],
    [-5.574, 0.343, 0.0, 0.0, 0.0],
    [-1.065, 0.65, 1.607, 27.0, 0.0],
    [-1.775, 0.736, 0.0, 0.0, 0.0],
    [4.4974, 0.15, 1.59, 34.3, 0.0],
    [0.0, 0.5, 1.474, 57.4, 0.0],
    [0.0, 0.15, 1.59, 34.3, 0.0],
    [2.143, 1.0292128, 0.0, 0.0, 0.0],
];
const PHONE_ASPHERES: [Asphere; 6] = [
    (1, -0.16132, &[-0.017182, -0.089244, 0.15951, -0.27251]),
    (2, 13.535, &[-0.17118, -0.054342, -0.052823, 0.026838]),
    (3, -0.088079, &[-0.063767, 0.18842, 0.45494, -0.98966, 0.6396]),
    (4, -3.3173, &[-0.048706, 0.22102, 0.022309, -0.020482, -0.0071305]),
    (5, -50.898, &[-0.1675, 0.12213, -0.061047, 0.019002, -0.0023685]),
    (8, -12.606, &[-0.090167, 0.037505, -0.012061, 0.0018675, -9.6805e-5]),
];

const MIRRORLESS_50: [Row; 12] = [
    [28.621, 4.2, 1.83481, 42.7, 15.0],
    [68.136, 0.18, 0.0, 0.0, 14.24],
    [17.772, 6.7, 1.79952, 42.2, 12.0],
    [59.525, 1.1, 1.80518, 25.4, 10.35],
    [11.427, 5.27, 0.0, 0.0, 8.36],
    [0.0, 6.2, 0.0, 0.0, 8.12],
    [-16.726, 0.9, 1.6727, 32.1, 7.5],
    [-29.829, 0.83, 0.0, 0.0, 7.73],
    [-25.0, 2.95, 1.5311, 55.9, 7.76],
    [-18.373, 0.98, 0.0, 0.0, 9.7],
    [280.004, 4.6, 1.734, 51.5, 12.23],
    [-34.002, 25.6244, 0.0, 0.0, 12.85],
];
const MIRRORLESS_50_ASPHERES: [Asphere; 2] = [
    (8, 0.0, &[-4.12032e-5, -2.90015e-7, -4.67119e-9, 7.90646e-11, -9.2847e-13]),
    (9, 0.0, &[-2.41619e-5, -3.29146e-7, 1.91098e-10, -9.28593e-13, -2.29193e-13]),
];

const MACRO_70: [Row; 20] = [
    [369.55, 1.8, 1.54072, 47.2, 19.21],
    [34.98, 13.45, 0.0, 0.0, 18.0],
    [46.16, 5.65, 1.7725, 49.6, 16.5],
    [-135.9, 0.15, 0.0, 0.0, 16.5],
    [31.73, 3.5, 1.6968, 55.5, 14.4],
    [69.5, 5.79, 0.0, 0.0, 14.4],
    [1000.0, 1.0, 1.60342, 38.0, 15.0],
    [22.74, 12.1, 0.0, 0.0, 13.5],
    [0.0, 4.2, 0.0, 0.0, 10.5],
    [-27.01, 1.0, 1.58144, 40.9, 11.2],
    [101.88, 4.7, 1.56045, 71.6, 12.5],
    [-35.28, 1.85, 0.0, 0.0, 12.5],
    [1000.0, 3.05, 1.56045, 71.6, 13.0],
    [-53.2, 0.15, 0.0, 0.0, 13.0],
    [125.46, 3.0, 1.497, 81.6, 13.3],
    [-89.7, 1.5, 0.0, 0.0, 13.3],
    [0.0, 1.2, 1.64, 60.2, 14.4],
    [52.82, 2.6, 0.0, 0.0, 13.0],
    [931.0, 2.35, 1.83481, 42.7, 15.0],
    [-113.6, 55.816, 0.0, 0.0, 15.0],
];

const MIRROR_500: [Row; 15] = [
    [587.0, 10.0, 1.5168, 64.12, 0.0],
    [-587.3, 2.5, 0.0, 0.0, 0.0],
    [0.0, 53.5, 0.0, 0.0, 0.0],
    [-116.666, 13.7, 1.5168, 64.12, 0.0],
    [-192.743, 13.7, 1.5168, 64.12, 0.0],
    [116.666, 48.5, 0.0, 0.0, 0.0],
    [58.093, 5.0, 1.5168, 64.12, 0.0],
    [99.328, 5.0, 1.5168, 64.12, 0.0],
    [-58.093, 41.5, 0.0, 0.0, 0.0],
    [10206.648, 3.0, 1.5168, 64.12, 0.0],
    [25.338, 7.5, 0.0, 0.0, 0.0],
    [-29.45, 4.5, 1.51823, 58.96, 0.0],
    [-41.602, 0.5, 0.0, 0.0, 0.0],
    [41.434, 5.0, 1.79631, 40.96, 0.0],
    [66.948, 63.216, 0.0, 0.0, 0.0],
];

/// The lens of that name.
pub(in crate::design) fn lens(name: &str) -> System {
    let (rows, aspheres, stop, aperture): (&[Row], &[Asphere], _, _) = match name {
        "phone" => (&PHONE, &PHONE_ASPHERES, 0, Aperture::EntrancePupil(1.30312)),
        "mirrorless-50" => (&MIRRORLESS_50, &MIRRORLESS_50_ASPHERES, 5, Aperture::StopRadius(8.12)),
        "macro-70" => (&MACRO_70, &[], 8, Aperture::StopRadius(10.5)),
        "mirror-500" => (&MIRROR_500, &[], 0, Aperture::EntrancePupil(74.55)),
        other => panic!("no lens {other}"),
    };
    let mut surfaces: Vec<Surface> = rows.iter().map(surface).collect();
    for (i, conic, coefficients) in aspheres {
        surfaces[*i].shape.conic = *conic;
        surfaces[*i].shape.aspheric = [&[0.0], *coefficients].concat();
    }
    if name == "mirror-500" {
        for (i, obscuration_mm) in [(2, 20.5), (4, 18.0)] {
            surfaces[i].obscuration_mm = Some(obscuration_mm);
        }
        (surfaces[4].is_mirror, surfaces[7].is_mirror) = (true, true);
    }
    surfaces.push(Surface::new(0.0, 0.0, Medium::Air));
    System {
        name: name.to_owned(),
        object_distance_mm: None,
        is_telecentric: false,
        surfaces,
        stop,
        aperture,
        field_kind: FieldKind::Angle,
        fields: vec![0.0],
        wavelengths_um: vec![(0.587_561_8, 1.0)],
        primary: 0,
        aiming: RayAiming::Real,
        notes: Vec::new(),
        asymmetry: None,
    }
}

fn surface([radius_mm, thickness_mm, n_d, v_d, aperture_mm]: &Row) -> Surface {
    let medium = match *v_d {
        0.0 => Medium::Air,
        _ => Medium::Glass(model_glass("model", *n_d, *v_d, 0.0).unwrap()),
    };
    let curvature = if *radius_mm == 0.0 { 0.0 } else { 1.0 / radius_mm };
    let aperture_mm = Some(*aperture_mm).filter(|mm| *mm > 0.0);
    Surface { aperture_mm, ..Surface::new(curvature, *thickness_mm, medium) }
}
