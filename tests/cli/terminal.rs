//! Names in files, paths and arguments that contain what a terminal obeys: no command prints them as they stand.

use crate::common::test_job::TestJob;
use crate::common::{CommandResult, files, identity_band, lens, scattered, text, write_pack};
use serde_json::{Value, json};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Sets the title, clears the screen, the same by a control character of one byte, reorders text.
const HOSTILE: &str = "n\u{1b}]0;title\u{7}\u{1b}[2J\r\u{9b}2J\u{202e}\u{2066}\u{7f}<b>";
/// The beginning of [`HOSTILE`] as it is printed.
const SHOWN: &str = "n\\u001b]0;title\\u0007\\u001b[2J\\r\\u009b2J\\u202e\\u2066\\u007f";

/// A job with hostile names of its folder, files and lens.
struct Place(TestJob);

impl Place {
    fn new() -> Self {
        let mut job = TestJob::small();
        let folder = job.at(HOSTILE);
        fs::create_dir(&folder).unwrap();
        let mut lens = lens([450.0, 500.0].map(|nm| identity_band(nm, 1.0, 5)).into());
        lens.name = HOSTILE.into();
        let stacks = lens.bands.iter().zip(1..).map(|(b, seed)| scattered(seed, b)).collect();
        job.pack = folder.join("pack.lens.zarr");
        write_pack(&job.pack, &lens, stacks);
        let chart = folder.join("chart.zarr");
        fs::rename(&job.chart, &chart).unwrap();
        job.chart = chart;
        job.film = folder.join("film.zarr");
        Self(job)
    }

    fn at(&self, name: &str) -> PathBuf {
        self.0.at(HOSTILE).join(name)
    }

    /// Runs a command in the folder, whose output has no character that a terminal obeys.
    fn call(&self, words: &[&str]) -> CommandResult {
        let mut command = Command::new(env!("CARGO_BIN_EXE_lenscube"));
        command.args(words).current_dir(self.0.at(HOSTILE)).env("XDG_CACHE_HOME", self.at("cache"));
        clean(&command.output().unwrap(), words)
    }

    /// As [`Place::call`]: its exit code, and the hostile name, escaped, in what it prints.
    fn names(&self, code: i32, words: &[&str]) -> CommandResult {
        let ran = self.call(words);
        assert_eq!(ran.code, code, "{words:?}: {}{}", ran.stdout, ran.stderr);
        assert!(ran.stdout.contains(SHOWN) || ran.stderr.contains(SHOWN), "{words:?}: {ran:?}");
        ran
    }
}

fn clean(output: &std::process::Output, words: &[&str]) -> CommandResult {
    for bytes in [&output.stdout, &output.stderr] {
        let text = std::str::from_utf8(bytes).unwrap_or_else(|e| panic!("{words:?}: {e}"));
        let obeyed = |c: &char| {
            (c.is_control() && !matches!(c, '\n' | '\t'))
                || matches!(c, '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
        };
        let found: Vec<char> = text.chars().filter(obeyed).collect();
        assert!(found.is_empty(), "{words:?}: {found:?} in {text:?}");
    }
    CommandResult::new(output)
}

/// `json` of a printed document names the hostile name as it is.
fn assert_json_names(ran: &CommandResult) {
    let value: Value = serde_json::from_str(&ran.stdout).unwrap();
    let mut strings = Vec::new();
    collect(&value, &mut strings);
    assert!(strings.iter().any(|s| s.contains(HOSTILE)), "{value}");
}

fn collect<'a>(value: &'a Value, strings: &mut Vec<&'a str>) {
    match value {
        Value::String(s) => strings.push(s),
        Value::Array(all) => all.iter().for_each(|v| collect(v, strings)),
        Value::Object(all) => all.values().for_each(|v| collect(v, strings)),
        _ => (),
    }
}

#[test]
fn commands_on_films_print_hostile_names_escaped() {
    let place = Place::new();
    let job = &place.0;
    let (chart, film, pack) = (text(&job.chart), text(&job.film), text(&job.pack));
    let run = ["run", chart, film, "--lens", pack, "--threads", "2", "--shard", "64", "--chunk", "32"];
    let with = |flags: &[&'static str]| [&run[..], flags].concat();
    place.names(0, &with(&["--dry-run"]));
    place.names(0, &with(&["--verbose", "--progress", "plain"]));
    place.names(0, &run);
    let lines = place.names(0, &with(&["--progress", "jsonl"])).stdout;
    assert!(lines.lines().all(|line| serde_json::from_str::<Value>(line).is_ok()), "{lines}");
    place.names(3, &with(&["--interp", "bilinear"]));
    place.names(0, &["status", film]);
    assert_json_names(&place.names(0, &["status", film, "--json"]));
    place.names(0, &["verify", film]);
    place.names(0, &["pyramid", film]);
    let planned = text(&place.at("job.json")).to_owned();
    place.names(0, &["plan", chart, text(&place.at("planned.zarr")), "--lens", pack, "-o", &planned]);
    place.names(0, &["run", "--plan", &planned]);
    place.call(&["status", "--plan", &planned, "--check"]);
    let png = text(&place.at("film.png")).to_owned();
    place.call(&["export", film, &png]);
    place.names(3, &["export", film, &png]);
    // Damaged, with a file that is not of the program.
    fs::write(job.film.join("film/c/0/0/0"), "x").unwrap();
    place.names(4, &["verify", film]);
    place.call(&["verify", film, "--repair"]);
    fs::write(job.film.join(format!("{HOSTILE}\n").replace('/', "")), "x").unwrap();
    place.names(3, &with(&["--interp", "bilinear", "--overwrite"]));
    assert!(!files(&job.film).is_empty());
}

#[test]
fn commands_on_lenses_and_sensors_print_hostile_names_escaped() {
    let place = Place::new();
    let pack = text(&place.0.pack).to_owned();
    place.names(0, &["lens", "show", &pack]);
    assert_json_names(&place.names(0, &["lens", "show", &pack, "--json"]));
    place.names(0, &["lens", "diff", &pack, &pack]);
    // A design whose name is hostile.
    let design = place.at("design.zmx");
    let text_of = include_str!("../../formats/data/lenses/double-gauss-28.zmx");
    let named: Vec<String> = text_of
        .lines()
        .map(
            |l| if l.starts_with("NAME ") { format!("NAME {}", HOSTILE.replace('\r', "")) } else { l.into() },
        )
        .collect();
    fs::write(&design, named.join("\n")).unwrap();
    let quick = ["--heights", "0", "--wavelengths", "550"];
    place.call(&[&["lens", "show", text(&design)], &quick[..]].concat());
    place.call(&["lens", "convert", text(&design), text(&place.at("design.csv"))]);
    fs::write(place.at("glass.zmx"), text_of.replace("N-SK16", "N-\u{1b}[2J\u{9b}")).unwrap();
    place.call(&["lens", "show", text(&place.at("glass.zmx"))]);
    // A sensor.
    let quoted: String = HOSTILE.chars().map(|c| format!("\\u{:04x}", u32::from(c))).collect();
    let sensor = include_str!("../../formats/data/sensors/example-2um.toml");
    let named = |line: &str| match line.starts_with("name =") || line.starts_with("description =") {
        true => format!("{} = \"{quoted}\"\n", line.split(' ').next().unwrap()),
        false => format!("{line}\n"),
    };
    fs::write(place.at("sensor.toml"), sensor.lines().map(named).collect::<String>()).unwrap();
    place.names(0, &["sensor", "show", text(&place.at("sensor.toml"))]);
}

#[test]
fn errors_and_notes_print_hostile_text_escaped() {
    let place = Place::new();
    let (film, pack) = (text(&place.0.film).to_owned(), text(&place.0.pack).to_owned());
    // Arguments, as the parser quotes them.
    place.names(2, &[HOSTILE]);
    place.names(2, &["run", "--scale", HOSTILE]);
    place.names(2, &["run", "a", "b", HOSTILE]);
    place.names(2, &["lens", "show", HOSTILE]);
    place.names(2, &["run", "gen:uniform?size=64", &film, "--lens", HOSTILE]);
    place.call(&["run", &format!("gen:{HOSTILE}"), &film, "--lens", &pack]);
    place.names(1, &["run", HOSTILE, &film, "--lens", &pack]);
    place.names(0, &["cache"]);
    // Files: a header of ENVI, metadata of a store, an array that is not there.
    let header = format!(
        "ENVI\nsamples = 2\nlines = 2\nbands = 1\ndata type = 4\ninterleave = {HOSTILE}\nbyte order = 0\n\
         wavelength units = {HOSTILE}\n"
    );
    fs::write(place.at("cube.hdr"), header.replace('\r', "")).unwrap();
    fs::write(place.at("cube"), [0; 16]).unwrap();
    place.call(&["run", text(&place.at("cube.hdr")), &film, "--lens", &pack]);
    place.names(1, &["run", &format!("{}//{HOSTILE}", text(&place.0.chart)), &film, "--lens", &pack]);
    let metadata = place.0.chart.join("zarr.json");
    fs::write(&metadata, json!({ "zarr_format": HOSTILE, "node_type": HOSTILE }).to_string()).unwrap();
    place.names(2, &["run", text(&place.0.chart), &film, "--lens", &pack]);
    place.names(1, &["status", text(Path::new(HOSTILE))]);
}

#[test]
fn names_are_escaped_in_svg_and_html() {
    let place = Place::new();
    let job = &place.0;
    let plots = place.at("plots");
    place.call(&["lens", "show", text(&job.pack), "--plot", text(&plots)]);
    let of_plots = files(&plots);
    let svgs = of_plots.iter().filter(|(path, _)| text(path).ends_with(".svg"));
    let mut named = 0;
    for (path, bytes) in svgs {
        let svg = String::from_utf8(bytes.clone()).unwrap();
        assert!(!svg.contains("<b>") && !svg.contains('\u{1b}'), "{}", path.display());
        named += usize::from(svg.contains("&lt;b&gt;"));
    }
    assert!(named > 0, "{:?}", of_plots.keys());
    job.run("", &[]).ok();
    let raws = ["a<b>", "c\"d"].map(|name| text(&place.at(&format!("{name}.raw.zarr"))).to_owned());
    for raw in &raws {
        let flags = ["--sensor", "example-2um", "--exposure", "auto", "--no-fsync"];
        let ran = place.call(&[&["sensor", text(&job.film), raw], &flags[..]].concat());
        assert_eq!(ran.code, 0, "{}", ran.stderr);
    }
    let report = place.at("report");
    let ran = place.names(0, &["compare", &raws[0], &raws[1], "--out", text(&report)]);
    assert_eq!(ran.code, 0);
    let page = fs::read_to_string(report.join("report.html")).unwrap();
    assert!(page.contains("a&lt;b&gt;") && !page.contains("a<b>"), "{page}");
}
