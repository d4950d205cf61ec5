//! OBJ, MTL and PLY.

use super::{folder, peak_of};
use lenscube_formats::mesh::{Limits, MeshError};
use pipeline::scene::description::{Positions, Scene};
use std::fmt::Write;
use std::path::Path;

/// Memory of messages, notes and tables, which is not counted by the reader.
const UNCOUNTED_BYTES: isize = 128 << 10;

/// Reads a mesh; checks its memory and what comes out.
fn check(path: &Path, max_bytes: u64) -> Result<Scene, MeshError> {
    let limits = Limits::of_memory(max_bytes);
    let (read, peak) = peak_of(|| lenscube_formats::mesh::read(path, &limits));
    assert!(peak <= max_bytes as isize + UNCOUNTED_BYTES, "{}: {peak} bytes of {max_bytes}", path.display());
    match &read {
        Ok((scene, _)) => check_scene(scene),
        Err(error) => {
            let message = error.to_string();
            assert!(message.contains(&path.parent().unwrap().display().to_string()), "{message}");
            assert!(!message.contains('\n'), "{message}");
        }
    }
    read.map(|(scene, _)| scene)
}

fn check_scene(scene: &Scene) {
    assert!(!scene.parts.is_empty());
    for part in &scene.parts {
        let geometry = &part.geometry;
        let count = match &geometry.positions {
            Positions::F32(positions) => {
                assert!(positions.iter().flatten().all(|v| v.is_finite()));
                positions.len()
            }
            Positions::F64(positions) => {
                assert!(positions.iter().flatten().all(|v| v.is_finite()));
                positions.len()
            }
        };
        assert!(geometry.triangles.iter().flatten().all(|&v| (v as usize) < count));
        for set in &geometry.texcoords {
            assert!(set.len() == count && set.iter().flatten().all(|v| v.is_finite()));
        }
        assert!(geometry.normals.is_empty() || geometry.normals.len() == count);
        assert!(geometry.normals.iter().flatten().all(|v| v.is_finite()));
        assert!(geometry.colours.is_empty() || geometry.colours.len() == count);
        assert!(geometry.colours.iter().flatten().all(|v| v.is_finite()));
        let material = &scene.materials[part.material];
        assert!(material.colour.iter().chain(&material.emission).all(|v| v.is_finite()));
        for used in material.texture.iter().chain(&material.emission_texture) {
            assert!(used.transform.iter().flatten().all(|v| v.is_finite()));
            let texture = &scene.textures[used.texture];
            assert_eq!(texture.texels.len(), texture.width * texture.height);
        }
    }
}

/// The generator of Numerical Recipes, with fixed seeds.
struct Random(u64);

impl Random {
    fn below(&mut self, end: usize) -> usize {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) as usize % end
    }
}

/// Every truncation of `bytes` and `changes` changes of one to four of them, as the file `changed` that `mesh` is or names.
fn check_changes(changed: &Path, mesh: &Path, bytes: &[u8], changes: usize) -> [usize; 2] {
    let mut outcomes = [0; 2];
    let mut attempt = |bytes: &[u8]| {
        std::fs::write(changed, bytes).unwrap();
        outcomes[usize::from(check(mesh, 1 << 20).is_err())] += 1;
    };
    for end in 0..bytes.len() {
        attempt(&bytes[..end]);
    }
    let mut random = Random(1);
    // Half of the new bytes are those of numbers and separators.
    let likely = b"0123456789-+.eE/\\# \n\r\tvfnt";
    for _ in 0..changes {
        let mut copy = bytes.to_vec();
        for _ in 0..=random.below(4) {
            let at = random.below(copy.len());
            copy[at] = match random.below(2) {
                0 => random.below(256) as u8,
                _ => likely[random.below(likely.len())],
            };
        }
        attempt(&copy);
    }
    std::fs::write(changed, bytes).unwrap();
    println!("{}: {} scenes, {} errors", changed.file_name().unwrap().display(), outcomes[0], outcomes[1]);
    outcomes
}

#[test]
fn changed_obj_and_mtl_are_a_scene_or_an_error() {
    let folder = folder();
    let mut mesh = "# mesh\nmtllib a.mtl\no cube\ng side left\n".to_string();
    for k in 0..12 {
        let (x, y) = (k % 4, k / 4);
        writeln!(mesh, "v {x}.5 {y}e-1 {k} 0.5 1 0\nvt 0.{k} 1.0 0\nvn 0 0 -1").unwrap();
    }
    mesh.push_str("usemtl red one\nf 1/1/1 2/2/2 6/6/6 5/5/5\nf 1//1 2//2 \\\n3//3\nf -1 -2 -3\ns 1\n");
    mesh.push_str("usemtl b\nf 1/1 2/2 7/7 4/4 11/11 12/12\nl 1 2\np 3\nf 12 11 10 9 1 2\n");
    let materials = "newmtl red one\nKd 0.8 0.1 0.1\nd 0.5\nmap_Kd -s 2 2 -clamp on t.png\nmap_d t.png\nnewmtl b\nKe 1 1 1\nTr 0\nmap_Ke t.png\n";
    let mut picture = Vec::new();
    let mut encoder = png::Encoder::new(&mut picture, 4, 4);
    encoder.set_color(png::ColorType::Rgba);
    encoder.write_header().unwrap().write_image_data(&[77; 64]).unwrap();
    let path = |name: &str| folder.path().join(name);
    std::fs::write(path("a.obj"), &mesh).unwrap();
    std::fs::write(path("a.mtl"), materials).unwrap();
    std::fs::write(path("t.png"), &picture).unwrap();
    assert_eq!(check(&path("a.obj"), 1 << 20).unwrap().parts.len(), 5);
    for (name, bytes, changes) in [
        ("a.obj", mesh.as_bytes(), 20_000),
        ("a.mtl", materials.as_bytes(), 5_000),
        ("t.png", &picture, 2_000),
    ] {
        let [scenes, errors] = check_changes(&path(name), &path("a.obj"), bytes, changes);
        assert!(scenes > 10 && errors > 10);
    }
    let utf16: Vec<u8> =
        "\u{FEFF}".encode_utf16().chain(mesh.encode_utf16()).flat_map(u16::to_le_bytes).collect();
    check_changes(&path("a.obj"), &path("a.obj"), &utf16, 2_000);
}

fn ply(format: &str) -> String {
    format!(
        "ply\nformat {format} 1.0\ncomment made here\nelement vertex 6\nproperty float x\nproperty double y\nproperty short z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nproperty float nx\nproperty float ny\nproperty float nz\nproperty float s\nproperty float t\n\
         element face 3\nproperty list uchar int vertex_indices\nproperty float quality\nelement edge 2\nproperty list int float l\nelement tristrips 1\nproperty list int int vertex_indices\nend_header\n"
    )
}

#[test]
fn changed_ascii_ply_is_a_scene_or_an_error() {
    let folder = folder();
    let mut mesh = ply("ascii");
    for k in 0..6 {
        writeln!(mesh, "{k}.5 {} {} {k} 200 1 0 0 1 0.{k} 0.5", k * k % 5, k % 2).unwrap();
    }
    mesh.push_str("3 0 1 2 1.5\n5 5 4 3 2 1 0\n4 0 1 4 5 7e-3\n2 1 2\n0\n7 0 1 2 3 -1 4 5\n");
    let path = folder.path().join("a.ply");
    let [scenes, errors] = check_changes(&path, &path, mesh.as_bytes(), 20_000);
    assert!(scenes > 10 && errors > 10);
    assert!(check(&path, 1 << 20).is_ok());
}

#[test]
fn changed_binary_ply_is_a_scene_or_an_error() {
    let folder = folder();
    for (format, is_big) in [("binary_little_endian", false), ("binary_big_endian", true)] {
        let mut mesh = ply(format).into_bytes();
        let mut put = |bytes: &[u8]| match is_big {
            true => mesh.extend(bytes.iter().rev()),
            false => mesh.extend_from_slice(bytes),
        };
        for k in 0..6u8 {
            put(&f32::from(k).to_le_bytes());
            put(&f64::from(k * k % 5).to_le_bytes());
            put(&i16::from(k % 2).to_le_bytes());
            [k, 200, 1].iter().for_each(|v| put(&[*v]));
            [0f32, 0.0, 1.0, 0.25, 0.5].iter().for_each(|v| put(&v.to_le_bytes()));
        }
        for face in [&[0i32, 1, 2][..], &[5, 4, 3, 2, 1], &[0, 1, 4, 5]] {
            put(&[face.len() as u8]);
            face.iter().for_each(|v| put(&v.to_le_bytes()));
            put(&1f32.to_le_bytes());
        }
        put(&1i32.to_le_bytes());
        put(&1f32.to_le_bytes());
        put(&0i32.to_le_bytes());
        [7i32, 0, 1, 2, 3, -1, 4, 5].iter().for_each(|v| put(&v.to_le_bytes()));
        let path = folder.path().join("a.ply");
        let [scenes, errors] = check_changes(&path, &path, &mesh, 20_000);
        assert!(scenes > 10 && errors > 10);
        assert!(check(&path, 1 << 20).is_ok());
    }
}

/// Files whose scene takes many times their size: the limit holds at every value.
#[test]
fn memory_is_limited_for_every_kind_of_list() {
    let folder = folder();
    let vertices = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0.1 0.1 0\n";
    let obj: [(&str, String); 7] = [
        ("many vertices", vertices.repeat(5000) + "f 1 2 3\n"),
        ("coloured", "v 0 0 0 1 1 1\n".repeat(20_000) + "f 1 2 3\n"),
        ("one polygon", vertices.to_string() + "f" + &" 1 2 3".repeat(30_000) + "\n"),
        ("concave polygon", vertices.to_string() + "f" + &" 1 2 4 3".repeat(300) + "\n"),
        (
            "many parts",
            vertices.to_string() + &(0..5000).map(|k| format!("o {k}\nf 1 2 3\n")).collect::<String>(),
        ),
        ("many corners", {
            let corners = (1..20_000).map(|k| format!("vt 0 0\nf 1/{k} 2/{k} 3/{k}\n")).collect::<String>();
            vertices.to_string() + &corners
        }),
        ("utf-16", String::new()),
    ];
    let mut files: Vec<(&str, &str, Vec<u8>)> =
        obj.into_iter().map(|(what, text)| (what, "a.obj", text.into_bytes())).collect();
    let text = vertices.repeat(3000) + "f 1 2 3\n";
    files.last_mut().unwrap().2 =
        "\u{FEFF}".encode_utf16().chain(text.encode_utf16()).flat_map(u16::to_be_bytes).collect();
    let head = |faces: usize| {
        format!(
            "ply\nformat ascii 1.0\nelement vertex 3\nproperty char x\nproperty char y\nproperty char z\nelement face {faces}\nproperty list int uchar vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n"
        )
    };
    files.push(("ascii faces", "a.ply", (head(30_000) + &"3 0 1 2\n".repeat(30_000)).into_bytes()));
    files.push(("empty faces", "a.ply", (head(90_001) + "3 0 1 2\n" + &"0\n".repeat(90_000)).into_bytes()));
    files.push(("long face", "a.ply", (head(1) + "90000" + &" 0 1 2".repeat(30_000)).into_bytes()));
    let strip = head(1).replace("face", "tristrips") + "90000" + &" 0 1 2".repeat(30_000);
    files.push(("long strip", "a.ply", strip.into_bytes()));
    let elements: String = (0..5000).map(|k| format!("element e{k} 9000000000000\n")).collect();
    files.push((
        "many elements",
        "a.ply",
        (head(1) + "3 0 1 2\n").replace("element vertex", &(elements + "element vertex")).into_bytes(),
    ));
    for (what, name, bytes) in files {
        let path = folder.path().join(name);
        std::fs::write(&path, &bytes).unwrap();
        let mut is_read = false;
        for kib in [0, 16, 64, 128, 256, 512, 1024, 2048, 4096, 8192, 16_384, 32_768] {
            let read = check(&path, kib << 10);
            assert!(!is_read || read.is_ok(), "{what} at {kib} KiB after success");
            is_read |= read.is_ok();
            assert!(is_read || matches!(read, Err(MeshError::Memory { .. })), "{what}: {:?}", read.err());
        }
        assert!(is_read, "{what}");
    }
}

/// Time is proportional to the size of the file.
#[test]
fn many_notes_parts_and_elements_take_little_time() {
    let folder = folder();
    let path = folder.path().join("a.obj");
    let mut mesh = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\n".to_string();
    let mut materials = String::new();
    for k in 0..50_000 {
        writeln!(mesh, "o {k}\nusemtl m{k}\nf 1 2 3\nx{k}").unwrap();
        writeln!(materials, "newmtl m{}\nq{k} 1", k / 3).unwrap();
    }
    std::fs::write(&path, mesh).unwrap();
    std::fs::write(folder.path().join("a.mtl"), materials).unwrap();
    let start = std::time::Instant::now();
    let scene = check(&path, 1 << 30).unwrap();
    assert_eq!((scene.parts.len(), scene.materials.len(), scene.notes.len()), (50_000, 50_000, 5));
    // Half a second; 50,000² steps would take minutes.
    assert!(start.elapsed().as_secs() < 20, "{:?}", start.elapsed());
}
