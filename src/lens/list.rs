//! `lenscube lens list`: the built-in lenses.

use crate::args::ListArgs;
use crate::progress::print;
use anyhow::{Context, Result};
use formats::lens::builtin_names;
use pipeline::design::describe;
use pipeline::design::shelf::LENSES;
use serde_json::json;

/// Runs the command.
pub fn command(args: &ListArgs) -> Result<()> {
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
