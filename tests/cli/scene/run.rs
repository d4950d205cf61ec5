//! Films of meshes in one command.

use super::*;

/// `run` of a mesh makes the scene, the film of it, and removes the scene; a killed one is resumed by the same command.
#[test]
fn a_film_is_made_of_a_mesh_in_one_command() {
    let place = Place::new();
    let (mesh, out, film) = (place.mesh(), place.at("scene.zarr"), place.at("film.zarr"));
    let bands = ["--wavelengths", "500,600", "--quiet"];
    scene(&mesh, &out, "120x90", &["--quiet", "--sun", "30,40"]).ok();
    let lens = ["--lens", "phone", "--focus-m", "1"];
    lenscube(&[&["run", text(&out), text(&film)], &lens[..], &bands].concat()).ok();
    let direct = place.at("direct.zarr");
    let run = |fault: &str, flags: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_lenscube"));
        command
            .args(["run", text(&mesh), text(&direct)])
            .args(VIEW)
            .args(["120x90", "--sun", "30,40"])
            .args(bands)
            .args(flags);
        CommandResult::new(&command.env("LENSCUBE_FAULT", fault).output().unwrap())
    };
    let beside = place.at("direct.zarr.scene");
    for fault in ["scene-shard:2:kill", "film-opened:1:kill", "commit:2:kill"] {
        assert!(run(fault, &[]).code != 0, "{fault}");
        assert!(beside.exists(), "{fault}");
    }
    run("", &["--keep-scene"]).ok();
    assert_eq!(bits(&pixels(&direct, "film").1), bits(&pixels(&film, "film").1));
    assert!(files(&beside) == files(&out));
    run("", &[]).ok();
    assert!(!beside.exists());
    // Of the complete film no shard of the scene is made.
    run("scene-shard:1:kill", &[]).ok();
    run("scene-shard:1:kill", &["--pyramid"]).ok();
    assert!(!beside.exists());
    let other =
        lenscube(&[&["run", text(&mesh), text(&direct)], &VIEW[..], &["120x90", "--center", "1,0"]].concat());
    assert_error_line(&other, USAGE, &["--center does not apply to a mesh"]);
    let chart = lenscube(&[
        "run",
        "gen:uniform?size=8",
        text(&place.at("c.zarr")),
        "--eye",
        "0,0,0",
        "--target",
        "0,0,1",
    ]);
    assert_error_line(&chart, USAGE, &["flags of meshes", "gen:uniform"]);
    let planned =
        lenscube(&["plan", text(&mesh), text(&place.at("p.zarr")), "-o", text(&place.at("job.json"))]);
    assert_error_line(&planned, USAGE, &["is a mesh", "lenscube scene"]);
}

/// A signal while the lens is traced, after the scene, ends the command at once.
#[test]
fn a_signal_while_the_lens_is_traced_ends_the_command() {
    let place = Place::new();
    let (mesh, film) = (place.mesh(), place.at("film.zarr"));
    let run = |fault: &str| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_lenscube"));
        let flags = ["60x40", "--wavelengths", "551.5", "--tails", "off"];
        command.args(["run", text(&mesh), text(&film)]).args(VIEW).args(flags);
        command.env("XDG_CACHE_HOME", place.at("cache")).env("LENSCUBE_FAULT", fault);
        CommandResult::new(&command.output().unwrap())
    };
    for signal in ["terminate", "interrupt"] {
        let stopped = run(&format!("tracing:1:{signal}"));
        assert_exit(&stopped, INTERRUPTED, &["stopped; the same command resumes"]);
        assert!(!stopped.stderr.contains("after the tiles in progress"), "{}", stopped.stderr);
        assert!(!film.exists() && place.at("film.zarr.scene").exists());
    }
    run("").ok();
    assert!(film.exists() && !place.at("film.zarr.scene").exists());
}

/// A film is of the scene that it was made of: another light, or an edited mesh, is another job.
#[test]
fn a_film_of_another_mesh_or_light_is_another_job() {
    let place = Place::new();
    let (mesh, film) = (place.mesh(), place.at("film.zarr"));
    let run = |sun: &str, film: &str| {
        let words =
            [&["run", text(&mesh), film], &VIEW[..], &["60x40", "--wavelengths", "550", "--sun", sun]]
                .concat();
        lenscube(&words)
    };
    run("30,40,50000", text(&film)).ok();
    assert_exit(&run("30,40,50000", text(&film)), 0, &["nothing to do"]);
    // The weights are doubled: files of the same names and, compressed, perhaps of the same sizes.
    assert_exit(&run("30,40,100000", text(&film)), OTHER_JOB, &["belongs to another job"]);
    assert!(!place.at("film.zarr.scene").exists(), "refused before its scene is made");
    std::fs::write(place.at("room.mtl"), "newmtl grey\nKd 0.25 0.25 0.25\nnewmtl red\nKd 0.6 0 0\n").unwrap();
    let slash = format!("{}/", text(&film));
    assert_exit(&run("30,40,50000", &slash), OTHER_JOB, &["belongs to another job"]);
    assert!(!place.at("film.zarr.scene").exists() && !film.join(".scene").exists());
    // Other bands are named, not all that differs with them.
    place.mesh();
    let words = [
        &["run", text(&mesh), text(&film)],
        &VIEW[..],
        &["60x40", "--wavelengths", "560", "--sun", "30,40,50000"],
    ];
    let bands = lenscube(&words.concat());
    assert_exit(&bands, OTHER_JOB, &["wavelengths (film [550.0], requested [560.0])"]);
    assert!(bands.stderr.lines().last().unwrap().len() < 600, "{}", bands.stderr);
    // A film that cannot be made is refused before the scene is.
    let other = place.at("other.zarr");
    std::fs::create_dir(&other).unwrap();
    std::fs::write(other.join("zarr.json"), "{\"zarr_format\": 3, \"node_type\": \"group\"}").unwrap();
    assert!(run("30,40,50000", text(&other)).code != 0);
    assert!(!place.at("other.zarr.scene").exists());
}

/// A film is complete only for the lens that it was made with: a file of a lens that was written again is read.
#[test]
fn a_lens_that_was_written_again_is_compared() {
    let place = Place::new();
    let (mesh, film, design) = (place.mesh(), place.at("film.zarr"), place.at("phone.csv"));
    lenscube(&["lens", "convert", "phone", text(&design)]).ok();
    let run = || {
        let words = ["run", text(&mesh), text(&film), "--wavelengths", "550"];
        let view = VIEW.map(|word| if word == "phone" { text(&design) } else { word });
        lenscube(&[&words[..], &view, &["60x40"]].concat())
    };
    run().ok();
    let found = run();
    assert_exit(&found, 0, &["nothing to do"]);
    assert!(!found.stderr.contains("scene of"), "{}", found.stderr);
    std::fs::write(&design, std::fs::read(&design).unwrap()).unwrap();
    assert_exit(&run(), 0, &["scene of", "nothing to do"]);
}
