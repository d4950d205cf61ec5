//! PLY files made here.

use crate::mesh::{Limits, MeshError, read_ply};
use pipeline::scene::description::{AlphaMode, Geometry, Positions, Scene};
use pipeline::scratch::Scratch;

fn read(bytes: impl AsRef<[u8]>) -> Result<Scene, MeshError> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("mesh.ply");
    std::fs::write(&path, bytes).unwrap();
    let (scene, sources) = read_ply(&path, &Limits::of_memory(1 << 24))?;
    assert_eq!((sources.len(), &sources[0].path), (1, &path));
    Ok(scene)
}

fn error(bytes: impl AsRef<[u8]>) -> String {
    let message = read(bytes).map(drop).unwrap_err().to_string();
    let (start, rest) = message.split_once("/").unwrap();
    format!("{start}{}", rest.split_once("mesh.ply").unwrap().1.trim_start_matches(", "))
}

/// A header of vertices (`properties`) and faces.
fn header(format: &str, vertices: usize, properties: &[&str], faces: usize, list: &str) -> String {
    let properties: String = properties.iter().map(|p| format!("property {p}\n")).collect();
    format!(
        "ply\nformat {format} 1.0\nelement vertex {vertices}\n{properties}element face {faces}\nproperty list {list} vertex_indices\nend_header\n"
    )
}

const XYZ: [&str; 3] = ["float x", "float y", "float z"];

fn ascii(vertices: &str, faces: &str) -> String {
    let rows = |text: &str| text.lines().count();
    header("ascii", rows(vertices), &XYZ, rows(faces), "uchar int") + vertices + faces
}

const TRIANGLE: &str = "0 0 0\n1 0 0\n0 1 0.1\n";

fn f32s(geometry: &Geometry) -> &[[f32; 3]] {
    match &geometry.positions {
        Positions::F32(positions) => positions,
        Positions::F64(_) => panic!("f64"),
    }
}

#[test]
fn ascii_polygons_become_triangles() {
    let scene = read(ascii(&format!("{TRIANGLE}1 1 0\n"), "4 0 1 3 2\n3 0 1 2\n2 0 1\n")).unwrap();
    let part = &scene.parts[0];
    assert_eq!(
        (part.name.as_str(), &part.geometry.triangles[..]),
        ("mesh", &[[0, 1, 3], [0, 3, 2], [0, 1, 2]][..])
    );
    assert_eq!(f32s(&part.geometry)[2], [0.0, 1.0, 0.1]);
    assert_eq!((scene.materials[0].colour, scene.materials[0].two_sided), ([0.8; 3], true));
    assert_eq!(
        scene.notes,
        ["1 face with less than 3 corners ignored", "vertices without colour are 0.8 grey"]
    );
}

#[test]
fn concave_polygon_is_divided_inside_itself() {
    let scene = read(ascii("0 0 0\n4 1 0\n0 2 0\n1 1 0\n", "4 0 1 2 3\n")).unwrap();
    assert!(scene.parts[0].geometry.triangles.iter().all(|t| t.contains(&3) && t.contains(&1)));
}

/// The same rows as text and as bytes of both orders: columns of each type, skipped elements before, between and after.
#[test]
fn ascii_and_both_byte_orders_agree() {
    let header = |format: &str| {
        format!(
            "ply\r\nformat {format} 1.0\r\ncomment made \"here\"\r\nobj_info x\r\n\r\nelement camera 1\r\nproperty double d\r\nproperty list ushort short l\r\n\
             element vertex 3\r\nproperty uchar red\r\nproperty float32 x\r\nproperty float y\r\nproperty short z\r\nproperty list uint8 float weights\r\nproperty uchar green\r\nproperty uchar blue\r\nproperty uchar alpha\r\n\
             property float nx\r\nproperty double ny\r\nproperty char nz\r\nproperty float texture_u\r\nproperty float texture_v\r\n\
             element edge 2\r\nproperty int a\r\nelement face 1\r\nproperty uint flags\r\nproperty list int ushort vertex_index\r\nproperty list uchar float texcoord\r\nend_header\r\n"
        )
    };
    let text = "1.5 2 -7 8\r\n\
                255 0 0.5 -3 0 0 127 255 0 1e-3 1 0.25 0.75\r\n\r\n\
                0 1 0.5 -3 2 9 9 10 20 255 0 0 1 0 0\n\
                1 2 0.5 300 1 9 10 20 51 0 0 1 1 1\r\n\
                5\r\n6\r\n4000000000 3 2 1 0 6 0 0 0 0 0 0\r\n";
    let bytes = |big: bool| {
        let mut out = Vec::new();
        let mut put = |bytes: &[u8]| match big {
            true => out.extend(bytes.iter().rev()),
            false => out.extend_from_slice(bytes),
        };
        put(&1.5f64.to_le_bytes());
        put(&2u16.to_le_bytes());
        put(&(-7i16).to_le_bytes());
        put(&8i16.to_le_bytes());
        for (red, x, z, weights, [green, blue, alpha], n, uv) in [
            (255u8, 0f32, -3i16, 0u8, [0u8, 127, 255], (0f32, 1e-3f64, 1i8), [0.25f32, 0.75]),
            (0, 1.0, -3, 2, [10, 20, 255], (0.0, 0.0, 1), [0.0, 0.0]),
            (1, 2.0, 300, 1, [10, 20, 51], (0.0, 0.0, 1), [1.0, 1.0]),
        ] {
            put(&[red]);
            put(&x.to_le_bytes());
            put(&0.5f32.to_le_bytes());
            put(&z.to_le_bytes());
            put(&[weights]);
            (0..weights).for_each(|_| put(&9f32.to_le_bytes()));
            [green, blue, alpha].iter().for_each(|&v| put(&[v]));
            put(&n.0.to_le_bytes());
            put(&n.1.to_le_bytes());
            put(&n.2.to_le_bytes());
            uv.iter().for_each(|v| put(&v.to_le_bytes()));
        }
        put(&5i32.to_le_bytes());
        put(&6i32.to_le_bytes());
        put(&4_000_000_000u32.to_le_bytes());
        put(&3i32.to_le_bytes());
        [2u16, 1, 0].iter().for_each(|v| put(&v.to_le_bytes()));
        put(&[6]);
        (0..6).for_each(|_| put(&0f32.to_le_bytes()));
        out
    };
    let files = [
        (header("ascii") + text).into_bytes(),
        [header("binary_little_endian").into_bytes(), bytes(false)].concat(),
        [header("binary_big_endian").into_bytes(), bytes(true)].concat(),
    ];
    for file in files {
        let scene = read(file).unwrap();
        let geometry = &*scene.parts[0].geometry;
        assert_eq!(geometry.triangles, [[2, 1, 0]]);
        assert_eq!(f32s(geometry), [[0.0, 0.5, -3.0], [1.0, 0.5, -3.0], [2.0, 0.5, 300.0]]);
        assert_eq!(geometry.normals[0], [0.0, 1e-3, 1.0]);
        assert_eq!(geometry.texcoords, [[[0.25, 0.25], [0.0, 1.0], [1.0, 0.0]]]);
        let colours = &geometry.colours;
        assert_eq!((colours[0][0], colours[0][1], colours[0][3], colours[2][3]), (1.0, 0.0, 1.0, 0.2));
        // sRGB 127/255.
        assert!((colours[0][2] - 0.212_230_76).abs() < 1e-7);
        assert_eq!((scene.materials[0].alpha_mode, scene.materials[0].colour), (AlphaMode::Blend, [1.0; 3]));
        assert_eq!(
            scene.notes,
            [
                r#"properties "weights" of element "vertex" are ignored"#,
                r#"properties "flags", "texcoord" of element "face" are ignored"#,
                r#"elements "camera" (1 row), "edge" (2 rows) are ignored"#,
            ]
        );
    }
}

#[test]
fn lines_of_the_header_may_end_with_cr() {
    let text = ascii(TRIANGLE, "3 0 1 2\n").replace('\n', "\r");
    assert_eq!(read(text).unwrap().parts[0].geometry.triangles, [[0, 1, 2]]);
    let mut binary = header("binary_little_endian", 3, &["char x", "char y", "char z"], 1, "uchar uchar")
        .replace('\n', "\r")
        .into_bytes();
    // The first row starts with the code of LF.
    binary.extend([10, 0, 0, 1, 0, 0, 0, 1, 0, 3, 0, 1, 2]);
    assert_eq!(f32s(&read(binary).unwrap().parts[0].geometry)[0], [10.0, 0.0, 0.0]);
}

#[test]
fn types_of_positions_and_colours() {
    for (of, is_double) in
        [("double", true), ("int", true), ("uint32", true), ("float32", false), ("int16", false)]
    {
        let text = header("ascii", 3, &["float x", &format!("{of} y"), "uchar z"], 1, "uchar uint")
            + "0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n";
        let scene = read(text).unwrap();
        assert_eq!(matches!(scene.parts[0].geometry.positions, Positions::F64(_)), is_double, "{of}");
    }
    let colour = |of: &str, value: &str| {
        let properties = XYZ
            .map(String::from)
            .into_iter()
            .chain(["diffuse_red", "diffuse_green", "diffuse_blue"].map(|c| format!("{of} {c}")));
        let properties: Vec<String> = properties.collect();
        let names: Vec<&str> = properties.iter().map(String::as_str).collect();
        let row = format!("0 0 0 {value} 0 0\n");
        read(header("ascii", 3, &names, 1, "uchar int") + &row.repeat(3) + "3 0 1 2\n").unwrap()
    };
    assert_eq!(colour("float", "0.5").parts[0].geometry.colours[0], [0.5, 0.0, 0.0, 1.0]);
    assert_eq!(colour("ushort", "65535").parts[0].geometry.colours[0], [1.0, 0.0, 0.0, 1.0]);
    assert_eq!(colour("uchar", "255").parts[0].geometry.colours[0], [1.0, 0.0, 0.0, 1.0]);
    assert!(
        colour("float", "255").notes[0]
            .starts_with("vertices whose colours are outside 0…1 and are clipped: 3")
    );
}

#[test]
fn alpha_of_zero_everywhere_is_ignored() {
    let properties =
        ["float x", "float y", "float z", "uchar red", "uchar green", "uchar blue", "uchar alpha"];
    let scene = read(
        header("ascii", 3, &properties, 1, "uchar int") + &"0 0 0 255 255 255 0\n".repeat(3) + "3 0 1 2\n",
    )
    .unwrap();
    assert_eq!(scene.materials[0].alpha_mode, AlphaMode::Opaque);
    assert_eq!(scene.notes, ["the alpha of all vertices is 0, and is ignored"]);
}

#[test]
fn strips_alternate_and_end_at_negative_indices() {
    let text = header("ascii", 4, &XYZ, 1, "int int").replace("element face", "element tristrips")
        + "0 0 0\n1 0 0\n0 1 0\n1 1 0\n11 0 1 2 3 3 -1 2 1 0 -1 1\n";
    let scene = read(text).unwrap();
    assert_eq!(scene.parts[0].geometry.triangles, [[0, 1, 2], [2, 1, 3], [2, 1, 0]]);
}

#[test]
fn unknown_header_lines_and_texture_comments_are_notes() {
    let text = ascii(TRIANGLE, "3 0 1 2\n")
        .replace("element vertex", "Created by a program\ncomment TextureFile a.png\nelement vertex")
        + "\n\nmore\n";
    assert_eq!(
        read(text).unwrap().notes,
        [
            "the header has lines of unknown meaning, which are skipped",
            "the texture of a comment TextureFile is not read",
            "the file has more data than its header declares; they are ignored",
            "vertices without colour are 0.8 grey",
        ]
    );
}

#[test]
fn wrong_headers_are_errors_with_their_line() {
    let good = ascii(TRIANGLE, "3 0 1 2\n");
    for (from, to, expected) in [
        ("ply\n", "plx\n", r#"line 1: expected ply, found "plx\nformat ascii""#),
        (
            "ascii 1.0",
            "ascii 2.0",
            r#"line 2: expected format ascii, binary_little_endian or binary_big_endian, and 1.0, found "format ascii 2.0""#,
        ),
        ("format ascii 1.0\n", "", r#"line 8: expected a line `format` before it, found end_header"#),
        ("vertex 3", "vertex -3", r#"line 3: expected element NAME ROWS, found "element vertex -3""#),
        (
            "vertex 3",
            "vertex 99999999999999999999",
            r#"line 3: expected element NAME ROWS, found "element vertex 99999999999999999999""#,
        ),
        (
            "float x",
            "half x",
            r#"line 4: expected property TYPE NAME or property list TYPE TYPE NAME; a type is char, uchar, short, ushort, int, uint, float or double, a count an integer, found "property half x""#,
        ),
        ("element vertex 3\n", "", r#"line 3: expected element before property, found "property float x""#),
        (
            "element face",
            "element vertex",
            r#"line 7: expected one element vertex and one element face, found "element vertex 1""#,
        ),
        ("end_header", "end", r#"line 14: expected end_header, found the end of the file"#),
        ("float x", "float w", r#"element "vertex": expected properties x, y and z, found "w", "y", "z""#),
        (
            "uchar int",
            "uchar float",
            r#"element "face": expected a list vertex_indices of whole numbers, found none"#,
        ),
    ] {
        let text = good.replacen(from, to, 1);
        assert_eq!(error(&text), format!("reading mesh {expected}"), "{from} → {to}");
    }
}

#[test]
fn wrong_rows_are_errors_with_line_and_row() {
    for (vertices, faces, expected) in [
        (
            "0 0 0\n1 0\n0 1 0\n",
            "3 0 1 2\n",
            r#"line 11, row 1 of element "vertex": expected a number for each property, found the end of the line"#,
        ),
        (
            "0 0 0\n1 0 0 0\n0 1 0\n",
            "3 0 1 2\n",
            r#"line 11, row 1 of element "vertex": expected the end of the line after the last property, found "0""#,
        ),
        (
            "0 0 0\n\n1,5 0 0\n0 1 0\n",
            "3 0 1 2\n",
            r#"line 12, row 1 of element "vertex": expected a number with a decimal point, not a comma; export the file again in an English locale, found "1,5""#,
        ),
        (
            "nan 0 0\n1 0 0\n0 1 0\n",
            "3 0 1 2\n",
            r#"line 10, row 0 of element "vertex": expected a finite number, found "nan""#,
        ),
        (
            "1e39 0 0\n1 0 0\n0 1 0\n",
            "3 0 1 2\n",
            r#"line 10, row 0 of element "vertex": expected a finite number, found "1e39""#,
        ),
        (
            TRIANGLE,
            "3 0 1 3\n",
            r#"line 13, row 0 of element "face": expected a vertex index of 0 to 2, found 3"#,
        ),
        (
            TRIANGLE,
            "3 0 1 -1\n",
            r#"line 13, row 0 of element "face": expected a vertex index of 0 to 2, found -1"#,
        ),
        (
            TRIANGLE,
            "3 0 1 1.5\n",
            r#"line 13, row 0 of element "face": expected a whole number of -2147483648 to 2147483647, found "1.5""#,
        ),
        (
            TRIANGLE,
            "300 0 1 2\n",
            r#"line 13, row 0 of element "face": expected a whole number of 0 to 255, found "300""#,
        ),
        (
            TRIANGLE,
            "200 0 1 2\n",
            r#"line 13, row 0 of element "face": expected a list "vertex_indices" of 0 to 3 values, for which there is data, found 200 values"#,
        ),
    ] {
        let text = ascii(vertices, faces).replace("vertex 4", "vertex 3");
        assert_eq!(error(text), format!("reading mesh {expected}"));
    }
}

#[test]
fn fewer_rows_than_declared_are_an_error_with_counts() {
    let text = ascii(TRIANGLE, "3 0 1 2\n").replace("face 1", "face 7");
    assert_eq!(
        error(text),
        r#"reading mesh element "face": expected 7 rows; is the file truncated?, found 1 complete rows before the end of the file"#
    );
    let text = ascii(TRIANGLE, "").replace("vertex 3", "vertex 9000000000000000000");
    assert!(
        error(text).contains("expected 9000000000000000000 rows; is the file truncated?, found 3 complete")
    );
    let binary = |vertices: usize, faces: usize, list: &[u8]| {
        let mut bytes =
            header("binary_big_endian", vertices, &["char x", "char y", "char z"], faces, "int int")
                .into_bytes();
        bytes.extend([0, 0, 0, 1, 0, 0, 0, 1, 0]);
        bytes.extend(list);
        bytes
    };
    let triangle = [0, 0, 0, 3, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 2];
    assert!(read(binary(3, 1, &triangle)).is_ok());
    assert!(
        error(binary(3, 2, &triangle))
            .contains("expected 2 rows; is the file truncated?, found 1 complete rows")
    );
    assert!(
        error(binary(100_000, 2, &triangle))
            .contains("expected 100000 rows; is the file truncated?, found 8 complete rows")
    );
    // Lists of 2³¹ − 1 and of −1 values.
    assert!(
        error(binary(3, 1, &[0x7F, 0xFF, 0xFF, 0xFF, 0, 0, 0, 0]))
            .ends_with("of 0 to 1 values, for which there is data, found 2147483647 values")
    );
    assert!(error(binary(3, 1, &[0xFF; 8])).ends_with("found -1 values"));
}

#[test]
fn not_finite_binary_numbers_are_errors_with_their_byte() {
    let mut bytes =
        header("binary_little_endian", 1, &["float x", "double y", "float z"], 0, "int int").into_bytes();
    let body = bytes.len();
    bytes.extend(1f32.to_le_bytes());
    bytes.extend(f64::NEG_INFINITY.to_le_bytes());
    bytes.extend(1f32.to_le_bytes());
    assert_eq!(
        error(bytes),
        format!(
            r#"reading mesh byte {}, row 0 of element "vertex": expected a finite number "y", found -inf"#,
            body + 12
        )
    );
}

#[test]
fn a_file_without_triangles_says_what_it_has() {
    assert!(error(ascii(TRIANGLE, "2 0 1\n")).ends_with(": no triangles: found vertices: 3, faces: 1"));
    assert!(
        error("ply\nformat ascii 1.0\nend_header\n").ends_with(": no triangles: found vertices: 0, faces: 0")
    );
    assert!(error("").ends_with(r#"line 1: expected ply, found """#));
}

#[test]
fn elements_without_properties_have_no_rows() {
    let text = ascii(TRIANGLE, "3 0 1 2\n")
        .replace("element vertex", "element nothing 9000000000000000000\nelement vertex");
    assert_eq!(read(text).unwrap().parts[0].geometry.triangles.len(), 1);
}

#[test]
fn lists_beyond_memory_are_in_a_scratch_file_and_have_the_same_values() {
    let side = 150;
    let vertices: String = (0..side * side).map(|k| format!("{} {} {k}\n", k % side, k / side)).collect();
    let quad = |k: usize| format!("4 {k} {} {} {}\n", k + 1, k + side + 1, k + side);
    let faces: String =
        (0..side - 1).flat_map(|row| (0..side - 1).map(move |k| quad(row * side + k))).collect();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("net.ply");
    std::fs::write(&path, ascii(&vertices, &faces)).unwrap();
    let of = |scratch: Scratch| {
        let limits = Limits { scratch, ..Limits::of_memory(1 << 24) };
        let scene = read_ply(&path, &limits).unwrap().0;
        let geometry = &scene.parts[0].geometry;
        (f32s(geometry).to_vec(), geometry.triangles.to_vec(), geometry.bytes())
    };
    let (positions, triangles, in_memory) = of(Scratch::default());
    let scratch = Scratch::new(folder.path(), 0);
    assert!(of(scratch.clone()) == (positions, triangles, 0));
    assert!(in_memory > 500_000 && scratch.file_bytes() > 1_000_000);
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
}
