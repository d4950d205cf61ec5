//! Films that another command replaces while a process works on them, and files that no command may replace.

mod overwrite;
mod processes;

use crate::common::test_job::{StoppedRun, TestJob};
use crate::common::{CommandResult, files, lenscube, text};
use serde_json::Value;
use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};

const OTHER_JOB: i32 = 3;
const USAGE: i32 = 2;
const WRONG: i32 = 4;
const RETRY: i32 = 75;

/// Flags of job B, which differs from job A.
const JOB_B: [&str; 2] = ["--interp", "bilinear"];

fn worker(plan: &Path, unit: &str) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_lenscube"));
    command.args(["run", "--plan", text(plan), "--unit", unit, "--no-fsync", "--progress", "jsonl"]);
    command
}

fn plan(job: &TestJob, name: &str, flags: &[&str]) -> CommandResult {
    let path = job.at(name);
    CommandResult::new(
        &job.plan(&job.film, flags).args(["--units", "1", "-o", text(&path)]).output().unwrap(),
    )
}
