//! URLs with secrets, malformed environment variables of stores, file names that are not UTF-8.

use crate::common::test_job::TestJob;
use crate::common::{CommandResult, files, text};
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

fn lenscube<W: AsRef<OsStr>>(words: impl IntoIterator<Item = W>) -> CommandResult {
    CommandResult::new(&program().args(words).output().unwrap())
}

/// Asserts the exit code, a single line on stderr without panic, and that none of `secrets` is printed.
fn assert_one_line(ran: &CommandResult, code: i32, secrets: &[&str], context: &str) {
    assert_eq!(ran.code, code, "{context}: {}", ran.stderr);
    assert!(!ran.stderr.contains("panicked"), "{context}: {}", ran.stderr);
    assert_eq!(ran.stderr.lines().count(), 1, "{context}: {}", ran.stderr);
    for secret in secrets {
        assert!(!ran.stderr.contains(secret) && !ran.stdout.contains(secret), "{context}: {}", ran.stderr);
    }
}

#[test]
fn credentials_in_a_url_are_never_printed() {
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
            assert_one_line(
                &lenscube(&words),
                USAGE,
                &["hush", "AKIAX", "user", "hu#", "sh@"],
                &words.join(" "),
            );
        }
    }
    // These flags require local directories; no directory named `s3:` is created.
    let far = "s3://bucket/report";
    for command in [
        &["validate", "--out", far][..],
        &["demo", "--dir", far],
        &["bench", "--dir", far],
        &["man", far],
        &["lens", "show", "double-gauss-28-npz", "--plot", far],
        &["export", "gen:uniform?size=64", "s3://bucket/x.npy"],
    ] {
        let ran = CommandResult::new(&program().current_dir(dir.path()).args(command).output().unwrap());
        assert_one_line(&ran, USAGE, &[], &command.join(" "));
        assert!(ran.stderr.contains("local "), "{command:?}: {}", ran.stderr);
    }
    assert_eq!(files(dir.path()).len(), 0, "files were written");
}

#[test]
fn malformed_store_environment_exits_2_with_one_line() {
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
        CommandResult::new(&program().envs(good).env(name, value).args(["status", url]).output().unwrap())
    };
    let secrets = ["AKIAHUSH", "hush"];
    for (name, value, expected) in [
        ("AWS_ENDPOINT_URL", &b"127.0.0.1:9000"[..], "expected http://HOST:PORT"),
        ("AWS_ENDPOINT_URL", b"localhost:9000", "expected http://HOST:PORT"),
        ("AWS_ENDPOINT_URL", b"", "expected http://HOST:PORT"),
        ("AWS_ENDPOINT_URL", b"http://me:hush@127.0.0.1:9", "contains credentials"),
        ("AWS_ENDPOINT_URL", b"http://127.0.0.1:9/?X-Amz-Signature=hush", "a query or a fragment"),
        ("AWS_ENDPOINT_URL_S3", b"http://127.0.0.1:9\n", "line break"),
        ("AWS_ACCESS_KEY_ID", b"AKIAHUSH\n", "AWS_ACCESS_KEY_ID contains a line break"),
        ("AWS_SECRET_ACCESS_KEY", b"hush\nhush", "AWS_SECRET_ACCESS_KEY contains a line break"),
        ("AWS_SECRET_ACCESS_KEY", b"hush-\xff", "AWS_SECRET_ACCESS_KEY is not UTF-8"),
        ("AWS_SESSION_TOKEN", b"hush\r\n", "AWS_SESSION_TOKEN contains a line break"),
        ("AWS_REGION", b"us-east-1\n", "AWS_REGION contains a line break"),
        ("AWS_REGION", b"us east", "expected a region"),
        ("AWS_DEFAULT_REGION", b"", "expected a region"),
    ] {
        let ran = ran("s3://bucket/film.zarr", name, value);
        assert_one_line(&ran, USAGE, &secrets, name);
        assert!(ran.stderr.contains(expected), "{name}: {}", ran.stderr);
    }
    for url in ["s3://my bucket/film.zarr", "s3://bucket\n/film.zarr", "http://ho st/film.zarr"] {
        assert_one_line(&ran(url, "AWS_REGION", b"us-east-1"), USAGE, &secrets, url);
    }
    // No server at that port: retryable, and no secrets printed.
    assert_one_line(&ran("s3://bucket/film.zarr", "AWS_REGION", b"us-east-1"), 75, &secrets, "unreachable");
}

fn not_utf8(dir: &std::path::Path, name: &str) -> PathBuf {
    dir.join(OsString::from_vec([name.as_bytes(), b"\xff"].concat()))
}

#[test]
fn outputs_accept_names_that_are_not_utf_8() {
    let job = TestJob::small();
    let dir = job.dir.path();
    let at = |name: &str| not_utf8(dir, name);
    let film = at("film");
    let words = |words: &[&str], path: &PathBuf, more: &[&str]| -> CommandResult {
        let ran = CommandResult::new(&program().args(words).arg(path).args(more).output().unwrap());
        assert!(!ran.stderr.contains("panicked"), "{words:?}: {}", ran.stderr);
        ran
    };
    let lens = ["--lens", text(&job.pack), "--threads", "2", "--progress", "jsonl"];
    let json = |text: &str| serde_json::from_str::<serde_json::Value>(text).unwrap();
    // The second run has nothing to do.
    for shards in [Some(2), None] {
        let ran = words(&["run", text(&job.chart)], &film, &lens).ok();
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
        words(&["export", text(&job.chart), "--format", format], &at(name), &[]).ok();
    }
    // The command line of a plan, and inputs, must be UTF-8.
    let rest: [(&[&str], &[&str]); 9] = [
        (&["plan", text(&job.chart)], &["-o", "job.json", "--lens", text(&job.pack)]),
        (&["run"], &[text(&job.film)]),
        (&["run", text(&job.chart), text(&job.film), "--lens"], &[]),
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
