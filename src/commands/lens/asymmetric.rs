//! `lens show` of a lens pack without rotational symmetry: a summary of its map, PSFs and manufacturing errors; figures.

use super::film_figures;
use super::film_lens::FilmLens;
use crate::args::ShowArgs;
use crate::failure::usage;
use crate::progress::print;
use anyhow::Result;
use formats::lens::{LensPack, summary};

/// Refuses flags of `args` that need image heights, and `others`; `way_out` ends the error.
///
/// # Errors
/// Usage: one of them is given.
pub fn refuse(args: &ShowArgs, others: &[(&str, bool)], way_out: &str) -> Result<()> {
    let refused = [
        ("--csv", args.csv.is_some()),
        ("--tables", args.tables.is_some()),
        ("--heights", args.heights.is_some()),
        ("--wavelengths", args.wavelengths.is_some()),
    ];
    match refused.iter().chain(others).find(|(_, is_given)| *is_given) {
        Some((flag, _)) => Err(usage(format!(
            "{flag}: expected a lens with rotational symmetry, `{}` has none{way_out}",
            args.lens
        ))),
        None => Ok(()),
    }
}

/// Prints the summary, and writes the figures of `--plot`.
///
/// # Errors
/// Flags that need image heights; a figure exists, or cannot be written; the output is closed.
pub fn show(args: &ShowArgs, pack: LensPack) -> Result<()> {
    refuse(args, &[], "")?;
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
