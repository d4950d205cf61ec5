//! `lens show` of a lens pack without rotational symmetry: a summary of its map, PSFs and manufacturing errors.

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
        ("--plot", args.plot.is_some()),
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

/// Prints the summary.
///
/// # Errors
/// The output is closed.
pub fn show(args: &ShowArgs, pack: &LensPack) -> Result<()> {
    let summary = summary(pack, args.all_bands, None);
    match args.json {
        true => print(serde_json::to_string_pretty(&summary)?),
        false => print(summary.to_string().trim_end()),
    }
    Ok(())
}
