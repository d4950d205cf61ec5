//! `lenscube lens list`: the built-in lenses.

use super::cross_section::cross_section;
use super::plots::EXTENSIONS;
use crate::args::ListArgs;
use crate::outputs::check_absent_in;
use crate::progress::{log_line, print};
use anyhow::{Context, Result};
use formats::design::builtin::LENSES;
use formats::durable::{create_directories, finish_together};
use formats::lens::builtin_names;
use formats::picture::style::Style;
use pipeline::design::describe;
use serde_json::json;
use std::path::Path;

/// Runs the command.
pub fn command(args: &ListArgs) -> Result<()> {
    if let Some(dir) = &args.plot {
        let files = LENSES.iter().flat_map(|lens| EXTENSIONS.map(|e| format!("{}.{e}", lens.name)));
        check_absent_in(dir, files, args.overwrite)?;
        draw(dir)?;
    }
    let (mut rows, mut values) = (String::new(), Vec::new());
    for lens in LENSES {
        let system = lens.system();
        let d = describe(&system).with_context(|| format!("design {}", lens.name))?;
        let source = lens.source();
        let (f, number, field) = (d.effective_focal_length_mm, d.image_space_f_number, d.maximum_field_deg);
        let (name, kind) = (lens.name, lens.kind);
        rows += &format!("{name:<16} {kind:<20} {f:8.2}  {number:5.2}  {field:5.1}  {source}\n");
        values.push(json!({
            "name": name,
            "kind": kind,
            "effective_focal_length_mm": f,
            "image_space_f_number": number,
            "maximum_field_deg": field,
            "source": source,
        }));
    }
    if args.json {
        print(serde_json::to_string_pretty(&json!({ "designs": values }))?);
        return Ok(());
    }
    let packs: Vec<&str> = builtin_names().collect();
    let head = format!("{:<16} {:<20} {:>8}  {:>5}  {:>5}  source", "design", "kind", "f mm", "f/", "field");
    print(format!(
        "{head}\n{rows}Field: half of the field of view, degrees. Glasses known by n_d and V_d only are model glasses (`lens show NAME` lists them).\n\
         Lens packs: {}",
        packs.join(", ")
    ));
    Ok(())
}

/// Writes a cross-section of each lens into `dir`, as SVG and PNG.
fn draw(dir: &Path) -> Result<()> {
    create_directories(dir, true)?;
    let mut files = Vec::new();
    for lens in LENSES {
        let figure = cross_section(&lens.system())?.figure(Style::Light);
        for extension in EXTENSIONS {
            files.push(figure.file(&dir.join(format!("{}.{extension}", lens.name)))?);
        }
    }
    finish_together(files)?;
    log_line(format!("{}: SVG and PNG of {} lenses", dir.display(), LENSES.len()));
    Ok(())
}
