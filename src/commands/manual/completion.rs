//! Completions with the names that arguments accept: built-in lenses and sensors, kinds of charts, fields of `--set`. Files are completed as
//! well where a name may be one.

use crate::args::Cli;
use clap::builder::PossibleValuesParser;
use clap::{Command, CommandFactory};
use clap_complete::Shell;

/// The completion script of `shell`.
pub(super) fn script(shell: Shell) -> String {
    let names = Names {
        lenses: crate::design::builtin_names().chain(formats::lens::builtin_names()).collect(),
        sensors: formats::sensor::builtin_names(),
        kinds: pipeline::chart::KINDS.iter().map(|k| k.0).collect(),
        // Of the life of the process, as clap requires; made once.
        fields: formats::sensor::field_names().iter().map(|f| &*format!("{f}=").leak()).collect(),
    };
    let mut script = Vec::new();
    clap_complete::generate(shell, &mut names.add_to(Cli::command(), "lenscube"), "lenscube", &mut script);
    let script = String::from_utf8_lossy(&script).into_owned();
    match shell {
        Shell::Zsh => [&names.lenses, &names.sensors].iter().fold(script, |script, list| {
            let list = list.join(" ");
            script.replace(&format!(":({list})"), &format!(":{{compadd -- {list}; _files}}"))
        }),
        // `-f` excludes files.
        Shell::Fish => script.replace(" -r -f -a \"double-gauss-28", " -r -a \"double-gauss-28"),
        // Bash offers files where no name fits.
        _ => script,
    }
}

struct Names {
    lenses: Vec<&'static str>,
    sensors: Vec<&'static str>,
    kinds: Vec<&'static str>,
    fields: Vec<&'static str>,
}

impl Names {
    /// `command` and its subcommands with these names as values.
    fn add_to(&self, command: Command, name: &str) -> Command {
        let is_lens_command = ["show", "diff", "trace", "convert"].contains(&name);
        let command = command.mut_args(|argument| {
            let values = match (name, argument.get_id().as_str()) {
                (_, "lens" | "against") => &self.lenses,
                ("diff", "a" | "b") | ("trace" | "convert", "design") if is_lens_command => &self.lenses,
                (_, "sensor") => &self.sensors,
                ("chart", "kind") => &self.kinds,
                (_, "set") => &self.fields,
                _ => return argument,
            };
            argument.value_parser(PossibleValuesParser::new(values.clone())).hide_possible_values(false)
        });
        let subcommands: Vec<String> = command.get_subcommands().map(|c| c.get_name().to_owned()).collect();
        subcommands
            .iter()
            .fold(command, |command, name| command.mut_subcommand(name, |c| self.add_to(c, name)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_completed_in_every_shell() {
        for shell in [Shell::Bash, Shell::Zsh, Shell::Fish] {
            let script = script(shell);
            for name in ["double-gauss-28-npz", "cmv12000-rgb", "noise.prnu="] {
                assert!(script.contains(name), "{shell}: {name}");
            }
        }
        assert!(script(Shell::Zsh).contains("cooke-triplet") || script(Shell::Zsh).contains("triplet"));
        assert!(script(Shell::Zsh).contains("; _files}"));
        assert!(script(Shell::Bash).contains("slanted-edge"));
    }
}
