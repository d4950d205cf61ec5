//! `lenscube scene`: a mesh, as the pinhole of a lens sees it, becomes a scene: chart, distances and coverages of what is seen first and of what is hidden.
//!
//! Order, each before anything that a later step may change: the design in focus and the film within its field; the illuminant; the mesh with all of its
//! files, its camera; memory; by a coarse picture whether the camera stands inside something, and how near surfaces are; materials and lights; the size of the
//! chart; the disk; the scene of another job. Then the scene is created or resumed, and its missing shards are made.

mod chart_frame;
mod done;
mod environment;
mod illuminant;
mod job;
mod light;
mod make;
mod objects;
mod prepared;
mod report;
mod scratch;
mod seen;

use crate::args::SceneArgs;
use crate::progress::log_line;
use anyhow::Result;
use job::SceneJob;
use pipeline::scene::appearance::Appearance;
use pipeline::scene::mesh::Mesh;
use prepared::Prepared;

/// Runs the command; the exit code.
pub fn command(args: &SceneArgs) -> Result<u8> {
    let prepared = Prepared::new(args)?;
    if args.materials {
        report::print_materials(&prepared);
        return Ok(0);
    }
    let note = |note: &String| log_line(format!("note: {note}"));
    prepared.notes.iter().for_each(note);
    with_job(args, prepared, |prepared, appearance, job| {
        appearance.notes().iter().for_each(note);
        if args.info {
            report::print_info(prepared, job);
            return Ok(0);
        }
        make::scene(args, prepared, appearance, job)
    })
}

/// Digest of the job of the scene of `args`.
///
/// # Errors
/// Those of the command before it writes.
pub fn job_digest(args: &SceneArgs) -> Result<String> {
    with_job(args, Prepared::new(args)?, |_, _, job| Ok(job.digest()))
}

/// Resolves the job of `args` and its `prepared` mesh for `work`.
fn with_job<T>(
    args: &SceneArgs,
    mut prepared: Prepared,
    work: impl FnOnce(&Prepared, &Appearance<'_, Mesh>, &SceneJob) -> Result<T>,
) -> Result<T> {
    let textures = light::textures(&mut prepared)?;
    let assigned = light::assigned_spectra(args, &prepared)?;
    let appearance = light::appearance(args, &prepared, textures, &assigned)?;
    let job = SceneJob::new(args, &prepared, &appearance, &assigned)?;
    work(&prepared, &appearance, &job)
}
