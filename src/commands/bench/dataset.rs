//! `lenscube dataset` in a separate process: samples per second of small films, PNG in and out, with the lens traced and in the cache.

use super::Bench;
use anyhow::{Context, Result, bail};
use formats::dataset::encode::{Codes, png};
use pipeline::geometry::Size;
use pipeline::sensor::random::word_of;
use serde_json::Value;
use std::path::Path;
use std::process::Command;

/// Pictures, their side, and samples of a round.
const PICTURES: u32 = 8;
const SIDE: usize = 320;
const SAMPLES: u64 = 60;

/// Key, label, flags of the lens and tables of the outputs.
const ROWS: [(&str, &str, &str, &str); 3] = [
    (
        "dataset_films_s",
        "data set: films of 256 x 256 x 3, phone, PNG in and out",
        "",
        "[output]\nfilm = \"png\"",
    ),
    (
        "dataset_films_without_tails_s",
        "  without tails of PSFs",
        "tails = \"off\"",
        "[output]\nfilm = \"png\"",
    ),
    (
        "dataset_pictures_s",
        "  with sensor and development",
        "",
        "[sensor]\nname = \"example-2um\"\n[output]\npicture = \"png\"",
    ),
];

pub(super) fn measure(bench: &mut Bench<'_>) -> Result<()> {
    let directory = bench.scratch.0.join("dataset");
    std::fs::create_dir_all(directory.join("pictures")).context("creating the pictures of a data set")?;
    let size = Size::new(SIDE, SIDE);
    for k in 0..PICTURES {
        let values: Vec<u16> =
            (0..3 * size.pixels() as u32).map(|i| (word_of([i, k, 0, 0], 1) & 255) as u16).collect();
        let bytes = png(Codes { size, channels: 3, values: &values }, 8, true)?;
        std::fs::write(directory.join(format!("pictures/{k}.png")), bytes)?;
    }
    for (key, label, flags, output) in ROWS {
        let recipe = directory.join("recipe.toml");
        let text = format!(
            "schema = \"lenscube/dataset/1\"\nsamples = {SAMPLES}\n[pictures]\nfiles = \"pictures\"\nsize = [256, 256]\nwavelengths_nm = [650, 550, 450]\n\
             [lens]\nname = \"phone\"\nfocus_m = 1\nflags = {{ {flags} }}\n[film]\npitch_um = 2\nradius_mm = {{ from = 0, to = 1.5 }}\n{output}\n"
        );
        std::fs::write(&recipe, text)?;
        // The lens is traced, or found in the cache.
        made(bench, &recipe, &directory.join("out"), 1)?;
        let rate = bench.median(|| {
            let report = made(bench, &recipe, &directory.join("out"), SAMPLES)?;
            let number = |name: &str| report[name].as_f64().context("a report of numbers");
            Ok(number("made_samples")? / number("seconds")?)
        })?;
        bench.add_number(key, rate, "samples/s", label);
    }
    Ok(())
}

/// The report of a data set of `samples`, which is removed.
fn made(bench: &Bench<'_>, recipe: &Path, out: &Path, samples: u64) -> Result<Value> {
    let program = std::env::current_exe().context("finding this program")?;
    let done = Command::new(program)
        .arg("dataset")
        .args([recipe, out])
        .args([format!("--samples={samples}"), format!("--threads={}", bench.threads)])
        .args(["--json", "--quiet"])
        .output()
        .context("running lenscube dataset")?;
    if !done.status.success() {
        bail!("lenscube dataset: {}", String::from_utf8_lossy(&done.stderr).trim());
    }
    std::fs::remove_dir_all(out)?;
    Ok(serde_json::from_slice(&done.stdout)?)
}
