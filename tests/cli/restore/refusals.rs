//! What cannot be restored.

use super::*;
use crate::common::assert_exit;

#[test]
fn raws_that_cannot_be_restored_are_refused() {
    let folder = Folder::new(64);
    let film = folder.at("film.zarr");
    expose(
        &folder.at("clean.zarr"),
        &folder.at("raw.zarr"),
        "ideal-mono",
        &["--exposure=auto", "--size=64", "--center=-2.937,-1.937"],
    );
    expose(
        &folder.at("clean.zarr"),
        &folder.at("roi.zarr"),
        "ideal-mono",
        &["--exposure=1s", "--roi=0,0,32,32", "--size=64", "--center=-2.937,-1.937"],
    );
    let refused = |raw: &str, flags: &[&str], texts: &[&str]| {
        assert_error_line(&folder.restore(raw, "out.zarr", flags), 2, texts);
        assert!(!folder.at("out.zarr").exists());
    };
    let clean = folder.at("clean.zarr");
    refused("raw.zarr", &[], &["is a raw", "--film"]);
    refused("film.zarr", &["--film", text(&film)], &["--film", "raws"]);
    refused("film.zarr", &["--frame", "1"], &["--frame", "raws"]);
    refused("raw.zarr", &["--film", text(&clean), "--noise", "1"], &["--noise", "sensor"]);
    refused("raw.zarr", &["--film", text(&clean), "--frame", "3"], &["--frame 3", "1 frame"]);
    refused("roi.zarr", &["--film", text(&clean)], &["region", "--roi"]);
    let other = folder.at("other.zarr");
    run(text(&folder.at("chart.zarr")), &other, LENS, &["--film-size=64"]).ok();
    refused("raw.zarr", &["--film", text(&other)], &["not made of film", "--film"]);
    assert_error_line(
        &folder.restore("raw.zarr", "raw.zarr", &["--film", text(&clean), "--overwrite"]),
        2,
        &["raw.zarr"],
    );
}

#[test]
fn films_that_cannot_be_restored_are_refused() {
    let folder = Folder::new(64);
    let refused = |film: &str, out: &str, flags: &[&str], code: i32, texts: &[&str]| {
        assert_error_line(&folder.restore(film, out, flags), code, texts);
        assert!(out != "out.zarr" || !folder.at(out).exists());
    };
    refused("film.zarr", "film.zarr", &[], 2, &["film"]);
    refused("no.zarr", "out.zarr", &[], 1, &["no.zarr"]);
    refused("film.zarr", "out.zarr", &["--iterations", "3"], 2, &["richardson-lucy"]);
    refused("film.zarr", "out.zarr", &["--bands", "700"], 2, &["--bands"]);
    refused("film.zarr", "out.zarr", &["--roi", "60,0,10,10"], 2, &["--roi", "64x64"]);
    refused("film.zarr", "out.zarr", &["--lens", "no.zmx"], 2, &["no.zmx"]);
    refused("film.zarr", "out.zarr", &["--lens", "double-gauss-28"], 2, &["not the one that made the film"]);
    fs::create_dir(folder.at("other")).unwrap();
    refused("film.zarr", "other", &[], 3, &["--overwrite"]);
    assert_exit(
        &folder.restore("film.zarr", "other", &["--overwrite"]),
        3,
        &["no Zarr group with an array `chart`"],
    );

    // Regions; veiling glare; a lens that is not recorded; a shard that is missing, and one that is damaged.
    let chart = folder.at("chart.zarr");
    run(text(&chart), &folder.at("roi.zarr"), LENS, &["--roi=3,5,40,30"]).ok();
    refused("roi.zarr", "out.zarr", &[], 2, &["regions only", "--roi"]);
    run(text(&chart), &folder.at("veil.zarr"), LENS, &["--veiling-glare=0.03"]).ok();
    refused("veil.zarr", "out.zarr", &[], 2, &["--veiling-glare"]);
    let film = folder.at("film.zarr");
    let shard = film.join(shards(&film).remove(0));
    let bytes = fs::read(&shard).unwrap();
    let mut damaged = bytes.clone();
    damaged[100] ^= 255;
    fs::write(&shard, damaged).unwrap();
    refused("film.zarr", "out.zarr", &[], 1, &["checksum"]);
    fs::remove_file(&shard).unwrap();
    refused("film.zarr", "out.zarr", &[], 4, &["1 of 1 shards are missing", "lenscube run"]);
}

#[test]
fn films_of_surfaces_at_several_distances_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let (film, out) = (folder.path().join("film.zarr"), folder.path().join("out.zarr"));
    let scene = "gen:depth-scene?size=60x48&overscan=0&near_m=0.3&far_m=0.5&wavelengths=550";
    run(scene, &film, "phone", &["--focus-m=0.4", "--depth-tolerance=0.1"]).ok();
    let result = lenscube(&["restore", text(&film), text(&out)]);
    assert_error_line(&result, 2, &["several distances", "--depth none"]);
}
