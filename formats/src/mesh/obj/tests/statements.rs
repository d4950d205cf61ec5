//! Statements and lines of OBJ files: wrong and ignored ones, encodings, the limit of memory.

use super::*;
use std::path::Path;

#[test]
fn wrong_statements_are_errors_with_their_line() {
    for (statement, expected) in [
        ("f 1 2 0", r#"expected a vertex index of 1 to 3, or -1 to -3 counted backwards, found "0""#),
        ("f 1 2 4", r#"expected a vertex index of 1 to 3, or -1 to -3 counted backwards, found "4""#),
        ("f 1 2 -4", r#"expected a vertex index of 1 to 3, or -1 to -3 counted backwards, found "-4""#),
        (
            "f 1 2 99999999999999999999",
            r#"expected a vertex index of 1 to 3, or -1 to -3 counted backwards, found "99999999999999999999""#,
        ),
        (
            "f 1/1 2/1 3/1",
            r#"expected a texture coordinate index of 1 to 0, or -1 to -0 counted backwards, found "1/1""#,
        ),
        ("f 1//9 2 3", r#"expected a normal index of 1 to 0, or -1 to -0 counted backwards, found "1//9""#),
        ("f 1 2 3#4", r#"expected a vertex index of 1 to 3, or -1 to -3 counted backwards, found "3#4""#),
        ("f 1/// 2 3", r#"expected a corner v, v/vt, v//vn or v/vt/vn, found "1///""#),
        ("f /1 2 3", r#"expected a vertex index of 1 to 3, or -1 to -3 counted backwards, found "/1""#),
        (
            "v 1,5 2 3",
            r#"expected a number with a decimal point, not a comma; export the file again in an English locale, found "1,5""#,
        ),
        (
            "v 1.#QNAN 2 3",
            r#"expected a finite number (the program that wrote it computed no valid number), found "1.#QNAN""#,
        ),
        ("v nan 2 3", r#"expected a finite number, found "nan""#),
        ("v 1 -inf 3", r#"expected a finite number, found "-inf""#),
        ("v 1 1e999 3", r#"expected a finite number, found "1e999""#),
        ("v 1 2", r#"expected v with 3 coordinates, a weight or 3 colour values after them, found "v 1 2""#),
        (
            "v 1 2 3 4 5",
            r#"expected v with 3 coordinates, a weight or 3 colour values after them, found "v 1 2 3 4 5""#,
        ),
        ("v 1 2 3 4 5 6 7", r#"expected at most 6 numbers, found "1 2 3 4 5 6 7""#),
        ("vt", r#"expected vt with 1 to 3 coordinates, found "vt""#),
        ("vt 1e39", "expected at most 3.4e38, found 1000000000000000000000000000000000000000"),
        ("vn 1 2", r#"expected vn with 3 components, found "vn 1 2""#),
    ] {
        let mesh = format!("{TRIANGLE}\n\\\n\nf 1 2 3\n{statement}\nf 1 2 3");
        let files = Files::new(&mesh);
        assert_eq!(files.error(), format!("reading mesh mesh.obj, line 8: {expected}"), "{statement}");
    }
}

#[test]
fn points_lines_curves_and_small_faces_are_counted() {
    let mesh = format!(
        "{TRIANGLE}p 1 2\nl 1 2 3\nl 1 2\ncurv 0 1 1 2\nf 1 2\nf\ns 1\nf 1 2 3\ncall a.obj\nxyzzy 1\ns off\nvp 1\n"
    );
    assert_eq!(
        Files::new(mesh).scene().notes,
        [
            "1 statement of points (p) ignored",
            "2 statements of lines (l) ignored",
            "1 statement of curves and free-form surfaces (curv, curv2, surf) ignored",
            "2 faces with less than 3 corners ignored",
            "smoothing groups (s) are not applied: faces without normals are flat",
            r#"statements "call", "xyzzy" are ignored"#,
            "faces without material (usemtl) are 0.8 grey",
        ]
    );
    assert_eq!(
        Files::new(format!("{TRIANGLE}l 1 2")).error(),
        "reading mesh mesh.obj: no triangles: found vertices: 3, faces: 0, 1 statement of lines"
    );
    assert_eq!(Files::new("").error(), "reading mesh mesh.obj: no triangles: found vertices: 0, faces: 0");
}

#[test]
fn text_is_utf8_utf16_or_latin1_with_any_line_ends() {
    let text = format!("{TRIANGLE}o Stühle\nf 1 2 3\n");
    let utf16 = |to: fn(u16) -> [u8; 2]| {
        std::iter::once(0xFEFF).chain(text.encode_utf16()).flat_map(to).collect::<Vec<u8>>()
    };
    let latin1: Vec<u8> = text.chars().map(|c| c as u8).collect();
    for bytes in [
        text.clone().into_bytes(),
        format!("\u{FEFF}{text}").into_bytes(),
        utf16(u16::to_le_bytes),
        utf16(u16::to_be_bytes),
        latin1,
        text.replace('\n', "\r\n").into_bytes(),
        text.replace('\n', "\r").into_bytes(),
    ] {
        assert_eq!(Files::new(bytes).scene().parts[0].name, "Stühle");
    }
}

#[test]
fn lines_continue_after_a_backslash() {
    let scene = Files::new(format!("# C:\\\n{TRIANGLE}f 1 \\\r\n2\\\n 3\n")).scene();
    assert_eq!(scene.parts[0].geometry.triangles, [[0, 1, 2]]);
    let error = Files::new(format!("{TRIANGLE}f 1 \\\n2 \\\n9\n")).error();
    assert!(error.starts_with("reading mesh mesh.obj, line 4: "), "{error}");
}

#[test]
fn a_mesh_beyond_the_memory_is_an_error() {
    let files = Files::new(format!("{TRIANGLE}{}", "f 1 2 3\n".repeat(10_000)));
    let limits = Limits { max_total_bytes: 500_000, ..Files::limits() };
    assert!(matches!(files.read_with(&limits).map(drop), Err(MeshError::Memory { .. })));
    assert!(matches!(read_obj(Path::new("/nowhere.obj"), &limits).map(drop), Err(MeshError::Io { .. })));
}
