//! Charts in the projection of the film: hits against their definition, and against planar charts.

use super::*;
use crate::projection::FilmProjection;
use crate::real;
use crate::scene::film_directions::FilmDirections;
use std::sync::Arc;

/// A chart whose angles are `angle_rad` of the height.
fn frame(side: usize, pitch_mm: f64, focal_mm: f64, angle_rad: impl Fn(f64) -> f64) -> Frame {
    let planar = Frame::centred(side, side, pitch_mm, focal_mm);
    let reach_mm = 0.5 * side as f64 * pitch_mm * std::f64::consts::SQRT_2;
    let projection = FilmProjection::fit(focal_mm, reach_mm, |r| Ok::<_, ()>(angle_rad(r)));
    let film = FilmDirections::new(projection.unwrap().unwrap(), reach_mm).unwrap();
    Frame { film: Some(Arc::new(film)), ..planar }
}

/// Triangles about the camera, some of them behind it.
fn triangles_around(seed: u64, count: u32) -> Mesh {
    let mut random = Random(seed);
    let mut corners = Vec::new();
    for _ in 0..count {
        let size = if random.next() < 0.15 { 2.0 } else { 0.12 };
        let middle = [random.between(-4.0, 4.0), random.between(-4.0, 4.0), random.between(-0.3, 2.0)];
        for _ in 0..3 {
            corners.push(middle.map(|m| m + random.between(-size, size)));
        }
    }
    let triangles = (0..count).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]).collect();
    mesh(vec![(corners, triangles)], OPTIONS)
}

/// Up to 83° from the axis in the corners.
#[test]
fn tiles_of_a_fisheye_have_the_hits_of_all_triangles() {
    let mesh = triangles_around(11, 600);
    let shader = OfPart(&mesh);
    for samples in [1, 4, 16] {
        let frame = frame(700, 0.0146, 5.0, |r| r / 5.0);
        let places = pattern(samples).unwrap();
        let of = |engine| Renderer::new(&mesh, frame.clone(), &shader, settings(samples, 1), engine).unwrap();
        let renderer = of(Engine::detect());
        let mut worker = renderer.worker();
        let (mut compared, mut total) = (0, 0);
        for tile in (0..renderer.grid().tiles()).step_by(5) {
            renderer.surfaces(tile, &mut worker, |row, column, sample, found| {
                if (row * 7 + column * 3 + sample) % 211 == 0 {
                    let place = places[sample];
                    let (x, y) = frame.direction(row as f64 + place[1], column as f64 + place[0]);
                    assert_eq!(found, hits_of_ray(&mesh, 0..mesh.triangles(), x, y), "{row} {column}");
                    compared += 1;
                    total += found.len();
                }
            });
        }
        assert!(compared > 400 && total > 2 * compared, "{compared} {total}");
        let portable = of(Engine::PORTABLE);
        for tile in [3, 40, 90] {
            let all = |renderer: &Renderer<'_>| format!("{:?}", renderer.all(tile, &mut renderer.worker()));
            assert!(all(&portable) == all(&renderer));
        }
    }
}

/// θ = atan(r/f) is a planar chart: samples differ by rounding, which a few of them at edges show.
#[test]
fn a_film_without_distortion_is_the_planar_chart() {
    let mesh = mesh(vec![icosphere([0.3, 0.1, 1.0], 0.4, 3), wall(3.0)], OPTIONS);
    let film = frame(200, 0.05, 9.0, |r| real::atan2(r, 9.0));
    let planar = Frame { film: None, ..film.clone() };
    let (mut differing, mut compared) = (0, 0);
    for tile in [0, 1, 5, 6, 10] {
        let (a, _) = render(&mesh, film.clone(), settings(16, 1), tile);
        let (b, _) = render(&mesh, planar.clone(), settings(16, 1), tile);
        for (a, b) in a.sheet.depth.iter().zip(&b.sheet.depth) {
            compared += 1;
            differing += usize::from((a - b).abs() > 1e-6 * b);
        }
    }
    assert!(compared > 12_000 && differing < 5, "{differing} of {compared}");
}

/// The change from pixel to pixel that textures are filtered with is that of the directions.
#[test]
fn steps_are_the_differences_of_directions() {
    let film = frame(700, 0.0146, 5.0, |r| r / 5.0);
    for chart in [Frame { film: None, ..film.clone() }, film] {
        for (row, column) in [(350.0, 350.0), (20.0, 400.0), (600.0, 90.0)] {
            let (x, y) = chart.direction(row, column);
            let steps = chart.steps(x, y);
            let (right, left) = (chart.direction(row, column + 0.5), chart.direction(row, column - 0.5));
            let (below, above) = (chart.direction(row + 0.5, column), chart.direction(row - 0.5, column));
            for (step, (to, from)) in steps.iter().zip([(right, left), (below, above)]) {
                let expected = [to.0 - from.0, to.1 - from.1];
                let size = expected[0].hypot(expected[1]);
                for k in 0..2 {
                    assert!((step[k] - expected[k]).abs() < 2e-3 * size, "{step:?} {expected:?}");
                }
            }
        }
    }
}
