//! Maps against the NumPy reference and closed forms.

use super::*;
use crate::field::Outside;
use crate::field::planar::{PlanarField, check_covers};
use crate::geometry::{Frame, Rect, Size};

/// X, Y, ideal X, ideal Y, R at 200 points; X, Y, J where J is least; rows of a remapped image: `tests/data/make_planar_map.py`.
const GOLDEN: &str = include_str!("../../../tests/data/planar_map.txt");

/// Ideal X, ideal Y and R at (x, y), as in `make_planar_map.py`.
fn sample(x: f64, y: f64) -> [f64; 3] {
    let r2 = x * x + y * y;
    let keystone = 1.0 / (1.0 + 1e-3 * x - 2e-3 * y);
    let radial = 1.01 - 5e-5 * r2 + 4e-8 * r2 * r2;
    let vignetting = 1.0 + 2e-3 * r2;
    [x * radial * keystone - 0.03, y * radial * keystone + 0.05, 1.0 / (vignetting * vignetting) + 1e-3 * x]
}

fn map_of(x_mm: Vec<f64>, y_mm: Vec<f64>, sample: impl Fn(f64, f64) -> [f64; 3]) -> PlanarMap {
    let table = |of: usize| {
        y_mm.iter().flat_map(|y| x_mm.iter().map(|x| sample(*x, *y)[of]).collect::<Vec<_>>()).collect()
    };
    PlanarMap { ideal_x_mm: table(0), ideal_y_mm: table(1), relative_illumination: table(2), x_mm, y_mm }
}

pub(crate) fn golden_map() -> PlanarMap {
    let nodes = |first: f64, step: f64, n: i32| (0..n).map(|i| first + step * f64::from(i)).collect();
    map_of(nodes(-14.0, 3.0, 11), nodes(-13.0, 3.125, 9), sample)
}

pub(crate) fn golden() -> Vec<Vec<f64>> {
    GOLDEN.lines().map(|line| line.split(' ').map(|v| v.parse().unwrap()).collect()).collect()
}

#[test]
fn map_equals_the_reference_at_200_points() {
    let (map, pitch_mm, gain) = (golden_map(), 2e-3, 3.0);
    let field = PlanarField::new(&map, pitch_mm, true, true, gain);
    let points = golden();
    assert_eq!(points.len(), 213);
    for point in &points[..200] {
        let [x, y, ideal_x, ideal_y, light] = point[..] else { panic!("five values") };
        let [down, across, r] = field.at(y / pitch_mm, x / pitch_mm);
        assert!((x + across * pitch_mm - ideal_x).abs() < 1e-12, "X at ({x}, {y})");
        assert!((y + down * pitch_mm - ideal_y).abs() < 1e-12, "Y at ({x}, {y})");
        assert!((r / gain - light).abs() < 1e-13, "R at ({x}, {y})");
    }
}

#[test]
fn least_area_is_that_of_the_reference() {
    let [x, y, area] = golden()[200][..] else { panic!("three values") };
    let (place, found) = folding::least_area(&golden_map());
    assert!((found - area).abs() < 1e-12, "{found}, expected {area}");
    assert!((place.0 - x).abs() < 1e-9 && (place.1 - y).abs() < 1e-9, "{place:?}");
}

#[test]
fn displacement_and_illumination_of_the_nearest_edge_apply_beyond_the_map() {
    let (map, pitch_mm) = (golden_map(), 2e-3);
    let field = PlanarField::new(&map, pitch_mm, true, true, 1.0);
    for (beyond, edge) in
        [((20.0, 3.0), (16.0, 3.0)), ((-99.0, -99.0), (-14.0, -13.0)), ((1.0, 12.5), (1.0, 12.0))]
    {
        let at = |(x, y): (f64, f64)| field.at(y / pitch_mm, x / pitch_mm);
        assert_eq!(at(beyond), at(edge), "{beyond:?}");
    }
    // A corner is a node: the displacement is that of the table.
    let [down, across, light] = field.at(-1e9, -1e9);
    let [x, y, r] = sample(-14.0, -13.0);
    assert!((across * pitch_mm - (x + 14.0)).abs() < 1e-12 && (down * pitch_mm - (y + 13.0)).abs() < 1e-12);
    assert!((light - r).abs() < 1e-14);
}

#[test]
fn disabled_stages_are_the_identity() {
    let field = PlanarField::new(&golden_map(), 2e-3, false, false, 2.0);
    for (dy, dx) in [(0.0, 0.0), (17.3, -812.0), (1e6, 4.0)] {
        let [down, across, light] = field.at(dy, dx);
        assert_eq!([down, across], [0.0; 2]);
        assert!((light - 2.0).abs() < 1e-15);
    }
}

#[test]
fn film_beyond_the_map_is_an_error_or_clamped() {
    let map = golden_map();
    let mut frame = Frame::centred(Size::new(13_001, 14_001), Size::new(1, 1), 2.0);
    frame.axis_px = (6500.0, 7000.0);
    let check = |rect: Rect, outside| check_covers(&map, 550.0, &frame, rect, outside);
    // Rows from −13 mm to 12 mm, columns from −14 mm to 16 mm.
    let film = Rect::new(0, 0, 12_501, 15_001);
    assert_eq!(check(film, Outside::Error), Ok(()));
    for (y, x) in [(-1, 0), (1, 0), (0, -1), (0, 1)] {
        let moved = Rect::new(y, x, film.height, film.width);
        let error = check(moved, Outside::Error).unwrap_err();
        assert!(matches!(error, LensError::OutsideMap { .. }));
        assert!(
            error.to_string().contains("550 nm from (-14.000000, -13.000000) to (16.000000, 12.000000) mm"),
            "{error}"
        );
        assert_eq!(check(moved, Outside::Clamp), Ok(()));
    }
}

#[test]
fn map_that_folds_is_an_error_with_its_place() {
    // X turns back where its slope 1 − 3x²/16 is negative, beyond 2.31 mm; it is least at both ends, by 1e-3·x more so at the
    // right one.
    let nodes: Vec<f64> = (-4..=4).map(f64::from).collect();
    let folded = map_of(nodes.clone(), nodes.clone(), |x, y| {
        [x - x * x * x / 16.0 - 5e-4 * x * x, y + 0.01 * y * y, 1.0]
    });
    let error = folded.check(450.0).unwrap_err().to_string();
    assert!(error.contains("lens band 450 nm") && error.contains("folds at (4.000, 4.000) mm"), "{error}");
    // Slopes 1 − 3 − 0.004 of X and 1 + 0.08 of Y.
    assert!(error.contains("-2.164e0 times"), "{error}");
    // Between two nodes only: a step of −0.6 of a cell, where the slope of the spline is least in the middle of the cell.
    let step = map_of(nodes.clone(), nodes.clone(), |x, y| [x - if x > 0.5 { 1.0 } else { 0.0 }, y, 1.0]);
    let ((x, _), area) = folding::least_area(&step);
    assert!(x > 0.0 && x < 1.0 && area < 0.0, "{area} at {x}");
    // Mirrored.
    assert!(map_of(nodes.clone(), nodes.clone(), |x, y| [-x, y, 1.0]).check(450.0).is_err());
    assert_eq!(map_of(nodes.clone(), nodes, |x, y| [x, y, 1.0]).check(450.0), Ok(()));
}

#[test]
fn tables_that_violate_the_contract_are_errors_that_name_them() {
    type Change<'a> = &'a dyn Fn(&mut PlanarMap);
    let good = golden_map();
    assert_eq!(good.check(550.0), Ok(()));
    let problem = |change: Change<'_>| {
        let mut map = good.clone();
        change(&mut map);
        map.check(550.0).unwrap_err().to_string()
    };
    let cases: [(Change<'_>, &str); 8] = [
        (&|m| m.x_mm[3] += 1e-6, "map_x is not uniform"),
        (&|m| m.x_mm.reverse(), "map_x does not ascend"),
        (
            &|m| m.y_mm.truncate(3),
            "map_y is out of bounds: the number of nodes of the map is 3, expected 4 to 1025",
        ),
        (&|m| m.y_mm[8] = f64::NAN, "map_y is out of bounds at index 8"),
        (&|m| m.ideal_x_mm[12] = f64::INFINITY, "map_ideal_x is out of bounds at row 1, column 1"),
        (&|m| m.ideal_y_mm.truncate(98), "map_ideal_y has 98 values, expected 9 x 11"),
        (
            &|m| m.relative_illumination[0] = -0.1,
            "map_relative_illumination is out of bounds at row 0, column 0",
        ),
        (&|m| m.ideal_x_mm.reverse(), "folds at"),
    ];
    for (change, expected) in cases {
        let found = problem(change);
        assert!(found.contains(expected), "{found}, expected {expected}");
    }
}
