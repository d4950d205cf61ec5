//! Planes, balls, floors and rooms: distances, silhouettes and sheets in closed form.

use super::*;
use crate::scene::mesh::tests::{cuboid, quad};

#[test]
fn a_tilted_plane_has_the_distances_of_the_closed_form() {
    let (n, k) = ([0.25, -0.5, 1.0], 2.0);
    let corner = |x: f64, y: f64| [x, y, (k - n[0] * x - n[1] * y) / n[2]];
    let corners = vec![corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)];
    let mesh = mesh(vec![(corners, vec![[0, 1, 2], [0, 2, 3]])], OPTIONS);
    let shader = OfPart(&mesh);
    let renderer = Renderer::new(&mesh, FRAME, &shader, settings(16, 1), Engine::detect()).unwrap();
    let places = pattern(16).unwrap();
    let mut worker = renderer.worker();
    renderer.surfaces(0, &mut worker, |row, column, sample, found| {
        let (x, y) = FRAME.direction(row as f64 + places[sample][1], column as f64 + places[sample][0]);
        let exact = (n[0] * x + n[1] * y + n[2]) / k;
        assert_eq!(found.len(), 1);
        assert!((found[0].0 / exact - 1.0).abs() <= 4e-16);
    });
    let front = renderer.front(0, &mut worker);
    for (at, &z) in front.sheet.depth.iter().enumerate() {
        let (x, y) = FRAME.direction((at / 64) as f64, (at % 64) as f64);
        assert!((f64::from(z) * (n[0] * x + n[1] * y + n[2]) / k - 1.0).abs() <= 6e-8);
    }
    assert!(!front.has_edge && front.sheet.coverage.iter().all(|&c| c == 1.0));
}

#[test]
fn a_ball_of_triangles_lies_within_its_sagitta() {
    let (centre, radius) = ([0.004, -0.003, 1.0], 0.015);
    for level in [3, 4] {
        let mesh = mesh(vec![icosphere(centre, radius, level)], MeshOptions { solids: false, ..OPTIONS });
        let shader = OfPart(&mesh);
        let renderer = Renderer::new(&mesh, FRAME, &shader, settings(1, 1), Engine::detect()).unwrap();
        let (mut worst, mut compared) = (0f64, 0);
        renderer.surfaces(0, &mut renderer.worker(), |row, column, _, found| {
            let (x, y) = FRAME.direction(row as f64, column as f64);
            let (dc, dd) = (x * centre[0] + y * centre[1] + centre[2], x * x + y * y + 1.0);
            let cc: f64 = centre.iter().map(|c| c * c).sum();
            let root = dc * dc - dd * (cc - radius * radius);
            assert!(found.is_empty() || found.len() == 2);
            if found.len() == 2 && root > 0.0 {
                let (near, far) = ((dc - root.sqrt()) / dd, (dc + root.sqrt()) / dd);
                if far - near > radius {
                    worst = worst.max((1.0 / found[0].0 - near).abs()).max((1.0 / found[1].0 - far).abs());
                    compared += 1;
                }
            }
        });
        assert!(compared > 400 && worst > 0.0);
        assert!(worst <= 0.8 * radius * 0.25f64.powi(level as i32), "{worst}");
    }
}

#[test]
fn the_silhouette_of_a_ball_has_its_area() {
    let mesh = mesh(vec![icosphere([0.0, 0.0, 1.0], 0.02, 3), wall(2.0)], OPTIONS);
    let (front, hidden) = render(&mesh, FRAME, settings(16, 3), 0);
    let area: f64 = (0..4096)
        .filter(|&at| front.sheet.depth[at] < 1.5)
        .map(|at| f64::from(front.sheet.coverage[at]))
        .sum();
    // tan² asin r = r²/(1 − r²), 10⁻⁶ per pixel.
    let exact = std::f64::consts::PI * 0.0004 / (1.0 - 0.0004) / 1e-6;
    assert!((area / exact - 1.0).abs() <= 0.006, "{area} {exact}");
    assert!(front.has_edge && hidden[1].is_empty());
    for at in 0..4096 {
        let is_ball = front.sheet.depth[at] < 1.5;
        assert_eq!(hidden[0].coverage[at], if is_ball { 1.0 } else { 0.0 });
        assert_eq!(hidden[0].depth[at], if is_ball { 2.0 } else { 0.0 });
        assert_eq!(hidden[0].weights[4096 + at], if is_ball { 1.0 } else { 0.0 });
    }
}

#[test]
fn without_solids_the_back_of_a_ball_hides_the_wall() {
    let shapes = || vec![icosphere([0.0, 0.0, 1.0], 0.02, 3), wall(2.0)];
    let solid = mesh(shapes(), OPTIONS);
    let open = mesh(shapes(), MeshOptions { solids: false, ..OPTIONS });
    let (_, with) = render(&solid, FRAME, settings(4, 2), 0);
    let (front, without) = render(&open, FRAME, settings(4, 2), 0);
    let centre = 32 * 64 + 32;
    assert!((with[0].depth[centre] - without[0].depth[centre]).abs() > 0.1);
    assert!(front.counts.hidden_back_samples * 2 > front.counts.hidden_samples);
}

#[test]
fn the_floor_to_the_horizon_is_one_surface() {
    let floor = quad([-5e5, 1.0, 0.5], [1e6, 0.0, 0.0], [0.0, 0.0, 1e6]);
    let mesh = mesh(vec![floor], OPTIONS);
    let background = Some(Background { vergence: 0.0, weights: vec![0.0, 0.0, 1.0] });
    let settings = Settings { gap_dioptre: 1e-4, background, ..settings(16, 2) };
    let (front, hidden) = render(&mesh, FRAME, settings, 0);
    for row in 34..64 {
        for column in 0..64 {
            let at = row * 64 + column;
            let vergence = FRAME.y(row as f64);
            assert!((f64::from(front.sheet.depth[at]) * vergence - 1.0).abs() <= 1e-6);
            assert_eq!((front.sheet.coverage[at], hidden[0].coverage[at]), (1.0, 1.0));
            assert!(hidden[0].depth[at].is_infinite() && hidden[0].weights[2 * 4096 + at] == 1.0);
        }
    }
    assert!(front.sheet.depth[..64].iter().all(|z| z.is_infinite()));
}

#[test]
fn rooms_end_the_scene_and_boxes_hide_what_is_inside() {
    for room in [cuboid([-1.0; 3], [1.0, 1.0, 4.0]), flipped(cuboid([-1.0; 3], [1.0, 1.0, 4.0]))] {
        let mesh = mesh(vec![room, cuboid([-0.01, -0.01, 1.0], [0.01, 0.01, 1.02]), wall(6.0)], OPTIONS);
        let (front, hidden) = render(&mesh, FRAME, settings(4, 3), 0);
        let centre = 32 * 64 + 32;
        assert_eq!((front.sheet.depth[centre], hidden[0].depth[centre]), (1.0, 4.0));
        assert!(hidden[1].is_empty());
    }
    let ball = icosphere([0.0, 0.0, 1.0], 0.02, 2);
    let mesh = mesh(vec![ball, icosphere([0.0, 0.0, 1.0], 0.01, 2), wall(2.0)], OPTIONS);
    let (_, hidden) = render(&mesh, FRAME, settings(4, 3), 0);
    assert!(hidden[1].is_empty() && hidden[0].weights[..4096].iter().all(|&w| w == 0.0));
}
