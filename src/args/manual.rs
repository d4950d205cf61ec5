//! `lenscube completions` and `lenscube man`.

use clap::Args;
use clap_complete::Shell;
use std::path::PathBuf;

/// `lenscube completions`
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  lenscube completions bash > ~/.local/share/bash-completion/completions/lenscube\n  \
lenscube completions zsh > ~/.zfunc/_lenscube\n  lenscube completions fish > ~/.config/fish/completions/lenscube.fish"
)]
pub struct CompletionsArgs {
    /// The shell
    #[arg(value_name = "SHELL")]
    pub shell: Shell,
}

/// `lenscube man`
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  lenscube man ~/.local/share/man/man1     # a page for every command\n  \
lenscube man | man -l -                  # the first page\n  \
lenscube man --json | jq '.commands[].name'"
)]
pub struct ManArgs {
    /// Directory for the pages of all commands [default: the program's own page to stdout]
    #[arg(value_name = "DIR")]
    pub dir: Option<PathBuf>,
    /// Print commands, arguments and exit codes as JSON, for programs that call this one
    #[arg(long, conflicts_with = "dir")]
    pub json: bool,
}

/// `lenscube help`
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  lenscube help charts     # a page of the guide\n  lenscube help lens trace"
)]
pub struct HelpArgs {
    /// A page of the guide, or a command [default: the commands and the pages]
    #[arg(value_name = "TOPIC")]
    pub topic: Vec<String>,
}
