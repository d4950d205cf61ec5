//! Plan files: reproducible, never overwritten; other flags, films and charts than the plan's are errors.

use super::*;

#[test]
fn plan_file_is_reproducible_and_never_overwritten_by_another() {
    let place = place();
    let plan = |flags: &[&str]| {
        CommandResult::new(&place.plan(&place.film, flags).current_dir(place.dir.path()).output().unwrap())
    };
    let made = plan(&["--unit-rows", "2"]).ok();
    let name = made.stdout.trim().trim_start_matches("./").to_owned();
    let text_of = || fs::read_to_string(place.at(&name)).unwrap();
    let first = text_of();
    let json: Value = serde_json::from_str(&first).unwrap();
    assert_eq!(name, format!("plan-{}.json", &json["digest"].as_str().unwrap()[..12]));
    // The digest is that of all other lines.
    let others: String =
        first.lines().filter(|l| !l.contains("\"digest\"")).map(|l| format!("{l}\n")).collect();
    assert_eq!(json["digest"], blake3::hash(others.as_bytes()).to_hex().as_str());
    plan(&["--unit-rows", "2"]).ok();
    assert_eq!(text_of(), first);
    crate::common::assert_exit(
        &plan(&["--unit-rows", "4", "-o", &name]),
        OTHER_JOB,
        &["another file exists", "another name"],
    );
    crate::common::assert_exit(&plan(&["--interp", "bilinear"]), OTHER_JOB, &["another job", "interp"]);
    // The units add up to the film.
    let sum =
        |key: &str| json["units"].as_array().unwrap().iter().map(|u| u[key].as_u64().unwrap()).sum::<u64>();
    assert_eq!(sum("shards"), 2 * 8 * 8);
    assert_eq!(sum("bytes_written"), 2 * 631 * 637 * 4);
    assert!(sum("bytes_read") >= 2 * 631 * 637 * 4 && sum("tiles_again") > 0);
    for key in ["shards", "tiles", "tiles_again", "bytes_read", "bytes_written"] {
        assert_eq!(json["totals"][key], sum(key), "{key}");
    }
    assert!(
        json["units"][0]["core_s"].as_f64().unwrap() > 0.0
            && json["totals"]["gpu_bytes"].as_u64().unwrap() > 0
    );
    assert_eq!(json["command"]["chart"], text(&place.chart));
}

#[test]
fn edited_plan_other_flags_and_other_film_exit_3() {
    let planned = Planned::new(place(), &["--unit-rows", "4"]);
    let good = fs::read_to_string(&planned.job).unwrap();
    let with = |text: &str| fs::write(&planned.job, text).unwrap();
    // Edited, truncated, not a plan, of another version.
    for (wrong, words) in [
        (good.replace("\"unit\":1", "\"unit\":9"), "its digest does not match"),
        (good.replace("bicubic", "bilinear"), "its digest does not match"),
        (good[..good.len() / 2].to_owned(), "its digest does not match"),
        ("{}\n".to_owned(), "not a digest"),
    ] {
        with(&wrong);
        crate::common::assert_exit(&planned.run("0", &[]), OTHER_JOB, &[words, "make it again"]);
        crate::common::assert_exit(
            &lenscube(&["status", "--plan", text(&planned.job), "--missing"]),
            OTHER_JOB,
            &[words],
        );
    }
    with(&signed(&good.replace("lenscube/plan/1", "lenscube/plan/9")));
    crate::common::assert_exit(&planned.run("0", &[]), OTHER_JOB, &["lenscube/plan/9"]);
    let version = planned.plan["job"]["numeric_version"].as_u64().unwrap();
    let newer = format!("\"numeric_version\": {}", version + 1);
    with(&signed(&good.replace(&format!("\"numeric_version\": {version}"), &newer)));
    let words = [&format!("numeric version {}", version + 1)[..], "plan a new film"];
    crate::common::assert_exit(&planned.run("0", &[]), OTHER_JOB, &words);
    with(&good);
    // Other flags.
    crate::common::assert_exit(
        &planned.run("0", &["--interp", "bilinear"]),
        OTHER_JOB,
        &["interp (planned \"bicubic\", found \"bilinear\")"],
    );
    crate::common::assert_exit(
        &planned.run("0", &["--shard", "160"]),
        OTHER_JOB,
        &["shard (planned 80, found 160)"],
    );
    crate::common::assert_exit(
        &planned.run("0", &["--bands", "1"]),
        OTHER_JOB,
        &["chart_bands (planned [0,1], found [1])"],
    );
    crate::common::assert_exit(&planned.run("3", &["--bands", "1"]), OTHER_JOB, &["not those of the plan"]);
    // Another film.
    let other = planned.place.at("other.zarr");
    CommandResult::new(&planned.place.command(&other, "", &["--interp", "bilinear"]).output().unwrap()).ok();
    let at = |film: &Path| {
        let mut command = planned.worker("0", &[]);
        CommandResult::new(&command.arg(&planned.place.chart).arg(film).output().unwrap())
    };
    crate::common::assert_exit(&at(&other), OTHER_JOB, &["is not the film of", "job_digest"]);
    crate::common::assert_exit(
        &at(&planned.place.at("nothing.zarr")),
        OTHER_JOB,
        &["found nothing", "lenscube plan"],
    );
}

/// The text of a plan with its digest.
fn signed(text: &str) -> String {
    let others: String =
        text.lines().filter(|l| !l.contains("\"digest\"")).map(|l| format!("{l}\n")).collect();
    let digest = blake3::hash(others.as_bytes()).to_hex();
    others.replacen("{\n", &format!("{{\n  \"digest\": \"{digest}\",\n"), 1)
}

#[test]
fn moved_or_touched_chart_exits_3_and_a_chart_at_another_path_is_accepted() {
    let planned = Planned::new(place(), &["--unit-rows", "8"]);
    let expected = planned.single_run(&[]);
    let moved = planned.place.at("moved.zarr");
    fs::rename(&planned.place.chart, &moved).unwrap();
    let gone = planned.run("0", &[]);
    assert_eq!(gone.code, 1, "{}", gone.stderr);
    assert!(gone.stderr.contains("chart.zarr"), "{}", gone.stderr);
    // The same files under another name, and the film by a relative path.
    let mut command = planned.worker("0", &[]);
    crate::common::assert_exit(
        &CommandResult::new(
            &command
                .args(["moved.zarr", "film.zarr"])
                .current_dir(planned.place.dir.path())
                .output()
                .unwrap(),
        ),
        0,
        &[],
    );
    assert_eq!(planned.missing(), "1");
    // Another chart in its place.
    crate::common::Picture::noise(12, Size::new(631, 637), 2).write(&planned.place.chart);
    crate::common::assert_exit(
        &planned.run("1", &[]),
        OTHER_JOB,
        &["the job differs from the plan", "chart_mtimes"],
    );
    fs::remove_dir_all(&planned.place.chart).unwrap();
    fs::rename(&moved, &planned.place.chart).unwrap();
    // Touched.
    let chunk = fs::File::open(planned.place.chart.join("chart/c/0/0/0")).unwrap();
    chunk.set_modified(std::time::UNIX_EPOCH).unwrap();
    crate::common::assert_exit(&planned.run("1", &[]), OTHER_JOB, &["chart_mtimes", "--trust-input"]);
    crate::common::assert_exit(&planned.run("1", &["--trust-input"]), 0, &[]);
    assert!(files(&planned.place.film) == expected);
}

#[test]
fn a_plan_with_check_input_compares_the_content_of_the_chart() {
    let planned = Planned::new(place(), &["--unit-rows", "8", "--check-input"]);
    let expected = planned.single_run(&["--check-input"]);
    planned.run("0", &[]).ok();
    // Its band 1, the one that is missing, with the same size and time.
    let file = planned.place.chart.join("chart/c/1/0/0");
    let (good, modified) = (fs::read(&file).unwrap(), fs::metadata(&file).unwrap().modified().unwrap());
    let mut bytes = good.clone();
    *bytes.last_mut().unwrap() ^= 1;
    fs::write(&file, bytes).unwrap();
    fs::File::options().write(true).open(&file).unwrap().set_modified(modified).unwrap();
    for flags in [&[][..], &["--trust-input"]] {
        crate::common::assert_exit(
            &planned.run("1", flags),
            OTHER_JOB,
            &["differs from the plan", "chart_digest"],
        );
    }
    crate::common::assert_exit(&planned.run("0", &[]), OTHER_JOB, &["differs from the plan"]);
    fs::write(&file, good).unwrap();
    planned.run("1", &[]).ok();
    crate::common::assert_exit(&planned.run("0-1", &[]), 0, &["complete"]);
    assert!(files(&planned.place.film) == expected);
}
