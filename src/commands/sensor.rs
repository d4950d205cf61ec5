//! `lenscube sensor`: film → signal → raw; the raw is created, resumed, or found complete.

mod attributes;
mod directions;
mod exposure;
mod exposure_times;
mod figures;
mod film;
mod geometry;
mod identity;
mod kept;
mod memory;
pub mod motion;
mod open;
mod picture;
mod raw;
mod record;
mod resolve;
mod show;
mod signal;
mod validate;
mod warnings;
mod warnings_after;
mod write;

use crate::args::{ExposeArgs, SensorArgs, SensorCommand};
use crate::failure::usage;
use anyhow::Result;
pub use directions::check_lens;
pub use exposure::{Times, time};
pub use geometry::Geometry;
pub use open::open_sensor;
pub use picture::temporary_raw;
pub use raw::remove;
use resolve::RawJob;
pub use resolve::check_before_film;
use std::path::Path;

/// Names of the files of `sensor show --plot`.
pub use show::FIGURES;
pub use warnings::of_spectrum;

/// Names of the files of `sensor validate --out`.
pub fn validation_files() -> impl Iterator<Item = &'static str> {
    validate::FILES.into_iter().chain(show::FIGURES)
}

/// Whether `out` is a file of one frame, as opposed to a raw.
///
/// # Errors
/// Usage: a file of another kind.
pub fn is_file(out: &Path) -> Result<bool> {
    Ok(picture::format_of(out)?.is_some())
}

/// Runs the command; the exit code.
pub fn command(args: &SensorArgs) -> Result<u8> {
    match &args.command {
        Some(SensorCommand::List) => show::list().map(|()| 0),
        Some(SensorCommand::Show(args)) => show::show(args).map(|()| 0),
        Some(SensorCommand::Validate(args)) => validate::command(args),
        None => expose(&args.expose),
    }
}

/// Exposes a sensor to a film; the exit code.
pub fn expose(args: &ExposeArgs) -> Result<u8> {
    let (Some(film), Some(out)) = (&args.film, &args.raw) else {
        return Err(usage("expected FILM and RAW; see `lenscube sensor --help`"));
    };
    let format = picture::format_of(out)?;
    if args.keep_dn && !matches!(format, Some(picture::FileFormat::Tiff | picture::FileFormat::Png)) {
        return Err(usage(format!(
            "--keep-dn is for .tif and .png; {} has digital numbers in any case",
            out.display()
        )));
    }
    if args.white.is_some() && format != Some(picture::FileFormat::Dng) {
        return Err(usage(format!(
            "--white is the neutral of a .dng; {} has none: give --white to `lenscube develop`",
            out.display()
        )));
    }
    match format {
        Some(format) => picture::command(args, film, (out, format)),
        None => raw::expose(args, &RawJob::new(args, film)?, out),
    }
}
