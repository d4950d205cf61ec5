//! Scatter and veiling glare: closed forms on films of the program, the same bytes however a film is made, the stored layer, and errors.

use crate::common::test_job::TestJob;
use crate::common::{
    CommandResult, Picture, assert_error_line, assert_exit, bits, files, identity_band, lens, lenscube,
    pixels, run, scattered, shards, text, write_npy, write_pack,
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
    for (threads, memory) in [("1", "512MiB"), ("7", "4GiB"), ("2", "4GiB")] {
        let flags = [&VEIL[..], &["--memory", memory]].concat();
        let mut command = job.command_on(threads, &job.at(threads), &flags);
        CommandResult::new(&command.output().unwrap()).ok();
        assert!(files(&job.at(threads)) == first, "{threads} threads, {memory}");
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
    // Nine renames create the film, two are those of the layers.
    let faults: Vec<String> = (1..=13)
        .flat_map(|n| [format!("rename:{n}:kill"), format!("write:{n}:kill")])
        .chain(["layer-made:1", "layer-made:2", "layer-committed:1"].map(|point| format!("{point}:kill")))
        .collect();
    for fault in faults {
        let ran = job.run(&fault, &VEIL);
        kills += usize::from(ran.code == KILLED);
        let layers = |band: usize| job.film.join(format!("veil/c/{band}/0/0")).exists();
        let all = if job.film.exists() { shards(&job.film) } else { Vec::new() };
        let is_shard = |p: &PathBuf| !text(p).contains(".tmp-");
        let shards = |band: usize| {
            let of_band = Path::new("film/c").join(band.to_string());
            all.iter().filter(|p| is_shard(p)).any(|p| p.starts_with(&of_band))
        };
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
    // Shards have their light already: a layer that is lost is made again alone.
    fs::remove_file(&layer).unwrap();
    assert_exit(&lenscube(&["status", text(&job.film), "--check"]), 4, &[]);
    let restored = job.run("", &VEIL);
    assert_exit(&restored, 0, &["band 1 (", "lost, computed again", "nothing to do"]);
    assert!(files(&job.film) == intact);
    assert_exit(&lenscube(&["status", text(&job.film), "--check"]), 0, &[]);
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
        (&["--scatter", "3%,blur=5"], &["blur", "SHARE|roughness=NM[,r0=UM][,slope=S][,reach=MM]"]),
        (&["--veiling-glare", "49%", "--scatter", "45%"], &["--veiling-glare", "--scatter", "0.9"]),
        (&["--scatter", "roughness=-1"], &["roughness", "0 to 1e3 nm"]),
        (&["--scatter", "roughness=1"], &["roughness", "lens pack", "--scatter SHARE"]),
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

/// The limit that a job needs at least is named; one that suffices for the job without the veil is too small for that with it.
#[test]
fn memory_that_the_veil_lacks_is_an_error_that_names_larger_bins() {
    let scene = Scene::new(Size::new(8, 8), |_, _| 1.0);
    let film = scene.dir.path().join("film");
    let with = |limit: &str, flags: &[&str]| {
        let always = ["--outside", "clamp", "--stages", "ri,distortion", "--memory", limit, "--dry-run"];
        let chart = "gen:checker?size=4096&wavelengths=450&pitch_um=2";
        run(chart, &film, text(&scene.pack), &[&always[..], flags].concat())
    };
    let refused = with("20MiB", &[]);
    let words: Vec<&str> = refused.stderr.split_whitespace().collect();
    let at = words.iter().position(|word| *word == "least").unwrap();
    let enough = words[at + 1].trim_end_matches(';');
    with(enough, &[]).ok();
    assert_error_line(&with(enough, &VEIL), 2, &["light that spreads over the film", "--veil-bin 64"]);
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

/// The veil is that of what the middle of the pupil sees: of one surface with a distance per pixel its chart, as if it were flat.
#[test]
fn surfaces_at_several_distances_have_the_veil_of_what_is_seen() {
    let dir = tempfile::tempdir().unwrap();
    let size = Size::new(560, 530);
    let pack = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden/depth/packs/six-slabs.lens.zip");
    let depth = dir.path().join("depth.npy");
    let metres: Vec<f32> = (0..size.pixels()).map(|i| if i % 530 < 260 { 0.55 } else { 3.0 }).collect();
    write_npy(&depth, size, &metres);
    let film = |name: &str, flags: &[&str]| {
        let film = dir.path().join(name);
        let always = ["--wavelengths", "500", "--outside", "clamp", "--depth", text(&depth)];
        run("gen:composite?size=530x560&overscan=0", &film, text(&pack), &[&always[..], flags].concat()).ok();
        film
    };
    let pixel_values = |film: &Path| pixels(film, "film").1.remove(0);
    let without = pixel_values(&film("without", &[]));
    let with = film("with", &["--veiling-glare", "2%"]);
    // Means over the film: of the layer's bins, and of the film itself, whose PSFs move light over its edge and whose blur is that of distances.
    let mean = without.iter().map(|v| f64::from(*v)).sum::<f64>() / without.len() as f64;
    for (a, b) in std::iter::zip(&without, pixel_values(&with)) {
        let glare = f64::from(b) - 0.98 * f64::from(*a);
        assert!((glare / (0.02 * mean) - 1.0).abs() < 0.02, "{glare} {}", 0.02 * mean);
    }
    let again = film("again", &["--veiling-glare", "2%", "--threads", "1"]);
    assert!(files(&again) == files(&with));
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

/// TIS of each surface, from the indices that `lens light` prints: 1 − Π (1 − TIS), as the film has it at each wavelength.
#[test]
fn roughness_scatters_what_the_surfaces_of_the_design_do() {
    let dir = tempfile::tempdir().unwrap();
    let film = dir.path().join("film");
    let flags = ["--stages", "ri,distortion", "--scatter", "roughness=2,r0=5"];
    // 587.6 nm is the primary wavelength, at which the surfaces are listed.
    let chart = "gen:uniform?size=128&wavelengths=587.6,450&pitch_um=200&value=1";
    run(chart, &film, "double-gauss-28", &flags).ok();
    let metadata: serde_json::Value =
        serde_json::from_slice(&fs::read(film.join("veil/zarr.json")).unwrap()).unwrap();
    let [taken, parts] = ["share_taken", "parts"].map(|key| &metadata["attributes"][key]);
    let listed = lenscube(&["lens", "light", "double-gauss-28", "--coatings", "none", "--json"]).ok().stdout;
    let listed: serde_json::Value = serde_json::from_str(&listed).unwrap();
    let surfaces = listed["surfaces"].as_array().unwrap();
    let remaining = surfaces.iter().fold(1.0, |product, surface| {
        let [before, behind] = ["index_before", "index_behind"].map(|key| surface[key].as_f64().unwrap());
        let phase: f64 = 2.0 * std::f64::consts::PI * (behind - before) * 2.0 / 587.6;
        product * (-phase * phase).exp()
    });
    let found = [0, 1].map(|band| taken[band].as_f64().unwrap());
    assert!((found[0] / (1.0 - remaining) - 1.0).abs() < 1e-9, "{found:?} {}", 1.0 - remaining);
    // The inverse square of the wavelength, and the dispersion of the glasses.
    let ratio = found[1] / found[0] / (587.6f64 / 450.0).powi(2);
    assert!((1.0..1.1).contains(&ratio), "{found:?}");
    assert_eq!(&parts["scatter"], taken);
    let middle: Vec<f32> = pixels(&film, "film").1.iter().map(|band| band[64 * 128 + 64]).collect();
    assert!(middle.iter().all(|value| (value - 1.0).abs() < 1e-5), "{middle:?}");
    let others = ["--stages", "ri,distortion", "--scatter", "roughness=2.1,r0=5"];
    assert_error_line(&run(chart, &film, "double-gauss-28", &others), 3, &["--scatter (film {", "2.1"]);
    let rough = ["--scatter", "roughness=900", "--dry-run"];
    assert_error_line(&run(chart, &film, "double-gauss-28", &rough), 2, &["--scatter roughness=900", "50%"]);
}

/// The entries of the cache of reduced charts.
fn reduced_charts(cache: &Path) -> Vec<PathBuf> {
    let files = fs::read_dir(cache.join("lenscube/lenses")).into_iter().flatten();
    let mut all: Vec<_> = files.map(|file| file.unwrap().path()).collect();
    all.retain(|path| path.extension().is_some_and(|extension| extension == "reduced"));
    all.sort();
    all
}

#[test]
fn reduced_chart_is_read_from_the_cache_with_the_same_film() {
    let scene = Scene::new(Size::new(300, 310), |y, x| ((y * 7 + x * 3) % 11) as f32);
    let written = std::time::Instant::now();
    let (cache, other) = (scene.dir.path().join("cache"), scene.dir.path().join("other"));
    let drawn = "gen:checker?size=256&wavelengths=450&pitch_um=2&noise=0.1";
    let command = |chart: &str, film: &Path, cache: &Path| {
        let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_lenscube"));
        command.args(["run", chart, text(film), "--lens", text(&scene.pack), "--outside", "clamp"]);
        command.args(["--threads", "2", "--verbose"]).args(VEIL).env("XDG_CACHE_HOME", cache);
        command
    };
    let film = |chart: &str, name: &str, cache: &Path| {
        let film = scene.dir.path().join(name);
        let ran = CommandResult::new(&command(chart, &film, cache).output().unwrap()).ok();
        (files(&film), ran.stderr)
    };
    const FOUND: &str = "reduced chart of band 0: from the cache";
    let (expected, first) = film(drawn, "first", &cache);
    assert!(!first.contains(FOUND), "{first}");
    let [entry] = &reduced_charts(&cache)[..] else { panic!("{:?}", reduced_charts(&cache)) };
    let (again, second) = film(drawn, "second", &cache);
    assert!(second.contains(FOUND) && again == expected, "{second}");
    let listed = std::process::Command::new(env!("CARGO_BIN_EXE_lenscube"));
    let mut listed = listed;
    let listed = listed.arg("cache").env("XDG_CACHE_HOME", &cache).output().unwrap();
    let listed = CommandResult::new(&listed).ok().stdout;
    assert!(listed.contains("0 traced bands, 1 reduced chart band, 0.0 MB"), "{listed}");
    // Another chart, bin or treatment of its values is another entry.
    film("gen:checker?size=256&wavelengths=450&pitch_um=2&noise=0.2", "noisier", &cache);
    assert_eq!(reduced_charts(&cache).len(), 2);
    // A damaged entry is made anew.
    let mut bytes = fs::read(entry).unwrap();
    bytes[300] ^= 1;
    fs::write(entry, &bytes).unwrap();
    let (again, third) = film(drawn, "third", &cache);
    assert!(third.contains("cannot be used (it is damaged); the chart is read again"), "{third}");
    assert!(again == expected && reduced_charts(&cache).len() == 2 && fs::read(entry).unwrap() != bytes);
    // A directory that cannot be one.
    fs::write(&other, "").unwrap();
    assert!(film(drawn, "without", &other).0 == expected);
    // Killed before the entry has its name, then two at once.
    let race = scene.dir.path().join("race");
    let killed = command(drawn, &scene.dir.path().join("killed"), &race)
        .env("LENSCUBE_FAULT", "reduced-chart-written:1:kill")
        .output()
        .unwrap();
    assert!(CommandResult::new(&killed).code == KILLED && reduced_charts(&race).is_empty());
    let both = ["one", "two"].map(|name| {
        let mut command = command(drawn, &scene.dir.path().join(name), &race);
        command.stdout(std::process::Stdio::null()).stderr(std::process::Stdio::null());
        command.spawn().unwrap()
    });
    both.into_iter().for_each(|mut run| assert!(run.wait().unwrap().success()));
    assert!(["one", "two"].iter().all(|name| files(&scene.dir.path().join(name)) == expected));
    assert_eq!(fs::read_dir(race.join("lenscube/lenses")).unwrap().count(), 1, "one entry and no other file");
    // A chart in a file is kept once its last change is as old as the steps of clocks.
    while written.elapsed() < std::time::Duration::from_millis(4200) {
        std::thread::sleep(std::time::Duration::from_millis(50));
    }
    let of_file = scene.dir.path().join("of-file");
    let (expected, first) = film(text(&scene.chart), "file-first", &of_file);
    let (again, second) = film(text(&scene.chart), "file-second", &of_file);
    assert!(!first.contains(FOUND) && second.contains(FOUND) && again == expected, "{second}");
    // Written again just now: it is read, and not kept.
    fs::remove_dir_all(&scene.chart).unwrap();
    Picture { size: Size::new(300, 310), bands: vec![vec![0.5; 300 * 310]] }.write(&scene.chart);
    let (changed, third) = film(text(&scene.chart), "file-third", &of_file);
    assert!(!third.contains(FOUND) && changed != expected && reduced_charts(&of_file).len() == 1, "{third}");
}

/// A raw is measured in electrons without black level and dark signal: its index is that of its film, whose bands are all alike.
#[test]
fn index_of_a_raw_is_that_of_its_film() {
    let dir = tempfile::tempdir().unwrap();
    let (keep, out) = (dir.path().join("shot"), dir.path().join("shot.png"));
    let chart = "gen:black-spots?size=400&wavelengths=450:650:50&spots=1&diameter=40%";
    let words = ["shoot", chart, text(&out), "--lens", "double-gauss-28-npz", "--sensor", "example-2um"];
    let flags = ["--keep", text(&keep), "--veiling-glare", "5%", "--memory", "1GiB"];
    lenscube(&[&words[..], &flags].concat()).ok();
    let areas = ["--glare", "180,180,40,40", "--white-area", "5,5,30,30"];
    let index = |name: &str, key: &str| -> Vec<(String, f64)> {
        let json = dir.path().join(format!("{name}.json"));
        let path = keep.join(name);
        lenscube(&[&["measure", text(&path), "--json", text(&json)], &areas[..]].concat()).ok();
        let json: serde_json::Value = serde_json::from_slice(&fs::read(json).unwrap()).unwrap();
        let one = |band: &serde_json::Value| {
            (band[key].to_string(), band["figures"]["veiling_glare_index"].as_f64().unwrap())
        };
        json["bands"].as_array().unwrap().iter().map(one).collect()
    };
    let film = index("film.zarr", "wavelength_nm");
    let raw = index("raw.zarr", "plane");
    assert_eq!(raw.iter().map(|(plane, _)| &**plane).collect::<Vec<_>>(), ["\"R\"", "\"G\"", "\"B\""]);
    let expected = film.iter().map(|(_, index)| index).sum::<f64>() / film.len() as f64;
    assert!(film.iter().all(|(_, index)| (index / expected - 1.0).abs() < 1e-2), "{film:?}");
    assert!(raw.iter().all(|(_, index)| (index / expected - 1.0).abs() < 0.03), "{raw:?} {expected}");
    let path = keep.join("raw.zarr");
    let tiny = ["measure", text(&path), "--glare", "180,180,40,40", "--white-area", "5,5,1,1"];
    assert_exit(&lenscube(&tiny), 2, &["the white area", "no pixel of this colour"]);
    let frame = [&["measure", text(&path), "--frame", "1"], &areas[..]].concat();
    assert_exit(&lenscube(&frame), 2, &["--frame 1"]);
}

/// Glare of a lamp on a dark ground: everywhere the same share of the light of the film, so all percentiles are one value, and the light outside over that inside follows from it.
#[test]
fn flare_of_a_lamp_with_glare_has_its_closed_form() {
    let scene = Scene::new(Size::new(8, 8), |_, _| 1.0);
    let at = |name: &str| scene.dir.path().join(name);
    let (film, json, csv) = (at("lamp.zarr"), at("flare.json"), at("flare.csv"));
    // Radius 20.5 px about pixel (150, 140).
    let chart = "gen:lamp?size=304&radius=20.5&x=140&y=150&wavelengths=450&pitch_um=2&overscan=0";
    let flags = ["--stages", "ri,distortion", "--veiling-glare", "1%", "--outside", "clamp"];
    run(chart, &film, text(&scene.pack), &flags).ok();
    let (map, plot) = (at("map.png"), at("flare.svg"));
    let words = ["measure", text(&film), "--flare", "140,150,22", "--json", text(&json), "--csv", text(&csv)];
    let outputs = ["--map", text(&map), "--plot", text(&plot)];
    let measured = lenscube(&[&words[..], &outputs].concat()).ok().stdout;
    assert!(
        measured.contains("450 nm: normalised flare of the lamp") && measured.contains(" dB)"),
        "{measured}"
    );
    let json: serde_json::Value = serde_json::from_slice(&fs::read(json).unwrap()).unwrap();
    let figures = &json["bands"][0]["figures"];
    // Light of 1 in the lamp of area π r² = s of the film: 0.99 + 0.01 s in it; within 22 px are n pixels of which π r² have the lamp.
    let share = std::f64::consts::PI * 20.5 * 20.5 / (304.0 * 304.0);
    let place = |i: usize| ((i / 304) as f64, (i % 304) as f64);
    let inside = (0..304 * 304).map(place).filter(|(y, x)| (y - 150.0).hypot(x - 140.0) <= 22.0);
    let n = inside.count() as f64;
    let lamp = 0.01 * share + 0.99 * share * 304.0 * 304.0 / n;
    // The ground has a millionth of the lamp's light.
    let beside = 0.01 * share + 0.99e-6;
    for percentile in ["p50", "p95", "p99_9"] {
        let found = figures["normalised_flare"][percentile].as_f64().unwrap();
        assert!((found / (beside / lamp) - 1.0).abs() < 5e-4, "{percentile}: {found} {}", beside / lamp);
    }
    let outside = beside * (304.0 * 304.0 - n) / (lamp * n);
    let found = figures["outside_over_inside"].as_f64().unwrap();
    assert!((found / outside - 1.0).abs() < 1e-3, "{found} {outside}");
    let profile = fs::read_to_string(csv).unwrap();
    assert!(profile.starts_with("wavelength_nm,distance_px,normalised_flare\n450,0.500000,"), "{profile}");
    assert!(
        fs::read(map).unwrap().starts_with(b"\x89PNG")
            && fs::read_to_string(plot).unwrap().contains("normalised flare (dB)")
    );
    for (flags, texts) in [
        (&["--flare", "5,150,22"][..], &["--flare", "is not inside the image of 304x304"][..]),
        (&["--flare", "140,150,0.5"], &["--flare", "the radius"]),
        (&["--flare", "140,150,22", "--map", "map.svg"], &["--map", ".png"]),
        (&["--points", "140,150", "--map", "map.png"], &["--map", "--points"]),
        (&["--flare", "140,150,22", "--frame", "1"], &["--frame", "not a raw"]),
    ] {
        assert_exit(&lenscube(&[&["measure", text(&film)], flags].concat()), 2, texts);
    }
}
