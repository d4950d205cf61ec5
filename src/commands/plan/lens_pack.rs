//! `lenscube plan --lens-pack`: the bands of a design, traced for a job, in one lens pack; workers then need neither the trace cache nor
//! time to trace.

use crate::args::RunArgs;
use crate::commands::lens::trace::bytes_of;
use crate::failure::{other_job, usage};
use crate::job::{Job, UntracedJob};
use crate::progress::{log_line, plural};
use anyhow::{Context, Result};
use formats::durable::{parent_of, publish, remove_temp, sweep_entries, temp_name};
use formats::lens::{LensPack, LensPackWriter, PackAttributes, ReferencePoint};
use serde_json::json;
use std::path::Path;

/// Traces the job's design into the pack `path` and returns its name; an identical pack there is left unchanged.
///
/// # Errors
/// The lens is a pack already; another pack exists (exit code 3); the disk.
pub fn write(run: &RunArgs, path: &Path) -> Result<String> {
    let name = path
        .to_str()
        .ok_or_else(|| usage("--lens-pack: the path is not UTF-8, so it cannot be stored in a plan"))?;
    let untraced = UntracedJob::new(run)?;
    if untraced.has_pack() {
        return Err(usage(format!("--lens-pack: `{}` is a lens pack already; omit the flag", run.lens)));
    }
    if run.veil.ghosts.is_on() && untraced.has_distances() {
        return Err(usage(
            "--lens-pack: a pack with depth nodes has no ghosts; leave out --lens-pack or --ghosts on",
        ));
    }
    let job = untraced.traced()?;
    sweep_entries(parent_of(path))?;
    let zip = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("zip"));
    let temp = path.with_file_name(format!("{}{}", temp_name(), if zip { ".zip" } else { "" }));
    let made = write_pack(&job, run, &temp).and_then(|digest| publish_pack(&temp, path, &digest));
    if temp.symlink_metadata().is_ok() {
        remove_temp(&temp)?;
    }
    made.with_context(|| format!("writing the lens pack {name}"))?;
    log_line(format!("{name}: {}, {:.1} MB", plural(job.plans.len(), "band"), bytes_of(path) as f64 * 1e-6));
    Ok(name.to_owned())
}

/// Writes the pack and returns its digest.
fn write_pack(job: &Job, run: &RunArgs, path: &Path) -> Result<String> {
    let lens = job.lens.lens();
    let mut pack = match lens.is_symmetric() {
        true => LensPackWriter::create(path)?,
        false => LensPackWriter::create_planar(path)?,
    };
    for band in 0..lens.bands.len() {
        match &lens.depth {
            None => pack.psf(band, &job.lens.psf(band)?)?,
            Some(depth) => {
                for node in 0..depth.bands[band].nodes.len() {
                    pack.psf_of_node(band, node, &job.lens.psf_of_node(band, node)?)?;
                }
            }
        }
    }
    if let Some(ghosts) = job.layers.iter().find_map(|layer| layer.ghosts()) {
        for band in 0..lens.bands.len() {
            let mut of_band = job.plans.iter().filter(|plan| plan.lens_bands.first == band);
            let plan = of_band.next().context("a band of the lens that no band of the film has")?;
            let operator = ghosts.operator(plan).map_err(anyhow::Error::from_boxed)?;
            pack.ghosts(band, &operator, ghosts.film_reflectance(plan)?)?;
        }
    }
    let [errors, compensators] = match job.lens.errors() {
        Some(recorded) => recorded.map(|(_, value)| Some(value)),
        None => [None, None],
    };
    let attributes = PackAttributes {
        reference_point: errors.is_some().then_some(ReferencePoint::ChiefRay),
        errors,
        compensators,
        image_plane: Some(format!("{:?}", run.tracing.image_plane).to_lowercase()),
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

/// Renames the pack to `path`, unless a pack of the same digest is there.
fn publish_pack(temp: &Path, path: &Path, digest: &str) -> Result<()> {
    if path.symlink_metadata().is_err() && publish(temp, path, true)? {
        return Ok(());
    }
    match LensPack::open(path) {
        Ok(existing) if existing.digest()? == digest => Ok(()),
        _ => Err(other_job(format!("{} exists and is not this lens; choose another name", path.display()))),
    }
}
