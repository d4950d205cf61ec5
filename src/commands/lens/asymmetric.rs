//! `lens show` of a lens pack without rotational symmetry: a summary of its map, PSFs and manufacturing errors; figures.

use super::film_figures;
use super::film_lens::FilmLens;
use crate::args::ShowArgs;
use crate::design::is_design;
use crate::failure::usage;
use crate::open;
use crate::progress::print;
use anyhow::Result;
use formats::lens::{LensPack, summary};

/// The lens pack that `args` name, if it has no rotational symmetry.
///
/// # Errors
/// It cannot be opened; flags that need image heights.
pub fn pack(args: &ShowArgs) -> Result<Option<LensPack>> {
    if is_design(&args.lens) {
        return Ok(None);
    }
    let pack = open::lens(&args.lens)?;
    if pack.lens().is_symmetric() {
        return Ok(None);
    }
    let refused = [
        ("--csv", args.csv.is_some()),
        ("--tables", args.tables.is_some()),
        ("--heights", args.heights.is_some()),
        ("--wavelengths", args.wavelengths.is_some()),
    ];
    match refused.iter().find(|(_, is_given)| *is_given) {
        Some((flag, _)) => {
            Err(usage(format!("{flag}: expected a lens with rotational symmetry, `{}` has none", args.lens)))
        }
        None => Ok(Some(pack)),
    }
}

/// Prints the summary, and writes the figures of `--plot`.
///
/// # Errors
/// A figure exists, or cannot be written; the output is closed.
pub fn show(args: &ShowArgs, pack: LensPack) -> Result<()> {
    if args.overwrite && args.plot.is_none() {
        return Err(usage("--overwrite replaces figures: give --plot, too"));
    }
    if let Some(dir) = &args.plot {
        film_figures::check_absent(dir, args.overwrite)?;
    }
    let summary = summary(&pack, args.all_bands, None);
    match args.json {
        true => print(serde_json::to_string_pretty(&summary)?),
        false => print(summary.to_string().trim_end()),
    }
    let Some(dir) = &args.plot else { return Ok(()) };
    let attributes = pack.attributes().clone();
    film_figures::write(dir, &FilmLens::of_pack(&args.lens, pack)?, &attributes, args.style)
}
