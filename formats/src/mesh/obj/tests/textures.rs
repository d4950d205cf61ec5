//! Textures of materials: options, opacity, emission, files that are shared, missing or refused.

use super::*;
use pipeline::scene::description::{TextureUse, Wrap};

fn png(width: u32, height: u32, colour: png::ColorType, samples: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width, height);
    encoder.set_color(colour);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.write_header().unwrap().write_image_data(samples).unwrap();
    bytes
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
