//! The command line of a job in a form that another process can repeat: chart, film, and one string per flag.
//!
//! A plan file holds it as text, so that plans of other versions of the program remain readable: a process that starts from a plan parses it,
//! together with the flags that it was given itself.

use crate::args::{ProcessArgs, RunArgs};
use crate::failure::usage;
use anyhow::{Context, Result};
use clap::parser::ValueSource;
use clap::{ArgAction, ArgMatches, Args, Command, FromArgMatches};
use formats::durable::is_url;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// A job as arguments of `lenscube run`.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct CommandLine {
    /// The chart, if given.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub chart: Option<String>,
    /// The film, if given.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub film: Option<String>,
    /// `--name` or `--name=value`, in the order of `--help`.
    pub flags: Vec<String>,
}

impl CommandLine {
    /// The job's arguments among `matches`, those of `lenscube run` or `lenscube plan`. Excluded: defaults, and flags of the process
    /// ([`ProcessArgs`] and those outside [`RunArgs`]).
    ///
    /// # Errors
    /// A value that is not UTF-8 and therefore cannot be stored in JSON.
    pub fn given(matches: &ArgMatches) -> Result<Self> {
        let job = RunArgs::augment_args(Command::new("job"));
        let process = ProcessArgs::augment_args(Command::new("process"));
        let mut line = Self::default();
        for arg in job.get_arguments() {
            let id = arg.get_id().as_str();
            let of_process = process.get_arguments().any(|a| a.get_id() == arg.get_id());
            if of_process || matches.value_source(id) != Some(ValueSource::CommandLine) {
                continue;
            }
            match id {
                "chart" => line.chart = values(matches, id)?.pop(),
                "film" => line.film = values(matches, id)?.pop(),
                _ => {
                    let flag = format!("--{}", arg.get_long().unwrap_or(id));
                    match arg.get_action() {
                        ArgAction::SetTrue => line.flags.push(flag),
                        _ => line.flags.extend(values(matches, id)?.iter().map(|v| format!("{flag}={v}"))),
                    }
                }
            }
        }
        Ok(line)
    }

    /// The arguments of this command line, those of `overrides` taking precedence.
    ///
    /// # Errors
    /// Usage, as the parser reports it.
    pub fn parse(&self, overrides: &Self) -> Result<RunArgs> {
        let paths = [
            overrides.chart.as_ref().or(self.chart.as_ref()),
            overrides.film.as_ref().or(self.film.as_ref()),
        ];
        let paths = paths.into_iter().flatten().cloned();
        let all = self.flags.iter().chain(&overrides.flags).cloned();
        let all = all.chain(["--".to_owned()]).chain(paths);
        // A later flag replaces an earlier one.
        let command =
            RunArgs::augment_args(Command::new("run")).no_binary_name(true).args_override_self(true);
        let matches = command.try_get_matches_from(all);
        matches.and_then(|matches| RunArgs::from_arg_matches(&matches)).map_err(|e| usage(first_line(&e)))
    }
}

/// The parser's message without its usage lines.
fn first_line(error: &clap::Error) -> String {
    let text = error.to_string();
    text.lines().next().unwrap_or_default().trim_start_matches("error: ").to_owned()
}

fn values(matches: &ArgMatches, id: &str) -> Result<Vec<String>> {
    let text = |raw: &std::ffi::OsStr| {
        raw.to_str().map(str::to_owned).ok_or_else(|| {
            usage(format!("{} is not UTF-8, so it cannot be stored in a plan", raw.to_string_lossy()))
        })
    };
    matches.get_raw(id).into_iter().flatten().map(text).collect()
}

/// A chart for processes with another current directory: `gen:…`, a URL, or an absolute path.
///
/// # Errors
/// The current directory does not exist or is not UTF-8.
pub fn absolute_chart(chart: &str) -> Result<String> {
    if chart.starts_with("gen:") { Ok(chart.to_owned()) } else { absolute_path(chart) }
}

/// A path for processes with another current directory: a URL, or an absolute path.
///
/// # Errors
/// As [`absolute_chart`].
pub fn absolute_path(path: &str) -> Result<String> {
    if is_url(Path::new(path)) || Path::new(path).is_absolute() {
        return Ok(path.to_owned());
    }
    let directory = std::env::current_dir().context("reading the current directory")?;
    let directory = directory
        .to_str()
        .ok_or_else(|| usage("the current directory is not UTF-8, so it cannot be stored in a plan"))?;
    // Not `Path::join`, which would reduce the slashes of `PATH//array`.
    Ok(format!("{}/{path}", directory.trim_end_matches('/')))
}
