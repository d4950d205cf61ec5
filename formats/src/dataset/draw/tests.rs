use super::*;

const DRAWN: &str = r#"
schema = "lenscube/dataset/1"
samples = 1000
seed = 5
[pictures]
files = "*.png"
[lens]
name = ["a", "b", "c"]
focus_m = { from = 0.5, to = 8, log = true }
[film]
pitch_um = 2
radius_mm = { from = 0, to = 2 }
[sensor]
name = "s"
gain = [1, 2, 4]
exposure_ev = { from = -2, to = 0 }
[output]
picture = "png"
"#;

fn recipe(text: &str) -> Recipe {
    Recipe::parse(text).unwrap()
}

#[test]
fn samples_do_not_depend_on_their_number() {
    let (recipe, more) = (recipe(DRAWN), recipe(&DRAWN.replace("1000", "2000")));
    let (few, many) = (Draws::new(&recipe, 17), Draws::new(&more, 17));
    assert_eq!((few.count(), many.count()), (1000, 2000));
    for sample in [0, 1, 999] {
        assert_eq!(few.of(sample), many.of(sample));
    }
    let other = self::recipe(&DRAWN.replace("seed = 5", "seed = 6"));
    assert_ne!(Draws::new(&other, 17).of(0), few.of(0));
}

/// Within five standard errors.
#[test]
fn draws_are_uniform_over_lists_ranges_and_areas() {
    let recipe = recipe(DRAWN);
    let draws = Draws::new(&recipe, 17);
    let all: Vec<Draw> = (0..1000).map(|k| draws.of(k)).collect();
    let share = |of: &dyn Fn(&Draw) -> bool| all.iter().filter(|d| of(d)).count() as f64 / 1000.0;
    let near = |found: f64, expected: f64| {
        assert!(
            (found - expected).abs() < 5.0 * (expected * (1.0 - expected) / 1000.0).sqrt(),
            "{found} {expected}"
        );
    };
    near(share(&|d| d.lens == 2), 1.0 / 3.0);
    near(share(&|d| d.picture == 16), 1.0 / 17.0);
    near(share(&|d| d.gain == 4.0), 1.0 / 3.0);
    near(share(&|d| d.focus_m.unwrap() < 2.0), 0.5);
    near(share(&|d| d.exposure_ev < -1.0), 0.5);
    near(share(&|d| pipeline::real::hypot(d.center_mm[0], d.center_mm[1]) < 1.0), 0.25);
    near(share(&|d| d.center_mm[1] > 0.0), 0.5);
    near(share(&|d| d.part.0 < 0.25), 0.25);
    let seeds: std::collections::BTreeSet<u64> = all.iter().map(|d| d.noise_seed).collect();
    assert_eq!(seeds.len(), 1000);
    assert!(all.iter().all(|d| (0.5..=8.0).contains(&d.focus_m.unwrap())));
}

#[test]
fn without_a_number_of_samples_there_is_every_combination_once() {
    let text = DRAWN
        .replace("samples = 1000", "repeats = 2")
        .replace("focus_m = { from = 0.5, to = 8, log = true }", "focus_m = [0.5, 1]")
        .replace("radius_mm = { from = 0, to = 2 }", "center_mm = [[0, 0], [1, 0.5]]")
        .replace("exposure_ev = { from = -2, to = 0 }", "");
    let recipe = recipe(&text);
    let draws = Draws::new(&recipe, 5);
    assert_eq!(draws.count(), 5 * 3 * 2 * 2 * 3 * 2);
    let combination =
        |d: Draw| format!("{} {} {:?} {:?} {}", d.picture, d.lens, d.focus_m, d.center_mm, d.gain);
    let all: Vec<String> = (0..draws.count()).map(|k| combination(draws.of(k))).collect();
    let once: std::collections::BTreeSet<&String> = all.iter().collect();
    assert_eq!(once.len(), all.len() / 2);
    assert_eq!(
        (draws.of(0).picture, draws.of(draws.count() - 1).picture),
        (0, 4),
        "pictures are the slowest"
    );
    assert_eq!(all[0], all[1]);
    assert_ne!(draws.of(0).noise_seed, draws.of(1).noise_seed);
}

#[test]
fn recipes_that_cannot_be_say_where_and_why() {
    for (from, to, expected) in [
        ("schema = \"lenscube/dataset/1\"", "schema = \"x\"", "schema: expected"),
        ("samples = 1000", "samples = 0", "samples: expected 1 to"),
        ("samples = 1000", "", "lens.focus_m: a range is drawn from"),
        ("seed = 5", "sede = 5", "line 4, column 1: unknown field `sede`"),
        ("focus_m = {", "focus_m = { step = 1,", "unknown field `step`"),
        ("from = 0.5", "from = 9", "from <= to"),
        ("from = 0.5", "from = 0", "lens.focus_m: expected"),
        ("[1, 2, 4]", "\"auto\"", "a number, a list of numbers, or { from = A, to = B }"),
        ("[1, 2, 4]", "[]", "sensor.gain: expected one or more"),
        ("pitch_um = 2", "pitch_um = -2", "film.pitch_um"),
        ("pitch_um = 2", "pitch_um = 2\ncenter_mm = [[0, 0]]", "give center_mm, or radius_mm"),
        ("picture = \"png\"", "", "output: expected one or more of"),
        ("picture = \"png\"", "picture = \"gif\"", "unknown variant `gif`"),
        ("picture = \"png\"", "as = \"zarr\"\npicture = \"png\"", "expected \"npy\""),
        (
            "[sensor]\nname = \"s\"\ngain = [1, 2, 4]\nexposure_ev = { from = -2, to = 0 }",
            "",
            "needs a table [sensor]",
        ),
    ] {
        assert!(DRAWN.contains(from), "{from}");
        let error = Recipe::parse(&DRAWN.replace(from, to)).unwrap_err();
        assert!(error.contains(expected), "{to}: {error}");
    }
}
