//! Flags of `lenscube run` for arrays in memory.

use crate::args::help;
use crate::args::{Cli, Command, Device, RunArgs};
use crate::failure::usage;
use anyhow::Result;
use clap::FromArgMatches;
use clap::error::ErrorKind;
use clap::parser::ValueSource;

/// Flags that apply to arrays: of the lens, the film's geometry and the computation, none of stores.
const OF_ARRAYS: [&str; 41] = [
    "lens",
    "image_plane",
    "aiming",
    "configuration",
    "glass_catalog",
    "coatings",
    "energy",
    "max_window_px",
    "reach_mm",
    "tails",
    "tolerances",
    "seed",
    "lens_sample",
    "focus_m",
    "gap",
    "stages",
    "roi",
    "azimuths",
    "psf_window",
    "interpolate_psf",
    "film_size",
    "film_pitch_um",
    "axis",
    "scale",
    "chart_pitch_mm",
    "fit",
    "center",
    "veiling_glare",
    "scatter",
    "veil_bin",
    "ghosts",
    "sensor_reflectance",
    "ghost_rings",
    "interp",
    "surround",
    "outside",
    "nan",
    "film_units",
    "engine",
    "threads",
    "memory",
];
/// Memory without `--memory`, bytes.
const MEMORY: u64 = 1 << 30;

/// A job of arrays as its flags describe it.
pub struct ArrayFlags {
    /// The job; chart and film have no name.
    pub job: RunArgs,
}

impl ArrayFlags {
    /// Parses `flags`.
    ///
    /// # Errors
    /// Usage: the parser's error; a flag of stores.
    pub fn parse(flags: &[String]) -> Result<Self> {
        let before = ["lenscube", "run", "array", "array"].map(str::to_owned);
        let words = before.iter().chain(flags);
        let matches = help::command().try_get_matches_from(words).map_err(|e| usage(message(&e)))?;
        let (_, given) = matches.subcommand().expect("the command is run");
        let is_given = |id: &str| given.value_source(id) == Some(ValueSource::CommandLine);
        let known = |id: &str| ["chart", "film"].contains(&id) || OF_ARRAYS.contains(&id);
        // Groups of arguments have ids as well, of types' names.
        let ids = given.ids().map(clap::Id::as_str).filter(|id| !id.starts_with(char::is_uppercase));
        if let Some(id) = ids.into_iter().find(|id| is_given(id) && !known(id)) {
            return Err(usage(format!("--{} does not apply to arrays in memory", id.replace('_', "-"))));
        }
        let cli = Cli::from_arg_matches(&matches).map_err(|e| usage(message(&e)))?;
        let Command::Run(run) = cli.command else { unreachable!("the command is run") };
        let mut job = run.job;
        // No name of a file, which would be opened or compared with others.
        job.chart = "array".into();
        job.film = "".into();
        job.device = Device::Cpu;
        job.memory = job.memory.or(Some(MEMORY));
        Ok(Self { job })
    }
}

/// The parser's message without its usage. Its tip on unknown flags, to pass them as values, does not apply.
fn message(error: &clap::Error) -> String {
    let text = error.to_string();
    let lines = text.lines().take_while(|line| !line.starts_with("Usage:") && !line.starts_with("For more"));
    let lines = lines.map(str::trim).filter(|line| !line.is_empty());
    let (mut tips, found): (Vec<&str>, Vec<&str>) = lines.partition(|line| line.starts_with("tip: "));
    tips.retain(|tip| !tip.starts_with("tip: to pass "));
    if error.kind() == ErrorKind::UnknownArgument && tips.is_empty() {
        tips.push("`lenscube run --help` lists the flags");
    }
    let all = [found.join(" ")].into_iter().chain(tips.iter().map(|tip| tip.replacen("tip: ", "", 1)));
    all.collect::<Vec<_>>().join("; ").trim_start_matches("error: ").to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unknown_flags_have_a_tip_that_applies() {
        for (flag, expected) in [
            ("--foo=1", "unexpected argument '--foo' found; `lenscube run --help` lists the flags"),
            (
                "--interpolate-pfs",
                "unexpected argument '--interpolate-pfs' found; a similar argument exists: '--interpolate-psf'",
            ),
        ] {
            let error = ArrayFlags::parse(&[flag.to_owned()]).err().unwrap();
            assert_eq!(error.to_string(), expected);
        }
    }
}
