//! Films of the program against closed forms.

use super::*;
use crate::common::write_npy;

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
