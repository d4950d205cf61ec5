//! The one check of a command's paths: no output is an input or another output, lies in one, or contains one; none is a device, FIFO or socket, and no
//! input but a text, which is read from its beginning to its end. What does not exist yet can be created where it is to lie.

use super::place::{Place, Relation};
use crate::design::{files_beside, is_design};
use crate::failure::{other_job, usage};
use crate::open::is_builtin;
use anyhow::{Context, Result};
use formats::chart::files_of;
use formats::durable::{check_writable, is_url, link_target};
use std::os::unix::fs::FileTypeExt;
use std::path::{Path, PathBuf};

/// Inputs and outputs of a command.
#[derive(Debug, Default)]
pub struct Guard {
    inputs: Vec<Input>,
    outputs: Vec<Output>,
}

/// A file or directory that is read.
#[derive(Debug)]
struct Input {
    /// What it is, for messages.
    what: &'static str,
    /// As it was given.
    given: String,
    file: PathBuf,
    /// Whether it is read from its beginning to its end, as a FIFO can be.
    is_text: bool,
}

/// A file or directory that is written.
#[derive(Debug)]
struct Output {
    /// Flag or name of the position.
    argument: &'static str,
    path: PathBuf,
    /// Whether the command names it, in a directory that is given.
    is_named_by_command: bool,
}

impl Guard {
    /// Adds an input.
    pub fn reads(self, what: &'static str, path: &Path) -> Self {
        self.reads_as(what, &path.display().to_string(), [path.to_path_buf()])
    }

    /// Adds a text.
    pub fn reads_text(mut self, what: &'static str, path: &Path) -> Self {
        let (given, file) = (path.display().to_string(), path.to_path_buf());
        self.inputs.push(Input { what, given, file, is_text: true });
        self
    }

    /// Adds the files of an input that was given as `given`.
    pub fn reads_as(
        mut self,
        what: &'static str,
        given: &str,
        files: impl IntoIterator<Item = PathBuf>,
    ) -> Self {
        let input = |file| Input { what, given: given.to_owned(), file, is_text: false };
        self.inputs.extend(files.into_iter().map(input));
        self
    }

    /// Adds a chart or a film with all of its files; nothing of `gen:KIND?…`.
    pub fn reads_chart(self, what: &'static str, spec: &str) -> Self {
        self.reads_as(what, spec, files_of(spec))
    }

    /// Adds a lens pack, or a design with the catalogues and coatings beside it; nothing of a built-in lens.
    pub fn reads_lens(self, name: &str) -> Self {
        if is_builtin(name) {
            return self;
        }
        let guard = self.reads("lens", Path::new(name));
        let beside = if is_design(name) { files_beside(Path::new(name)) } else { Vec::new() };
        beside.iter().fold(guard, |guard, path| {
            let is_catalogue = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("agf"));
            guard.reads_text(if is_catalogue { "glass catalogue" } else { "coating file" }, path)
        })
    }

    /// Adds an output: `argument` is its flag or the name of its position.
    pub fn writes(mut self, argument: &'static str, path: impl Into<PathBuf>) -> Self {
        self.outputs.push(Output { argument, path: path.into(), is_named_by_command: false });
        self
    }

    /// Adds the files `names` in a directory; other files there may be inputs.
    pub fn writes_in(
        mut self,
        argument: &'static str,
        directory: &Path,
        names: impl IntoIterator<Item = impl AsRef<Path>>,
    ) -> Self {
        let named = |name| Output { argument, path: directory.join(name), is_named_by_command: true };
        self.outputs.extend(names.into_iter().map(named));
        self
    }

    /// Adds an output that is optional.
    pub fn may_write(self, argument: &'static str, path: Option<&PathBuf>) -> Self {
        path.into_iter().fold(self, |guard, path| guard.writes(argument, path))
    }

    /// Fails (exit code 2) if an output is, lies in or contains an input or another output, or is what a file would replace but not be: a device, a FIFO, a
    /// socket; or if an input is one of these or its name is empty. Fails if an output cannot be created: exit code 1 in a directory that cannot be written; under a file 2, or 3 if the
    /// command needs a directory where that file is.
    pub fn check(&self) -> Result<()> {
        self.outputs.iter().try_for_each(check_output)?;
        self.inputs.iter().filter(|input| !input.is_text).try_for_each(check_input)?;
        let inputs: Vec<Place> = self.inputs.iter().map(|input| Place::new(&input.file)).collect();
        let outputs: Vec<Place> = self.outputs.iter().map(|output| Place::new(&output.path)).collect();
        for (k, (output, place)) in self.outputs.iter().zip(&outputs).enumerate() {
            for (input, other) in self.inputs.iter().zip(&inputs) {
                if let Some(relation) = place.relation_to(other) {
                    let part = match input.given == input.file.to_string_lossy()
                        || input.given.split("//").next() == input.file.to_str()
                    {
                        true => String::new(),
                        false => format!("{}, of ", input.file.display()),
                    };
                    let other = format!("{part}the {} {}", input.what, input.given);
                    return Err(conflict(output, place, relation, &other, "which this command reads"));
                }
            }
            for (earlier, other) in self.outputs.iter().zip(&outputs).take(k) {
                if let Some(relation) = place.relation_to(other) {
                    let other = format!("{} {}", earlier.argument, earlier.path.display());
                    return Err(conflict(output, place, relation, &other, "which this command writes"));
                }
            }
        }
        self.outputs.iter().try_for_each(check_can_be_created)
    }

    /// Paths of the inputs.
    #[cfg(any(test, feature = "mesh"))]
    pub fn inputs(&self) -> impl Iterator<Item = &Path> {
        self.inputs.iter().map(|input| &*input.file)
    }

    /// Paths of the inputs and of the outputs.
    #[cfg(test)]
    pub fn paths(&self) -> [Vec<&Path>; 2] {
        [self.inputs().collect(), self.outputs.iter().map(|output| &*output.path).collect()]
    }
}

/// What exists at `path` if it is neither a file nor a directory.
fn special(path: &Path) -> Option<&'static str> {
    let kind = path.metadata().ok()?.file_type();
    match () {
        () if kind.is_char_device() || kind.is_block_device() => Some("a device"),
        () if kind.is_fifo() => Some("a FIFO or pipe"),
        () if kind.is_socket() => Some("a socket"),
        () => None,
    }
}

/// Fails for an existing device, FIFO or socket: a finished file is renamed to its path.
fn check_output(output: &Output) -> Result<()> {
    let Output { argument, path, .. } = output;
    let Some(kind) = special(path) else { return Ok(()) };
    let shown = path.display();
    Err(usage(format!(
        "{argument} {shown} is {kind}, which would be replaced by a file; choose another path for {argument}"
    )))
}

/// Fails if nothing exists at the output's path, and nothing can be created there: what exists above it is a file, or a directory that cannot be
/// written. A file that exists is replaced, or what it is part of is opened, later.
fn check_can_be_created(output: &Output) -> Result<()> {
    let Output { argument, path, is_named_by_command } = output;
    let target = link_target(path);
    if is_url(path) || target.symlink_metadata().is_ok() {
        return Ok(());
    }
    let above = target.ancestors().skip(1).find(|above| above.symlink_metadata().is_ok());
    let (above, shown) = (above.unwrap_or(Path::new(".")), path.display());
    if !above.is_dir() {
        let above = above.display();
        let message =
            format!("{argument} {shown}: {above} is not a directory; choose another path for {argument}");
        return Err(if *is_named_by_command { other_job(message) } else { usage(message) });
    }
    check_writable(above)
        .with_context(|| format!("{argument} {shown} cannot be created; choose another path for {argument}"))
}

/// Fails for an empty name, and for a device, FIFO or socket, whose parts cannot be read in any order, and which may block for ever.
fn check_input(input: &Input) -> Result<()> {
    let Input { what, given, file, .. } = input;
    if given.is_empty() {
        return Err(usage(format!("the name of the {what} is empty; give its path")));
    }
    let Some(kind) = special(file) else { return Ok(()) };
    let shown = file.display();
    Err(usage(format!(
        "the {what} {shown} is {kind}, not a regular file or a directory; store it in a file first"
    )))
}

fn conflict(output: &Output, place: &Place, relation: Relation, other: &str, role: &str) -> anyhow::Error {
    let relation = match relation {
        Relation::Same => "is",
        Relation::Inside => "lies in",
        Relation::Around => "contains",
        Relation::Linked => "is a hard link to a file of",
    };
    let Output { argument, path, .. } = output;
    let leads = match std::path::absolute(path) {
        Ok(absolute) if absolute != place.path && !is_url(path) => {
            format!(" (a link to {})", place.path.display())
        }
        _ => String::new(),
    };
    usage(format!(
        "{argument} {}{leads} {relation} {other}, {role}; choose another path for {argument}",
        path.display()
    ))
}
