//! `lenscube lens convert`: writes a design in another format.

use crate::args::{CoatingsArg, ConvertArgs};
use crate::design;
use crate::failure::usage;
use crate::outputs::check_absent;
use crate::progress::{log_line, plural};
use anyhow::{Context, Result};
use formats::design::{endings_written, writer};
use formats::durable::{AtomicFile, finish_together};
use std::path::{Path, PathBuf};

/// Name of the catalogue of the design `out`: one word.
fn catalogue_name(out: &Path) -> String {
    let stem = out.file_stem().unwrap_or_default().to_string_lossy();
    stem.chars().map(|c| if c.is_alphanumeric() { c } else { '-' }).collect()
}

/// The file of glasses that are not built in, written beside the design `out` if it has any.
pub fn catalogue_path(out: &Path) -> PathBuf {
    out.with_file_name(format!("{}.agf", catalogue_name(out)))
}

/// Runs the command.
pub fn command(args: &ConvertArgs) -> Result<()> {
    let out = &args.out;
    let own = catalogue_name(out);
    let Some(write) = writer(out) else {
        let expected = endings_written();
        return Err(usage(format!("{}: expected a file ending with {expected}", out.display())));
    };
    if args.parameters.coatings != CoatingsArg::Ideal {
        return Err(usage(format!(
            "--coatings {}: a design file names coatings and holds none; give --coatings to the command that traces {}",
            args.parameters.coatings,
            out.display()
        )));
    }
    check_absent(out, args.overwrite)?;
    let system = design::open_unchecked(&args.design, &args.parameters)?;
    for note in &system.notes {
        log_line(format!("note: {note}"));
    }
    let written = write(&system, &own).with_context(|| format!("writing {}", out.display()))?;
    for note in &written.notes {
        log_line(format!("note: {}: {note}", out.display()));
    }
    let (mut files, mut lines) = (Vec::new(), Vec::new());
    if let Some(catalogue) = &written.catalogue {
        let path = catalogue_path(out);
        check_absent(&path, args.overwrite)?;
        files.push(AtomicFile::with_text(&path, catalogue)?);
        lines.push(format!("{}: glasses that are not built in, for {}", path.display(), out.display()));
    }
    // The design last: until it is there, its catalogue is of no use.
    files.push(AtomicFile::with_text(out, &written.text)?);
    finish_together(files)?;
    lines.push(format!("{}: {}", out.display(), plural(system.surfaces.len(), "surface")));
    lines.iter().for_each(log_line);
    Ok(())
}
