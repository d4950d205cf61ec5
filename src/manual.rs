//! `lenscube completions` and `lenscube man`: what shells and `man` are told, from the flags themselves.

use crate::args::{Cli, CompletionsArgs, ManArgs};
use crate::progress::say;
use anyhow::{Context, Result};
use clap::CommandFactory;
use formats::durable::create_directories;
use std::io::{ErrorKind, Write};
use std::path::Path;

/// Writes the completions of a shell to stdout.
pub fn completions(args: &CompletionsArgs) -> Result<()> {
    let mut script = Vec::new();
    clap_complete::generate(args.shell, &mut Cli::command(), "lenscube", &mut script);
    to_stdout(&script)
}

/// Writes the pages of all commands into a directory, or the program's own to stdout.
pub fn man(args: &ManArgs) -> Result<()> {
    let mut cli = Cli::command();
    // Names the subcommands in full, as `lenscube-lens-trace`.
    cli.build();
    let Some(dir) = &args.dir else { return to_stdout(&page(cli)?) };
    create_directories(dir, true)?;
    let pages = write(&cli, "", dir)?;
    say(format!("{pages} pages in {}; try `man {}/lenscube.1`", dir.display(), dir.display()));
    Ok(())
}

/// Writes the page of `command`, whose name follows `before`, and of all below it; how many.
fn write(command: &clap::Command, before: &str, dir: &Path) -> Result<usize> {
    let name = format!("{before}{}", command.get_name());
    let path = dir.join(format!("{name}.1"));
    let bytes = page(command.clone())?;
    std::fs::write(&path, bytes).with_context(|| format!("writing {}", path.display()))?;
    let below = command.get_subcommands().filter(|c| c.get_name() != "help");
    below.map(|c| write(c, &format!("{name}-"), dir)).try_fold(1, |sum, pages| Ok(sum + pages?))
}

fn page(command: clap::Command) -> Result<Vec<u8>> {
    let mut bytes = Vec::new();
    clap_mangen::Man::new(command).render(&mut bytes).context("writing a manual page")?;
    Ok(bytes)
}

/// A reader that has gone, as `head` goes, is no fault.
fn to_stdout(bytes: &[u8]) -> Result<()> {
    match std::io::stdout().write_all(bytes) {
        Err(e) if e.kind() != ErrorKind::BrokenPipe => Err(e).context("writing the result"),
        _ => Ok(()),
    }
}
