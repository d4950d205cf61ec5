//! Rays through closed meshes, and the hits of tiles against those of all triangles.

use super::*;
use crate::scene::visibility::bins::Bins;
use crate::scene::visibility::raster::{Label, TileTriangle};
use crate::scene::visibility::surfaces::{Sample, TileSolids};

/// Vertices of a mesh as directions.
fn directions_of_vertices(shape: &Shape) -> Vec<(f64, f64)> {
    shape.0.iter().map(|v| v.map(|c| f64::from(c as f32))).map(|[x, y, z]| (x / z, y / z)).collect()
}

/// A triangle as a tile has it.
fn tile_triangle(mesh: &Mesh, triangle: u32, solids: &mut TileSolids, is_front: bool) -> TileTriangle {
    TileTriangle {
        edges: Edges::new(mesh.corners(triangle)).unwrap(),
        triangle,
        solid: solids.number(mesh, triangle),
        label: Label::new(0, 0),
        rows: (0, 0),
        spans: 0,
        is_front,
        is_one_sided: mesh.is_one_sided(triangle),
        has_alpha: false,
    }
}

/// Parity of the hits of a ball, and whether the wall behind is a surface, of rays through the triangles that `of` lists.
fn check_rays<I: Iterator<Item = u32>>(
    mesh: &Mesh,
    ball: u32,
    of: impl Fn(f64, f64) -> I,
    rays: impl Iterator<Item = (f64, f64)>,
) -> (usize, usize, usize) {
    let shader = OfPart(mesh);
    let mut solids = TileSolids::default();
    let (mut total, mut odd, mut hit) = (0, 0, 0);
    for (x, y) in rays {
        let found = hits_of_ray(mesh, of(x, y), x, y);
        let crossings = found.iter().filter(|h| h.1 < ball).count();
        total += 1;
        odd += crossings % 2;
        hit += usize::from(crossings > 0);
        solids.clear();
        let triangles: Vec<_> = found.iter().map(|h| tile_triangle(mesh, h.1, &mut solids, true)).collect();
        let labelled: Vec<_> =
            (0..found.len()).map(|k| (found[k].0, Label::new(k as u32, triangles[k].solid))).collect();
        let sample = Sample { sample: 0, samples: 1, x, y, nearest: f64::INFINITY };
        let mut last = None;
        surfaces((&mut solids, &triangles), labelled.iter().copied(), sample, &shader, |_, k| {
            last = Some(found[k as usize].1);
        });
        assert!(last.is_some_and(|t| t >= ball), "the wall is seen at {x} {y}");
    }
    (total, odd, hit)
}

#[test]
fn closed_meshes_are_watertight() {
    let shape = icosphere([0.1, 0.05, 2.0], 0.3, 2);
    let vertices = directions_of_vertices(&shape);
    let mesh = mesh(vec![shape, wall(4.0)], OPTIONS);
    let mut random = Random(1);
    let rays = (0..100_000).map(|_| (random.between(-0.1, 0.2), random.between(-0.12, 0.17)));
    let (total, odd, hit) = check_rays(&mesh, 320, |_, _| 0..mesh.triangles(), rays);
    assert_eq!((total, odd), (100_000, 0));
    assert!(hit > 50_000);
    // Rounding of the vertex's direction may end in a ray that touches the ball; the wall is seen all the same.
    let (total, odd, _) = check_rays(&mesh, 320, |_, _| 0..mesh.triangles(), vertices.into_iter());
    assert!(total == 162 && odd < 25, "{odd}");
}

#[test]
#[ignore = "long: a minute, 10⁶ rays through a closed mesh of 1.3·10⁶ triangles, and through its vertices"]
fn large_closed_meshes_are_watertight() {
    let shape = icosphere([0.1, 0.05, 2.0], 0.3, 8);
    let (ball, vertices) = (shape.1.len() as u32, directions_of_vertices(&shape));
    let mesh = mesh(vec![shape, wall(4.0)], OPTIONS);
    let frame = Frame::centred(8192, 8192, 0.002, 28.0);
    let bins = Bins::new(&mesh, &frame).unwrap();
    let grid = bins.grid();
    let of = |x: f64, y: f64| {
        let [row, column] = [frame.row(y), frame.column(x)].map(|v| (v + 0.5).floor() as usize / 64);
        bins.of(row * grid.across() + column)
    };
    let mut random = Random(2);
    let rays = (0..1_000_000).map(|_| (random.between(-0.1, 0.2), random.between(-0.12, 0.17)));
    assert_eq!(check_rays(&mesh, ball, of, rays).1, 0);
    check_rays(&mesh, ball, of, vertices.into_iter());
}

#[test]
fn tiles_have_the_hits_of_all_triangles() {
    // Triangles of all sizes, some about the camera, on 21 × 21 tiles.
    let mut random = Random(3);
    let mut corners = Vec::new();
    for k in 0..400 {
        let (size, z) = ([0.002, 0.05, 1.0, 20.0][k % 4], random.between(0.2, 2.0));
        let middle = [random.between(-0.4, 0.4) * z, random.between(-0.4, 0.4) * z, z];
        for _ in 0..3 {
            corners.push(middle.map(|m| m + random.between(-size, size)));
        }
    }
    let triangles = (0..400).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]).collect();
    let mesh = mesh(vec![(corners, triangles)], OPTIONS);
    let frame =
        Frame { centre_mm: (0.3, -0.2), scale: (1.0, 1.25), ..Frame::centred(1300, 1340, 0.03, 50.0) };
    let shader = OfPart(&mesh);
    let renderer = Renderer::new(&mesh, frame.clone(), &shader, settings(1, 1), Engine::detect()).unwrap();
    let mut worker = renderer.worker();
    let (mut compared, mut total) = (0, 0);
    for tile in (0..renderer.grid().tiles()).step_by(17) {
        renderer.surfaces(tile, &mut worker, |row, column, _, found| {
            if (row * 7 + column * 3) % 61 == 0 {
                let (x, y) = frame.direction(row as f64, column as f64);
                assert_eq!(found, hits_of_ray(&mesh, 0..mesh.triangles(), x, y), "{row} {column}");
                compared += 1;
                total += found.len();
            }
        });
    }
    assert!(compared > 1500 && total > 5 * compared, "{compared} {total}");
}

#[test]
fn a_one_sided_solid_that_is_crossed_once_shows_no_back() {
    // The hits of a ray but the first, as if rounding had lost it.
    let shape = icosphere([0.0, 0.0, 1.0], 0.02, 1);
    let parts = [part(shape, 0), part(wall(2.0), 1)];
    let mesh =
        Mesh::new(&parts, &[material(false), material(true)], &crate::scene::mesh::tests::pose(), OPTIONS)
            .unwrap();
    let shader = OfPart(&mesh);
    let back = hits_of_ray(&mesh, 0..mesh.triangles(), 0.001, 0.002);
    assert_eq!(back.len(), 3);
    let mut solids = TileSolids::default();
    let triangles: Vec<_> = back[1..].iter().map(|h| tile_triangle(&mesh, h.1, &mut solids, false)).collect();
    let hits =
        [(back[1].0, Label::new(0, triangles[0].solid)), (back[2].0, Label::new(1, triangles[1].solid))];
    let sample = Sample { sample: 0, samples: 1, x: 0.001, y: 0.002, nearest: f64::INFINITY };
    let mut found = Vec::new();
    surfaces((&mut solids, &triangles), hits.into_iter(), sample, &shader, |_, number| found.push(number));
    assert_eq!(found, [1], "the wall alone");
}
