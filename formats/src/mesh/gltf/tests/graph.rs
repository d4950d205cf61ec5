//! Nodes: order, matrices, cameras, lights, graphs that are no trees.

use std::f64::consts::{FRAC_1_SQRT_2, FRAC_PI_4};

use serde_json::{Value, json};

use super::file::File;
use super::{error, message, scene};
use pipeline::scene::description::LightKind;

/// A triangle at each node; node 0 is the root.
fn tree(nodes: Value) -> File {
    let mut file = File::triangle();
    file.json["nodes"] = nodes;
    file
}

#[test]
fn nodes_depth_first_in_the_order_of_the_file() {
    let mut file = tree(json!([
        {"name": "a", "mesh": 0, "children": [3, 1]},
        {"name": "b", "mesh": 0},
        {"name": "other root", "mesh": 0},
        {"name": "c", "mesh": 0, "children": [4]},
        {"mesh": 0},
    ]));
    let nodes = |file: &File| scene(file).parts.iter().map(|part| part.node).collect::<Vec<_>>();
    assert_eq!(nodes(&file), [0, 3, 4, 1]);
    assert_eq!(scene(&file).parts[2].name, "node 4");
    // The default scene, else the first, else all roots.
    file.json["scenes"] = json!([{"nodes": [0]}, {"nodes": [2, 0], "name": "Both"}]);
    assert_eq!(nodes(&file), [0, 3, 4, 1]);
    file.json["scene"] = json!(1);
    assert_eq!(nodes(&file), [2, 0, 3, 4, 1]);
    assert_eq!(scene(&file).notes[0], "of 2 scenes number 1 (\"Both\") is read");
    file.json.as_object_mut().unwrap().remove("scene");
    assert_eq!(nodes(&file), [0, 3, 4, 1]);
    file.json.as_object_mut().unwrap().remove("scenes");
    assert_eq!(nodes(&file), [0, 3, 4, 1, 2]);
}

#[test]
fn matrices_are_products_in_f64() {
    // UTM coordinates: f32 would round them to 0.5 m.
    let file = tree(json!([
        {"translation": [5_000_000.123, 0.0, 0.0], "children": [1]},
        {"translation": [0.001, 2.0, 0.0], "rotation": [0.0, 0.0, FRAC_1_SQRT_2, FRAC_1_SQRT_2], "scale": [2.0, 3.0, 4.0], "mesh": 0},
    ]));
    let m = scene(&file).parts[0].to_world;
    assert_eq!([m[0][3], m[1][3], m[2][3]], [5_000_000.123 + 0.001, 2.0, 0.0]);
    // A quarter turn about z takes x to y, and y to −x, after the scale; a few ulp of √½ squared.
    let expected = [[0.0, -3.0, 0.0], [2.0, 0.0, 0.0], [0.0, 0.0, 4.0]];
    for (row, expected) in m.iter().zip(expected) {
        assert!(row.iter().zip(expected).all(|(a, b): (&f64, f64)| (a - b).abs() < 1e-15), "{m:?}");
    }
    // By columns in the file.
    let columns = [1, 5, 9, 0, 2, 6, 10, 0, 3, 7, 11, 0, 4, 8, 12, 1];
    let m = scene(&tree(json!([{"matrix": columns, "mesh": 0}]))).parts[0].to_world;
    assert_eq!(m, [[1., 2., 3., 4.], [5., 6., 7., 8.], [9., 10., 11., 12.], [0., 0., 0., 1.]]);
}

#[test]
fn matrices_that_are_refused() {
    let projective = json!([{"matrix": [1, 0, 0, 0.5, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1], "mesh": 0}]);
    assert_eq!(
        error(&tree(projective)),
        ", nodes[0].matrix: expected last row 0, 0, 0, 1, found [0.5, 0.0, 0.0, 1.0]"
    );
    let zero = json!([{"rotation": [0, 0, 0, 0], "mesh": 0}]);
    assert_eq!(
        error(&tree(zero)),
        ", nodes[0].rotation: expected a unit quaternion, found [0.0, 0.0, 0.0, 0.0]"
    );
    let huge = json!([{"scale": [1e200, 1, 1], "children": [1]}, {"scale": [1e200, 1, 1], "mesh": 0}]);
    let expected =
        ", nodes[1]: expected a finite matrix, found NaN or infinity in the product with its parents";
    assert_eq!(error(&tree(huge)), expected);
    let text = br#"{"asset": {"version": "2.0"}, "nodes": [{"translation": [1e999, 0, 0]}]}"#;
    assert!(message(text).contains("JSON line 1, column"), "{}", message(text));
    let long = tree(json!([{"rotation": [0, 0, 0, 2], "mesh": 0}]));
    assert_eq!(scene(&long).parts[0].to_world[0], [1., 0., 0., 0.]);
    assert_eq!(scene(&long).notes[0], "rotations of a length other than 1 are normalised");
}

#[test]
fn cameras_under_scaled_and_rotated_parents() {
    let mut file = tree(json!([
        {"scale": [2, 2, 2], "children": [1], "mesh": 0},
        {"rotation": [0, FRAC_1_SQRT_2, 0, FRAC_1_SQRT_2], "translation": [1, 2, 3], "camera": 0, "name": "Cam1", "children": [2, 3]},
        {"camera": 1},
        {"camera": 0},
    ]));
    file.json["cameras"] = json!([
        {"type": "perspective", "perspective": {"yfov": 0.7, "znear": 0.01}},
        {"type": "orthographic", "name": "Plan", "orthographic": {"xmag": 1, "ymag": 1, "zfar": 100, "znear": 0.01}},
    ]);
    let cameras = scene(&file).cameras;
    let names: Vec<_> = cameras.iter().map(|camera| camera.name.as_str()).collect();
    assert_eq!(names, ["Cam1", "Plan", "camera 2"]);
    assert_eq!((cameras[0].yfov_rad, cameras[1].yfov_rad), (Some(0.7), None));
    let m = cameras[0].to_world;
    assert_eq!([m[0][3], m[1][3], m[2][3]], [2., 4., 6.]);
    // A quarter turn about y: the view axis −Z becomes −X; +Y stays; both have the scale of the parent.
    let column = |c: usize| [m[0][c], m[1][c], m[2][c]];
    let near = |a: [f64; 3], b: [f64; 3]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-15);
    assert!(near(column(2), [2., 0., 0.]) && near(column(1), [0., 2., 0.]), "{m:?}");
    file.json["cameras"][0]["perspective"]["yfov"] = json!(4);
    assert_eq!(error(&file), ", cameras[0].perspective.yfov: expected an angle between 0 and π, found 4");
    file.json["cameras"][0] = json!({"type": "fisheye"});
    assert_eq!(error(&file), ", cameras[0].type: expected perspective or orthographic, found \"fisheye\"");
    file.json["cameras"] = json!([]);
    assert_eq!(error(&file), ", nodes[1]: expected a number below 0 (cameras), found 0");
}

#[test]
fn lights() {
    let mut file = tree(json!([
        {"mesh": 0, "children": [1, 2, 3]},
        {"extensions": {"KHR_lights_punctual": {"light": 0}}},
        {"extensions": {"KHR_lights_punctual": {"light": 1}}, "translation": [0, 3, 0], "name": "Lamp"},
        {"extensions": {"KHR_lights_punctual": {"light": 2}}},
    ]));
    file.json["extensionsRequired"] = json!(["KHR_lights_punctual"]);
    file.json["extensions"]["KHR_lights_punctual"]["lights"] = json!([
        {"type": "directional", "intensity": 100_000, "color": [1, 0.9, 0.8], "name": "Sun"},
        {"type": "point", "range": 5},
        {"type": "spot", "spot": {"innerConeAngle": 0.1}, "intensity": 20},
    ]);
    let lights = scene(&file).lights;
    assert_eq!(
        (lights[0].name.as_str(), lights[0].intensity, lights[0].kind),
        ("Sun", 1e5, LightKind::Directional)
    );
    assert_eq!(lights[0].colour, [1.0, 0.9, 0.8]);
    assert_eq!((lights[1].name.as_str(), lights[1].intensity), ("Lamp", 1.0));
    assert_eq!((lights[1].kind, lights[1].to_world[1][3]), (LightKind::Point(Some(5.0)), 3.0));
    assert_eq!((lights[2].name.as_str(), lights[2].kind), ("light 2", LightKind::Spot(0.1, FRAC_PI_4, None)));
    file.json["extensions"]["KHR_lights_punctual"]["lights"][2]["spot"]["innerConeAngle"] = json!(1);
    assert!(
        error(&file).contains("lights[2].spot: expected angles 0 ≤ inner < outer ≤ π/2"),
        "{}",
        error(&file)
    );
    file.json["extensions"]["KHR_lights_punctual"]["lights"][0]["intensity"] = json!(-1);
    assert!(
        error(&file).contains("lights[0].intensity: expected a number from 0 on, found -1"),
        "{}",
        error(&file)
    );
}

#[test]
fn graphs_that_are_no_trees() {
    let cycle = tree(json!([{"children": [1]}, {"children": [2]}, {"children": [0], "mesh": 0}]));
    let expected = ", nodes[0].children: expected a tree of nodes, found nodes[0] among its own descendants";
    assert_eq!(error(&cycle), expected);
    let own = tree(json!([{"mesh": 0}, {"children": [1]}]));
    assert_eq!(error(&own), expected.replace("nodes[0]", "nodes[1]"));
    let shared = tree(json!([{"children": [1, 2]}, {"children": [2]}, {"mesh": 0}]));
    let expected = ", nodes[1].children[0]: expected a node with one parent, found nodes[2], which is also a child of nodes[0]";
    assert_eq!(error(&shared), expected);
    let absent = tree(json!([{"children": [7]}]));
    assert_eq!(error(&absent), ", nodes[0].children[0]: expected a number below 1 (nodes), found 7");
    let mut child = tree(json!([{"children": [1]}, {"mesh": 0}]));
    child.json["scenes"][0]["nodes"] = json!([1]);
    let expected =
        ", scenes[0].nodes[0]: expected a node without a parent, found nodes[1], a child of nodes[0]";
    assert_eq!(error(&child), expected);
    child.json["scenes"][0]["nodes"] = json!([0, 0]);
    assert_eq!(error(&child), ", scenes: expected each root node once, found nodes[0] twice");
    child.json["scene"] = json!(4_294_967_296_u64);
    assert_eq!(error(&child), ", scene: expected a number below 1 (scenes), found 4294967296");
}

#[test]
fn depth_is_limited() {
    let chain = |length: usize| {
        let mut nodes: Vec<Value> = (1..length).map(|k| json!({"children": [k]})).collect();
        nodes.push(json!({"mesh": 0}));
        tree(json!(nodes))
    };
    assert_eq!(scene(&chain(1000)).parts[0].node, 999);
    assert_eq!(
        error(&chain(1001)),
        ", nodes[1000]: expected at most 1000 nodes from root to leaf, found more"
    );
}
