//! `lenscube scene`: a mesh, as the pinhole of a lens sees it, becomes a scene: chart, distances and coverages of what is seen first and of what is hidden.
//!
//! Order, each before anything that a later step may change: the design in focus and the film within its field; the illuminant; the mesh with all of its
//! files, its camera; memory; by a coarse picture whether the camera stands inside something, and how near surfaces are; materials and lights; the size of the
//! chart; the disk; the scene of another job. Then the scene is created or resumed, and its missing shards are made.

mod done;
mod illuminant;
mod job;
mod light;
mod make;
mod prepared;
mod report;
mod seen;

use crate::args::SceneArgs;
use crate::progress::log_line;
use anyhow::Result;
use prepared::Prepared;

/// Runs the command; the exit code.
pub fn command(args: &SceneArgs) -> Result<u8> {
    let mut prepared = Prepared::new(args)?;
    if args.materials {
        report::print_materials(&prepared);
        return Ok(0);
    }
    prepared.notes.iter().for_each(|note| log_line(format!("note: {note}")));
    let textures = light::textures(&mut prepared)?;
    let assigned = light::assigned_spectra(args, &prepared)?;
    let appearance = light::appearance(args, &prepared, textures, &assigned)?;
    appearance.notes().iter().for_each(|note| log_line(format!("note: {note}")));
    let job = job::SceneJob::new(args, &prepared, &appearance, &assigned)?;
    if args.info {
        report::print_info(&prepared, &job);
        return Ok(0);
    }
    make::scene(args, &prepared, &appearance, &job)
}
