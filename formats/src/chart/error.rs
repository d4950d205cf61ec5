//! Why a chart cannot be opened or read.

use std::path::PathBuf;

use pipeline::geometry::Rect;

use crate::durable::DurableError;

/// A chart cannot be opened or read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ChartError {
    /// Nothing there.
    #[error(
        "opening chart {path}: nothing there; give a Zarr store (PATH or PATH//array), a .npy file, an ENVI header (.hdr) or a spectral .exr"
    )]
    NotFound {
        /// What was asked for.
        path: PathBuf,
    },
    /// Something else than a Zarr store.
    #[error(
        "opening chart {path}: {found}, expected the directory of a Zarr v2 or v3 store (zarr.json, .zgroup or .zarray)"
    )]
    NotZarr {
        /// What was asked for.
        path: PathBuf,
        /// What lies there.
        found: String,
    },
    /// The group has no such array.
    #[error("opening chart {path}: no array {wanted}; arrays there: {found}; name one as {path}//ARRAY", path = path.display())]
    NoArray {
        /// The group.
        path: PathBuf,
        /// What was looked for.
        wanted: String,
        /// Arrays that are there.
        found: String,
    },
    /// Metadata that says what cannot be, or what is not supported.
    #[error("opening chart {path}, array {array:?}: {what}: expected {expected}, found {found}")]
    Metadata {
        /// The store.
        path: PathBuf,
        /// The array in it.
        array: String,
        /// Which property.
        what: &'static str,
        /// What it must be.
        expected: String,
        /// What it is.
        found: String,
    },
    /// The header of a flat file.
    #[error("opening chart {path}: {what}: expected {expected}, found {found}")]
    Header {
        /// The file.
        path: PathBuf,
        /// Which property.
        what: &'static str,
        /// What it must be.
        expected: String,
        /// What it is.
        found: String,
    },
    /// A flat file that lacks samples, from the beginning or since it was opened.
    #[error(
        "reading chart {path}: expected {expected} bytes, found {found}; is the file cut short, or still being written?"
    )]
    Short {
        /// The file.
        path: PathBuf,
        /// Bytes that its header asks for.
        expected: u64,
        /// Bytes it has.
        found: u64,
    },
    /// A file is not what it was when the chart was opened.
    #[error(
        "reading chart {path}: {what} since the chart was opened, so what was read may be of both; let the chart rest, then start anew with --overwrite"
    )]
    Changed {
        /// The file.
        path: PathBuf,
        /// How it differs.
        what: &'static str,
    },
    /// A compressed file that does not decode.
    #[error(
        "reading {path}: the file is damaged, or cut short: {reason}; restore it from its source, or write it anew"
    )]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
    /// The store's files cannot be read.
    #[error("reading chart: {0}")]
    Io(#[from] DurableError),
    /// A chunk that does not decode.
    #[error(
        "reading chart {path}, bands {first_band}..{end_band}, {region}: the chunk is damaged: {reason}; restore the file from its source"
    )]
    Corrupt {
        /// The file.
        path: PathBuf,
        /// First band of the chunk.
        first_band: usize,
        /// One past its last band.
        end_band: usize,
        /// Its pixels.
        region: Rect,
        /// What is wrong with it.
        reason: String,
    },
    /// NaN or infinity.
    #[error(
        "reading chart {path}: {value} at band {band}, row {row}, column {column}; --nan zero reads such pixels as 0 and counts them"
    )]
    NotFinite {
        /// The array.
        path: PathBuf,
        /// Band.
        band: usize,
        /// Row.
        row: usize,
        /// Column.
        column: usize,
        /// The value.
        value: f64,
    },
    /// A sample that the chart declares to be no data.
    #[error(
        "reading chart {path}: no data at band {band}, row {row}, column {column}: the sample {value} is a declared fill value or outside the declared valid range; --nan zero reads such pixels as 0 and counts them"
    )]
    NoData {
        /// The array.
        path: PathBuf,
        /// Band.
        band: usize,
        /// Row.
        row: usize,
        /// Column.
        column: usize,
        /// The sample as it is stored.
        value: f64,
    },
    /// A value that sums over a tile may overflow on.
    #[error(
        "reading chart {path}: {value:e} at band {band}, row {row}, column {column}: expected at most {largest:e} in magnitude, so that 32-bit sums do not overflow; if it stands for no data, declare it (attribute _FillValue, ENVI `data ignore value`) and add --nan zero, else correct the chart"
    )]
    TooLarge {
        /// The array.
        path: PathBuf,
        /// Band.
        band: usize,
        /// Row.
        row: usize,
        /// Column.
        column: usize,
        /// The value.
        value: f64,
        /// Largest magnitude.
        largest: f32,
    },
    /// A chunk is missing, and its fill value is not a number.
    #[error(
        "reading chart {path}, band {band}, {region}: the chunk is missing and the fill value {fill} stands for no data; complete the chart, or --nan zero reads it as 0"
    )]
    MissingChunk {
        /// The file that is not there, or lacks the inner chunk.
        path: PathBuf,
        /// Band.
        band: usize,
        /// Pixels of the chunk.
        region: Rect,
        /// The fill value.
        fill: f64,
    },
    /// A request that the chart cannot answer; the caller's fault.
    #[error(
        "reading chart {path}: band {band}, {rect} is asked for into {room} pixels; it has {bands} bands of {size}"
    )]
    Request {
        /// The array.
        path: PathBuf,
        /// Band.
        band: usize,
        /// Pixels.
        rect: Rect,
        /// Pixels that the buffer holds.
        room: usize,
        /// Bands there are.
        bands: usize,
        /// Size of the chart.
        size: pipeline::geometry::Size,
    },
    /// No room for the temporary store.
    #[error(
        "re-chunking chart {path}: {needed} bytes are needed in {directory}, {free} are free; choose another directory for temporary files"
    )]
    Space {
        /// The chart.
        path: PathBuf,
        /// The directory for temporary files.
        directory: PathBuf,
        /// Bytes needed.
        needed: u64,
        /// Bytes free.
        free: u64,
    },
}

impl ChartError {
    /// Whether the same call may succeed a moment later with nobody's help.
    pub fn retryable(&self) -> bool {
        matches!(self, Self::Io(e) if e.retryable())
    }
}
