//! Lens packs from exports of optical design programs.
//!
//! | source | content | module |
//! |---|---|---|
//! | `iset` | folder written by the ISET macros for Zemax or Code V: ISETPARMS.TXT, `_RI_`, `_DI_`, `_PSF_` files | [`mod@iset`] |
//! | `listings` | folder of OpticStudio text listings: distortion, relative illumination, PSFs | [`mod@listings`] |
//! | `tables` | folder of CSV tables and NPY windows, for any other program | [`mod@tables`] |
//! | `npz` | one NumPy archive of tables and windows | [`mod@npz`] |
//! | a description `.toml` | measured PSFs over the film, of lenses without symmetry: steps of its own | [`mod@field`] |
//!
//! Steps common to all sources:
//! 1. *Heights.* Ideal height = f·tan(field angle) in mm, f = the DISTORTION focal length; image height = that of the REAL chief
//!    ray. Tables with few field points are made dense by [`mod@dense`]; the points are kept in the pack's attribute `source`.
//! 2. *Windows.* Rotated so that the field point lies on +x, row down, chief ray at the centre of an odd window of sum 1
//!    ([`mod@window`]). Conventions that a file does not state (row order, side of the field point, position of the chief ray in an
//!    even window, point or integrated samples) are required as options, never guessed.
//! 3. *Numbers.* Units are part of names (mm, µm, nm); NaN, infinity, wrong counts and heights that do not ascend are errors
//!    that name file and line. Files are parsed, never evaluated.
//!
//! Not supported, but by descriptions: PSFs at field points on neither axis (they would have to be interpolated). Polychromatic PSFs.

mod csv;
pub mod dense;
pub mod distortion_listing;
mod error;
pub mod field;
mod field_table;
pub mod illumination_listing;
pub mod iset;
mod iset_tables;
pub mod isetparms;
pub mod listings;
mod matrix;
pub mod npy;
pub mod npz;
mod options;
pub mod psf_listing;
pub mod tables;
mod template;
mod text;
pub mod window;
mod write;

pub use error::ImportError;
use options::MAX_COUNT;
pub use options::{Format, ImportOptions};
pub use template::TEMPLATE;
pub use write::{Imported, write};

use std::path::Path;

/// Maximum bytes of an array file.
const MAX_ARRAY_BYTES: u64 = 1 << 30;
/// Maximum bytes of a text file: a listing of 4096 × 4096 samples has 200 MB.
const MAX_TEXT_BYTES: u64 = 1 << 28;
/// Maximum side of a window, samples.
const MAX_SIDE: usize = 4096;

/// Reads `path`, a folder or an .npz, in the format of `options`, else in the one recognised by file names.
///
/// # Errors
/// [`ImportError`]: the file, the line, the expected content, or the option that is required.
pub fn open(path: &Path, options: &ImportOptions) -> Result<Imported, ImportError> {
    let format = match options.format {
        Some(format) => format,
        None => detect_format(path)?,
    };
    if options.psf_heights.is_some() && format != Format::Iset {
        return Err(ImportError::Option {
            option: "--psf-heights",
            problem: format!(
                "{}: applies to exports of ISET alone, whose PSFs are files by number",
                path.display()
            ),
        });
    }
    match format {
        Format::Iset => iset::open(path, options),
        Format::Listings => listings::open(path, options),
        Format::Tables => tables::open(path, options),
        Format::Npz => npz::open(path, options),
    }
}

/// The format by the names of the files.
fn detect_format(path: &Path) -> Result<Format, ImportError> {
    if !path.is_dir() {
        let npz = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("npz"));
        return match path.metadata() {
            Err(source) => Err(ImportError::io(path, "open")(source)),
            Ok(_) if npz => Ok(Format::Npz),
            Ok(_) => Err(ImportError::file(
                path,
                "is neither a folder nor an .npz or .toml; give the format by `--from`",
            )),
        };
    }
    let names = text::file_names(path)?;
    if names.iter().any(|n| n.to_ascii_uppercase().ends_with("ISETPARMS.TXT")) {
        Ok(Format::Iset)
    } else if names.iter().any(|n| n == tables::LENS_FILE) {
        Ok(Format::Tables)
    } else {
        Ok(Format::Listings)
    }
}
