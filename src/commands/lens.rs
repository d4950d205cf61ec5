//! `lenscube lens`: creates, shows and compares lenses.

mod aberrations;
mod asymmetric;
mod asymmetric_design;
mod camera;
mod comparison;
pub mod convert;
mod cross_section;
mod curves;
mod diff;
pub mod export;
mod film_diff;
pub mod film_figures;
mod film_lens;
mod ghosts;
mod import;
mod light;
mod list;
mod pack_light;
pub mod plots;
mod psf;
mod psf_figure;
mod psf_sheet;
mod show;
mod shown;
mod spot_figure;
pub mod tables;
pub mod tolerance;
pub mod trace;

use crate::args::{LensArgs, LensCommand};
use anyhow::Result;

/// Runs the command.
pub fn command(args: &LensArgs) -> Result<()> {
    match &args.command {
        LensCommand::Show(args) => show::command(args),
        LensCommand::Psf(args) => psf::command(args),
        LensCommand::Diff(args) => diff::command(args),
        LensCommand::Camera(args) => camera::command(args),
        LensCommand::Export(args) => export::command(args),
        LensCommand::Light(args) => light::command(args),
        LensCommand::List(args) => list::command(args),
        LensCommand::Convert(args) => convert::command(args),
        LensCommand::Trace(args) => trace::command(args),
        LensCommand::Tolerance(args) => tolerance::command(args),
        LensCommand::Import(args) => import::command(args),
    }
}
