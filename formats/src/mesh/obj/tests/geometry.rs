//! Vertices, faces and parts.

use super::*;
use pipeline::scene::description::{Geometry, Positions};

fn positions(geometry: &Geometry) -> &[[f64; 3]] {
    match &geometry.positions {
        Positions::F64(positions) => positions,
        Positions::F32(_) => panic!("f32"),
    }
}

#[test]
fn polygon_with_texture_coordinates_and_normals_becomes_triangles() {
    let scene = Files::new(
        "v 0 0 0.1\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0.25\nvt 1 1 7\nvn 0 0 2\nf 1/1/1 2/2/1 3/2/1 4/1/1 # quad\n",
    )
    .scene();
    let part = &scene.parts[0];
    let geometry = &*part.geometry;
    assert_eq!((scene.parts.len(), part.name.as_str(), part.node), (1, "mesh", 0));
    assert_eq!(positions(geometry), [[0.0, 0.0, 0.1], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]]);
    assert_eq!(geometry.triangles, [[0, 1, 2], [0, 2, 3]]);
    assert_eq!(geometry.texcoords, [[[0.0, 0.75], [1.0, 0.0], [1.0, 0.0], [0.0, 0.75]]]);
    assert_eq!(geometry.normals, [[0.0, 0.0, 2.0]; 4]);
    assert!(geometry.colours.is_empty());
    let material = &scene.materials[part.material];
    assert_eq!((material.colour, material.two_sided), ([0.8; 3], true));
    assert_eq!(scene.notes, ["faces without material (usemtl) are 0.8 grey"]);
}

#[test]
fn vertices_are_shared_where_all_their_numbers_are_equal() {
    let scene =
        Files::new(format!("{TRIANGLE}v 1 1 0\nvt 0 0\nvt 1 0\nf 1/1 2/1 3/1\nf 2/1 4/1 3/2\nf 2/1 4/1 3/2"))
            .scene();
    let geometry = &scene.parts[0].geometry;
    assert_eq!(geometry.triangles, [[0, 1, 2], [1, 3, 4], [1, 3, 4]]);
    assert_eq!(positions(geometry)[2], positions(geometry)[4]);
}

#[test]
fn negative_indices_count_backwards_and_faces_may_precede_vertices() {
    let scene = Files::new(format!("f 4 5 6\n{TRIANGLE}f -3 -2 -1\nv 5 0 0\nv 6 0 0\nv 7 0 0\n")).scene();
    let geometry = &scene.parts[0].geometry;
    assert_eq!(geometry.triangles, [[0, 1, 2], [3, 4, 5]]);
    assert_eq!(positions(geometry).map_x(), [5.0, 6.0, 7.0, 0.0, 1.0, 0.0]);
}

trait MapX {
    fn map_x(&self) -> Vec<f64>;
}

impl MapX for [[f64; 3]] {
    fn map_x(&self) -> Vec<f64> {
        self.iter().map(|p| p[0]).collect()
    }
}

#[test]
fn parts_are_object_group_and_material_in_the_order_of_the_first_face() {
    let mesh = format!(
        "{TRIANGLE}o one\ng side\nusemtl red\nf 1 2 3\nusemtl blue\nf 1 2 3\no two\ng two\nf 3 2 1\no one\ng side\nusemtl red\nf 2 3 1\no\ng far left\nf 1 2 3"
    );
    let scene = Files::new(mesh).scene();
    let parts: Vec<_> = scene
        .parts
        .iter()
        .map(|p| {
            (p.name.as_str(), p.node, scene.materials[p.material].name.as_str(), p.geometry.triangles.len())
        })
        .collect();
    assert_eq!(
        parts,
        [
            ("one/side", 0, "red", 2),
            ("one/side", 0, "blue", 1),
            ("two", 1, "blue", 1),
            ("far left", 2, "red", 1)
        ]
    );
    assert_eq!(
        scene.notes,
        [
            r#"materials without definition, which are 0.8 grey or have the colours of vertices: "red", "blue""#
        ]
    );
}

#[test]
fn corners_without_normals_or_texture_coordinates_are_parts_of_their_own() {
    let mesh = format!("{TRIANGLE}vt 0 0\nvn 0 0 1\nf 1/1/1 2/1/1 3/1/1\nf 1//1 2//1 3//1\nf 1/1 2/1/ 3\n");
    let scene = Files::new(mesh).scene();
    let kinds: Vec<_> =
        scene.parts.iter().map(|p| (p.geometry.texcoords.len(), p.geometry.normals.len())).collect();
    assert_eq!(kinds, [(1, 3), (0, 3), (0, 0)]);
    assert_eq!(
        scene.notes[0],
        "1 face with texture coordinates or normals at some corners only, which are ignored"
    );
}

#[test]
fn concave_polygon_is_divided_inside_itself() {
    let scene = Files::new("v 0 0 3\nv 0 4 3\nv 0 1 2\nv 0 0 0\nf 1 2 3 4").scene();
    assert_eq!(scene.parts[0].geometry.triangles.len(), 2);
    let scene = Files::new("v 0 0 0\nv 4 1 0\nv 0 2 0\nv 1 1 0\nf 1 2 3 4").scene();
    let (geometry, mut area) = (&scene.parts[0].geometry, 0.0);
    for t in &geometry.triangles[..] {
        let [a, b, c] = t.map(|i| positions(geometry)[i as usize]);
        let twice = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
        assert!(twice > 0.0);
        area += twice / 2.0;
    }
    assert!((area - 3.0).abs() < 1e-15);
}

#[test]
fn colours_of_vertices_are_decoded_and_others_are_white() {
    let scene =
        Files::new("v 0 0 0 1 0.5 0\nv 1 0 0\nv 0 1 0 2 0 0\nv 0 0 1 1\nv 0 0 2 0.5\nf 1 2 3\nf 1 2 4")
            .scene();
    let colours = &scene.parts[0].geometry.colours;
    assert_eq!((colours[0][0], colours[0][2], colours[0][3]), (1.0, 0.0, 1.0));
    // sRGB 0.5: ((0.5 + 0.055)/1.055)^2.4.
    assert!((colours[0][1] - 0.214_041_14).abs() < 1e-7);
    assert_eq!(colours[1..], [[1.0; 4], [1.0, 0.0, 0.0, 1.0], [1.0; 4]]);
    assert_eq!(scene.materials[0].colour, [1.0; 3]);
    assert_eq!(
        scene.notes,
        [
            "vertices whose weight (w) is not applied: 1",
            "vertices without colour are white: 2",
            "vertices whose colours are outside 0…1 and are clipped: 1; colours of 0…255 must be divided by 255"
        ]
    );
}

#[test]
fn colours_of_vertices_without_surface_have_no_note() {
    let scene =
        Files::new("v 0 0 0 1 1 0\nv 1 0 0 1 0 0\nv 0 1 0 0 0 1\nv 9 9 9\nv 9 9 8 255 0 0\nf 1 2 3").scene();
    assert_eq!((scene.notes.len(), scene.parts[0].geometry.colours.len()), (0, 3), "{:?}", scene.notes);
}
