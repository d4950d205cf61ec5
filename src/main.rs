//! The command: parse, run, turn an error into one line and an exit code.

mod args;
mod bench;
mod chart;
mod demo;
mod design;
mod device;
mod engine;
mod export;
mod failure;
mod import;
mod job;
mod lens;
mod manual;
mod measure;
mod memory;
mod open;
mod plan;
mod progress;
mod pyramid;
mod run;
mod status;
mod trace;
mod validate;
mod verify;
mod view;

use args::{Cli, Command};
use clap::Parser;
use progress::say;
use std::process::ExitCode;

fn main() -> ExitCode {
    // Before any word of the command line is shown or kept.
    if let Err(error) = args::check_urls(std::env::args_os().skip(1)) {
        return report(&error);
    }
    let cli = Cli::parse();
    let result = match &cli.command {
        Command::Chart(args) => chart::command(args).map(|()| 0),
        Command::Run(args) => run::command(args),
        Command::Plan(args) => plan::command(args),
        Command::Status(args) => status::command(args),
        Command::Verify(args) => verify::command(args),
        Command::Lens(args) => lens::command(args).map(|()| 0),
        Command::Export(args) => export::command(args),
        Command::Demo(args) => demo::command(args),
        Command::Pyramid(args) => pyramid::command(args),
        Command::View(args) => view::command(args).map(|()| 0),
        Command::Validate(args) => validate::command(args),
        Command::Measure(args) => measure::command(args).map(|()| 0),
        Command::Bench(args) => bench::command(args).map(|()| 0),
        Command::Completions(args) => manual::completions(args).map(|()| 0),
        Command::Man(args) => manual::man(args).map(|()| 0),
    };
    match result {
        Ok(code) => ExitCode::from(code),
        Err(error) => report(&error),
    }
}

fn report(error: &anyhow::Error) -> ExitCode {
    say(format!("lenscube: {}", failure::line(error)));
    ExitCode::from(failure::exit_code(error))
}
