//! Lens packs from what design programs export: one file a format, each ending in the same given tables and windows.
//!
//! | source | what it is | room |
//! |---|---|---|
//! | `iset` | folder written by the ISET macros for Zemax or Code V: ISETPARMS.TXT, `_RI_`, `_DI_`, `_PSF_` files | [`mod@iset`] |
//! | `listings` | folder of OpticStudio text listings: distortion, relative illumination, PSFs | [`mod@listings`] |
//! | `tables` | folder of CSV tables and NPY windows, for any other program | [`mod@tables`] |
//! | `npz` | one NumPy archive of tables and windows | [`mod@npz`] |
//!
//! What every source goes through:
//! 1. *Heights.* Ideal height = f·tan(field angle) in mm, f = the DISTORTION focal length; image height = the REAL chief ray's.
//!    Given at a few field points, they are made dense by [`mod@dense`]; the points stay in the pack's attribute `source`.
//! 2. *Windows.* Turned so that the field point lies on +x, row down, chief ray at the centre of an odd window of sum 1
//!    ([`mod@window`]). What a file does not tell (row order, side of the field point, where the chief ray is in an even window,
//!    point or integrated samples) is asked for by name: never guessed.
//! 3. *Numbers.* Units are named at the door (mm, µm, nm); NaN, infinity, wrong counts and heights that do not ascend are errors
//!    that name file and line. Files are parsed, never evaluated.
//!
//! Left out: a PSF at a field point on neither axis (it would have to be interpolated), polychromatic PSFs.

mod csv;
pub mod dense;
pub mod distortion_listing;
mod error;
pub mod illumination_listing;
pub mod iset;
pub mod isetparms;
pub mod listings;
mod matrix;
pub mod npy;
pub mod npz;
mod options;
pub mod psf_listing;
pub mod tables;
mod text;
pub mod window;
mod write;

pub use error::ImportError;
pub use options::{Format, ImportOptions};
pub use write::{Imported, write};

use std::path::Path;

/// Largest array that is read.
const MAX_FILE: u64 = 1 << 30;
/// Largest text: a listing of 4096 × 4096 samples takes 200 MB.
const MAX_TEXT: u64 = 1 << 28;
/// Most wavelengths or heights of a source.
const MOST: usize = 4096;
/// Widest window.
const WIDEST: usize = 4096;

/// Reads `path`, a folder or an .npz, in the format that `options` names or that its files tell.
///
/// # Errors
/// [`ImportError`]: which file, which line, what was expected, or which option has to be given.
pub fn open(path: &Path, options: &ImportOptions) -> Result<Imported, ImportError> {
    let format = match options.format {
        Some(format) => format,
        None => detect(path)?,
    };
    match format {
        Format::Iset => iset::open(path, options),
        Format::Listings => listings::open(path, options),
        Format::Tables => tables::open(path, options),
        Format::Npz => npz::open(path, options),
    }
}

/// The format by the names of the files.
fn detect(path: &Path) -> Result<Format, ImportError> {
    if !path.is_dir() {
        let npz = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("npz"));
        return match path.metadata() {
            Err(source) => Err(ImportError::Io { path: path.into(), action: "open", source }),
            Ok(_) if npz => Ok(Format::Npz),
            Ok(_) => {
                Err(ImportError::file(path, "is neither a folder nor an .npz; say the format by `--from`"))
            }
        };
    }
    let names = text::names(path)?;
    if names.iter().any(|n| n.to_ascii_uppercase().ends_with("ISETPARMS.TXT")) {
        Ok(Format::Iset)
    } else if names.iter().any(|n| n == tables::LENS_FILE) {
        Ok(Format::Tables)
    } else {
        Ok(Format::Listings)
    }
}
