//! A design's bands, traced for a job, in one lens pack: workers that have it need neither a cache nor time to trace.

use crate::args::{DesignArgs, RunArgs};
use crate::failure::{other_job, usage};
use crate::job::Job;
use crate::lens::source::Source;
use crate::progress::say;
use crate::trace::bytes_of;
use anyhow::{Context, Result};
use formats::durable::{parent_of, publish, remove_temp, sweep_entries, temp_name};
use formats::lens::{LensPack, LensPackWriter, PackAttributes};
use serde_json::json;
use std::path::Path;

/// Traces the job's design into the pack `path` and gives its name; the same pack there already is left as it is.
///
/// # Errors
/// The lens is a pack already; another pack is there (exit code 3); the disk.
pub fn write(run: &RunArgs, path: &Path) -> Result<String> {
    let name =
        path.to_str().ok_or_else(|| usage("--lens-pack: the path is no UTF-8, which a plan cannot hold"))?;
    let job = Job::new(run)?;
    let Source::Traced(_) = &job.lens else {
        return Err(usage(format!(
            "--lens-pack: `{}` is a lens pack already; leave the flag away",
            run.lens
        )));
    };
    sweep_entries(parent_of(path))?;
    let zip = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("zip"));
    let temp = path.with_file_name(format!("{}{}", temp_name(), if zip { ".zip" } else { "" }));
    let made = written(&job, run, &temp).and_then(|digest| settle(&temp, path, &digest));
    if temp.symlink_metadata().is_ok() {
        remove_temp(&temp)?;
    }
    made.with_context(|| format!("writing the lens pack {name}"))?;
    say(format!("{name}: {} bands, {:.1} MB", job.plans.len(), bytes_of(path) as f64 * 1e-6));
    Ok(name.to_owned())
}

/// Writes the pack and gives its digest.
fn written(job: &Job, run: &RunArgs, path: &Path) -> Result<String> {
    let mut pack = LensPackWriter::create(path)?;
    let lens = job.lens.lens();
    for band in 0..lens.bands.len() {
        pack.psf(band, &job.lens.psf(band)?)?;
    }
    let attributes = PackAttributes {
        image_plane: Some(format!("{:?}", DesignArgs::default().image_plane).to_lowercase()),
        source: Some(json!({
            "program": concat!("lenscube ", env!("CARGO_PKG_VERSION")),
            "design": run.lens,
            "film_pitch_um": job.frame.pitch_um,
        })),
        ..PackAttributes::default()
    };
    pack.finish(lens, &attributes)?;
    Ok(LensPack::open(path)?.digest()?.to_owned())
}

/// Gives the pack its name, or finds the same one there.
fn settle(temp: &Path, path: &Path, digest: &str) -> Result<()> {
    if path.symlink_metadata().is_err() && publish(temp, path, true)? {
        return Ok(());
    }
    match LensPack::open(path) {
        Ok(there) if there.digest()? == digest => Ok(()),
        _ => Err(other_job(format!("{} exists and is not this lens; choose another name", path.display()))),
    }
}
