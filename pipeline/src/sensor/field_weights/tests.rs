//! Weights over a sensor against the float64 model (tests/golden/sensor/make_angles_golden.py), which sums over directions and wavelengths at each pixel.

use super::*;
use crate::lens::cone::{Cone, ConeTable};
use crate::lens::cone_field::ConeGrid;
use crate::real;
use crate::sensor::angle::{
    Acceptance, AngularResponse, Microlenses, Plate, PlateKind, Response, SlopeTable, radians, slope,
};
use crate::sensor::response_map::ResponseMap;
use crate::sensor::{Channel, Curve, Pattern, Sensor};

const BANDS_NM: [f64; 4] = [500.0, 600.0, 640.0, 660.0];
const PLACEMENT: Placement =
    Placement { size: Size { height: 60, width: 80 }, pitch_mm: 0.1, centre_mm: (1.0, 2.0) };

fn sensor(angle: Option<AngularResponse>, plates: Vec<Plate>) -> Sensor {
    let channel = |name: &str, values: [f64; 2]| Channel {
        name: name.into(),
        plane: name.into(),
        curve: Curve { wavelengths_nm: vec![400.0, 700.0], values: values.to_vec() },
    };
    Sensor {
        channels: vec![channel("A", [0.3, 0.7]), channel("B", [0.8, 0.2])],
        pattern: Pattern { rows: 1, columns: 2, channels: vec![0, 1] },
        angle,
        plates,
        ..crate::sensor::noise::tests::example()
    }
}

fn cones() -> Vec<ConeField> {
    let cone = |h: f64| Cone {
        chief: 0.05 * h - 2e-4 * h * h * h,
        centre: 0.048 * h,
        tangential: 0.2 - 1e-3 * h * h,
        sagittal: 0.2 - 5e-4 * h * h,
    };
    let table = ConeTable::new(0.25, (0..41).map(|k| cone(0.25 * f64::from(k))).collect());
    vec![ConeField::Symmetric(table); BANDS_NM.len()]
}

fn sine(degrees: f64) -> f64 {
    real::sin(radians(degrees))
}

fn edge() -> Plate {
    Plate {
        curve: Curve { wavelengths_nm: vec![400.0, 630.0, 660.0, 700.0], values: vec![0.9, 0.9, 0.05, 0.0] },
        kind: PlateKind::Interference,
        index: 1.8,
    }
}

fn case(name: &str) -> Sensor {
    let model = |degrees: f64, half_exponent| -> Acceptance {
        Response::Model { half_slope: slope(sine(degrees), 1.5), half_exponent }.into()
    };
    match name {
        "model" => {
            let channels = vec![model(25.0, 1), model(18.0, 2)];
            let angle = AngularResponse { stack_index: 1.5, microlenses: Microlenses::Centred, channels };
            sensor(Some(angle), vec![])
        }
        "spectral" => {
            let sines: Vec<f64> = (0..=10).map(|k| sine(4.0 * f64::from(k))).collect();
            let table = |half_deg: f64| {
                let of = |s: &f64| {
                    real::exp(-std::f64::consts::LN_2 * (s / sine(half_deg)) * (s / sine(half_deg)))
                };
                Response::Radial(SlopeTable::new(&sines, &sines.iter().map(of).collect::<Vec<_>>(), 1.5))
            };
            let of = |degrees: [f64; 3]| {
                let wavelengths_nm = vec![520.0, 610.0, 650.0];
                Acceptance { wavelengths_nm, responses: degrees.map(table).to_vec() }
            };
            let channels = vec![of([30.0, 22.0, 15.0]), of([15.0, 25.0, 40.0])];
            let angle = AngularResponse { stack_index: 1.5, microlenses: Microlenses::Centred, channels };
            sensor(Some(angle), vec![edge()])
        }
        "plates" => {
            let curve = Curve { wavelengths_nm: vec![400.0, 550.0, 700.0], values: vec![0.95, 0.9, 0.3] };
            let glass = Plate { curve, kind: PlateKind::Absorbing, index: 1.52 };
            sensor(None, vec![edge(), glass])
        }
        _ => {
            let sines: Vec<f64> = (-4..=4).map(|k| sine(10.0 * f64::from(k))).collect();
            let table = |values: [f64; 9]| SlopeTable::new(&sines, &values, 1.4);
            let separable = Acceptance::from(Response::Separable {
                horizontal: table([0.2, 0.4, 0.7, 0.95, 1.25, 1.2, 0.8, 0.5, 0.3]),
                vertical: table([0.1, 0.3, 0.6, 0.9, 1.0, 0.85, 0.6, 0.35, 0.15]),
            });
            let shifts = [(0.0, 0.0), (4.0, 10.0), (8.0, 16.0)];
            let angle = AngularResponse {
                stack_index: 1.4,
                microlenses: Microlenses::Table(shifts.map(|(h, degrees)| (h, sine(degrees))).to_vec()),
                channels: vec![separable.clone(), separable],
            };
            sensor(Some(angle), vec![edge()])
        }
    }
}

fn weights(sensor: &Sensor, threads: usize) -> FieldWeights {
    FieldWeights::new(sensor, (&BANDS_NM, &[1.0; 4]), &cones(), &PLACEMENT, threads)
}

#[test]
fn weights_equal_the_f64_model() {
    let golden = include_str!("../../../tests/data/angles.csv");
    // A table whose angles are 10 degrees apart has kinks, which the rule over directions blunts.
    for (name, tolerance) in [("model", 2e-6), ("plates", 3e-6), ("table", 1.5e-3), ("spectral", 2e-4)] {
        let sensor = case(name);
        let field = weights(&sensor, 2);
        let mut count = 0;
        for line in golden.lines().filter(|line| line.starts_with(&format!("{name},"))) {
            let cells: Vec<&str> = line.split(',').collect();
            let number = |k: usize| cells[k].parse::<f64>().unwrap();
            let channel = usize::from(cells[1] == "B");
            let band = BANDS_NM.iter().position(|nm| *nm == number(2)).unwrap();
            let normal = sensor.band_weights(channel, &BANDS_NM)[band] * sensor.area_m2();
            let found = 1.0 + field.difference_at((channel, band), number(3) + 0.5, number(4) + 0.5) / normal;
            assert!((found - number(5)).abs() < tolerance, "{line}: {found}");
            count += 1;
        }
        assert_eq!(count, 64, "{name}");
    }
}

#[test]
fn a_response_of_one_changes_no_bit_and_threads_change_none() {
    let flat = SlopeTable::new(&[0.0, 0.9], &[0.7, 0.7], 1.5);
    let radial = Response::Radial(flat);
    let spectral = Acceptance { wavelengths_nm: vec![510.0, 640.0], responses: vec![radial.clone(); 2] };
    let angle = AngularResponse {
        stack_index: 1.5,
        microlenses: Microlenses::OfLens,
        channels: vec![radial.into(), spectral],
    };
    let field = weights(&sensor(Some(angle), vec![]), 1);
    assert!(field.differences.iter().flatten().flatten().all(|v| *v == 0.0));
    let case = case("table");
    assert_eq!(weights(&case, 1), weights(&case, 3));
}

/// The same cones over the film: their root in the axes of the film has other elements than half axes.
#[test]
fn cones_over_the_film_have_the_weights_of_the_same_cones_over_the_height() {
    let places = |centre: f64, half: f64| -> Vec<f64> {
        (0..49).map(|k| centre + half * (f64::from(k) / 24.0 - 1.0)).collect()
    };
    let (x_mm, y_mm) = (places(PLACEMENT.centre_mm.1, 4.0), places(PLACEMENT.centre_mm.0, 3.0));
    let of = |field: &ConeField| {
        let cone = |x: f64, y: f64| {
            let height_mm = (x * x + y * y).sqrt();
            let away = if height_mm > 0.0 { [x / height_mm, y / height_mm] } else { [1.0, 0.0] };
            let cone = field.at([x, y], (height_mm, away));
            let [a, _, c] = cone.root;
            let [u, v] = [cone.on_film([a, 0.0]), cone.on_film([0.0, c])];
            let [xx, xy, yy] = [[0, 0], [0, 1], [1, 1]].map(|[i, j]| u[i] * u[j] + v[i] * v[j]);
            let ([cx, cy], [mx, my]) = (cone.on_film(cone.chief), cone.on_film(cone.centre));
            [cx, cy, mx, my, xx.sqrt(), xy / xx.sqrt(), (yy - xy * xy / xx).sqrt()]
        };
        let all = y_mm.iter().flat_map(|y| x_mm.iter().map(|x| cone(*x, *y))).collect();
        ConeField::Planar(ConeGrid::new(x_mm.clone(), y_mm.clone(), all).unwrap())
    };
    let planar: Vec<ConeField> = cones().iter().map(of).collect();
    let with_table = case("table").angle.unwrap();
    let of_lens = AngularResponse { microlenses: Microlenses::OfLens, ..with_table.clone() };
    for (sensor, tolerance) in [
        (case("model"), 1e-6),
        (case("plates"), 1e-6),
        // The nodes of the disc lie on other sides of a table's kinks.
        (sensor(Some(with_table), vec![edge()]), 3e-3),
        (sensor(Some(of_lens), vec![edge()]), 3e-3),
    ] {
        let of =
            |cones: &[ConeField]| FieldWeights::new(&sensor, (&BANDS_NM, &[1.0; 4]), cones, &PLACEMENT, 2);
        let (found, expected) = (of(&planar), of(&cones()));
        let normal = sensor.band_weights(0, &BANDS_NM)[1] * sensor.area_m2();
        for (y, x) in [(0.5, 0.5), (59.5, 79.5), (20.5, 31.5), (44.5, 3.5)] {
            let [found, expected] = [&found, &expected].map(|of| of.difference_at((0, 1), y, x) / normal);
            assert!((found - expected).abs() < tolerance, "{y} {x}: {found} {expected}");
        }
    }
}

#[test]
fn microlenses_shifted_for_the_lens_leave_half_of_the_shading_or_less() {
    let of = |microlenses| {
        let half_slope = slope(sine(25.0), 1.5);
        let channels = vec![Response::Model { half_slope, half_exponent: 1 }.into(); 2];
        let sensor = sensor(Some(AngularResponse { stack_index: 1.5, microlenses, channels }), vec![]);
        let normal = sensor.band_weights(0, &BANDS_NM)[1] * sensor.area_m2();
        let field = weights(&sensor, 2);
        let at = |row: f64, column: f64| 1.0 + field.difference_at((0, 1), row, column) / normal;
        // The pixel on the axis, and the farthest corner.
        at(59.5, 79.5) / at(19.5, 19.5)
    };
    let (centred, matched) = (of(Microlenses::Centred), of(Microlenses::OfLens));
    assert!(centred < 0.75, "{centred}");
    assert!(matched > 0.98 && matched < 1.1, "{matched}");
}

#[test]
fn response_map_is_the_share_of_the_light_of_all_bands() {
    let sensor = case("model");
    let field = weights(&sensor, 2);
    let map = ResponseMap::new(&sensor, PLACEMENT.size, &field, (&BANDS_NM, &[1.0; 4]));
    assert_eq!((map.cells, map.filters.len(), map.filters[0].len()), ((24, 32), 2, 25 * 33));
    for (row, column) in [(0, 0), (30, 41), (59, 79), (7, 66)] {
        let normal = sensor.band_weights(1, &BANDS_NM);
        let more =
            |band: usize| field.difference_at((1, band), f64::from(row) + 0.5, f64::from(column) + 0.5);
        let of: f64 = (0..4).map(|b| normal[b] * sensor.area_m2() + more(b)).sum();
        let expected = of / (normal.iter().sum::<f64>() * sensor.area_m2());
        let found = f64::from(map.at(1, (row as f32, column as f32)));
        assert!((found - expected).abs() < 1e-3, "{row} {column}: {found} {expected}");
    }
}
