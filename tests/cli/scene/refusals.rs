//! What cannot be, and scenes of another lens.

use super::*;

#[test]
fn what_cannot_be_is_refused_before_anything_is_written() {
    let place = Place::new();
    let mesh = place.mesh();
    let out = place.at("scene.zarr");
    let lens = ["--lens", "phone", "--focus-m", "1", "--film-pitch-um", "6", "--film-size", "60x40"];
    let unit = ["--mesh-unit", "m"];
    let looking = ["--eye", "0,0,0", "--target", "0,0,-1"];
    let run = |mesh: &Path, flags: &[&[&str]]| {
        lenscube(&[&["scene", text(mesh), text(&out)], &flags.concat()[..]].concat())
    };
    std::fs::write(place.at("notes.txt"), "v 0 0 0").unwrap();
    std::fs::write(place.at("empty.obj"), "v 0 0 0\nv 1 0 0\n").unwrap();
    std::fs::write(place.at("bad.obj"), "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n").unwrap();
    std::fs::write(place.at("binary.obj"), b"glTF\x02\0\0\0").unwrap();
    std::fs::write(place.at("painted.mtl"), "newmtl a\nmap_Kd wood.png\n").unwrap();
    std::fs::write(place.at("wood.png"), "no picture").unwrap();
    let painted = "mtllib painted.mtl\nv 0 0 -1\nv 1 0 -1\nv 0 1 -1\nusemtl a\nf 1 2 3\n";
    std::fs::write(place.at("painted.obj"), painted).unwrap();
    std::fs::create_dir(place.at("folder.obj")).unwrap();
    std::fs::create_dir(place.at("store.zarr")).unwrap();
    std::fs::write(place.at("store.zarr/zarr.json"), "{}").unwrap();
    for (mesh, flags, texts) in [
        (&*mesh, &[&lens[..], &looking][..], &["--mesh-unit"][..]),
        (&mesh, &[&lens, &unit], &["no camera", "--eye"]),
        (&mesh, &[&lens, &unit, &["--eye", "0,0,0", "--target", "0,0,1"]], &["before the camera"]),
        (&mesh, &[&lens, &unit, &["--eye", "0,0,0", "--target", "0,1,0"]], &["--up"]),
        (
            &mesh,
            &[&lens, &unit, &["--eye", "0.2,0,-0.83", "--target", "0.2,0,0"]],
            &["stands inside or at", "Ball"],
        ),
        (
            &mesh,
            &[&lens, &unit, &looking, &["--material", "blue=x.csv"]],
            &["no material is called `blue`", "grey", "red"],
        ),
        (&mesh, &[&lens, &unit, &looking, &["--material", "red=none.csv"]], &["none.csv"]),
        (&mesh, &[&lens, &unit, &looking, &["--illuminant", "D66"]], &["--illuminant D66"]),
        (&mesh, &[&lens, &unit, &looking, &["--lights", "file"]], &["has no lights"]),
        (&mesh, &[&lens, &unit, &looking, &["--memory", "20MiB"]], &["too small"]),
        (
            &mesh,
            &[&lens, &unit, &looking, &["--allow-path", "/none/such"]],
            &["--allow-path /none/such", "no such folder"],
        ),
        (
            &mesh,
            &[&lens, &unit, &looking, &["--sky-samples", "4"]],
            &["--sky-samples", "--sky and --environment, of which none is given"],
        ),
        (&place.at("binary.obj"), &[&lens, &unit, &looking], &["binary.obj", "rename it to .glb"]),
        (
            &place.at("painted.obj"),
            &[&lens, &unit, &looking],
            &["reading texture", "wood.png", "convert it to PNG"],
        ),
        (&place.at("folder.obj"), &[&lens, &unit, &looking], &["folder.obj: it is a folder"]),
        (&place.at("store.zarr"), &[&lens, &unit, &looking], &["store.zarr: it is a Zarr store", ".obj"]),
        (Path::new("https://example.org/a.glb"), &[&lens], &["a.glb: it is a URL", "download it"]),
        (&place.at("notes.txt"), &[&lens, &unit, &looking], &["notes.txt", ".glb, .gltf, .obj or .ply"]),
        (&place.at("missing.obj"), &[&lens, &unit, &looking], &["missing.obj"]),
        (&place.at("empty.obj"), &[&lens, &unit, &looking], &["no triangles"]),
        (&place.at("bad.obj"), &[&lens, &unit, &looking], &["line 4"]),
    ] {
        let result = run(mesh, flags);
        // A file that cannot be read at all is a failure (1), all else usage.
        let expected = if matches!(texts, ["missing.obj" | "none.csv"]) { 1 } else { USAGE };
        assert_error_line(&result, expected, texts);
        assert!(!out.exists(), "{flags:?}");
    }
    // Outputs never touch an input.
    for output in [&mesh, &place.at("room.mtl")] {
        let before = std::fs::read(output).unwrap();
        let words =
            [&["scene", text(&mesh), text(output), "--overwrite"], &lens[..], &unit, &looking].concat();
        let result = lenscube(&words);
        assert_error_line(&result, USAGE, &["SCENE", "which this command reads"]);
        assert_eq!(std::fs::read(output).unwrap(), before);
    }
}

#[test]
fn a_scene_is_of_its_lens_and_notes_the_error_of_colours() {
    let place = Place::new();
    let (mesh, out, film) = (place.mesh(), place.at("scene.zarr"), place.at("film.zarr"));
    scene(&mesh, &out, "60x40", &["--quiet", "--sheets", "1", "--samples-per-px", "4"]).ok();
    let run =
        |flags: &[&str]| lenscube(&[&["run", text(&out), text(&film), "--lens", "phone"], flags].concat());
    let other = run(&["--focus-m", "0.5", "--wavelengths", "550"]);
    assert_error_line(&other, USAGE, &["was made for a lens of f_D", "--focus-m"]);
    assert!(!film.exists());
    // One band cannot represent colours: a note, and the nearest.
    assert_exit(
        &run(&["--focus-m", "1", "--wavelengths", "550", "--tails", "off"]),
        0,
        &["colours are in error"],
    );
    let info = lenscube(&[&["scene", text(&mesh), "--info"], &VIEW[..], &["60x40"]].concat()).ok();
    for expected in
        ["triangles               530 in 2 parts", "1 closed", "3 weights with spectra red, green, blue"]
    {
        assert!(info.stdout.contains(expected), "{expected}: {}", info.stdout);
    }
    let materials = lenscube(&[&["scene", text(&mesh), "--materials"], &VIEW[..], &["60x40"]].concat()).ok();
    assert!(
        materials.stdout.contains("grey") && materials.stdout.contains("0.600 0.000 0.000"),
        "{}",
        materials.stdout
    );
}
