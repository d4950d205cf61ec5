//! Build script: what `lenscube --version` prints of the build.
//!
//! The commit is recorded in optimised builds alone: a debug build would be made anew after every commit. LENSCUBE_COMMIT gives it
//! where there is no repository, as in a source archive.

use std::env::var;
use std::path::Path;
use std::process::Command;

fn main() {
    println!("cargo::rerun-if-env-changed=LENSCUBE_COMMIT");
    println!("cargo::rerun-if-changed=scripts/build.rs");
    let target = var("TARGET").expect("set by Cargo");
    let profile = var("PROFILE").expect("set by Cargo");
    let compiler = output(&var("RUSTC").expect("set by Cargo"), &["--version"]);
    println!("cargo::rustc-env=LENSCUBE_TARGET={target}");
    println!("cargo::rustc-env=LENSCUBE_COMPILER={}", compiler.unwrap_or_else(|| "unknown compiler".into()));
    println!("cargo::rustc-env=LENSCUBE_FEATURES={}", features());
    println!("cargo::rustc-env=LENSCUBE_COMMIT={}", commit(profile == "release"));
}

/// The Cargo features of this build.
fn features() -> String {
    let named = |(key, _): (String, String)| key.strip_prefix("CARGO_FEATURE_").map(str::to_lowercase);
    let mut names: Vec<String> =
        std::env::vars().filter_map(named).filter(|n| n != "default").map(|n| n.replace('_', "-")).collect();
    names.sort();
    match names.is_empty() {
        true => "none".into(),
        false => names.join(", "),
    }
}

/// The commit, with `+` where tracked files differ from it.
fn commit(optimised: bool) -> String {
    if let Ok(given) = var("LENSCUBE_COMMIT") {
        return given;
    }
    if !optimised {
        return "not recorded in debug builds".into();
    }
    let Some(head) = output("git", &["rev-parse", "--short=12", "HEAD"]) else {
        return "unknown".into();
    };
    if let Some(directory) = output("git", &["rev-parse", "--absolute-git-dir"]) {
        for file in ["HEAD", "logs/HEAD"].map(|name| format!("{directory}/{name}")) {
            // A file that does not exist would count as changed.
            if Path::new(&file).exists() {
                println!("cargo::rerun-if-changed={file}");
            }
        }
    }
    for source in ["src", "pipeline", "formats", "Cargo.toml", "Cargo.lock"] {
        println!("cargo::rerun-if-changed={source}");
    }
    let changed = output("git", &["status", "--porcelain", "--untracked-files=no"]);
    let mark = if changed.is_some_and(|c| !c.is_empty()) { "+" } else { "" };
    let date = output("git", &["log", "-1", "--format=%cs"]).unwrap_or_default();
    format!("{head}{mark} ({date})")
}

/// Standard output of a program that succeeds.
fn output(program: &str, arguments: &[&str]) -> Option<String> {
    let done = Command::new(program).args(arguments).output().ok()?;
    done.status.success().then(|| String::from_utf8_lossy(&done.stdout).trim().to_owned())
}
