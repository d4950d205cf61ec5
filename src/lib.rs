//! The command `lenscube`, [`main`]: parses the arguments, runs a command, turns an error into one line and an exit code. And, for Python, lenses for arrays in memory
//! ([`ArrayLens`]).

// Output goes through `progress::terminal`.
#![cfg_attr(not(test), warn(clippy::disallowed_methods, clippy::print_stdout, clippy::print_stderr))]

mod args;
mod camera;
mod commands;
mod design;
mod failure;
mod film;
mod job;
mod machine;
mod manual;
mod open;
mod outputs;
mod progress;

pub use job::arrays::{ArrayFilm, ArrayLens};
pub use pipeline::geometry::Size;
pub use progress::log_to;

use args::Cli;
use clap::{ArgMatches, FromArgMatches};
use formats::escape;
use progress::{Verbosity, error_line, set_verbosity};
use std::ffi::OsString;
use std::process::ExitCode;

/// Runs the command that the arguments of this process name; its exit code.
pub fn main() -> ExitCode {
    failure::file_size::catch_signal();
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
    match commands::run(&cli.command, matches) {
        Ok(code) => ExitCode::from(code),
        Err(error) => report(&error),
    }
}

/// The arguments `words`, of which the first is the program.
fn parsed(words: impl IntoIterator<Item = OsString>) -> Result<(Cli, ArgMatches), clap::Error> {
    let matches = args::help::command().try_get_matches_from(words)?;
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

/// The exit code of an error and its message.
pub fn code_and_message(error: &anyhow::Error) -> (u8, String) {
    (failure::exit_code(error), failure::line(error))
}

fn report(error: &anyhow::Error) -> ExitCode {
    error_line(format!("lenscube: {}", failure::line(error)));
    ExitCode::from(failure::exit_code(error))
}
