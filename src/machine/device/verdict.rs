//! Stored results of `lenscube device check`, in the user's cache: whether a GPU with its driver and this program has made the films
//! of the CPU. A result holds for one card, by its UUID: cards of the same name may differ, one of them being defective.

use super::driver;
use crate::machine::user_cache;
use anyhow::{Context, Result};
use formats::durable::{AtomicFile, create_directories};
use pipeline::cuda::DeviceInfo;
use pipeline::cuda::ptx::{self, Kernels};
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
    Some(user_cache()?.join("device-checks.json"))
}

/// What a result holds for: one GPU, its driver, the program and its kernels as PTX and cubins.
fn key(info: &DeviceInfo) -> String {
    let (capability, uuid) = (info.compute_capability, u128::from_be_bytes(info.uuid));
    format!(
        "{} {uuid:032x} sm_{}{} {} lenscube {} kernels {}",
        info.name,
        capability.0,
        capability.1,
        driver::description(info),
        env!("CARGO_PKG_VERSION"),
        &digest([&ptx::REMAP, &ptx::PSF, &ptx::OVERLAP_ADD])[..16],
    )
}

/// Digest of kernels in both forms: a GPU runs one of its cubins, or PTX that its driver assembles.
fn digest(kernels: [&Kernels; 3]) -> String {
    let mut hasher = blake3::Hasher::new();
    for kernels in kernels {
        hasher.update(kernels.ptx.as_bytes());
        for (_, cubin) in kernels.cubins {
            hasher.update(cubin);
        }
    }
    hasher.finalize().to_hex().to_string()
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn key_differs_for_another_card_driver_or_capability() {
        let info = DeviceInfo {
            index: 0,
            name: "a GPU".into(),
            uuid: [7; 16],
            compute_capability: (9, 0),
            memory_bytes: 0,
            multiprocessors: 132,
            clock_mhz: 0,
            memory_gb_per_s: 0.0,
            shared_bytes: 0,
            driver_version: (12, 2),
        };
        let key_of = |change: fn(&mut DeviceInfo)| {
            let mut other = info.clone();
            change(&mut other);
            key(&other)
        };
        assert_eq!(key_of(|info| info.index = 1), key(&info), "the order of the GPUs may change");
        assert_ne!(key_of(|info| info.uuid[15] = 8), key(&info));
        assert_ne!(key_of(|info| info.driver_version = (12, 4)), key(&info));
        assert_ne!(key_of(|info| info.compute_capability = (8, 0)), key(&info));
    }

    #[test]
    fn digest_is_that_of_ptx_and_cubins() {
        static OTHER_CUBIN: Kernels = Kernels { cubins: &[((9, 0), b"other")], ..Kernels::of_ptx("ptx") };
        static OTHER_PTX: Kernels = Kernels::of_ptx("other ptx");
        static SAME: Kernels = Kernels::of_ptx("ptx");
        let of = |kernels| digest([kernels, &ptx::PSF, &ptx::OVERLAP_ADD]);
        assert!(of(&SAME) != of(&OTHER_CUBIN) && of(&SAME) != of(&OTHER_PTX));
    }
}
