//! OBJ and MTL files made here.

use std::path::{Path, PathBuf};

use crate::mesh::{Limits, MeshError, SourceFile, read_obj};
use pipeline::scene::description::{AlphaMode, Geometry, Positions, Scene, TextureUse, Wrap};

/// A folder with files; the first is the mesh.
struct Files(tempfile::TempDir);

const MESH: &str = "mesh.obj";
const TRIANGLE: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";

impl Files {
    fn new(mesh: impl AsRef<[u8]>) -> Self {
        Self(tempfile::tempdir().unwrap()).with(MESH, mesh)
    }

    fn with(self, name: &str, bytes: impl AsRef<[u8]>) -> Self {
        std::fs::write(self.path(name), bytes).unwrap();
        self
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn limits() -> Limits {
        Limits::of_memory(1 << 24)
    }

    fn read_with(&self, limits: &Limits) -> Result<(Scene, Vec<SourceFile>), MeshError> {
        read_obj(&self.path(MESH), limits)
    }

    fn scene(&self) -> Scene {
        self.read_with(&Self::limits()).unwrap().0
    }

    /// The message of the error, without the folder.
    fn error(&self) -> String {
        let message = self.read_with(&Self::limits()).map(drop).unwrap_err().to_string();
        message.replace(&format!("{}/", self.0.path().display()), "")
    }
}

fn positions(geometry: &Geometry) -> &[[f64; 3]] {
    match &geometry.positions {
        Positions::F64(positions) => positions,
        Positions::F32(_) => panic!("f32"),
    }
}

fn png(width: u32, height: u32, colour: png::ColorType, samples: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width, height);
    encoder.set_color(colour);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.write_header().unwrap().write_image_data(samples).unwrap();
    bytes
}

/// A mesh of one material `m` of these statements.
fn with_material(statements: &str) -> Files {
    let mesh = format!("mtllib a.mtl\nusemtl m\n{TRIANGLE}vt 0 0\nf 1/1 2/1 3/1\n");
    Files::new(mesh).with("a.mtl", format!("newmtl m\n{statements}\n"))
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
fn concave_polygon_is_divided_inside_itself() {
    let scene = Files::new("v 0 0 3\nv 0 4 3\nv 0 1 2\nv 0 0 0\nf 1 2 3 4").scene();
    assert_eq!(scene.parts[0].geometry.triangles.len(), 2);
    let scene = Files::new("v 0 0 0\nv 4 1 0\nv 0 2 0\nv 1 1 0\nf 1 2 3 4").scene();
    let (geometry, mut area) = (&scene.parts[0].geometry, 0.0);
    for t in &geometry.triangles {
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

#[test]
fn texture_options_become_wrap_and_transform() {
    let red = png(1, 2, png::ColorType::Rgb, &[200, 0, 0, 0, 0, 9]);
    let files =
        with_material("map_Kd -s 2 3 1 -o 0.5 0.25 -clamp on -mm 0 1 my wood.png").with("my wood.png", red);
    let scene = files.scene();
    let material = &scene.materials[0];
    assert_eq!(material.colour, [1.0; 3]);
    // v = 1 − v_file and v' = 1 − (3 v_file + 0.25): v' = 3 v − 2.25.
    assert_eq!(
        material.texture,
        Some(TextureUse {
            texture: 0,
            set: 0,
            wrap: [Wrap::Clamp; 2],
            nearest: false,
            transform: [[2.0, 0.0, 0.5], [0.0, 3.0, -2.25]],
        })
    );
    let texture = &scene.textures[0];
    assert_eq!((texture.name.as_str(), texture.width, texture.height), ("my wood.png", 1, 2));
    assert_eq!(texture.texels, [[200, 0, 0, 255], [0, 0, 9, 255]]);
    assert_eq!(scene.notes, ["option -mm of textures is ignored"]);
    let scene = with_material("Kd 0 0 0\nmap_Kd 1.png")
        .with("1.png", png(1, 1, png::ColorType::Grayscale, &[7]))
        .scene();
    assert_eq!(scene.materials[0].texture.as_ref().unwrap().transform, [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
    assert_eq!(scene.notes, [r#"materials that are black because Kd, a factor of their texture, is 0: "m""#]);
}

#[test]
fn opacity_texture_becomes_alpha_of_the_colour_texture() {
    use png::ColorType::{Grayscale, Rgb, Rgba};
    let colour = png(2, 1, Rgb, &[10, 20, 30, 40, 50, 60]);
    let mask = png(1, 2, Grayscale, &[0, 200]);
    let scene =
        with_material("map_Kd c.png\nmap_d m.png").with("c.png", &colour).with("m.png", &mask).scene();
    let texture = &scene.textures[0];
    assert_eq!((scene.textures.len(), texture.width, texture.height), (1, 2, 2));
    assert_eq!(texture.texels, [[10, 20, 30, 0], [40, 50, 60, 0], [10, 20, 30, 200], [40, 50, 60, 200]]);
    assert_eq!(scene.materials[0].alpha_mode, AlphaMode::Blend);

    let scene =
        with_material("Kd 0.5 0.5 0.5\nmap_d m.png").with("m.png", png(1, 1, Rgba, &[1, 2, 3, 77])).scene();
    assert_eq!((scene.textures[0].texels[0], scene.materials[0].colour), ([255, 255, 255, 77], [0.5; 3]));

    let files = with_material("map_Kd c.png\nmap_d -s 2 2 m.png").with("c.png", &colour).with("m.png", &mask);
    let scene = files.scene();
    assert_eq!((scene.materials[0].alpha_mode, scene.textures[0].height), (AlphaMode::Opaque, 1));
    assert!(scene.notes[0].starts_with("materials whose opacity texture is ignored"));
}

#[test]
fn emission_and_its_texture() {
    let scene = with_material("Kd 1 1 1\nKe 3 2 1").scene();
    assert_eq!(scene.materials[0].emission, [3.0, 2.0, 1.0]);
    assert_eq!(scene.notes, ["emission (Ke) has no unit in MTL files; its values are taken as cd/m²"]);
    let files = with_material("Kd 1 1 1\nKe 0 0 0\nmap_Ke e.png")
        .with("e.png", png(1, 1, png::ColorType::Grayscale, &[9]));
    let material = &files.scene().materials[0];
    assert_eq!((material.emission, material.emission_texture.as_ref().unwrap().texture), ([1.0; 3], 0));
}

#[test]
fn a_texture_of_several_materials_is_decoded_once() {
    let mesh = format!("mtllib a.mtl\n{TRIANGLE}usemtl m\nf 1 2 3\nusemtl n\nf 1 2 3\n");
    let files = Files::new(mesh)
        .with(
            "a.mtl",
            "newmtl m\nmap_Kd t.png\nnewmtl n\nmap_Kd .\\T.PNG\nnewmtl unused\nmap_Kd missing.png\n",
        )
        .with("t.png", png(1, 1, png::ColorType::Grayscale, &[9]));
    let (scene, sources) = files.read_with(&Files::limits()).unwrap();
    assert_eq!(sources.len(), 3);
    assert_eq!(scene.textures.len(), 1);
    assert_eq!(
        scene.notes,
        [r#"file names that differ in upper and lower case from the files read: ".\\T.PNG""#]
    );
}

#[test]
fn missing_refused_and_foreign_textures() {
    let files = with_material("Kd 1 0 0\nmap_Kd gone.png");
    assert_eq!(
        files.error(),
        "reading materials a.mtl, line 3: gone.png is not there; restore it, or read the mesh without it by --missing-textures grey"
    );
    let scene = files.read_with(&Limits { missing_textures_grey: true, ..Files::limits() }).unwrap().0;
    assert_eq!((scene.materials[0].colour, scene.textures.len()), ([0.8, 0.0, 0.0], 0));
    assert_eq!(scene.notes, [r#"missing textures, read as 0.8 grey: "gone.png""#]);
    for name in ["../a.png", "/etc/passwd", "http://example.org/a.png", r"C:\a.png", "..\\..\\a.png"] {
        let error = with_material(&format!("map_Kd {name}")).error();
        assert!(
            error.starts_with("reading materials a.mtl, line 2: ") && error.contains("is refused"),
            "{error}"
        );
        let grey = Limits { missing_textures_grey: true, ..Files::limits() };
        let refused = with_material(&format!("map_Kd {name}")).read_with(&grey).map(drop);
        assert!(matches!(refused, Err(MeshError::Refused { .. })));
    }
    assert!(with_material("map_Kd a.tga").with("a.tga", "TRUEVISION").error().contains("is not supported"));
    let large = png(300, 300, png::ColorType::Grayscale, &[0; 90_000]);
    let limits = Limits { max_bytes: 359_999, ..Files::limits() };
    let read = with_material("map_Kd a.png").with("a.png", large).read_with(&limits).map(drop);
    assert!(matches!(read, Err(MeshError::Memory { needed: 360_000, allowed: 359_999, .. })), "{read:?}");
}

#[test]
fn a_mesh_beyond_the_memory_is_an_error() {
    let files = Files::new(format!("{TRIANGLE}{}", "f 1 2 3\n".repeat(10_000)));
    let limits = Limits { max_total_bytes: 500_000, ..Files::limits() };
    assert!(matches!(files.read_with(&limits).map(drop), Err(MeshError::Memory { .. })));
    assert!(matches!(read_obj(Path::new("/nowhere.obj"), &limits).map(drop), Err(MeshError::Io { .. })));
}
