//! Help and errors as they are printed. A file of `tests/snapshots` holds commands, `$ lenscube …`, run in its order in one new directory, each followed
//! by its exit code, `? 2`, if that is not 0, and by what it prints: standard output, then standard error. `[..]` stands for any text within a line.
//!
//! `LENSCUBE_SNAPSHOTS=write cargo test --workspace --all-features --test snapshots` writes the files anew; lines that match stay as they are.

use libtest_mimic::{Arguments, Failed, Trial};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};

fn main() -> ExitCode {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/snapshots");
    let mut files: Vec<PathBuf> = fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()).collect();
    files.sort();
    let texts: String = files.iter().map(|f| fs::read_to_string(f).unwrap()).collect();
    let mut trials =
        vec![Trial::test("every_command_has_its_help", move || every_command_has_its_help(&texts))];
    trials.extend(files.into_iter().map(|file| {
        let name = file.file_stem().unwrap().to_string_lossy().into_owned();
        Trial::test(name, move || compare(&file))
    }));
    libtest_mimic::run(&Arguments::from_args(), trials).exit_code()
}

/// The exit code, if not 0, and what is printed.
fn run(arguments: &str, dir: &Path) -> Vec<String> {
    let mut command = Command::new(env!("CARGO_BIN_EXE_lenscube"));
    command.args(arguments.split(' ').skip(1)).current_dir(dir).env("XDG_CACHE_HOME", dir.join("cache"));
    let done = command.output().unwrap();
    let text = [done.stdout, done.stderr].map(|stream| String::from_utf8(stream).unwrap()).concat();
    let code = done.status.code().unwrap();
    let code = (code != 0).then(|| format!("? {code}"));
    code.into_iter().chain(text.trim_end().lines().map(|line| line.trim_end().to_owned())).collect()
}

/// Whether `line` is `pattern`, in which `[..]` stands for any text.
fn matches(pattern: &str, line: &str) -> bool {
    let Some((first, rest)) = pattern.split_once("[..]") else { return pattern == line };
    let Some(mut line) = line.strip_prefix(first) else { return false };
    let mut parts: Vec<&str> = rest.split("[..]").collect();
    let last = parts.pop().unwrap();
    for part in parts {
        let Some(at) = line.find(part) else { return false };
        line = &line[at + part.len()..];
    }
    line.ends_with(last)
}

fn compare(file: &Path) -> Result<(), Failed> {
    let dir = tempfile::tempdir().unwrap();
    fs::write(dir.path().join("notes.xyz"), "1 2 3").unwrap();
    let expected = fs::read_to_string(file).unwrap();
    let (mut printed, mut differences) = (String::new(), String::new());
    for block in format!("\n{expected}").split("\n$ ").skip(1) {
        let mut lines = block.trim_end().lines();
        let command = lines.next().unwrap();
        let lines: Vec<&str> = lines.collect();
        let mut found = run(command, dir.path());
        if lines.len() == found.len() && lines.iter().zip(&found).all(|(l, f)| matches(l, f)) {
            found = lines.iter().map(ToString::to_string).collect();
        } else {
            differences += &format!("$ {command}\n{}\nexpected:\n{}\n\n", found.join("\n"), lines.join("\n"));
        }
        printed += &format!("$ {command}\n{}\n\n", found.join("\n"));
    }
    if std::env::var_os("LENSCUBE_SNAPSHOTS").is_some_and(|v| v == "write") {
        fs::write(file, printed.trim_end().to_owned() + "\n").unwrap();
        return Ok(());
    }
    if differences.is_empty() { Ok(()) } else { Err(differences.into()) }
}

fn every_command_has_its_help(texts: &str) -> Result<(), Failed> {
    let listing = run("lenscube man --json", Path::new(".")).join("\n");
    let listing: serde_json::Value = serde_json::from_str(&listing)?;
    let names = listing["commands"].as_array().unwrap().iter().map(|c| c["name"].as_str().unwrap());
    let missing: Vec<&str> =
        names.filter(|name| !texts.contains(&format!("$ lenscube {name} -h\n"))).collect();
    if missing.is_empty() { Ok(()) } else { Err(format!("no help of {missing:?} in tests/snapshots").into()) }
}
