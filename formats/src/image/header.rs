//! What decoders of all formats share: header, errors, limits.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};

use pipeline::geometry::Size;

use crate::durable::DurableError;

/// Maximum memory of a decoder.
pub(crate) const MAX_DECODED_BYTES: usize = 256 << 20;

/// Header of an image file.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct ImageHeader {
    pub(crate) size: Size,
    /// 1 (grey) or 3 (RGB).
    pub(crate) channels: usize,
    /// Maximum sample: 255 or 65535.
    pub(crate) white: u16,
    /// Remarks for the user.
    pub(crate) notes: Vec<String>,
}

/// An image file that cannot be decoded.
#[derive(Debug)]
pub(crate) enum ImageError {
    /// Property of the header that is not supported.
    Header { path: PathBuf, what: &'static str, expected: String, found: String },
    /// Size of the file in bytes.
    Short { path: PathBuf, expected: u64, found: u64 },
    /// Data that do not decode.
    Damaged { path: PathBuf, reason: String },
    /// Error of the file system.
    Io(DurableError),
}

impl From<DurableError> for ImageError {
    fn from(e: DurableError) -> Self {
        Self::Io(e)
    }
}

/// Receives row after row (number, samples with interleaved channels).
pub(crate) type RowSink<'a, E> = &'a mut dyn FnMut(usize, &[u16]) -> Result<(), E>;

/// An error of the header.
pub(crate) fn header_error(
    path: &Path,
    what: &'static str,
    expected: impl Into<String>,
    found: impl Into<String>,
) -> ImageError {
    ImageError::Header { path: path.into(), what, expected: expected.into(), found: found.into() }
}

/// The error for a file with an alpha channel.
pub(crate) fn alpha_error(path: &Path) -> ImageError {
    let expected = "no transparency; flatten the image onto its background";
    header_error(path, "channels", expected, "an alpha channel")
}

/// Runs a decoder; an error or a panic of it means a damaged file.
pub(super) fn guarded<T, E: std::fmt::Display>(
    path: &Path,
    decode: impl FnOnce() -> Result<T, E>,
) -> Result<T, ImageError> {
    let damaged = |reason: String| ImageError::Damaged { path: path.into(), reason };
    match catch_unwind(AssertUnwindSafe(decode)) {
        Ok(done) => done.map_err(|e| damaged(e.to_string())),
        Err(_) => Err(damaged("the decoder failed on it".into())),
    }
}
