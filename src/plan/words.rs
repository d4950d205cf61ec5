//! A command line as it was typed, so that another process can say the same: chart, film, and each flag as one word.

use crate::args::{Cli, Command, RunArgs};
use crate::failure::usage;
use anyhow::{Context, Result};
use clap::parser::ValueSource;
use clap::{ArgAction, ArgMatches, CommandFactory, FromArgMatches};
use formats::durable::is_url;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// A job in the words of `lenscube run`.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Words {
    /// The chart; absent if it was not typed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub chart: Option<String>,
    /// The film.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub film: Option<String>,
    /// `--name` or `--name=value`, in the order of `--help`.
    pub flags: Vec<String>,
}

/// What belongs to one process rather than to the job.
const OWN: [&str; 9] = [
    "output",
    "unit_rows",
    "lens_pack",
    "overwrite",
    "take_over",
    "plan",
    "unit",
    "progress",
    "die_with_parent",
];

impl Words {
    /// What this process's user typed after `lenscube run` or `lenscube plan`, flags of its own left out.
    ///
    /// # Errors
    /// A word that is no UTF-8: it cannot be told in JSON.
    pub fn typed() -> Result<Self> {
        let matches = Cli::command().get_matches();
        let (name, matches) = matches.subcommand().expect("the command line was parsed before");
        let all = Cli::command();
        let command = all.find_subcommand(name).expect("one of the commands");
        let mut words = Self::default();
        for arg in command.get_arguments() {
            let id = arg.get_id().as_str();
            if matches.value_source(id) != Some(ValueSource::CommandLine) {
                continue;
            }
            match id {
                "chart" => words.chart = values(matches, id)?.pop(),
                "film" => words.film = values(matches, id)?.pop(),
                id if OWN.contains(&id) => (),
                _ => {
                    let flag = format!("--{}", arg.get_long().unwrap_or(id));
                    match arg.get_action() {
                        ArgAction::SetTrue => words.flags.push(flag),
                        _ => words.flags.extend(values(matches, id)?.iter().map(|v| format!("{flag}={v}"))),
                    }
                }
            }
        }
        Ok(words)
    }

    /// These words, and `more` on top of them, as `lenscube run` understands them.
    ///
    /// # Errors
    /// What the parser says.
    pub fn parse(&self, more: &Self) -> Result<RunArgs> {
        let program = ["lenscube", "run"].map(String::from);
        let places = [more.chart.as_ref().or(self.chart.as_ref()), more.film.as_ref().or(self.film.as_ref())];
        let places = places.into_iter().flatten().cloned();
        let all = program.into_iter().chain(self.flags.iter().chain(&more.flags).cloned());
        let all = all.chain(["--".to_owned()]).chain(places);
        // What is typed last counts.
        let command = Cli::command().mut_subcommand("run", |run| run.args_override_self(true));
        let matches = command.try_get_matches_from(all).map_err(|e| usage(clap_line(&e)))?;
        let cli = Cli::from_arg_matches(&matches)?;
        match cli.command {
            Command::Run(run) => Ok(run.job),
            _ => unreachable!("`run` is typed above"),
        }
    }
}

/// The parser's words without its usage lines.
fn clap_line(error: &clap::Error) -> String {
    let text = error.to_string();
    text.lines().next().unwrap_or_default().trim_start_matches("error: ").to_owned()
}

fn values(matches: &ArgMatches, id: &str) -> Result<Vec<String>> {
    let text = |raw: &std::ffi::OsStr| {
        raw.to_str()
            .map(str::to_owned)
            .ok_or_else(|| usage(format!("{} is no UTF-8, which a plan cannot hold", raw.to_string_lossy())))
    };
    matches.get_raw(id).into_iter().flatten().map(text).collect()
}

/// A chart as processes that start elsewhere must name it: drawn (`gen:…`), a URL, or an absolute path.
///
/// # Errors
/// The current directory is gone, or is no UTF-8.
pub fn absolute(word: &str) -> Result<String> {
    if word.starts_with("gen:") { Ok(word.to_owned()) } else { absolute_path(word) }
}

/// A path as processes that start elsewhere must name it; a URL stays as it is.
///
/// # Errors
/// As [`absolute`].
pub fn absolute_path(word: &str) -> Result<String> {
    if is_url(Path::new(word)) || Path::new(word).is_absolute() {
        return Ok(word.to_owned());
    }
    let here = std::env::current_dir().context("asking for the current directory")?;
    let here =
        here.to_str().ok_or_else(|| usage("the current directory is no UTF-8, which a plan cannot hold"))?;
    // Not joined as paths: `PATH//array` has to keep its slashes.
    Ok(format!("{}/{word}", here.trim_end_matches('/')))
}
