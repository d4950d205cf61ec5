//! Answers of the hierarchy against tests of all triangles, and rays that a box test could miss.

use super::*;
use crate::scene::description::{Geometry, Positions};
use crate::scene::test_mesh::{Random, TestMesh, quad, wall};

fn mesh(positions: Vec<[f32; 3]>, triangles: Vec<[u32; 3]>) -> TestMesh {
    let (positions, triangles) = (Positions::F32(positions.into()), triangles.into());
    TestMesh::default().with(0, Geometry { positions, triangles, ..Geometry::default() })
}

fn ray(start: [f64; 3], direction: [f64; 3]) -> ShadowRay {
    ShadowRay { start, direction, end: f64::INFINITY }
}

fn is_blocked(mesh: &TestMesh, ray: &ShadowRay) -> bool {
    Occluders::new(mesh).unwrap().is_blocked(mesh, ray, |_, _| true)
}

/// Triangles at random in a cube of side 2·`size` about `centre`, edges of about `size`·`edge`.
fn soup(count: usize, centre: [f64; 3], size: f64, edge: f64) -> TestMesh {
    let mut random = Random(11);
    let mut positions = Vec::new();
    for _ in 0..count {
        let middle: [f64; 3] = std::array::from_fn(|k| centre[k] + size * random.between(-1.0, 1.0));
        for _ in 0..3 {
            positions
                .push(std::array::from_fn(|k| (middle[k] + size * edge * random.between(-1.0, 1.0)) as f32));
        }
    }
    mesh(positions, (0..count as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect())
}

#[test]
fn answers_are_those_of_a_test_of_all_triangles() {
    for (centre, size, edge) in
        [([0.0, 0.0, 5.0], 2.0, 0.1), ([300.0, -20.0, 900.0], 1e-3, 0.3), ([0.0; 3], 1e5, 0.2)]
    {
        let mesh = soup(600, centre, size, edge);
        let occluders = Occluders::new(&mesh).unwrap();
        let mut random = Random(5);
        let mut blocked = 0;
        for i in 0..4000 {
            let start: [f64; 3] = std::array::from_fn(|k| centre[k] + size * random.between(-1.5, 1.5));
            let mut direction: [f64; 3] = std::array::from_fn(|_| random.between(-1.0, 1.0));
            // Parallel to an axis or a plane, of either sign of zero.
            match i % 8 {
                0 => direction[i / 8 % 3] = 0.0,
                1 => direction[i / 8 % 3] = -0.0,
                2 => direction = std::array::from_fn(|k| if k == i / 8 % 3 { direction[k] } else { -0.0 }),
                3 => direction[i / 8 % 3] *= 1e-14,
                _ => {}
            }
            let end = if i % 2 == 0 { f64::INFINITY } else { size * random.next() };
            let ray = ShadowRay { start, direction, end };
            let expected = (0..600).any(|t| meets(mesh.corners(t), &ray).is_some());
            assert_eq!(occluders.is_blocked(&mesh, &ray, |_, _| true), expected, "{ray:?}");
            blocked += usize::from(expected);
        }
        assert!((100..3900).contains(&blocked), "{blocked} of 4000");
    }
}

#[test]
fn no_ray_passes_between_triangles_that_share_an_edge() {
    // A grid of 16 × 16 squares; rays from one point through vertices, edges and diagonals, exactly and nearly.
    let n = 16u32;
    let at = |i: u32| i as f32 / 8.0 - 1.0;
    let positions = (0..=n).flat_map(|r| (0..=n).map(move |c| [at(c), at(r), 1.0])).collect();
    let square = |r: u32, c: u32| {
        let a = r * (n + 1) + c;
        [[a, a + 1, a + n + 1], [a + 1, a + n + 2, a + n + 1]]
    };
    let triangles = (0..n).flat_map(|r| (0..n).flat_map(move |c| square(r, c))).collect();
    let mesh = mesh(positions, triangles);
    let occluders = Occluders::new(&mesh).unwrap();
    for start in [[0.0, 0.0, 0.0], [0.25, -0.5, -1.0], [0.123, -0.3, -2.0], [1e-9, 3e-10, 0.999]] {
        // Differences and products of the first two are exact, so that of the rays through corners, too, none is lost.
        let is_exact = start[2] <= 0.0 && start[0] != 0.123;
        for r in 0..31 {
            for c in 0..31 {
                if !is_exact && (c - 15) % 2 == 0 && (r - 15) % 2 == 0 {
                    continue;
                }
                let place = [f64::from(c - 15) / 16.0, f64::from(r - 15) / 16.0, 1.0];
                let direction = std::array::from_fn(|k| place[k] - start[k]);
                assert!(occluders.is_blocked(&mesh, &ray(start, direction), |_, _| true), "{place:?}");
            }
        }
    }
}

#[test]
fn near_triangles_in_a_large_scene_block() {
    // The floor sets the largest coordinate; a square blocks 1 µm to 1 mm above a place near the camera.
    for above in [1e-6f32, 2e-5, 1e-3] {
        let floor = quad([-50.0, 1.0, 0.5], [100.0, 0.0, 0.0], [0.0, 0.0, 100.0]);
        let small = quad([-0.1, -above, 0.9], [0.2, 0.0, 0.0], [0.0, 0.0, 0.2]);
        let mesh = TestMesh::default().with(0, floor).with(0, small);
        let start = [0.0, 0.0, 1.0];
        assert!(is_blocked(&mesh, &ray(start, [0.0, -1.0, 0.0])));
        assert!(is_blocked(&mesh, &ray(start, [0.01, -1.0, -0.03])));
        // As a ray that ends before it, and one that ends behind.
        let to = |share: f64| ShadowRay { start, direction: [0.0, -f64::from(above) * share, 0.0], end: 1.0 };
        assert!(!is_blocked(&mesh, &to(0.999)) && is_blocked(&mesh, &to(1.001)));
        let up = ray([0.0, -f64::from(above) * 1.001, 1.0], [0.0, -1.0, 0.0]);
        assert!(!is_blocked(&mesh, &up));
    }
}

#[test]
fn meshes_without_size_or_structure_have_a_hierarchy() {
    let none = TestMesh::default();
    let toward = ray([0.0; 3], [0.0, 0.0, 1.0]);
    assert!(!is_blocked(&none, &toward));
    let triangle = vec![[-1.0, -1.0, 2.0], [1.0, -1.0, 2.0], [0.0, 2.0, 2.0]];
    assert!(is_blocked(&mesh(triangle.clone(), vec![[0, 1, 2]]), &toward));
    assert!(is_blocked(&mesh(triangle.clone(), vec![[0, 2, 1]; 20_000]), &toward));
    assert!(!is_blocked(&mesh(triangle.clone(), vec![[0, 1, 1]; 5]), &toward));
    assert!(!is_blocked(&mesh(vec![[0.0; 3]; 3], vec![[0, 1, 2]; 9]), &toward));
    // Each triangle a tenth of the one before, down to the least that f32 resolves.
    let shrinking: Vec<[f32; 3]> =
        (0..38).flat_map(|i| triangle.iter().map(move |p| p.map(|v| v * 10f32.powi(-i)))).collect();
    let deep = mesh(shrinking, (0..38).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect());
    assert!(is_blocked(&deep, &toward));
    for direction in [[0.0; 3], [f64::NAN, 0.0, 1.0]] {
        assert!(!is_blocked(&deep, &ray([0.0; 3], direction)));
    }
}

#[test]
fn triangles_with_a_hole_do_not_block_there() {
    let mesh = TestMesh::default().with(0, wall(2.0, 1.0)).with(0, wall(3.0, 1.0));
    let occluders = Occluders::new(&mesh).unwrap();
    let to = |x: f64| ray([x, 0.1, 1.0], [0.0, 0.0, 1.0]);
    let right = |t: u32, b: [f64; 3]| {
        let corners = mesh.corners(t);
        (0..3).map(|k| b[k] * corners[k][0]).sum::<f64>() > 0.0
    };
    assert!(occluders.is_blocked(&mesh, &to(0.3), right) && !occluders.is_blocked(&mesh, &to(-0.3), right));
    // Only the second wall is one.
    assert!(occluders.is_blocked(&mesh, &to(-0.3), |t, b| t >= 2 || right(t, b)));
}

#[test]
fn the_hierarchy_takes_13_bytes_a_triangle() {
    let mesh = soup(20_000, [0.0, 0.0, 5.0], 2.0, 0.01);
    let bytes = Occluders::new(&mesh).unwrap().bytes() as f64 / 20_000.0;
    assert!((10.0..20.0).contains(&bytes), "{bytes}");
}
