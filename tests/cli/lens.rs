//! `lenscube lens trace | show | diff`, and runs whose lens is a design.

mod asymmetric;
mod built;
mod coatings;
mod commands;
mod design_files;
mod export;
mod export_psfs;
mod figures;
mod ghosts;
mod opticstudio;
mod runs;
mod sealed;
mod tolerance;

use crate::common::{
    CommandResult, Picture, assert_error_line, assert_exit, bits, files, lenscube, pairs, pixels, text,
};
use formats::lens::LensPack;
use pipeline::geometry::Size;
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

const FAILED: i32 = 1;
const USAGE: i32 = 2;
const OTHER_JOB: i32 = 3;
const DESIGN: &str = include_str!("../../formats/data/lenses/double-gauss-28.zmx");

/// What a command prints, as JSON.
fn json(ran: CommandResult) -> Value {
    serde_json::from_str(&ran.ok().stdout).unwrap()
}

/// `lens trace DESIGN OUT` of two bands and three heights to 3 mm: a second of work.
fn trace(design: &str, out: &Path, flags: &[&str]) -> CommandResult {
    let words = ["lens", "trace", design, text(out), "--wavelengths", "600,500", "--max-height-mm", "3"];
    lenscube(&[&words[..], &["--heights", "0,1.5,3"], flags].concat())
}
