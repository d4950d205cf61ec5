//! `lenscube dataset`.

use crate::common::{
    CommandResult, Noise, Picture, assert_error_line, bits, files, lenscube, pixels, read_npy, run, text,
    write_npy_of,
};
use crate::common::{identity_band, lens, scattered, write_pack};
use formats::dataset::encode::{Codes, png};
use pipeline::geometry::Size;
use pipeline::lens::LensBand;
use serde_json::Value;
use std::fs;
use std::path::PathBuf;
use std::process::Command;

/// A pack of PSFs at 450, 500, 550 … 650 nm.
const LENS: &str = "double-gauss-28-npz";
const SIZE: Size = Size::new(40, 48);

/// A folder with pictures and a recipe.
struct Folder(tempfile::TempDir);

impl Folder {
    /// `pictures` pictures of noise in colour, p0.png and so on.
    fn new(pictures: usize) -> Self {
        let folder = Self(tempfile::tempdir().unwrap());
        fs::create_dir(folder.at("in")).unwrap();
        for k in 0..pictures {
            folder.picture(&format!("in/p{k}.png"), k as u64, SIZE);
        }
        folder
    }

    fn at(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn picture(&self, name: &str, seed: u64, size: Size) {
        let mut noise = Noise(seed);
        let values: Vec<u16> = (0..3 * size.pixels()).map(|_| (noise.next() * 256.0) as u16).collect();
        let bytes = png(Codes { size, channels: 3, values: &values }, 8, true).unwrap();
        fs::write(self.at(name), bytes).unwrap();
    }

    /// Writes the recipe: `more` follows the first lines, `output` the table of outputs.
    fn recipe(&self, more: &str, output: &str) -> PathBuf {
        let text = format!(
            "schema = \"lenscube/dataset/1\"\n{more}\n[pictures]\nfiles = \"in\"\nsize = [32, 24]\nwavelengths_nm = [650, 550, 450]\n\
             [lens]\nname = \"{LENS}\"\nflags = {{ interpolate_psf = true }}\n[film]\npitch_um = 2\ncenter_mm = [[0, 0], [3, -2], [0.5, 4]]\n\
             [output]\n{output}\n"
        );
        let path = self.at("recipe.toml");
        fs::write(&path, text).unwrap();
        path
    }

    fn dataset(&self, out: &str, flags: &[&str]) -> CommandResult {
        lenscube(&[&["dataset", text(&self.at("recipe.toml")), text(&self.at(out))], flags].concat())
    }

    /// Lines of a complete data set.
    fn lines(&self, out: &str) -> Vec<Value> {
        let all = fs::read_to_string(self.at(out).join("samples.jsonl")).unwrap();
        all.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
    }
}

#[test]
fn films_have_the_bits_of_run_with_the_flags_of_their_line() {
    let folder = Folder::new(0);
    let chart = Picture::noise(5, SIZE, 3);
    chart.write(&folder.at("in/cube.zarr"));
    let recipe = folder.recipe("", "film = \"npy\"\nclean = \"npy\"");
    // Whole cubes of three bands, at each of three places.
    let whole = fs::read_to_string(&recipe).unwrap();
    fs::write(&recipe, whole.replace("size = [32, 24]\nwavelengths_nm = [650, 550, 450]\n", "")).unwrap();
    folder.dataset("out", &[]).ok();
    let lines = folder.lines("out");
    assert_eq!(lines.len(), 3);
    for line in &lines {
        let words: Vec<&str> = line["run"].as_array().unwrap().iter().map(|w| w.as_str().unwrap()).collect();
        for (item, stages) in [("film", &[][..]), ("clean", &["--stages=distortion"][..])] {
            let film = folder.at("film.zarr");
            assert!(words[0] == format!("--lens={LENS}") && words[1] == "--interpolate-psf", "{words:?}");
            run(
                text(&folder.at("in/cube.zarr")),
                &film,
                LENS,
                &[&["--overwrite"], &words[1..], stages].concat(),
            )
            .ok();
            let (_, expected) = pixels(&film, "film");
            let key = line["key"].as_str().unwrap();
            let found = read_npy(&folder.at("out").join(format!("000000/{key}.{item}.npy")));
            assert_eq!(bits(&[found]), bits(&[expected.concat()]), "{line} {item}");
        }
    }
}

#[test]
#[ignore = "long: makes four data sets"]
fn samples_are_the_same_for_any_number_threads_parts_and_after_kills() {
    let folder = Folder::new(3);
    folder.recipe("samples = 10\nseed = 3", "film = \"png\"\nclean = \"tif\"\nunit = 3");
    folder.dataset("whole", &["--threads", "1"]).ok();
    let whole = files(&folder.at("whole"));
    assert_eq!(whole.keys().filter(|path| path.extension().is_some_and(|e| e == "png")).count(), 10);
    let different: std::collections::BTreeSet<_> = whole.values().collect();
    assert!(different.len() > 20, "ten films and ten pictures in register");
    // In two parts, in the other order.
    folder.dataset("parts", &["--part", "2/2", "--threads", "2"]).ok();
    assert!(!folder.at("parts/samples.jsonl").exists());
    folder.dataset("parts", &["--part", "1/2"]).ok();
    assert!(files(&folder.at("parts")) == whole);
    // Killed after the items of the first and of the second unit, then resumed.
    for n in [1, 2] {
        let killed = Command::new(env!("CARGO_BIN_EXE_lenscube"))
            .args(["dataset", text(&folder.at("recipe.toml")), text(&folder.at("killed"))])
            .env("LENSCUBE_FAULT", format!("unit-written:{n}:kill"))
            .output()
            .unwrap();
        assert_eq!(CommandResult::new(&killed).code, -1, "{killed:?}");
    }
    assert!(!folder.at("killed/samples.jsonl").exists());
    folder.dataset("killed", &[]).ok();
    assert!(files(&folder.at("killed")) == whole);
    // First seven, then ten.
    folder.dataset("grown", &["--samples", "7"]).ok();
    let seven = folder.lines("grown");
    assert_eq!(seven, folder.lines("whole")[..7]);
    folder.dataset("grown", &[]).ok();
    assert!(files(&folder.at("grown")) == whole);
    assert_error_line(&folder.dataset("grown", &["--samples", "7"]), 3, &["10 samples", "--overwrite"]);
    lenscube(&["verify", text(&folder.at("grown"))]).ok();
}

#[test]
fn a_bad_picture_is_reported_and_skipped() {
    let folder = Folder::new(2);
    fs::write(folder.at("in/p1b.png"), b"\x89PNG\r\n\x1a\nno").unwrap();
    folder.picture("in/p9.png", 1, Size::new(10, 10));
    let recipe = folder.recipe("", "film = \"png\"");
    let text = fs::read_to_string(&recipe).unwrap();
    fs::write(&recipe, text.replace("center_mm = [[0, 0], [3, -2], [0.5, 4]]\n", "")).unwrap();
    for _ in 0..2 {
        let result = folder.dataset("out", &[]);
        assert_eq!(result.code, 4, "{}", result.stderr);
        assert!(
            result.stderr.contains("p1b.png") && result.stderr.contains("expected at least 32x24 px"),
            "{}",
            result.stderr
        );
    }
    let lines = folder.lines("out");
    let has = |k: usize| (lines[k].get("error").is_some(), lines[k]["items"].as_object().unwrap().len());
    assert_eq!((0..4).map(has).collect::<Vec<_>>(), [(false, 1), (false, 1), (true, 0), (true, 0)]);
    lenscube(&["verify", folder.at("out").to_str().unwrap()]).ok();
}

#[test]
fn raws_pictures_and_layouts_hold_the_same_samples() {
    let folder = Folder::new(2);
    let table = "\n[sensor]\nname = \"example-2um\"\nexposure_ev = [-1, 0]\n";
    let arrays = "film = \"npy\"\nraw = \"npy\"\npicture = \"npy\"\nunit = 4";
    for layout in ["folders", "tar", "zarr"] {
        folder.recipe("samples = 5", &format!("as = \"{layout}\"\n{arrays}{table}"));
        folder.dataset(layout, &[]).ok();
        lenscube(&["verify", text(&folder.at(layout))]).ok();
    }
    let (folders, tar, zarr) = (folder.lines("folders"), folder.lines("tar"), folder.lines("zarr"));
    assert_eq!(folders, tar);
    for (line, of_zarr) in folders.iter().zip(&zarr) {
        let key = line["key"].as_str().unwrap();
        let number = line["sample"].as_u64().unwrap() as usize;
        let unit = number / 4;
        let shard = fs::read(folder.at(&format!("tar/{unit:06}.tar"))).unwrap();
        for item in ["film", "raw", "picture"] {
            let file = fs::read(folder.at(&format!("folders/{unit:06}/{key}.{item}.npy"))).unwrap();
            assert!(shard.windows(file.len()).any(|w| w == file), "{item} of {key} in the shard");
            let samples = &file[file.len()
                - of_zarr["items"][format!("{item}.array")]["bytes"].as_u64().unwrap() as usize..];
            assert_eq!(
                blake3::hash(samples).to_hex().as_str(),
                of_zarr["items"][format!("{item}.array")]["blake3"].as_str().unwrap()
            );
        }
        let picture = read_npy(&folder.at(&format!("folders/{unit:06}/{key}.picture.npy")));
        assert!(picture.iter().all(|v| v.is_finite()) && picture.iter().any(|v| *v > 0.1));
        assert!(line["exposure_s"].as_f64().unwrap() > 0.0 && line["noise_seed"].is_u64());
    }
}

#[test]
fn labels_follow_the_light_to_a_fiftieth_of_a_pixel() {
    let folder = Folder::new(0);
    // Dots of 3 x 3 px on black, whose centres are keypoints.
    let size = Size::new(120, 140);
    let dots: Vec<(usize, usize)> =
        (20..110).step_by(20).flat_map(|y| (20..130).step_by(20).map(move |x| (y, x))).collect();
    let mut values = vec![0; 3 * size.pixels()];
    let mut labels = vec![0u16; size.pixels()];
    for (k, (y, x)) in dots.iter().enumerate() {
        for (dy, dx) in (0..9).map(|i| (i / 3, i % 3)) {
            let at = (y + dy - 1) * size.width + x + dx - 1;
            values[3 * at..][..3].fill(255);
            labels[at] = k as u16 + 1;
        }
    }
    fs::write(folder.at("in/dots.png"), png(Codes { size, channels: 3, values: &values }, 8, true).unwrap())
        .unwrap();
    fs::create_dir(folder.at("masks")).unwrap();
    fs::write(
        folder.at("masks/dots.png"),
        png(Codes { size, channels: 1, values: &labels }, 8, false).unwrap(),
    )
    .unwrap();
    let keypoints: Vec<f64> = dots.iter().flat_map(|(y, x)| [*x as f64, *y as f64, 2.0]).collect();
    let coco = serde_json::json!({
        "images": [{"id": 4, "file_name": "dots.png", "width": 140, "height": 120}],
        "annotations": [{"id": 1, "image_id": 4, "category_id": 1, "bbox": [19, 19, 3, 3], "keypoints": keypoints}],
        "categories": [{"id": 1, "name": "dots"}],
    });
    fs::write(folder.at("labels.json"), coco.to_string()).unwrap();
    let recipe = folder.recipe("", "clean = \"npy\"\nfilm = \"npy\"");
    let text = fs::read_to_string(&recipe).unwrap();
    let text = text.replace("size = [32, 24]\n", "labels = \"labels.json\"\nmasks = \"masks\"\n");
    fs::write(&recipe, text).unwrap();
    folder.dataset("out", &[]).ok();
    let mut checked = 0;
    for line in folder.lines("out") {
        let key = line["key"].as_str().unwrap();
        let found = &line["annotations"][0];
        let points: Vec<f64> =
            found["keypoints"].as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect();
        let clean = read_npy(&folder.at(&format!("out/000000/{key}.clean.npy")));
        let green = &clean[size.pixels()..][..size.pixels()];
        for point in points.as_chunks::<3>().0.iter().filter(|p| p[2] > 0.0) {
            let (cx, cy) = (point[0].round() as usize, point[1].round() as usize);
            if !(8..size.width - 8).contains(&cx) || !(8..size.height - 8).contains(&cy) {
                continue;
            }
            let (mut sum, mut x, mut y) = (0.0, 0.0, 0.0);
            for (row, column) in
                (cy - 7..=cy + 7).flat_map(|row| (cx - 7..=cx + 7).map(move |column| (row, column)))
            {
                let v = f64::from(green[row * size.width + column]);
                (sum, x, y) = (sum + v, x + v * column as f64, y + v * row as f64);
            }
            let (dx, dy) = (x / sum - point[0], y / sum - point[1]);
            assert!(dx.abs() < 0.02 && dy.abs() < 0.02, "{key}: {dx:.4} {dy:.4} px at {cx}, {cy}");
            checked += 1;
        }
        // The box of the first dot lies around its keypoint, and the mask has its number there.
        let bbox: Vec<f64> = found["bbox"].as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect();
        let middle = [bbox[0] + bbox[2] / 2.0 - 0.5, bbox[1] + bbox[3] / 2.0 - 0.5];
        assert!(
            (middle[0] - points[0]).abs() < 0.02 && (middle[1] - points[1]).abs() < 0.02,
            "{bbox:?} {points:?}"
        );
        let mask = formats::chart::image::ImageFile::open(&folder.at(&format!("out/000000/{key}.mask.png")))
            .unwrap();
        let values = mask.linear_part(formats::chart::image::Transfer::Linear, size.rect()).unwrap();
        let at = points[1].round() as usize * size.width + points[0].round() as usize;
        assert_eq!((values[at] * 255.0).round(), 1.0);
    }
    assert!(checked > 60, "{checked} dots");
}

#[test]
fn what_cannot_be_is_refused_before_work() {
    let folder = Folder::new(1);
    let refused = |from: &str, to: &str, code: i32, texts: &[&str]| {
        let recipe = folder.recipe("samples = 3", "film = \"png\"");
        let written = fs::read_to_string(&recipe).unwrap();
        assert!(written.contains(from), "{from}");
        fs::write(&recipe, written.replace(from, to)).unwrap();
        assert_error_line(&folder.dataset("out", &[]), code, texts);
        assert!(!folder.at("out").exists(), "{to}");
    };
    refused("samples = 3", "sample = 3", 2, &["line 2, column 1", "unknown field `sample`"]);
    refused("files = \"in\"", "files = \"inn\"", 2, &["inn", "no such file"]);
    refused("files = \"in\"", "files = \"in/*.jpg\"", 2, &["in/*.jpg", "no file matches"]);
    refused("double-gauss-28-npz", "double-gaus", 2, &["double-gaus", "built-in lenses"]);
    refused("interpolate_psf = true", "shard = 512", 2, &["--shard does not apply"]);
    refused("interpolate_psf = true", "focus_m = 1", 2, &["lens.focus_m"]);
    refused(
        "interpolate_psf = true",
        "foo = 1",
        2,
        &["'--foo' found; `lenscube run --help` lists the flags"],
    );
    refused("[650, 550, 450]", "[650, 550]", 2, &["red, green and blue, found 2"]);
    refused("film = \"png\"", "picture = \"png\"", 2, &["[sensor]"]);
    refused(
        "film = \"png\"",
        "film = \"png\"\n[sensor]\nname = \"example-2um\"\nexposure = \"10ms\"",
        2,
        &["film_scale"],
    );
    refused("film = \"png\"", "film = \"png\"\n[sensor]\nname = \"nothing\"", 2, &["nothing"]);
    refused("size = [32, 24]", "size = [32, 24]\nlabels = \"none.json\"", 2, &["none.json"]);
    refused("film = \"png\"", "film = \"npy\"\nas = \"zarr\"\nunit = 60000", 2, &["output.unit"]);
    // A data set of another recipe, files of others, and pictures are not touched.
    folder.recipe("samples = 3", "film = \"png\"");
    folder.dataset("out", &[]).ok();
    let before = files(&folder.at("out"));
    folder.recipe("samples = 3\nseed = 2", "film = \"png\"");
    assert_error_line(
        &folder.dataset("out", &[]),
        3,
        &["another recipe: seed (1 there, 2 in this recipe)", "--overwrite"],
    );
    assert!(files(&folder.at("out")) == before);
    folder.dataset("out", &["--overwrite"]).ok();
    assert!(files(&folder.at("out")) != before);
    let picture = fs::File::options().write(true).open(folder.at("in/p0.png")).unwrap();
    picture.set_modified(std::time::SystemTime::UNIX_EPOCH).unwrap();
    assert_error_line(&folder.dataset("out", &[]), 3, &["the same pictures with other modification times"]);
    let pictures = files(&folder.at("in"));
    assert_error_line(&folder.dataset("in", &["--overwrite"]), 2, &["one another"]);
    assert!(files(&folder.at("in")) == pictures);
    fs::create_dir(folder.at("mine")).unwrap();
    fs::write(folder.at("mine/notes.txt"), "x").unwrap();
    assert_error_line(&folder.dataset("mine", &["--overwrite"]), 3, &["notes.txt"]);
    assert!(folder.at("mine/notes.txt").exists());
}

#[test]
fn a_lens_file_that_changes_makes_another_data_set() {
    let folder = Folder::new(1);
    let bands: Vec<LensBand> = [450.0, 550.0, 650.0].map(|nm| identity_band(nm, 1.0, 21)).into();
    let lens = lens(bands);
    let write = |seed: u64| {
        let stacks = lens.bands.iter().map(|band| scattered(seed, band)).collect();
        write_pack(&folder.at("my.lens.zarr"), &lens, stacks);
    };
    write(1);
    let recipe = folder.recipe("samples = 2", "film = \"png\"");
    let text = fs::read_to_string(&recipe).unwrap();
    let text = text.replace(LENS, "my.lens.zarr").replace("center_mm = [[0, 0], [3, -2], [0.5, 4]]\n", "");
    fs::write(&recipe, text).unwrap();
    folder.dataset("out", &[]).ok();
    let line = &folder.lines("out")[0];
    assert_eq!((&line["lens"], &line["picture"]), (&Value::from("my.lens.zarr"), &Value::from("in/p0.png")));
    folder.dataset("out", &[]).ok();
    fs::remove_dir_all(folder.at("my.lens.zarr")).unwrap();
    write(2);
    assert_error_line(&folder.dataset("out", &[]), 3, &["other files of the lenses", "--overwrite"]);
}

#[test]
fn damaged_units_are_found_and_made_again() {
    let folder = Folder::new(2);
    folder.recipe("samples = 6", "film = \"png\"\nunit = 3");
    folder.dataset("out", &[]).ok();
    let whole = files(&folder.at("out"));
    let file = folder.at("out/000001/000000004.film.png");
    let mut bytes = fs::read(&file).unwrap();
    bytes[50] ^= 1;
    fs::write(&file, bytes).unwrap();
    let out = folder.at("out");
    let found = lenscube(&["verify", text(&out)]);
    assert_eq!(found.code, 4);
    assert!(found.stdout.contains("damaged: 000000004.film.png"), "{}", found.stdout);
    assert_eq!(lenscube(&["verify", text(&out), "--repair"]).code, 4);
    folder.dataset("out", &[]).ok();
    assert!(files(&out) == whole);
    lenscube(&["verify", text(&out)]).ok();
    fs::write(out.join("samples.jsonl"), "").unwrap();
    let found = lenscube(&["verify", text(&out), "--repair"]);
    assert!(found.code == 4 && found.stdout.contains("damaged: samples.jsonl"), "{}", found.stdout);
    folder.dataset("out", &[]).ok();
    assert!(files(&out) == whole);
}

#[test]
fn a_picture_among_cubes_is_reported_and_skipped() {
    let folder = Folder::new(1);
    let chart = folder.at("in/a.zarr");
    let flags = ["--film-size", "64", "--film-pitch-um", "2", "--wavelengths", "450,550,650"];
    lenscube(&[&["chart", "composite", text(&chart)][..], &flags].concat()).ok();
    let recipe = folder.recipe("", "film = \"npy\"");
    let text = fs::read_to_string(&recipe).unwrap();
    fs::write(&recipe, text.replace("wavelengths_nm = [650, 550, 450]\n", "")).unwrap();
    let result = folder.dataset("out", &[]);
    assert_eq!(result.code, 4, "{}", result.stderr);
    assert!(
        result.stderr.contains("p0.png") && result.stderr.contains("expected a cube"),
        "{}",
        result.stderr
    );
}

#[test]
fn a_cube_without_wavelengths_is_told_how_it_gets_them() {
    let folder = Folder::new(0);
    let cube = folder.at("in/cube.npy");
    write_npy_of(&cube, &[3, 40, 48], &vec![0.5; 3 * SIZE.pixels()]);
    folder.recipe("samples = 1", "film = \"npy\"");
    let command = format!("`lenscube export {} CHART.hdr`", text(&cube));
    assert_error_line(&folder.dataset("out", &[]), 2, &["no --wavelengths", &command]);
}

#[test]
fn a_dry_run_writes_nothing_and_says_what_would_be() {
    let folder = Folder::new(2);
    folder.recipe("samples = 100", "film = \"png\"\nclean = \"png\"");
    let result = folder.dataset("out", &["--dry-run", "--json"]).ok();
    let report: Value = serde_json::from_str(&result.stdout).unwrap();
    assert_eq!((report["samples"].as_u64(), report["pictures"].as_u64()), (Some(100), Some(2)));
    assert!(report["forecast_bytes"].as_f64().unwrap() > 100.0 * 500.0);
    assert!(!folder.at("out").exists());
}
