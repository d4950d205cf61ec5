//! Meshes from parts, and shapes for other tests.

use super::*;
use crate::scene::description::Geometry;
use std::sync::Arc;

/// Vertices and triangles.
pub(crate) type Shape = (Vec<[f64; 3]>, Vec<[u32; 3]>);

pub(crate) const IDENTITY: [[f64; 4]; 4] =
    [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]];

pub(crate) const OPTIONS: MeshOptions = MeshOptions { unit_m: 1.0, solids: true, two_sided: false };

/// World coordinates are those of the camera frame.
pub(crate) fn pose() -> Pose {
    Pose::looking([0.0; 3], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]).unwrap()
}

pub(crate) fn part(shape: Shape, material: usize) -> Part {
    let (positions, triangles) = (Positions::F64(shape.0.into()), shape.1.into());
    let geometry = Geometry { positions, triangles, ..Geometry::default() };
    Part {
        name: format!("part of {material}"),
        node: 0,
        to_world: IDENTITY,
        geometry: Arc::new(geometry),
        material,
    }
}

pub(crate) fn material(two_sided: bool) -> Material {
    Material { two_sided, ..Material::matt(String::new(), [1.0; 3]) }
}

pub(crate) fn mesh(shapes: Vec<Shape>, options: MeshOptions) -> Mesh {
    let materials = vec![material(true); shapes.len()];
    let parts: Vec<Part> = shapes.into_iter().enumerate().map(|(k, shape)| part(shape, k)).collect();
    Mesh::new(&parts, &materials, &pose(), options).unwrap()
}

pub(crate) fn quad(o: [f64; 3], u: [f64; 3], v: [f64; 3]) -> Shape {
    let at = |a: f64, b: f64| [0, 1, 2].map(|k| o[k] + a * u[k] + b * v[k]);
    (vec![at(0.0, 0.0), at(1.0, 0.0), at(1.0, 1.0), at(0.0, 1.0)], vec![[0, 1, 2], [0, 2, 3]])
}

pub(crate) fn wall(z: f64) -> Shape {
    quad([-9.0, -9.0, z], [18.0, 0.0, 0.0], [0.0, 18.0, 0.0])
}

pub(crate) fn cuboid(low: [f64; 3], high: [f64; 3]) -> Shape {
    let vertices =
        (0..8).map(|i| [0, 1, 2].map(|k| if i >> k & 1 == 1 { high[k] } else { low[k] })).collect();
    let faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    (vertices, faces.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect())
}

/// An icosahedron whose faces are divided into 4^level.
pub(crate) fn icosphere(centre: [f64; 3], radius: f64, level: usize) -> Shape {
    let g = (1.0 + 5f64.sqrt()) / 2.0;
    let corners = [
        [-1.0, g, 0.0],
        [1.0, g, 0.0],
        [-1.0, -g, 0.0],
        [1.0, -g, 0.0],
        [0.0, -1.0, g],
        [0.0, 1.0, g],
        [0.0, -1.0, -g],
        [0.0, 1.0, -g],
        [g, 0.0, -1.0],
        [g, 0.0, 1.0],
        [-g, 0.0, -1.0],
        [-g, 0.0, 1.0],
    ];
    let on_sphere = |p: [f64; 3]| p.map(|c| c / (p[0] * p[0] + p[1] * p[1] + p[2] * p[2]).sqrt());
    let mut vertices: Vec<[f64; 3]> = corners.map(on_sphere).to_vec();
    let mut triangles: Vec<[u32; 3]> = vec![
        [0, 11, 5],
        [0, 5, 1],
        [0, 1, 7],
        [0, 7, 10],
        [0, 10, 11],
        [1, 5, 9],
        [5, 11, 4],
        [11, 10, 2],
        [10, 7, 6],
        [7, 1, 8],
        [3, 9, 4],
        [3, 4, 2],
        [3, 2, 6],
        [3, 6, 8],
        [3, 8, 9],
        [4, 9, 5],
        [2, 4, 11],
        [6, 2, 10],
        [8, 6, 7],
        [9, 8, 1],
    ];
    for _ in 0..level {
        let mut middles = std::collections::HashMap::new();
        let mut divided = Vec::with_capacity(4 * triangles.len());
        for [a, b, c] in triangles {
            let [ab, bc, ca] = [(a, b), (b, c), (c, a)].map(|(p, q): (u32, u32)| {
                *middles.entry((p.min(q), p.max(q))).or_insert_with(|| {
                    let (p, q) = (vertices[p as usize], vertices[q as usize]);
                    vertices.push(on_sphere([p[0] + q[0], p[1] + q[1], p[2] + q[2]]));
                    vertices.len() as u32 - 1
                })
            });
            divided.extend([[a, ab, ca], [b, bc, ab], [c, ca, bc], [ab, bc, ca]]);
        }
        triangles = divided;
    }
    let moved = vertices.iter().map(|v| [0, 1, 2].map(|k| v[k] * radius + centre[k])).collect();
    (moved, triangles)
}

pub(crate) fn flipped(mut shape: Shape) -> Shape {
    shape.1.iter_mut().for_each(|t| t.swap(1, 2));
    shape
}

#[test]
fn solids_and_figures_of_a_ball_before_a_wall() {
    let shapes = || vec![icosphere([0.0, 0.0, 2.0], 0.5, 2), wall(4.0)];
    let m = mesh(shapes(), OPTIONS);
    let facts = m.facts();
    assert_eq!((facts.triangles, facts.degenerate, facts.solids, facts.open), (322, 0, 1, 1));
    assert_eq!((facts.largest_open, facts.around_camera), (Some((320, 2)), 0));
    assert!((facts.nearest_m - 1.5).abs() < 0.03 && facts.farthest_m == 4.0);
    assert_eq!((m.solid(0), m.solid(319), m.solid(320)), (0, 0, NOT_SOLID));
    assert_eq!((m.part_of(319), m.part_of(321)), ((0, 319), (1, 1)));
    let none = mesh(shapes(), MeshOptions { solids: false, ..OPTIONS });
    assert_eq!((none.facts().solids, none.facts().open, none.solid(0)), (0, 2, NOT_SOLID));
    let centimetres = mesh(shapes(), MeshOptions { unit_m: 0.01, ..OPTIONS });
    assert!((centimetres.facts().farthest_m - 0.04).abs() < 1e-9);
}

#[test]
fn a_component_with_alpha_is_not_solid() {
    let parts = [part(cuboid([-1.0, -1.0, 2.0], [1.0, 1.0, 3.0]), 0)];
    let mut glass = material(true);
    glass.alpha_mode = AlphaMode::Blend;
    let m = Mesh::new(&parts, &[glass], &pose(), OPTIONS).unwrap();
    assert_eq!((m.facts().solids, m.facts().open), (0, 1));
}

#[test]
fn edges_of_different_parts_are_welded() {
    let (v, t) = cuboid([-1.0, -1.0, 2.0], [1.0, 1.0, 3.0]);
    let halves = vec![(v.clone(), t[..5].to_vec()), (v.clone(), t[5..].to_vec())];
    assert_eq!(mesh(halves, OPTIONS).facts().solids, 1);
    let without_one = vec![(v, t[1..].to_vec())];
    assert_eq!(mesh(without_one, OPTIONS).facts().solids, 0);
}

#[test]
fn a_room_contains_the_camera_whichever_way_it_is_turned() {
    for room in [cuboid([-1.0, -1.0, -1.0], [1.0, 1.0, 4.0]), flipped(cuboid([-1.0; 3], [1.0, 1.0, 4.0]))] {
        let m = mesh(vec![room, icosphere([0.0, 0.0, 2.0], 0.3, 1)], OPTIONS);
        assert_eq!((m.facts().solids, m.facts().around_camera), (2, 1));
        assert!(m.is_around_camera(0) && !m.is_around_camera(1));
    }
}

#[test]
fn a_mirrored_part_keeps_its_front() {
    let mut mirrored = part(cuboid([-1.0, -1.0, 2.0], [1.0, 1.0, 3.0]), 0);
    mirrored.to_world[0][0] = -1.0;
    let (v, t) = cuboid([-1.0, -1.0, 2.0], [1.0, 1.0, 3.0]);
    let m = Mesh::new(&[mirrored], &[material(false)], &pose(), OPTIONS).unwrap();
    assert!(m.is_mirrored(0) && m.is_one_sided(0));
    assert_eq!(m.facts().solids, 1);
    // One half mirrored, the other not: still closed, since corners run counter-clockwise outside in both.
    let mut half =
        part((v.iter().map(|p| [-p[0], p[1], p[2]]).collect(), flipped((v.clone(), t[..6].to_vec())).1), 0);
    half.to_world[0][0] = -1.0;
    let m = Mesh::new(&[half, part((v, t[6..].to_vec()), 0)], &[material(false)], &pose(), OPTIONS).unwrap();
    assert_eq!(m.facts().solids, 1);
}

#[test]
fn bad_meshes_are_errors_that_name_the_place() {
    let of = |shape: Shape, material_number: usize| {
        let materials = [material(true)];
        Mesh::new(&[part(wall(2.0), 0), part(shape, material_number)], &materials, &pose(), OPTIONS).err()
    };
    let name = || "part of 0".to_owned();
    let (v, t) = wall(3.0);
    let mut bad = v.clone();
    bad[2][1] = f64::NAN;
    assert_eq!(of((bad, t.clone()), 0), Some(MeshError::NotFinite { name: name(), vertex: 2 }));
    let mut far = v.clone();
    far[3][0] = 1e39;
    assert_eq!(of((far, t.clone()), 0), Some(MeshError::NotFinite { name: name(), vertex: 3 }));
    let beyond = MeshError::NoVertex { name: name(), triangle: 1, vertex: 4, vertices: 4 };
    assert_eq!(beyond.to_string(), "`part of 0`: triangle 1 has vertex 4, of 4 vertices");
    assert_eq!(of((v.clone(), vec![[0, 1, 2], [0, 4, 1]]), 0), Some(beyond));
    assert!(matches!(of((v.clone(), t.clone()), 1), Some(MeshError::NoMaterial { material: 1, .. })));
    assert_eq!(of((v, vec![[0, 1, 1]]), 0), None);
    let alone = |shape| Mesh::new(&[part(shape, 0)], &[material(true)], &pose(), OPTIONS).err();
    assert_eq!(alone((vec![], vec![])), Some(MeshError::NoTriangles { degenerate: 0 }));
    assert_eq!(
        alone((vec![[0.0, 0.0, 1.0]], vec![[0, 0, 0]])),
        Some(MeshError::NoTriangles { degenerate: 1 })
    );
    assert_eq!(alone(wall(-1.0)), Some(MeshError::NothingInFront { triangles: 2 }));
}

#[test]
fn degenerate_triangles_keep_their_number() {
    let (v, _) = wall(2.0);
    let m = mesh(vec![(v, vec![[0, 0, 1], [0, 1, 2], [0, 2, 3]])], OPTIONS);
    assert_eq!((m.triangles(), m.facts().degenerate), (3, 1));
    assert!(m.is_degenerate(0) && !m.is_degenerate(1));
    assert_eq!(m.part_of(2), (0, 2));
}
