//! Lists of tolerances: identifiers, order, draws, deviations of the traced lens, and lists that cannot be.

mod batch;
mod compensation;
mod lens_figures;
mod symmetric_lens;

use super::built::noll;
use super::*;
use crate::design::glass_library::GlassLibrary;
use crate::design::skew::deviation::{self, Deviation};
use crate::design::skew::system::BuiltLens;
use crate::design::system::{Aperture, FieldKind, Medium, RayAiming, Surface, System};

/// λ of ISO 10110 in mm.
const FRINGE_MM: f64 = 546.1e-6;

/// Nine surfaces and a film: 1-2, 3-4-5 (cemented) and 7-8 are glass, 6 is a stop, 9 a plane; radius 50 mm but for 6 and 9; clear
/// radius 10 mm but for 9.
fn lens() -> System {
    let library = GlassLibrary::new();
    let glass = || Medium::Glass(library.find("N-BK7", &[]).unwrap().0);
    let glasses = [1, 3, 4, 7];
    let surface = |number: usize| {
        let curvature = if [6, 9, 10].contains(&number) { 0.0 } else { 0.02 };
        let medium = if glasses.contains(&number) { glass() } else { Medium::Air };
        let semi_diameter_mm = if number >= 9 { 0.0 } else { 10.0 };
        Surface { semi_diameter_mm, ..Surface::new(curvature, 5.0, medium) }
    };
    System {
        name: "ten".to_owned(),
        object_distance_mm: None,
        is_telecentric: false,
        surfaces: (1..=10).map(surface).collect(),
        stop: 5,
        aperture: Aperture::EntrancePupil(5.0),
        field_kind: FieldKind::Angle,
        fields: vec![0.0],
        wavelengths_um: vec![(0.55, 1.0)],
        primary: 0,
        aiming: RayAiming::Real,
        notes: Vec::new(),
        asymmetry: None,
    }
}

fn within(size: f64) -> Limits {
    Limits::symmetric(size, Law::Normal)
}

fn of(target: Target, quantity: Quantity, size: f64) -> Tolerance {
    Tolerance { target, quantity, limits: within(size) }
}

fn pivoted(first: usize, last: usize, surface: usize) -> Target {
    Target::Element { first, last, pivot: Pivot { surface, offset_mm: 0.0 } }
}

/// One error of each kind.
fn all_kinds() -> Vec<Tolerance> {
    use Direction::{Radial, X, Y};
    let gap = |absorb| Target::Gap { after: 3, absorb };
    vec![
        of(Target::Film, Quantity::Shift, 10.0),
        of(Target::Film, Quantity::Tilt(Y), 3.0),
        of(Target::Glass(3), Quantity::Abbe, 0.8),
        of(Target::Glass(3), Quantity::Index, 5e-4),
        of(gap(Some(5)), Quantity::Thickness, 20.0),
        of(gap(None), Quantity::Thickness, 30.0),
        of(Target::Surface(5), Quantity::Conic, 0.01),
        of(Target::Surface(5), Quantity::Radius(RadiusUnit::Percent), 0.1),
        of(Target::Surface(4), Quantity::Radius(RadiusUnit::Um), 15.0),
        of(Target::Surface(6), Quantity::Radius(RadiusUnit::Fringes), 3.0),
        of(Target::Surface(5), Quantity::Irregularity(Figure::Astigmatism), 0.5),
        of(Target::Surface(4), Quantity::Irregularity(Figure::Mixed), 0.5),
        of(Target::Surface(4), Quantity::Zernike(11), 0.05),
        of(Target::Surface(8), Quantity::Decentre(Radial), 7.0),
        of(Target::element(3, 5), Quantity::Decentre(X), 20.0),
        of(Target::element(3, 5), Quantity::Wedge(X), 1.0),
        of(Target::element(3, 5), Quantity::Shift, 12.0),
        of(Target::element(1, 5), Quantity::Decentre(Y), 40.0),
        of(pivoted(1, 5, 3), Quantity::Tilt(X), 2.0),
        of(pivoted(1, 5, 1), Quantity::Tilt(X), 2.0),
    ]
}

fn set(list: &[Tolerance]) -> Tolerances {
    Tolerances::new(list, 546.1, &lens()).unwrap()
}

fn problem(list: &[Tolerance]) -> ToleranceError {
    Tolerances::new(list, 546.1, &lens()).unwrap_err()
}

#[test]
fn identifiers_are_in_the_order_of_the_lens() {
    let ids: Vec<String> = set(&all_kinds()).parameters().iter().map(|p| p.id.clone()).collect();
    let expected = [
        "element 1-5/decentre_y",
        "element 1-5/tilt_x",
        "element 1-5/tilt_x#2",
        "element 3-5/decentre_x",
        "element 3-5/wedge_x",
        "element 3-5/shift",
        "surface 4/radius",
        "surface 4/irregularity",
        "surface 4/irregularity_angle",
        "surface 4/zernike_11",
        "surface 5/radius",
        "surface 5/irregularity",
        "surface 5/irregularity_angle",
        "surface 5/conic",
        "surface 6/radius",
        "surface 8/decentre",
        "surface 8/decentre_angle",
        "gap 3/thickness",
        "gap 3/thickness#2",
        "glass 3/index",
        "glass 3/abbe",
        "film/tilt_y",
        "film/shift",
    ];
    assert_eq!(ids, expected);
    let one = of(Target::element(3, 3), Quantity::Decentre(Direction::X), 1.0);
    assert_eq!(set(&[one]).parameters()[0].id, "element 3/decentre_x");
}

/// u(1, 7, "gap 3/thickness") = 0.3818843987044301 and "#2" of fields_reference.py, by the uniform law.
#[test]
fn draws_are_those_of_the_identifiers() {
    let uniform = |absorb, size: f64| Tolerance {
        target: Target::Gap { after: 3, absorb },
        quantity: Quantity::Thickness,
        limits: Limits::symmetric(size, Law::Uniform),
    };
    let values = set(&[uniform(Some(5), 20.0), uniform(None, 30.0)]).draw(1, 7);
    let expected = [30.0 * (2.0 * 0.3818843987044301 - 1.0), 20.0 * (2.0 * 0.38709522056068585 - 1.0)];
    assert_eq!(values, expected);
}

#[test]
fn lens_seven_is_the_same_in_any_batch_and_any_order_of_errors() {
    let list = all_kinds();
    let bits = |values: &[f64]| values.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
    let batch = |n: u64| -> Vec<Vec<f64>> {
        let set = set(&list);
        (0..n).map(|k| set.draw(1, k)).collect()
    };
    let (of_eight, of_thousand) = (batch(8), batch(1000));
    assert_eq!(bits(&of_eight[7]), bits(&of_thousand[7]));
    let mut reversed = list.clone();
    reversed.reverse();
    let mut turned = list.clone();
    turned.rotate_left(7);
    for other in [reversed, turned] {
        assert_eq!(set(&other), set(&list));
        assert_eq!(bits(&set(&other).draw(1, 7)), bits(&of_eight[7]));
        assert_eq!(set(&other).deviations(&of_eight[7]), set(&list).deviations(&of_eight[7]));
    }
    // A further error changes no other draw.
    let mut more = list.clone();
    more.push(of(Target::element(7, 8), Quantity::Shift, 5.0));
    let (more, list) = (set(&more), set(&list));
    let drawn = |set: &Tolerances| -> Vec<(String, u64)> {
        let values = set.draw(1, 7);
        set.parameters().iter().zip(values).map(|(p, v)| (p.id.clone(), v.to_bits())).collect()
    };
    let kept: Vec<_> = drawn(&more).into_iter().filter(|(id, _)| !id.starts_with("element 7-8")).collect();
    assert_eq!(kept, drawn(&list));
}

/// Values in the units of the description against mm and rad computed here.
#[test]
fn deviations_are_in_mm_and_rad() {
    let set = set(&all_kinds());
    let values: Vec<f64> = set
        .parameters()
        .iter()
        .map(|p| match p.id.as_str() {
            "surface 4/irregularity_angle" => 0.5,
            "surface 5/irregularity_angle" => 0.25,
            "surface 8/decentre_angle" => 1.2,
            _ => p.limits.high,
        })
        .collect();
    let arcmin = std::f64::consts::PI / 10_800.0;
    let close = |found: f64, expected: f64| {
        assert!((found - expected).abs() <= 1e-12 * expected.abs(), "{found}, expected {expected}");
    };
    let found = set.deviations(&values);
    assert_eq!(found.len(), 11);
    let Deviation::Element { surfaces: [0, 4], decentre_mm, tilt_rad, pivot, .. } = &found[0] else {
        panic!("{:?}", found[0])
    };
    close(decentre_mm[1], 0.04);
    close(tilt_rad[0], 2.0 * arcmin);
    assert_eq!(*pivot, Some(deviation::Pivot { surface: 0, offset_mm: 0.0 }));
    let Deviation::Element { surfaces: [0, 4], decentre_mm: [0.0, 0.0], pivot, .. } = &found[1] else {
        panic!("{:?}", found[1])
    };
    assert_eq!(*pivot, Some(deviation::Pivot { surface: 2, offset_mm: 0.0 }));
    let Deviation::Element { surfaces: [2, 4], decentre_mm, wedge_rad, shift_mm, .. } = &found[2] else {
        panic!("{:?}", found[2])
    };
    close(decentre_mm[0], 0.02);
    close(wedge_rad[0], arcmin);
    close(*shift_mm, 0.012);
    let Deviation::Surface { surface: 3, shape, .. } = &found[3] else { panic!("{:?}", found[3]) };
    close(shape.curvature, 1.0 / 50.015 - 0.02);
    let sag = |x: f64, y: f64| {
        shape.figure.iter().map(|t| t.coefficient * x.powi(t.i as i32) * y.powi(t.j as i32)).sum::<f64>()
    };
    // At ρ = 1: N λ/4 (1 + cos²(φ − φ₀)) + w λ √5 (6 − 6 + 1).
    let edge = 0.5 * FRINGE_MM / 4.0 * (1.0 + 0.5_f64.cos().powi(2)) + 0.05 * FRINGE_MM * 5.0_f64.sqrt();
    assert!((sag(10.0, 0.0) - edge).abs() < 1e-17, "{} {edge}", sag(10.0, 0.0));
    let Deviation::Surface { surface: 4, shape, .. } = &found[4] else { panic!("{:?}", found[4]) };
    close(shape.curvature, 1.0 / 50.05 - 0.02);
    assert_eq!(shape.conic, 0.01);
    let across: f64 = shape.figure.iter().filter(|t| t.j == 0).map(|t| t.coefficient * 100.0).sum();
    close(across, 0.5 * FRINGE_MM / 4.0 * 0.5_f64.cos());
    let Deviation::Surface { surface: 5, shape, .. } = &found[5] else { panic!("{:?}", found[5]) };
    close(shape.curvature, 3.0 * FRINGE_MM / 100.0);
    let Deviation::Surface { surface: 7, decentre_mm, .. } = &found[6] else { panic!("{:?}", found[6]) };
    close(decentre_mm[0], 0.007 * 1.2_f64.cos());
    close(decentre_mm[1], 0.007 * 1.2_f64.sin());
    assert_eq!(found[7], Deviation::Gap { after: 2, thickness_mm: 0.03, absorb: None });
    assert_eq!(found[8], Deviation::Gap { after: 2, thickness_mm: 0.02, absorb: Some(4) });
    assert_eq!(found[9], Deviation::Glass { after: 2, index: 5e-4, abbe: 0.8 / 100.0 });
    let Deviation::Film { decentre_mm: [0.0, 0.0], tilt_rad, shift_mm } = &found[10] else {
        panic!("{:?}", found[10])
    };
    close(tilt_rad[1], 3.0 * arcmin);
    close(*shift_mm, 0.01);
}

#[test]
fn extremes_have_one_error_at_its_limits() {
    let mut list = all_kinds();
    list[0].limits = Limits { low: -3.0, high: 8.0, law: Law::Uniform };
    let set = set(&list);
    let extremes = set.extremes();
    assert_eq!(extremes.len(), list.len());
    for Extreme { parameter, values } in &extremes {
        let p = &set.parameters()[*parameter];
        assert!(!p.is_direction);
        assert_eq!([values[0][*parameter], values[1][*parameter]], [p.limits.low, p.limits.high]);
        for values in values {
            assert!(values.iter().enumerate().all(|(i, v)| i == *parameter || *v == 0.0));
        }
    }
    let film = extremes.last().unwrap();
    assert_eq!([film.values[0].last(), film.values[1].last()], [Some(&-3.0), Some(&8.0)]);
}

/// Directions of radial errors cover the circle: the mean of 10⁵ vectors of uniform radius ± 1 is 0 within four deviations, 1/√(6
/// · 10⁵).
#[test]
fn radial_errors_have_no_preferred_direction() {
    let radial = Tolerance {
        target: Target::element(1, 2),
        quantity: Quantity::Decentre(Direction::Radial),
        limits: Limits::symmetric(1.0, Law::Uniform),
    };
    let set = set(&[radial]);
    let n = 100_000;
    let (mut sum, mut squares) = ([0.0; 2], [0.0; 2]);
    for k in 0..n {
        let [Deviation::Element { decentre_mm, .. }] = &set.deviations(&set.draw(5, k))[..] else { panic!() };
        for axis in 0..2 {
            let v = 1e3 * decentre_mm[axis];
            (sum[axis], squares[axis]) = (sum[axis] + v, squares[axis] + v * v);
        }
    }
    for axis in 0..2 {
        assert!((sum[axis] / n as f64).abs() < 4.0 / (6.0 * n as f64).sqrt(), "{sum:?}");
        assert!((squares[axis] / n as f64 * 6.0 - 1.0).abs() < 0.02, "{squares:?}");
    }
}

/// Noll's table 1.
#[test]
fn zernike_terms_have_the_orders_of_noll() {
    let table = [
        (1, (0, 0)),
        (4, (2, 0)),
        (5, (2, -2)),
        (6, (2, 2)),
        (7, (3, -1)),
        (8, (3, 1)),
        (9, (3, -3)),
        (10, (3, 3)),
        (11, (4, 0)),
        (12, (4, 2)),
        (13, (4, -2)),
        (14, (4, 4)),
        (15, (4, -4)),
        (22, (6, 0)),
    ];
    for (term, orders) in table {
        assert_eq!(noll(term), orders, "{term}");
    }
}

#[test]
fn ranges_that_cross_are_an_error_and_nested_ones_are_not() {
    let shift = |first, last| of(Target::element(first, last), Quantity::Shift, 1.0);
    for nested in [[(1, 5), (3, 5)], [(1, 5), (1, 2)], [(1, 8), (3, 4)], [(1, 2), (3, 4)]] {
        set(&nested.map(|(f, l)| shift(f, l)));
    }
    for crossing in [[(1, 4), (3, 5)], [(3, 5), (1, 4)], [(1, 2), (2, 3)]] {
        let error = problem(&crossing.map(|(f, l)| shift(f, l)));
        assert_eq!((error.index, error.other), (1, Some(0)));
        assert!(matches!(error.problem, Problem::Crossing { .. }), "{error}");
    }
    let text = problem(&[shift(1, 4), shift(3, 5)]).to_string();
    assert_eq!(
        text,
        "element 3-5/shift: its surfaces cross those of `element 1-4` and neither range contains the other: give a group all surfaces of its elements"
    );
}

#[test]
fn two_errors_of_one_parameter_are_an_error() {
    use Direction::{Radial, X, Y};
    let decentre = |d| of(Target::element(3, 5), Quantity::Decentre(d), 1.0);
    let radius = |unit| of(Target::Surface(4), Quantity::Radius(unit), 1.0);
    let (rear, wedge) = (Target::Surface(5), |first| of(Target::element(first, 5), Quantity::Wedge(X), 1.0));
    let twice = [
        [decentre(X), decentre(X)],
        [decentre(Radial), decentre(Y)],
        [radius(RadiusUnit::Percent), radius(RadiusUnit::Fringes)],
        [wedge(3), of(rear, Quantity::Tilt(X), 1.0)],
        [wedge(3), wedge(1)],
        [of(rear, Quantity::Tilt(X), 1.0), of(Target::element(5, 5), Quantity::Tilt(Radial), 1.0)],
        [of(Target::Film, Quantity::Shift, 1.0), of(Target::Film, Quantity::Shift, 2.0)],
        [of(Target::Glass(1), Quantity::Index, 1.0), of(Target::Glass(1), Quantity::Index, 2.0)],
    ];
    for pair in twice {
        let error = problem(&pair);
        assert!(matches!(error.problem, Problem::Twice { .. }), "{error}");
        assert_eq!((error.index, error.other), (1, Some(0)));
    }
    set(&[decentre(X), decentre(Y)]);
    set(&[wedge(3), of(rear, Quantity::Tilt(Y), 1.0)]);
    set(&[
        of(pivoted(3, 5, 3), Quantity::Tilt(X), 1.0),
        of(pivoted(3, 5, 5), Quantity::Tilt(X), 1.0),
        of(pivoted(3, 3, 4), Quantity::Tilt(X), 1.0),
        of(Target::Surface(3), Quantity::Tilt(X), 1.0),
    ]);
}

#[test]
fn surfaces_and_limits_that_cannot_be() {
    let shift = |first, last| of(Target::element(first, last), Quantity::Shift, 1.0);
    let gap = |after, absorb| of(Target::Gap { after, absorb }, Quantity::Thickness, 1.0);
    let radius = |surface, unit| of(Target::Surface(surface), Quantity::Radius(unit), 1.0);
    let zernike = |term| of(Target::Surface(1), Quantity::Zernike(term), 1.0);
    let limits = |low, high| Tolerance { limits: Limits { low, high, law: Law::Uniform }, ..shift(1, 2) };
    let surface = |surface, expected: &str| Problem::Surface { surface, expected: expected.to_owned() };
    let cases = [
        (shift(0, 2), surface(0, "1 to 9")),
        (shift(9, 11), surface(11, "1 to 9")),
        (shift(9, 10), Problem::Film { surface: 10 }),
        (shift(4, 3), Problem::Order { first: 4, last: 3 }),
        (of(pivoted(1, 2, 12), Quantity::Tilt(Direction::X), 1.0), surface(12, "1 to 9")),
        (of(Target::Surface(10), Quantity::Conic, 1.0), Problem::Film { surface: 10 }),
        (gap(10, None), Problem::Film { surface: 10 }),
        (gap(3, Some(3)), surface(3, "the surface in front of a later gap, 4 to 9")),
        (gap(3, Some(10)), surface(10, "the surface in front of a later gap, 4 to 9")),
        (of(Target::Glass(2), Quantity::Index, 1e-4), Problem::NoGlass { surface: 2 }),
        (radius(6, RadiusUnit::Percent), Problem::Flat { surface: 6 }),
        (radius(6, RadiusUnit::Um), Problem::Flat { surface: 6 }),
        (radius(9, RadiusUnit::Fringes), Problem::NoSemiDiameter { surface: 9 }),
        (zernike(3), Problem::Term { term: 3 }),
        (zernike(232), Problem::Term { term: 232 }),
        (limits(2.0, 1.0), Problem::Limits { low: 2.0, high: 1.0 }),
        (limits(0.0, f64::INFINITY), Problem::Limits { low: 0.0, high: f64::INFINITY }),
        (of(Target::Film, Quantity::Conic, 1.0), Problem::Kind),
    ];
    for (tolerance, expected) in cases {
        let error = problem(&[tolerance]);
        assert_eq!((error.index, error.other, &error.problem), (0, None, &expected), "{error}");
    }
    assert!(matches!(problem(&[limits(f64::NAN, 1.0)]).problem, Problem::Limits { .. }));
}

/// A drawn lens is accepted by the tracer, and zero values are the nominal lens.
#[test]
fn drawn_lenses_can_be_built() {
    let set = set(&all_kinds());
    let lens = lens();
    for k in 0..20 {
        BuiltLens::new(&lens, &set.deviations(&set.draw(1, k))).unwrap();
    }
    let zero = BuiltLens::new(&lens, &set.deviations(&vec![0.0; set.parameters().len()])).unwrap();
    assert_eq!(zero.poses(), BuiltLens::new(&lens, &[]).unwrap().poses());
}
