//! The help of the program: its commands in groups, and of `run -h` the flags of a first day (`--help` has all).

use super::Cli;
use clap::CommandFactory;

/// The commands, by what they are for. Each is in one group.
const GROUPS: [(&str, &[&str]); 5] = [
    ("Simulate", &["demo", "chart", "scene", "depth", "run", "shoot", "dataset"]),
    ("Lens", &["lens"]),
    ("Camera", &["sensor", "develop", "report", "compare", "restore"]),
    ("Inspect", &["status", "verify", "view", "export", "pyramid", "measure", "validate"]),
    ("Operate", &["plan", "bench", "device", "cache", "help", "completions", "man"]),
];

/// Flags of `run` that its short help shows.
const FIRST_DAY: [&str; 15] = [
    "chart",
    "film",
    "lens",
    "axes",
    "wavelengths",
    "bands",
    "film_size",
    "film_pitch_um",
    "focus_m",
    "depth",
    "stages",
    "roi",
    "memory",
    "overwrite",
    "dry_run",
];

/// The program's command, as the parser and the help have it.
pub fn command() -> clap::Command {
    let command = Cli::command().mut_subcommand("run", |run| {
        run.mut_args(|arg| match FIRST_DAY.contains(&arg.get_id().as_str()) || arg.is_positional() {
            true => arg,
            false => arg.hide_short_help(true),
        })
    });
    let list = groups(&command);
    command.help_template(format!(
        "{{about-with-newline}}\n{{usage-heading}} {{usage}}\n\n{list}Options:\n{{options}}{{after-help}}"
    ))
}

/// The list of commands.
fn groups(command: &clap::Command) -> String {
    let about = |name: &str| {
        let about = command.find_subcommand(name).and_then(clap::Command::get_about);
        about.map(ToString::to_string).unwrap_or_default()
    };
    let group = |(title, names): &(&str, &[&str])| {
        let lines: String = names.iter().map(|name| format!("  {name:<12}{}\n", about(name))).collect();
        format!("{title}:\n{lines}\n")
    };
    GROUPS.iter().map(group).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_command_is_in_one_group() {
        let cli = Cli::command();
        let mut names: Vec<&str> = cli.get_subcommands().map(clap::Command::get_name).collect();
        let mut grouped: Vec<&str> = GROUPS.iter().flat_map(|(_, names)| names.iter().copied()).collect();
        names.sort_unstable();
        grouped.sort_unstable();
        assert_eq!(names, grouped);
    }

    #[test]
    fn short_help_of_run_shows_the_flags_of_a_first_day() {
        let mut cli = command();
        cli.build();
        let run = cli.find_subcommand_mut("run").unwrap();
        let (short, long) = (run.render_help().to_string(), run.render_long_help().to_string());
        for flag in ["--lens", "--film-pitch-um", "--overwrite"] {
            assert!(short.contains(flag) && long.contains(flag), "{flag}");
        }
        assert!(long.contains("--azimuths") && !short.contains("--azimuths"));
        let known: Vec<&str> = run.get_arguments().map(|a| a.get_id().as_str()).collect();
        assert!(FIRST_DAY.iter().all(|id| known.contains(id)), "{known:?}");
    }
}
