//! `lenscube completions` and `lenscube man`: shell completions and manual pages, generated from the argument definitions and the guide.

mod completion;
mod listing;
mod page;

use crate::args::{Cli, CompletionsArgs, ManArgs};
use crate::manual::PAGES;
use crate::manual::roff::manual_page;
use crate::progress::terminal;
use crate::progress::{log_line, print};
use anyhow::{Context, Result};
use clap::CommandFactory;
use formats::durable::create_directories;
use page::page;
use std::io::ErrorKind;
use std::path::Path;

/// Writes the completions of a shell to stdout.
pub fn completions(args: &CompletionsArgs) -> Result<()> {
    to_stdout(completion::script(args.shell).as_bytes())
}

/// Writes the pages of all commands into a directory, or the page of the program to stdout.
pub fn man(args: &ManArgs) -> Result<()> {
    let mut cli = Cli::command();
    // Names the subcommands in full, as `lenscube-lens-trace`.
    cli.build();
    if args.json {
        print(serde_json::to_string_pretty(&listing::listing(&cli))?);
        return Ok(());
    }
    let Some(dir) = &args.dir else { return to_stdout(&page(cli)?) };
    create_directories(dir, true)?;
    let pages = write(&cli, "", dir)? + write_guide(dir)?;
    log_line(format!("{pages} pages in {}; try `man {}/lenscube.1`", dir.display(), dir.display()));
    Ok(())
}

/// Writes the page of `command`, named `prefix` and its name, and those of its subcommands; the number of pages.
fn write(command: &clap::Command, prefix: &str, dir: &Path) -> Result<usize> {
    let name = format!("{prefix}{}", command.get_name());
    let path = dir.join(format!("{name}.1"));
    let bytes = page(command.clone())?;
    std::fs::write(&path, bytes).with_context(|| format!("writing {}", path.display()))?;
    let subcommands = command.get_subcommands().filter(|c| c.get_name() != "help");
    subcommands.map(|c| write(c, &format!("{name}-"), dir)).try_fold(1, |sum, pages| Ok(sum + pages?))
}

/// Writes the pages of the guide, section 7 of the manual; their number.
fn write_guide(dir: &Path) -> Result<usize> {
    for page in PAGES {
        let path = dir.join(format!("lenscube-{}.7", page.name));
        std::fs::write(&path, manual_page(page)).with_context(|| format!("writing {}", path.display()))?;
    }
    Ok(PAGES.len())
}

/// A closed pipe (`| head`) is not an error.
fn to_stdout(bytes: &[u8]) -> Result<()> {
    match terminal::copy(&mut &bytes[..]) {
        Err(e) if e.kind() != ErrorKind::BrokenPipe => Err(e).context("writing the result"),
        _ => Ok(()),
    }
}
