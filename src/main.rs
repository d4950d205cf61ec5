//! The command `lenscube`: parses the arguments, runs a command, turns an error into one line and an exit code.

// Output goes through `terminal`.
#![cfg_attr(not(test), warn(clippy::disallowed_methods, clippy::print_stdout, clippy::print_stderr))]

mod args;
mod bench;
mod cache;
mod chart;
mod compare;
mod demo;
mod depth;
mod design;
mod develop;
mod device;
mod device_check;
mod engine;
mod export;
mod failure;
mod file_size;
mod film_engine;
mod import;
mod interrupt;
mod job;
mod lens;
mod light_units;
mod manual;
mod measure;
mod memory;
mod open;
mod outputs;
mod paths;
mod plan;
mod progress;
mod pyramid;
mod run;
mod sensor;
mod shoot;
mod status;
mod terminal;
mod trace;
mod validate;
mod verify;
mod version;
mod view;

use args::{Cli, Command};
use clap::{ArgMatches, CommandFactory, FromArgMatches};
use formats::escape;
use progress::{Verbosity, error_line, set_verbosity};
use std::ffi::OsString;
use std::process::ExitCode;

fn main() -> ExitCode {
    file_size::catch_signal();
    // First of all, so that no message or file repeats a URL with credentials.
    if let Err(error) = args::check_urls(std::env::args_os().skip(1)) {
        return report(&error);
    }
    let (cli, matches) = parsed(std::env::args_os()).unwrap_or_else(|answer| exit_with_answer(answer));
    set_verbosity(match (cli.quiet, cli.verbose) {
        (true, _) => Verbosity::Quiet,
        (_, true) => Verbosity::Verbose,
        _ => Verbosity::Normal,
    });
    let (_, matches) = matches.subcommand().expect("a subcommand is required");
    match run(&cli.command, matches) {
        Ok(code) => ExitCode::from(code),
        Err(error) => report(&error),
    }
}

/// The arguments `words`, of which the first is the program.
fn parsed(words: impl IntoIterator<Item = OsString>) -> Result<(Cli, ArgMatches), clap::Error> {
    let matches = Cli::command().try_get_matches_from(words)?;
    Ok((Cli::from_arg_matches(&matches)?, matches))
}

/// Prints the parser's answer, help or an error, and ends the process. An error quotes the arguments: they are parsed again, escaped.
fn exit_with_answer(answer: clap::Error) -> ! {
    let words = std::env::args_os().map(|word| escape::one_line(&word.to_string_lossy()).into_owned().into());
    if let Err(again) = parsed(words) {
        again.exit();
    }
    // Arguments that are not UTF-8.
    error_line(answer.to_string().trim_end());
    std::process::exit(answer.exit_code())
}

/// Runs `command`, parsed from `matches`; the exit code.
fn run(command: &Command, matches: &ArgMatches) -> anyhow::Result<u8> {
    paths::check(command)?;
    match command {
        Command::Chart(args) => chart::command(args).map(|()| 0),
        Command::Depth(args) => depth::command(args),
        Command::Run(args) => run::command(args, matches),
        Command::Sensor(args) => sensor::command(args),
        Command::Develop(args) => develop::command(args),
        Command::Shoot(args) => shoot::command(args),
        Command::Compare(args) => compare::command(args),
        Command::Plan(args) => plan::command(args, matches),
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
        Command::Device(args) => device_check::command(args),
        Command::Cache(args) => cache::command(args).map(|()| 0),
        Command::Completions(args) => manual::completions(args).map(|()| 0),
        Command::Man(args) => manual::man(args).map(|()| 0),
    }
}

fn report(error: &anyhow::Error) -> ExitCode {
    error_line(format!("lenscube: {}", failure::line(error)));
    ExitCode::from(failure::exit_code(error))
}
