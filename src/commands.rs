//! The commands, a module each: arguments to a report and an exit code. What most commands share lies beside this module; a command that
//! does what another does as a part of its own (`dataset` exposes sensors, `restore` reads raws) calls that one.

mod bench;
mod cache;
mod chart;
mod compare;
mod dataset;
mod demo;
mod depth;
mod develop;
mod device;
mod export;
mod help;
mod lens;
mod manual;
mod measure;
mod paths;
mod plan;
mod pyramid;
mod report;
mod restore;
mod run;
#[cfg(feature = "mesh")]
mod scene;
mod sensor;
mod shoot;
mod status;
mod validate;
mod verify;
#[cfg(feature = "view")]
mod view;

use crate::args::Command;
use clap::ArgMatches;

/// Runs `command`, parsed from `matches`; the exit code.
pub fn run(command: &Command, matches: &ArgMatches) -> anyhow::Result<u8> {
    paths::check(command)?;
    match command {
        Command::Chart(args) => chart::command(args).map(|()| 0),
        #[cfg(feature = "mesh")]
        Command::Scene(args) => scene::command(args),
        #[cfg(not(feature = "mesh"))]
        Command::Scene(_) => Err(anyhow::anyhow!("{}", formats::features::missing("mesh"))),
        Command::Depth(args) => depth::command(args),
        Command::Run(args) => run::command(args, matches),
        Command::Sensor(args) => sensor::command(args),
        Command::Develop(args) => develop::command(args),
        Command::Shoot(args) => shoot::command(args),
        Command::Compare(args) => compare::command(args),
        Command::Dataset(args) => dataset::command(args),
        Command::Restore(args) => restore::command(args),
        Command::Plan(args) => plan::command(args, matches),
        Command::Status(args) => status::command(args),
        Command::Verify(args) => verify::command(args),
        Command::Lens(args) => lens::command(args).map(|()| 0),
        Command::Export(args) => export::command(args),
        Command::Demo(args) => demo::command(args),
        Command::Pyramid(args) => pyramid::command(args),
        #[cfg(feature = "view")]
        Command::View(args) => view::command(args).map(|()| 0),
        #[cfg(not(feature = "view"))]
        Command::View(_) => Err(anyhow::anyhow!("{}", formats::features::missing("view"))),
        Command::Validate(args) => validate::command(args),
        Command::Measure(args) => measure::command(args).map(|()| 0),
        Command::Report(args) => report::command(args).map(|()| 0),
        Command::Bench(args) => bench::command(args).map(|()| 0),
        Command::Device(args) => device::command(args),
        Command::Cache(args) => cache::command(args).map(|()| 0),
        Command::Help(args) => help::command(args).map(|()| 0),
        Command::Completions(args) => manual::completions(args).map(|()| 0),
        Command::Man(args) => manual::man(args).map(|()| 0),
    }
}
