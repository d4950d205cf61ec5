//! Lenses as built: `lens trace --tolerances` and films of drawn lenses.

use super::runs::{DesignJob, attributes};
use super::*;

/// Errors of the rear element, and how it is focused.
pub(super) fn tolerances(job: &DesignJob, name: &str, entries: &str) -> PathBuf {
    let path = job.at(name);
    fs::write(&path, format!("{entries}\n[criterion]\nkind = \"rms-spot\"\n")).unwrap();
    path
}

pub(super) const ERRORS: &str =
    "[[element]]\nsurfaces = [10, 11]\ndecentre_um = 30\ntilt_arcmin = 3\n[[film]]\ntilt_arcmin = 5\n";
const NO_ERRORS: &str =
    "[[element]]\nsurfaces = [10, 11]\ndecentre_um = [0, 0]\n[compensate]\nfocus = false\n";

#[test]
fn a_lens_without_errors_is_its_design() {
    let job = DesignJob::new();
    let none = tolerances(&job, "none.toml", NO_ERRORS);
    let film = |name: &str| bits(&pixels(&job.at(name), "film").1);
    for tails in ["on", "off"] {
        let (built, nominal) = (format!("built-{tails}"), format!("nominal-{tails}"));
        job.run("cache", &nominal, &["--tails", tails]).ok();
        let run = job.run("cache", &built, &["--tails", tails, "--tolerances", text(&none), "-v"]).ok();
        assert!(!run.stderr.contains("traced in"), "its bands are those of the design: {}", run.stderr);
        assert!(film(&built) == film(&nominal), "--tails {tails}");
    }
    let source = attributes(&job.at("built-on"))["provenance"]["source"].to_string();
    assert!(source.contains("element 10-11/decentre_x") && source.contains("film_shift_mm"), "{source}");
    let other = job.run("cache", "built-on", &["--tails", "on"]);
    assert_error_line(&other, OTHER_JOB, &["--tolerances"]);

    let design = job.at("my.zmx");
    let trace = |name: &str, flags: &[&str]| {
        let pack = job.at(name);
        let words = ["lens", "trace", text(&design), text(&pack), "--wavelengths", "500"];
        let film = ["--max-height-mm", "1.2", "--film-pitch-um", "10"];
        lenscube(&[&words[..], &film, flags].concat()).ok();
        let digest = LensPack::open(&pack).unwrap().digest().unwrap().to_owned();
        (fs::read_to_string(pack.join("zarr.json")).unwrap(), digest)
    };
    let (built, digest) = trace("built.lens.zarr", &["--tolerances", text(&none)]);
    let (_, nominal) = trace("nominal.lens.zarr", &[]);
    assert!(built.contains("lenscube/lens-pack/1") && built.contains("element 10-11/decentre_x"), "{built}");
    assert_eq!(digest, nominal);
    // Where the film moves to the focus, the ideal plane remains that of the design.
    let focused = tolerances(&job, "focused.toml", "[[element]]\nsurfaces = [10, 11]\ndecentre_um = 0\n");
    let (moved, _) = trace("moved.lens.zarr", &["--tolerances", text(&focused)]);
    assert!(moved.contains("lenscube/lens-pack/4"), "{moved}");
}

#[test]
fn a_drawn_lens_depends_on_seed_and_sample_and_is_resumed_only_by_itself() {
    let job = DesignJob::new();
    let file = tolerances(&job, "tol.toml", ERRORS);
    let run = |film: &str, flags: &[&str]| {
        job.run("cache", film, &[&["--tolerances", text(&file)], flags].concat())
    };
    run("first", &["--lens-sample", "1"]).ok();
    job.run("other", "again", &["--tolerances", text(&file), "--lens-sample", "1", "--threads", "1"]).ok();
    let film = |name: &str| bits(&pixels(&job.at(name), "film").1);
    assert!(film("first") == film("again"), "the same lens");
    let other = run("first", &["--lens-sample", "2"]);
    assert_error_line(&other, OTHER_JOB, &["--lens-sample (film 1, requested 2)"]);
    run("two", &["--lens-sample", "2"]).ok();
    assert!(film("first") != film("two"), "another lens");
    let source = attributes(&job.at("first"))["provenance"]["source"].to_string();
    assert!(source.contains("element 10-11/decentre_x"), "{source}");
}

#[test]
fn what_drawn_lenses_do_not_have_is_not_blamed_on_their_design() {
    let job = DesignJob::new();
    let file = tolerances(&job, "tol.toml", ERRORS);
    for flags in [&["--depth", "2", "--focus-m", "2"][..], &["--reach-mm", "2"]] {
        let ran = job.run("cache", "film", &[&["--tolerances", text(&file)], flags].concat());
        assert_error_line(&ran, USAGE, &["my.zmx` with the drawn errors of --tolerances has none"]);
    }
}

#[test]
fn errors_of_judged_places_say_how_far_beyond_the_film_they_may_be() {
    let job = DesignJob::new();
    let entries = "[tolerances]\nlaw = \"two-point\"\n[[surface]]\nsurface = 2\ntilt_arcmin = 2000\n";
    let file = tolerances(&job, "tol.toml", entries);
    let judged = job.run("cache", "film", &["--lens", "double-gauss-28", "--tolerances", text(&file)]);
    assert_error_line(&judged, 1, &["lens 0 of seed 1, judged up to the circle of the film's corner, 0.3"]);
}

#[test]
fn a_pack_of_a_drawn_lens_makes_films_and_other_commands_refuse_it_in_one_line() {
    let job = DesignJob::new();
    let file = tolerances(&job, "tol.toml", ERRORS);
    let pack = job.at("built.lens.zarr");
    let design = job.at("my.zmx");
    let words = ["lens", "trace", text(&design), text(&pack), "--wavelengths", "450,500"];
    let flags = [
        "--max-height-mm",
        "1.2",
        "--film-pitch-um",
        "10",
        "--tolerances",
        text(&file),
        "--lens-sample",
        "3",
    ];
    lenscube(&[&words[..], &flags].concat()).ok();
    let schema = fs::read_to_string(pack.join("zarr.json")).unwrap();
    assert!(schema.contains("lenscube/lens-pack/4"), "{schema}");
    let shown = lenscube(&["lens", "show", text(&pack)]).ok();
    assert!(shown.stdout.contains("map") && shown.stdout.contains("azimuths"), "{}", shown.stdout);
    job.run("cache", "film", &["--lens", text(&pack)]).ok();
    let refused: [&[&str]; 3] = [
        &["lens", "show", text(&pack), "--csv", "tables"],
        &["bench", "--lens", text(&pack)],
        &["validate", "--lens", text(&pack), "--out", "report"],
    ];
    for words in refused {
        assert_error_line(&lenscube(words), USAGE, &["rotational symmetry"]);
    }
    show_and_diff(&job, &pack);
    let twice = job.run("cache", "film", &["--lens", text(&pack), "--tolerances", text(&file)]);
    assert_error_line(&twice, USAGE, &["--tolerances: expected a design"]);
}

/// Figures of `pack`, and its differences from its design and from itself.
fn show_and_diff(job: &DesignJob, pack: &Path) {
    let (figures, design) = (job.at("figures"), job.at("my.zmx"));
    let show = ["lens", "show", text(pack), "--plot", text(&figures)];
    lenscube(&show).ok();
    for name in ["map", "psf", "nodes", "errors"] {
        let svg = fs::read_to_string(figures.join(format!("{name}.svg"))).unwrap();
        // The text of an embedded picture may hold any letters, but none of these signs before them.
        let is_nan = ["\"NaN", ">NaN", " NaN", ",NaN"].iter().any(|nan| svg.contains(nan));
        assert!(svg.contains("<svg") && !is_nan, "{name}");
        assert!(figures.join(format!("{name}.png")).is_file(), "{name}");
    }
    assert_error_line(&lenscube(&show), OTHER_JOB, &["map.svg"]);

    let diff = |b: &Path, flags: &[&str]| {
        let words = ["lens", "diff", text(pack), text(b), "--film-pitch-um", "10", "--json"];
        json(lenscube(&[&words[..], flags].concat()))
    };
    let same = diff(pack, &[]);
    assert_eq!(same["bands"].as_array().unwrap().len(), 2);
    assert_eq!(same["fields"].as_array().unwrap().len(), 18);
    let size = |found: &Value, key: &str| found["bands"][0][key].as_f64().unwrap();
    assert!(size(&same, "largest_shift_um") < 1e-5 && size(&same, "largest_psf_l1") == 0.0, "{same}");
    // From the design: the boresight of the drawn lens, which goes away, and a smaller rest.
    let (kept, removed) = (diff(&design, &[]), diff(&design, &["--boresight", "remove"]));
    let of = |found: &Value, side: &str| -> f64 {
        let at = found["bands"][0]["boresight_um"][side].as_array().unwrap();
        at[0].as_f64().unwrap().hypot(at[1].as_f64().unwrap())
    };
    assert!(of(&kept, "a") > 1.0 && of(&kept, "b") < 1e-6, "{kept}");
    assert!((size(&kept, "largest_shift_um") / of(&kept, "a") - 1.0).abs() < 0.2, "{kept}");
    assert!(size(&removed, "largest_shift_um") < 0.3 * size(&kept, "largest_shift_um"), "{removed}");
    assert!((0.001..1.0).contains(&size(&kept, "largest_psf_l1")), "{kept}");
    let text_of = lenscube(&["lens", "diff", text(&design), text(pack), "--wavelengths", "450"]).ok();
    assert!(text_of.stdout.contains("450.00 nm: boresight A (0.000, 0.000) µm"), "{}", text_of.stdout);
    let heights = lenscube(&["lens", "diff", text(pack), text(&design), "--heights", "0,1"]);
    assert_error_line(
        &heights,
        USAGE,
        &["--heights: expected lenses with rotational symmetry", "built.lens"],
    );
    let nm = lenscube(&["lens", "diff", text(pack), text(&design), "--wavelengths", "460"]);
    assert_error_line(&nm, USAGE, &["has no band at 460 nm"]);
}

#[test]
fn films_of_several_lenses_have_the_index_in_their_path() {
    let job = DesignJob::new();
    let file = tolerances(&job, "tol.toml", ERRORS);
    let flags = ["--tolerances", text(&file), "--lens-sample", "0:2", "--bands", "#0"];
    job.run("cache", "built-{sample}.zarr", &flags).ok();
    assert!(job.at("built-0.zarr").is_dir() && job.at("built-1.zarr").is_dir());
    let unnamed = job.run("cache", "built.zarr", &flags);
    assert_error_line(&unnamed, USAGE, &["needs {sample} in its path"]);
    // Of a lens whose element is far beside the axis no light arrives; the others go on.
    let lost = tolerances(
        &job,
        "lost.toml",
        "[[element]]\nsurfaces = [1, 2]\ndecentre_x_um = { limits = [0, 80000], law = \"two-point\" }\n",
    );
    let flags = ["--tolerances", text(&lost), "--lens-sample", "0:4", "--bands", "#0"];
    let some = job.run("cache", "lost-{sample}.zarr", &flags);
    assert_exit(&some, 4, &["no film of lens"]);
    let made = (0..4).filter(|k| job.at(&format!("lost-{k}.zarr")).is_dir()).count();
    assert!((1..4).contains(&made), "{made} films");
}

#[test]
fn what_lenses_without_symmetry_do_not_have_is_an_error_of_one_line() {
    let job = DesignJob::new();
    let file = tolerances(&job, "tol.toml", ERRORS);
    let cases: [(&[&str], &str); 6] = [
        (&["--depth", "2"], "rotational symmetry"),
        (&["--device", "cuda"], "computed on the CPU"),
        (&["--coatings", "mgf2"], "has a coating"),
        (&["--veiling-glare", "1%"], "veiling glare"),
        (&["--band-samples", "2"], "--band-samples"),
        (&["--lens-sample", "5:5"], "--lens-sample"),
    ];
    for (flags, named) in cases {
        let refused = job.run("cache", "film", &[&["--tolerances", text(&file)], flags].concat());
        assert_exit(&refused, USAGE, &[named]);
    }
    let unknown = tolerances(&job, "unknown.toml", "[[element]]\nsurfaces = [9, 40]\ndecentre_um = 30\n");
    let refused = job.run("cache", "film", &["--tolerances", text(&unknown)]);
    assert_error_line(&refused, USAGE, &["unknown.toml", "40"]);
}

#[test]
fn a_plan_has_the_drawn_lens_or_its_pack() {
    let job = DesignJob::new();
    let file = tolerances(&job, "tol.toml", ERRORS);
    let flags = ["--tolerances", text(&file), "--lens-sample", "3"];
    job.run("cache", "whole", &flags).ok();
    let whole = bits(&pixels(&job.at("whole"), "film").1);
    for (name, more) in [("design", vec![]), ("pack", vec!["--lens-pack", "built.lens.zarr"])] {
        let lenscube = |words: &[&str]| {
            let mut command = Command::new(env!("CARGO_BIN_EXE_lenscube"));
            command.args(words).current_dir(job.at("")).env("XDG_CACHE_HOME", job.at("cache"));
            CommandResult::new(&command.output().unwrap()).ok()
        };
        let plan =
            ["plan", "chart", name, "--lens", "my.zmx", "--film-pitch-um", "10", "--output", "plan.json"];
        lenscube(&[&plan[..], &flags, &more].concat());
        lenscube(&["run", "--plan", "plan.json", "--device", "cpu"]);
        assert!(bits(&pixels(&job.at(name), "film").1) == whole, "{name}");
        fs::remove_file(job.at("plan.json")).unwrap();
    }
}
