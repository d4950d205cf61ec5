//! `lenscube lens tolerance DESIGN.zmx --import-tol`: the description of the TOL lines of a design file.

use crate::args::ToleranceArgs;
use crate::design;
use crate::failure::usage;
use crate::outputs::check_absent;
use crate::progress::{log_line, print};
use anyhow::{Context, Result};
use formats::design::tolerance::import;
use formats::durable::AtomicFile;
use std::path::Path;

/// Runs the command.
pub fn command(args: &ToleranceArgs) -> Result<()> {
    let path = Path::new(&args.design);
    let is_zmx = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("zmx"));
    if design::is_builtin(&args.design) || !is_zmx {
        return Err(usage(format!(
            "--import-tol {}: expected a .zmx file, whose TOL lines are read",
            args.design
        )));
    }
    if let Some(out) = &args.output {
        check_absent(out, args.overwrite)?;
    }
    let system = design::open(&args.design, &args.parameters)?;
    let bytes = std::fs::read(path).with_context(|| format!("reading {}", path.display()))?;
    let imported = import(&bytes, &system);
    imported.notes.iter().for_each(|note| log_line(format!("note: {note}")));
    if imported.list.is_empty() {
        return Err(usage(format!("{}: no tolerance of its TOL lines can be imported", path.display())));
    }
    match &args.output {
        Some(out) => {
            AtomicFile::with_text(out, &imported.text)?.finish()?;
            log_line(format!("{}: {} errors", out.display(), imported.list.len()));
        }
        None => print(imported.text.trim_end()),
    }
    Ok(())
}
