//! Addresses and paths that programs trip over: URLs with secrets, malformed environments of stores, file names that are not UTF-8.
#![allow(missing_docs)]

mod common;

use common::place::Place;
use common::{Ran, files, text};
use std::ffi::{OsStr, OsString};
use std::os::unix::ffi::{OsStrExt, OsStringExt};
use std::path::PathBuf;
use std::process::Command;

const USAGE: i32 = 2;

fn program() -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_lenscube"));
    for (name, _) in std::env::vars_os().filter(|(name, _)| name.as_bytes().starts_with(b"AWS_")) {
        command.env_remove(name);
    }
    command
}

fn lenscube<W: AsRef<OsStr>>(words: impl IntoIterator<Item = W>) -> Ran {
    Ran::of(&program().args(words).output().unwrap())
}

/// One line for the user, no panic, none of `secrets` anywhere.
fn check(ran: &Ran, code: i32, secrets: &[&str], context: &str) {
    assert_eq!(ran.code, code, "{context}: {}", ran.stderr);
    assert!(!ran.stderr.contains("panicked"), "{context}: {}", ran.stderr);
    assert_eq!(ran.stderr.lines().count(), 1, "{context}: {}", ran.stderr);
    for secret in secrets {
        assert!(!ran.stderr.contains(secret) && !ran.stdout.contains(secret), "{context}: {}", ran.stderr);
    }
}

#[test]
fn no_command_shows_the_credentials_of_a_url() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("out");
    let out = text(&out);
    let urls = [
        "http://user:hush@host/x.zarr",
        "https://host/x.zarr?X-Amz-Credential=AKIAX&X-Amz-Signature=hush",
        "s3://AKIAX:hush@bucket/x.zarr",
        "http://user:hu#sh@host/x.zarr",
    ];
    let commands: [&[&str]; 24] = [
        &["run", "URL", "film.zarr"],
        &["run", "gen:uniform?size=64", "URL"],
        &["run", "gen:uniform?size=64", out, "--lens", "URL"],
        &["run", "gen:uniform?size=64", out, "--lens=URL"],
        &["run", "URL//film", out, "--progress", "jsonl"],
        &["run", "--plan", "URL"],
        &["plan", "URL", out, "-o", "job.json"],
        &["plan", "gen:uniform?size=64", "URL", "-o", out],
        &["plan", "gen:uniform?size=64", out, "-o", "URL"],
        &["status", "URL", "--json"],
        &["verify", "URL"],
        &["export", "URL", out],
        &["export", "gen:uniform?size=64", "URL"],
        &["pyramid", "URL"],
        &["view", "URL"],
        &["view", "gen:uniform?size=64", "--chart", "URL"],
        &["measure", "URL", "--edge", "1,2,3,4"],
        &["validate", "--out", "URL"],
        &["lens", "show", "URL"],
        &["lens", "diff", "double-gauss-28", "URL"],
        &["lens", "import", "URL", out],
        &["chart", "uniform", "URL"],
        &["chart", "image", "URL", out],
        &["no-such-command", "URL"],
    ];
    for url in urls {
        for command in commands {
            let words: Vec<String> = command.iter().map(|w| w.replace("URL", url)).collect();
            check(&lenscube(&words), USAGE, &["hush", "AKIAX", "user", "hu#", "sh@"], &words.join(" "));
        }
    }
    // Directories of this machine are no stores, and no directory called `s3:` is made.
    let far = "s3://bucket/report";
    for command in [
        &["validate", "--out", far][..],
        &["demo", "--dir", far],
        &["bench", "--dir", far],
        &["man", far],
        &["lens", "show", "double-gauss-28-npz", "--plot", far],
        &["export", "gen:uniform?size=64", "s3://bucket/x.npy"],
    ] {
        let ran = Ran::of(&program().current_dir(dir.path()).args(command).output().unwrap());
        check(&ran, USAGE, &[], &command.join(" "));
        assert!(ran.stderr.contains("of this machine"), "{command:?}: {}", ran.stderr);
    }
    assert_eq!(files(dir.path()).len(), 0, "something was written");
}

#[test]
fn a_malformed_environment_of_a_store_is_one_line_and_exit_code_2() {
    let good = [
        ("AWS_ACCESS_KEY_ID", "AKIAHUSH"),
        ("AWS_SECRET_ACCESS_KEY", "hush-hush"),
        ("AWS_REGION", "us-east-1"),
        ("AWS_ENDPOINT_URL", "http://127.0.0.1:9"),
        ("AWS_ALLOW_HTTP", "true"),
        ("AWS_MAX_ATTEMPTS", "1"),
    ];
    let ran = |url: &str, name: &str, value: &[u8]| {
        let value = OsString::from_vec(value.to_vec());
        Ran::of(&program().envs(good).env(name, value).args(["status", url]).output().unwrap())
    };
    let secrets = ["AKIAHUSH", "hush"];
    for (name, value, expected) in [
        ("AWS_ENDPOINT_URL", &b"127.0.0.1:9000"[..], "expected http://HOST:PORT"),
        ("AWS_ENDPOINT_URL", b"localhost:9000", "expected http://HOST:PORT"),
        ("AWS_ENDPOINT_URL", b"", "expected http://HOST:PORT"),
        ("AWS_ENDPOINT_URL", b"http://me:hush@127.0.0.1:9", "holds credentials"),
        ("AWS_ENDPOINT_URL", b"http://127.0.0.1:9/?X-Amz-Signature=hush", "a query or a fragment"),
        ("AWS_ENDPOINT_URL_S3", b"http://127.0.0.1:9\n", "line break"),
        ("AWS_ACCESS_KEY_ID", b"AKIAHUSH\n", "AWS_ACCESS_KEY_ID holds a line break"),
        ("AWS_SECRET_ACCESS_KEY", b"hush\nhush", "AWS_SECRET_ACCESS_KEY holds a line break"),
        ("AWS_SECRET_ACCESS_KEY", b"hush-\xff", "AWS_SECRET_ACCESS_KEY is not UTF-8"),
        ("AWS_SESSION_TOKEN", b"hush\r\n", "AWS_SESSION_TOKEN holds a line break"),
        ("AWS_REGION", b"us-east-1\n", "AWS_REGION holds a line break"),
        ("AWS_REGION", b"us east", "expected a region"),
        ("AWS_DEFAULT_REGION", b"", "expected a region"),
    ] {
        let ran = ran("s3://bucket/film.zarr", name, value);
        check(&ran, USAGE, &secrets, name);
        assert!(ran.stderr.contains(expected), "{name}: {}", ran.stderr);
    }
    for url in ["s3://my bucket/film.zarr", "s3://bucket\n/film.zarr", "http://ho st/film.zarr"] {
        check(&ran(url, "AWS_REGION", b"us-east-1"), USAGE, &secrets, url);
    }
    // Nobody listens there: worth a retry, and still nothing secret.
    check(&ran("s3://bucket/film.zarr", "AWS_REGION", b"us-east-1"), 75, &secrets, "out of reach");
}

fn not_utf8(dir: &std::path::Path, name: &str) -> PathBuf {
    dir.join(OsString::from_vec([name.as_bytes(), b"\xff"].concat()))
}

#[test]
fn outputs_may_have_names_that_are_not_utf_8() {
    let place = Place::small();
    let dir = place.dir.path();
    let at = |name: &str| not_utf8(dir, name);
    let film = at("film");
    let words = |words: &[&str], path: &PathBuf, more: &[&str]| -> Ran {
        let ran = Ran::of(&program().args(words).arg(path).args(more).output().unwrap());
        assert!(!ran.stderr.contains("panicked"), "{words:?}: {}", ran.stderr);
        ran
    };
    let lens = ["--lens", text(&place.pack), "--threads", "2", "--progress", "jsonl"];
    let json = |text: &str| serde_json::from_str::<serde_json::Value>(text).unwrap();
    // Made, and then nothing to do.
    for shards in [Some(2), None] {
        let ran = words(&["run", text(&place.chart)], &film, &lens).ok();
        let lines: Vec<_> = ran.stdout.lines().map(json).collect();
        assert_eq!(
            lines.iter().find(|l| l["event"] == "start").unwrap()["film"],
            film.to_string_lossy().as_ref()
        );
        assert_eq!(lines.last().unwrap()["event"], "done");
        assert!(shards.is_none() || lines.iter().filter(|l| l["event"] == "shard").count() >= 2);
    }
    assert_eq!(json(&words(&["status", "--json"], &film, &[]).ok().stdout)["complete"], true);
    assert_eq!(json(&words(&["verify", "--json"], &film, &[]).ok().stdout)["sound"], true);
    words(&["status"], &film, &["--check"]).ok();
    words(&["verify"], &film, &["--repair"]).ok();
    words(&["pyramid"], &film, &[]).ok();
    words(&["chart", "uniform"], &at("chart"), &["--size", "40", "--wavelengths", "500"]).ok();
    let trace = ["--wavelengths", "500", "--max-height-mm", "1"];
    words(&["lens", "trace", "double-gauss-28"], &at("pack"), &trace).ok();
    let formats = [("png", "x.png"), ("npy", "x.npy"), ("envi", "x"), ("tiff", "x.tif"), ("exr", "x.exr")];
    for (format, name) in formats {
        words(&["export", text(&place.chart), "--format", format], &at(name), &[]).ok();
    }
    // A command line that others must be able to say again, and inputs that are text.
    let rest: [(&[&str], &[&str]); 9] = [
        (&["plan", text(&place.chart)], &["-o", "job.json", "--lens", text(&place.pack)]),
        (&["run"], &[text(&place.film)]),
        (&["run", text(&place.chart), text(&place.film), "--lens"], &[]),
        (&["export"], &["x.npy"]),
        (&["view"], &[]),
        (&["measure"], &["--edge", "1,2,3,4"]),
        (&["lens", "show"], &[]),
        (&["demo", "--dir"], &[]),
        (&["bench", "--dir"], &[]),
    ];
    for (before, after) in rest {
        let ran = words(before, &film, after);
        assert_eq!(ran.code, USAGE, "{before:?}: {}", ran.stderr);
        assert!(ran.stderr.contains("UTF-8"), "{before:?}: {}", ran.stderr);
    }
    let ran = words(&["validate", "--out"], &film, &[]);
    assert_eq!(ran.code, USAGE, "{}", ran.stderr);
}
