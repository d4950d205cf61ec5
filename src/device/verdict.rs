//! Stored results of `lenscube device check`, in the user's cache: whether a GPU with its driver and this program has made the films
//! of the CPU.

use crate::lens::cache;
use anyhow::{Context, Result};
use formats::durable::{AtomicFile, create_directories};
use pipeline::cuda::{DeviceInfo, ptx};
use serde_json::{Map, Value, json};
use std::path::PathBuf;

/// Result of the check of a GPU on this machine.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// Its films are those of the CPU, within the tolerance.
    Passed,
    /// They are not.
    Failed,
    /// No check with this GPU, driver and program is stored.
    Unknown,
}

/// File of the stored results.
fn results_path() -> Option<PathBuf> {
    Some(cache::directory()?.parent()?.join("device-checks.json"))
}

/// What a result holds for: the GPU, its driver, the program and its kernels.
fn key(info: &DeviceInfo) -> String {
    let kernels = blake3::hash(
        [&ptx::REMAP, &ptx::PSF, &ptx::OVERLAP_ADD].map(|kernels| kernels.ptx).concat().as_bytes(),
    )
    .to_hex();
    let (driver, capability) = (info.driver_version, info.compute_capability);
    format!(
        "{} sm_{}{} driver {}.{} lenscube {} kernels {}",
        info.name,
        capability.0,
        capability.1,
        driver.0,
        driver.1,
        env!("CARGO_PKG_VERSION"),
        &kernels[..16],
    )
}

/// Stored results; none if the file cannot be read.
fn results() -> Map<String, Value> {
    let text = results_path().and_then(|path| std::fs::read_to_string(path).ok());
    text.and_then(|text| serde_json::from_str(&text).ok()).unwrap_or_default()
}

/// The stored result for a GPU.
pub fn verdict(info: &DeviceInfo) -> Verdict {
    match results().get(&key(info)).and_then(|result| result["passed"].as_bool()) {
        Some(true) => Verdict::Passed,
        Some(false) => Verdict::Failed,
        None => Verdict::Unknown,
    }
}

/// Stores the result of a check: the largest difference, and whether it is within the tolerance.
pub fn store(info: &DeviceInfo, worst: f64, passed: bool) -> Result<()> {
    let path = results_path().context("neither XDG_CACHE_HOME nor HOME names a directory")?;
    if let Some(parent) = path.parent() {
        create_directories(parent, false)?;
    }
    let mut all = results();
    all.insert(key(info), json!({"passed": passed, "largest_difference": worst}));
    AtomicFile::with_text(&path, &format!("{:#}\n", Value::Object(all)))?.finish()?;
    Ok(())
}
