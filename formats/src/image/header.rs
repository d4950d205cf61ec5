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

/// Note on an alpha channel that must be opaque.
pub(crate) const ALPHA_NOTE: &str = "its alpha channel is dropped, and must be opaque everywhere";
/// Note on a colour profile.
pub(super) const PROFILE_NOTE: &str =
    "it has a colour profile, which is not applied: its samples are interpreted as sRGB";

/// Chromaticities of red, green, blue and white of sRGB (IEC 61966-2-1).
const SRGB_PRIMARIES: [(f32, f32); 4] = [(0.64, 0.33), (0.30, 0.60), (0.15, 0.06), (0.3127, 0.3290)];

/// A note if the chromaticities of red, green, blue and white that a file declares are not those of sRGB.
pub(crate) fn primaries_note(found: [(f32, f32); 4]) -> Option<String> {
    let is_same = |a: f32, b: f32| (a - b).abs() < 2e-3;
    let same = std::iter::zip(found, SRGB_PRIMARIES).all(|(a, b)| is_same(a.0, b.0) && is_same(a.1, b.1));
    let [red, green, blue, white] = found.map(|(x, y)| format!("({x:.4}, {y:.4})"));
    (!same).then(|| {
        format!(
            "its primaries (red {red}, green {green}, blue {blue}, white {white}) are not converted: its colours are interpreted as sRGB"
        )
    })
}

/// A note on an orientation (Exif, TIFF) other than 1.
pub(super) fn orientation_note(source: &str, orientation: u32) -> Option<String> {
    (orientation != 1).then(|| {
        format!(
            "its {source} orientation ({orientation}) is not applied: rows and columns are as stored, not as a viewer shows them"
        )
    })
}

/// Removes the last channel, alpha, of the `samples` of a row.
///
/// # Errors
/// A pixel is not opaque.
pub(super) fn without_alpha(
    path: &Path,
    header: &ImageHeader,
    row: usize,
    samples: &mut Vec<u16>,
) -> Result<(), ImageError> {
    let stored = header.channels + 1;
    if let Some(column) = samples.chunks_exact(stored).position(|p| p[header.channels] != header.white) {
        return Err(transparent_error(path, row, column));
    }
    for pixel in 0..samples.len() / stored {
        samples.copy_within(pixel * stored..pixel * stored + header.channels, pixel * header.channels);
    }
    samples.truncate(samples.len() / stored * header.channels);
    Ok(())
}

/// A pixel that is not opaque.
pub(crate) fn transparent_error(path: &Path, row: usize, column: usize) -> ImageError {
    let expected = "no transparency; flatten the image onto its background, e.g. `magick IN -background white -flatten OUT`";
    header_error(path, "alpha", expected, format!("a transparent pixel at row {row}, column {column}"))
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
