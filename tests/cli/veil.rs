//! Scatter and veiling glare: closed forms on films of the program, the same bytes however a film is made, the stored layer, and errors.

use crate::common::test_job::TestJob;
use crate::common::{
    CommandResult, Picture, assert_error_line, assert_exit, bits, files, identity_band, lens, lenscube,
    pixels, run, scattered, text, write_pack,
};
use pipeline::geometry::Size;
use std::fs;
use std::path::{Path, PathBuf};

const VEIL: [&str; 4] = ["--veiling-glare", "2%", "--scatter", "3%,r0=5,slope=2.2"];
const KILLED: i32 = -1;

/// A chart of `size` with the value f(row, column) in one band, and a lens without aberrations.
struct Scene {
    dir: tempfile::TempDir,
    chart: PathBuf,
    pack: PathBuf,
}

impl Scene {
    fn new(size: Size, f: impl Fn(usize, usize) -> f32) -> Self {
        let dir = tempfile::tempdir().unwrap();
        let (chart, pack) = (dir.path().join("chart.zarr"), dir.path().join("pack.lens.zip"));
        let values = (0..size.pixels()).map(|i| f(i / size.width, i % size.width)).collect();
        Picture { size, bands: vec![values] }.write(&chart);
        let lens = lens(vec![identity_band(450.0, 1.0, 5)]);
        let stacks = lens.bands.iter().map(|band| scattered(1, band)).collect();
        write_pack(&pack, &lens, stacks);
        Self { dir, chart, pack }
    }

    /// The pixels of the film with `flags`.
    fn film(&self, name: &str, flags: &[&str]) -> Vec<f32> {
        let film = self.dir.path().join(name);
        run(text(&self.chart), &film, text(&self.pack), &[&["--outside", "clamp"], flags].concat()).ok();
        pixels(&film, "film").1.remove(0)
    }
}

/// Side of the film with a black disc, px.
const SIDE: usize = 1024;
/// Radius of the disc, px.
const DISC_PX: f64 = 188.0;
/// Its centre, row and column, that of a bin of 8 px.
const CENTRE_PX: f64 = 515.5;

fn is_black(y: usize, x: usize) -> bool {
    (y as f64 - CENTRE_PX).hypot(x as f64 - CENTRE_PX) <= DISC_PX
}

fn black_disc() -> Scene {
    Scene::new(Size::new(SIDE, SIDE), |y, x| f32::from(!is_black(y, x)))
}

/// Share g of the light is spread evenly; a black part f of the film: index g (1 − f)/(1 − g f).
#[test]
fn veiling_glare_of_a_black_disc_has_its_closed_form() {
    let film = black_disc().film("film", &["--stages", "ri,distortion", "--veiling-glare", "2%"]);
    let black = (0..SIDE * SIDE).filter(|i| is_black(i / SIDE, i % SIDE)).count();
    let share = black as f64 / (SIDE * SIDE) as f64;
    let expected = 0.02 * (1.0 - share) / (1.0 - 0.02 * share);
    let index = f64::from(film[515 * SIDE + 515]) / f64::from(film[10 * SIDE + 10]);
    assert!((index / expected - 1.0).abs() < 1e-6, "{index} {expected}");
}

/// The chart of black spots, measured in its middle spot and beside it.
#[test]
fn index_of_black_spots_is_measured() {
    let scene = Scene::new(Size::new(8, 8), |_, _| 1.0);
    let film = scene.dir.path().join("spots.zarr");
    let chart = "gen:black-spots?size=360&diameter=10%&wavelengths=450&pitch_um=2&overscan=0";
    let flags = ["--stages", "ri,distortion", "--veiling-glare", "2%", "--outside", "clamp"];
    run(chart, &film, text(&scene.pack), &flags).ok();
    let json = scene.dir.path().join("index.json");
    let areas = ["--glare", "172,172,16,16", "--white-area", "230,172,16,16", "--json", text(&json)];
    let measured = lenscube(&[&["measure", text(&film)], &areas[..]].concat()).ok().stdout;
    assert!(measured.contains("450 nm: veiling glare index 1.8") && measured.contains(" dB)"), "{measured}");
    let json: serde_json::Value = serde_json::from_slice(&fs::read(json).unwrap()).unwrap();
    let index = json["bands"][0]["figures"]["veiling_glare_index"].as_f64().unwrap();
    // Nine discs with a diameter of 36 px.
    let share = 9.0 * std::f64::consts::PI * 18.0 * 18.0 / (360.0 * 360.0);
    let expected = 0.02 * (1.0 - share) / (1.0 - 0.02 * share);
    assert!((index / expected - 1.0).abs() < 1e-5, "{index} {expected}");
    let alone = lenscube(&["measure", text(&film), "--glare", "172,172,16,16"]);
    assert_exit(&alone, 2, &["--white-area"]);
    let outside = ["measure", text(&film), "--glare", "172,172,16,16", "--white-area", "350,0,16,16"];
    assert_exit(&lenscube(&outside), 2, &["the white area", "360x360"]);
}

/// ∫ (1 + (r/r₀)²)^(−s/2) over the disc of radius `r`.
fn mass(r: f64, r0: f64, slope: f64) -> f64 {
    let log = (r / r0).powi(2).ln_1p();
    let power = 1.0 - slope / 2.0;
    if power == 0.0 { log } else { (power * log).exp_m1() / power }
}

/// The share of the kernel outside the disc, in an unlimited white field.
#[test]
fn scatter_of_a_black_disc_has_its_closed_form() {
    let scene = black_disc();
    for (slope, r0_um) in [(2.0, 12.5), (2.5, 25.0), (3.0, 125.0)] {
        let scatter = format!("3%,r0={r0_um},slope={slope},reach=1");
        let film = scene.film(&scatter, &["--stages", "ri,distortion", "--scatter", &scatter]);
        let found = f64::from(film[515 * SIDE + 515]);
        let expected = 0.03 * (1.0 - mass(2.0 * DISC_PX, r0_um, slope) / mass(1000.0, r0_um, slope));
        assert!((found / expected - 1.0).abs() < 0.01, "{slope}: {found} {expected}");
    }
}

/// Rounding of f32. The veil spreads the light before the PSF, 0.75 everywhere; PSFs whose centroid moves with the field leave the image itself slightly uneven.
#[test]
fn uniform_chart_with_surround_edge_is_unchanged() {
    let scene = Scene::new(Size::new(300, 410), |_, _| 0.75);
    let veil = ["--scatter", "6%,r0=10", "--veiling-glare", "4%"];
    for stages in ["ri,distortion", "ri,distortion,svpsf"] {
        let flags = ["--stages", stages];
        let without = scene.film(&format!("without {stages}"), &flags);
        let with = scene.film(&format!("with {stages}"), &[&flags[..], &veil].concat());
        for (i, (a, b)) in std::iter::zip(without, with).enumerate() {
            let expected = 0.9 * f64::from(a) + 0.1 * 0.75;
            assert!(
                (f64::from(b) / expected - 1.0).abs() < 2e-6,
                "{stages}, pixel {i}: {a} without, {b} with"
            );
        }
    }
}

/// Light of a bright spot far from the edges: all of it is on the film and its scatter beyond the film is dark.
#[test]
fn light_of_the_film_is_that_of_the_film_without() {
    let is_bright = |y: usize, x: usize| (240..270).contains(&y) && (230..290).contains(&x);
    let scene = Scene::new(Size::new(512, 512), |y, x| if is_bright(y, x) { 100.0 } else { 0.0 });
    let sum = |film: Vec<f32>| film.iter().map(|v| f64::from(*v)).sum::<f64>();
    let flags = ["--stages", "ri,distortion", "--surround", "black"];
    let without = sum(scene.film("without", &flags));
    let veil = ["--veiling-glare", "1%", "--scatter", "5%,r0=4,reach=0.4"];
    let with = sum(scene.film("with", &[&flags[..], &veil].concat()));
    assert!((with / without - 1.0).abs() < 2e-6, "{with} {without}");
}

#[test]
fn shares_of_zero_are_no_veil() {
    let job = TestJob::small();
    let expected = job.expected_files();
    job.run("", &["--veiling-glare", "0", "--scatter", "0,slope=2", "--veil-bin", "auto"]).ok();
    assert!(files(&job.film) == expected);
}

#[test]
fn film_bytes_do_not_depend_on_threads_or_memory() {
    let job = TestJob::large();
    let run = |name: &str, flags: &[&str]| {
        let film = job.at(name);
        let flags = [&VEIL[..], flags].concat();
        CommandResult::new(&job.command(&film, "", &flags).output().unwrap()).ok();
        files(&film)
    };
    let first = run("first", &[]);
    assert!(first.contains_key(Path::new("veil/c/1/0/0")), "{:?}", first.keys());
    for (name, flags) in [
        ("one", ["--memory", "512MiB", "--threads", "1"]),
        ("seven", ["--memory", "4GiB", "--threads", "7"]),
        ("two", ["--memory", "4GiB", "--threads", "2"]),
    ] {
        // The later --threads of the two is that of the job; both are given once per run.
        let mut command = job.command(&job.at(name), "", &VEIL);
        let words: Vec<String> = command.get_args().map(|a| a.to_string_lossy().into_owned()).collect();
        let at = words.iter().position(|w| w == "--threads").unwrap();
        let others =
            words.iter().enumerate().filter(|(i, _)| *i != at && *i != at + 1).map(|(_, w)| w.clone());
        let all: Vec<String> = others.chain(flags.map(str::to_owned)).collect();
        command = std::process::Command::new(env!("CARGO_BIN_EXE_lenscube"));
        CommandResult::new(&command.args(&all).output().unwrap()).ok();
        assert!(files(&job.at(name)) == first, "{flags:?}");
    }
}

#[test]
fn regions_have_the_pixels_of_the_whole_film() {
    let job = TestJob::large();
    job.run("", &VEIL).ok();
    let (size, whole) = pixels(&job.film, "film");
    let whole = bits(&whole);
    let film = job.at("regions.zarr");
    let flags = [&VEIL[..], &["--roi", "300,411,320,200", "--roi", "5,600,690,31"]].concat();
    CommandResult::new(&job.command(&film, "", &flags).output().unwrap()).ok();
    for (i, (x, y, w, h)) in [(300, 411, 320, 200), (5, 600, 690, 31)].into_iter().enumerate() {
        let part = |band: &Vec<u32>| -> Vec<u32> {
            (y..y + h).flat_map(|row| band[row * size.width + x..][..w].to_vec()).collect()
        };
        let expected: Vec<_> = whole.iter().map(part).collect();
        assert!(bits(&pixels(&film, &format!("roi_{i}")).1) == expected, "region {i}");
    }
    assert!(fs::read(film.join("veil/c/0/0/0")).unwrap() == fs::read(job.film.join("veil/c/0/0/0")).unwrap());
}

#[test]
fn killed_runs_leave_the_bytes_of_an_undisturbed_one() {
    let job = TestJob::small();
    let whole = job.at("whole.zarr");
    CommandResult::new(&job.command(&whole, "", &VEIL).output().unwrap()).ok();
    let expected = files(&whole);
    let (mut kills, mut of_layers) = (0, 0);
    let faults: Vec<String> = (1..=10)
        .flat_map(|n| [format!("rename:{n}:kill"), format!("write:{n}:kill")])
        .chain(["layer-made:1", "layer-made:2", "layer-committed:1"].map(|point| format!("{point}:kill")))
        .collect();
    for fault in faults {
        let ran = job.run(&fault, &VEIL);
        kills += usize::from(ran.code == KILLED);
        let layers = |band: usize| job.film.join(format!("veil/c/{band}/0/0")).exists();
        let shards = |band: usize| job.film.join(format!("film/c/{band}")).exists();
        // No shard is there without the layer of its band.
        assert!((0..2).all(|band| layers(band) || !shards(band)), "{fault}");
        of_layers += usize::from(ran.code == KILLED && layers(0) != layers(1));
        let again = job.run("", &VEIL);
        assert_eq!(again.code, 0, "{fault}: {}", again.stderr);
        assert!(files(&job.film) == expected, "{fault}");
        assert_eq!(job.leftover_files(), Vec::<PathBuf>::new(), "{fault}");
        fs::remove_dir_all(&job.film).unwrap();
    }
    assert!(kills >= 20 && of_layers > 0, "{kills} kills, {of_layers} between the layers");
}

#[test]
fn damaged_layer_is_found_and_repaired_with_the_shards_of_its_band() {
    let job = TestJob::small();
    job.run("", &VEIL).ok();
    let intact = files(&job.film);
    assert_exit(&lenscube(&["verify", text(&job.film)]), 0, &["is correct"]);
    let status = lenscube(&["status", text(&job.film)]).ok().stdout;
    assert!(status.contains("veil    light beside the image of 2 of 2 bands"), "{status}");
    let layer = job.film.join("veil/c/1/0/0");
    let mut bytes = fs::read(&layer).unwrap();
    bytes[100] ^= 1;
    fs::write(&layer, &bytes).unwrap();
    fs::remove_file(job.film.join("film/c/1/0/0")).unwrap();
    // A run that needs it does not use it.
    assert_error_line(&job.run("", &VEIL), 1, &["veil/c/1/0/0", "checksum", "--repair"]);
    assert_exit(
        &lenscube(&["verify", text(&job.film)]),
        4,
        &["bad: veil/c/1/0/0: its checksum does not match"],
    );
    assert_eq!(lenscube(&["verify", text(&job.film), "--repair"]).code, 4);
    assert!(
        !layer.exists() && !job.film.join("film/c/1/1/1").exists() && job.film.join("film/c/0/1/1").exists()
    );
    let status = lenscube(&["status", text(&job.film), "--json"]).ok().stdout;
    let status: serde_json::Value = serde_json::from_str(&status).unwrap();
    assert_eq!(status["layers"], serde_json::json!([{"name": "veil", "bands": 2, "bands_done": 1}]));
    job.run("", &VEIL).ok();
    assert!(files(&job.film) == intact);
    // With --overwrite of another job the array is removed, too.
    job.run("", &["--overwrite"]).ok();
    assert!(!job.film.join("veil").exists());
}

#[test]
fn other_light_is_another_job() {
    let job = TestJob::small();
    job.run("", &VEIL).ok();
    let with = |flags: &[&str]| job.run("", flags);
    assert_error_line(
        &with(&[]),
        3,
        &["--veiling-glare (film 0.02, requested nothing)", "--scatter (film {"],
    );
    assert_error_line(&with(&["--veiling-glare", "2%"]), 3, &["--scatter (film {"]);
    let scatter = ["--veiling-glare", "2%", "--scatter", "3%,r0=5,slope=2.3"];
    assert_error_line(&with(&scatter), 3, &["--scatter (film {", "2.2", "2.3"]);
    assert_error_line(
        &with(&[&VEIL[..], &["--veil-bin", "16"]].concat()),
        3,
        &["--veil-bin (film nothing, requested 16)"],
    );
    // The bin of the film's size may be named.
    with(&[&VEIL[..], &["--veil-bin", "8"]].concat()).ok();
}

#[test]
fn light_that_does_not_fit_is_an_error_before_work() {
    let job = TestJob::small();
    for (flags, texts) in [
        (&["--veiling-glare", "50%"][..], &["50%", "share"][..]),
        (&["--scatter", "3%,slope=1"], &["slope", "1.000001 to 4"]),
        (&["--scatter", "3%,r0=0.5"], &["r0", "1 to"]),
        (&["--scatter", "3%,reach=0.01"], &["--scatter", "reach", "4 bins of 8 film pixels"]),
        (&["--scatter", "3%,reach=5"], &["--scatter", "reach"]),
        (&["--scatter", "3%,blur=5"], &["blur", "SHARE[,r0=UM][,slope=S][,reach=MM]"]),
        (&["--veiling-glare", "49%", "--scatter", "45%"], &["--veiling-glare", "--scatter", "0.9"]),
        (&["--veil-bin", "16"], &["--veil-bin", "--veiling-glare"]),
        (&["--veiling-glare", "1%", "--veil-bin", "12"], &["8, 16, 32, 64 or auto"]),
        (&["--stages", "ri,veil"], &["veil"]),
    ] {
        let rejected = job.run("", flags);
        assert_exit(&rejected, 2, texts);
        assert!(!job.film.exists(), "{flags:?}");
    }
    let bin = TestJob::new(Size::new(40, 50), &["--shard", "64", "--chunk", "32"]);
    assert_error_line(
        &bin.run("", &["--veiling-glare", "1%", "--veil-bin", "64"]),
        2,
        &["--veil-bin 64", "50x40"],
    );
}

#[test]
fn forecast_and_plan_name_the_reading_before_the_tiles() {
    let job = TestJob::large();
    let forecast = job.run("", &[&VEIL[..], &["--dry-run"]].concat()).ok().stdout;
    assert!(
        forecast.contains("before the tiles, of 2 bands, for light that spreads far (veil)"),
        "{forecast}"
    );
    let plan = |flags: &[&str]| {
        let path = job.at("plan.json");
        let film = job.at("planned.zarr");
        let made = job.plan(&film, flags).args(["-o", text(&path)]).output().unwrap();
        let made = CommandResult::new(&made).ok();
        let plan: serde_json::Value = serde_json::from_slice(&fs::read(&path).unwrap()).unwrap();
        fs::remove_file(path).unwrap();
        fs::remove_dir_all(film).unwrap();
        (plan["totals"]["bytes_read"].as_u64().unwrap(), made.stderr)
    };
    let ((without, _), (with, note)) =
        (plan(&["--unit-rows", "1"]), plan(&[&VEIL[..], &["--unit-rows", "1"]].concat()));
    // Two bands of a chart of 631 x 705 px of f32 are read once more.
    assert_eq!(with - without, 2 * 631 * 705 * 4);
    assert!(note.contains("each compute it, with the same result"), "{note}");
}

#[test]
fn surfaces_at_several_distances_are_an_error() {
    let dir = tempfile::tempdir().unwrap();
    let scene = "gen:depth-scene?size=200x160&wavelengths=550";
    let depth = format!("{scene}&part=depth");
    let flags = ["--depth", &*depth, "--focus-m", "1", "--scatter", "1%"];
    let rejected = run(scene, &dir.path().join("film.zarr"), "double-gauss-28", &flags);
    assert_error_line(&rejected, 2, &["--veiling-glare, --scatter", "--depth none"]);
}

#[test]
fn shot_has_the_veil_of_its_flags() {
    let dir = tempfile::tempdir().unwrap();
    let (keep, out) = (dir.path().join("shot"), dir.path().join("shot.png"));
    let words = [
        "shoot",
        "gen:checker?size=300&wavelengths=450,550,650",
        text(&out),
        "--lens",
        "double-gauss-28-npz",
    ];
    let flags =
        ["--sensor", "example-2um", "--keep", text(&keep), "--veiling-glare", "1%", "--memory", "1GiB"];
    lenscube(&[&words[..], &flags].concat()).ok();
    assert!(keep.join("film.zarr/veil/c/2/0/0").exists());
}
