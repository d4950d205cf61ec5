//! Charts in HDF5 files: HDF5 itself, NetCDF-4, MATLAB 7.3.
//!
//! | | supported |
//! |---|---|
//! | arrays | two or three axes of u8, u16, i16, f16, f32 or f64, little- or big-endian |
//! | storage | contiguous: mapped into memory as flat files are; chunked: decoded once to a temporary file |
//! | filters | deflate, shuffle, fletcher32, LZF, zstd |
//! | attributes | those of the CF conventions, see `super::conventions` |
//!
//! The array is the one that is named (`FILE//group/array`), else the only one of three axes, else the only one of two.
//!
//! Order of the axes, the first that exists: declared by the caller; MATLAB's (y, x, wavelength), which its files store reversed; labels
//! or names of dimensions (`dimensions`); (wavelength, y, x). Wavelengths: the coordinate of the spectral dimension, else an array of a
//! spectral name and one number a band in the same group.
//!
//! The file's structure is read by the crate `hdf5-pure` through a source that bounds the bytes read (`source`); sizes are compared with
//! the file's length and with a limit per chunk before memory is allocated; an error or panic of the crate is an error of the file.
//! Not supported: version 2 B-trees as chunk indexes (several unlimited axes of `libver="latest"`), virtual and external storage.

#[cfg(feature = "hdf5")]
mod attributes;
#[cfg(feature = "hdf5")]
mod chunks;
#[cfg(feature = "hdf5")]
mod dimensions;
#[cfg(feature = "hdf5")]
mod filters;
#[cfg(feature = "hdf5")]
mod guard;
#[cfg(feature = "hdf5")]
mod read;
#[cfg(feature = "hdf5")]
mod sample_type;
#[cfg(feature = "hdf5")]
mod source;
#[cfg(feature = "hdf5")]
mod variables;

use std::fs::File;
use std::os::unix::fs::FileExt;
use std::path::Path;

use super::decoded_chart::DecodedChart;
use super::raster::RasterChart;
#[cfg(feature = "hdf5")]
pub use read::open;

const SIGNATURE: &[u8; 8] = b"\x89HDF\r\n\x1a\n";
/// Positions of the signature: after a user block of so many bytes; MATLAB's has 512.
const SIGNATURE_OFFSETS: [u64; 4] = [0, 512, 1024, 2048];

/// A chart in an HDF5 file, by the storage of its array.
#[derive(Debug)]
pub enum Hdf5Chart {
    /// Contiguous.
    Raster(Box<RasterChart>),
    /// Chunked.
    Decoded(Box<DecodedChart>),
}

/// Whether `path` is an HDF5 file, by its signature.
pub fn is_hdf5(path: &Path) -> bool {
    // Before it is opened: opening a pipe would wait for its writer.
    if !path.is_file() {
        return false;
    }
    let Ok(file) = File::open(path) else { return false };
    let mut found = [0; 8];
    SIGNATURE_OFFSETS.iter().any(|&at| file.read_exact_at(&mut found, at).is_ok() && found == *SIGNATURE)
}

/// An error: this build reads none of them.
///
/// # Errors
/// Always.
#[cfg(not(feature = "hdf5"))]
pub fn open(
    path: &Path,
    _requested: &str,
    _axes: Option<&super::axes::AxisOrder>,
    _nan: super::options::NanPolicy,
    _given_wavelengths: Option<usize>,
) -> Result<Hdf5Chart, super::error::ChartError> {
    let expected = "a file of another format (HDF5, NetCDF-4 and MATLAB 7.3 are not read)";
    Err(super::header::header_error(
        path,
        "format",
        expected,
        format!("HDF5: {}", crate::features::missing("hdf5")),
    ))
}

#[cfg(all(test, feature = "hdf5"))]
mod tests;
