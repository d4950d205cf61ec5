//! Material files: names, opacity, errors.

use super::*;

#[test]
fn materials_of_several_files_with_spaces_in_their_names() {
    let mesh = format!(
        "mtllib my first.mtl second.MTL\nmtllib \"third file.mtl\"\n{TRIANGLE}usemtl Hard White \nf 1 2 3\nusemtl b #2\nf 1 2 3\nusemtl c\nf 1 2 3\n"
    );
    let files = Files::new(mesh)
        .with("my first.mtl", "# x\nnewmtl Hard White\nKd 0.1 0.2 0.3 # c\nnewmtl c\nKd 1 1 1\n")
        .with("second.MTL", "newmtl b #2\r\nKd 0.5\r\nKs 1 1 1\r\nnewmtl c\r\n")
        .with("third file.mtl", "newmtl c\nKd 0 0 0\n");
    let (scene, sources) = files.read_with(&Files::limits()).unwrap();
    let colours: Vec<_> = scene.materials.iter().map(|m| (m.name.as_str(), m.colour)).collect();
    assert_eq!(colours, [("Hard White", [0.1, 0.2, 0.3]), ("b #2", [0.5; 3]), ("c", [1.0; 3])]);
    let names: Vec<_> = sources.iter().map(|s| s.path.file_name().unwrap().to_str().unwrap()).collect();
    assert_eq!(names, [MESH, "my first.mtl", "second.MTL", "third file.mtl"]);
    for source in &sources {
        let bytes = std::fs::read(&source.path).unwrap();
        assert_eq!((source.bytes, source.blake3), (bytes.len() as u64, blake3::hash(&bytes)));
    }
    assert_eq!(
        scene.notes,
        [
            r#"material properties "Ks" are ignored"#,
            r#"materials defined more than once, of which the first is used: "c""#
        ]
    );
    let one = Files::new(format!("mtllib a.mtl b.mtl\nusemtl m\n{TRIANGLE}f 1 2 3"))
        .with("a.mtl b.mtl", "newmtl m\nKd 1");
    assert_eq!(one.scene().materials[0].colour, [1.0; 3]);
}

#[test]
fn missing_and_empty_material_files() {
    let files = Files::new(format!("mtllib a.mtl\n{TRIANGLE}usemtl m\nf 1 2 3"));
    assert_eq!(
        files.error(),
        "reading mesh mesh.obj, line 1: a.mtl is not there; restore it, or read the mesh without it by --missing-textures grey"
    );
    let grey = Limits { missing_textures_grey: true, ..Files::limits() };
    let scene = files.read_with(&grey).unwrap().0;
    assert_eq!(scene.materials[0].colour, [0.8; 3]);
    assert_eq!(
        scene.notes,
        [
            r#"missing material files: "a.mtl""#,
            r#"materials without definition, which are 0.8 grey or have the colours of vertices: "m""#
        ]
    );
    let scene = files.with("a.mtl", "").scene();
    assert_eq!(scene.notes[0], r#"material files without materials: "a.mtl""#);
}

#[test]
fn opacity_is_d_or_else_one_less_tr() {
    for (statements, alpha, mode) in [
        ("Kd 1 1 1", 1.0, AlphaMode::Opaque),
        ("Kd 1 1 1\nd 0.25", 0.25, AlphaMode::Blend),
        ("Kd 1 1 1\nTr 0.25", 0.75, AlphaMode::Blend),
        ("Kd 1 1 1\nTr 1\nd 1", 1.0, AlphaMode::Opaque),
        ("Kd 1 1 1\nd -halo 0.5", 0.5, AlphaMode::Blend),
        ("Kd 1 1 1\nd 7", 1.0, AlphaMode::Opaque),
    ] {
        let scene = with_material(statements).scene();
        assert_eq!((scene.materials[0].alpha, scene.materials[0].alpha_mode), (alpha, mode), "{statements}");
    }
    let notes = with_material("Kd 1 1 1\nd 0").scene().notes;
    assert_eq!(notes, [r#"materials that are invisible, as their opacity is 0: "m""#]);
}

#[test]
fn wrong_materials_are_errors_with_file_and_line() {
    for (statements, expected) in [
        (
            "Kd 1,0 0 0",
            r#"a number with a decimal point, not a comma; export the file again in an English locale, found "1,0""#,
        ),
        ("Kd nan 0 0", r#"a finite number, found "nan""#),
        ("Kd 1e39", "at most 3.4e38, found 1000000000000000000000000000000000000000"),
        ("map_Kd -s 1e99 a.png", &format!("at most 3.4e38, found {}", 1e99)),
        ("Kd 1 1", r#"a colour r g b, found "1 1""#),
        ("Kd xyz 1 1 1", r#"a colour r g b; `spectral` and `xyz` are not read, found "xyz 1 1 1""#),
        ("d", r#"a number of 0 to 1, found """#),
    ] {
        let error = with_material(statements).error();
        assert_eq!(error, format!("reading materials a.mtl, line 2: expected {expected}"), "{statements}");
    }
    // The last word of a texture statement is its file.
    assert!(with_material("map_Kd -s 1 1 1").error().contains("a.mtl, line 2: 1 is not there"));
    let files = Files::new(format!("mtllib a.mtl\n{TRIANGLE}f 1 2 3")).with("a.mtl", "Kd 1 1 1\n");
    assert_eq!(
        files.error(),
        r#"reading materials a.mtl, line 1: expected newmtl before other statements, found "Kd 1 1 1""#
    );
    assert!(with_material("map_Kd ").error().ends_with(r#"expected the name of a texture file, found """#));
}
