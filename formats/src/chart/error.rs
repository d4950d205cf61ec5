//! Errors of opening and reading a chart.

use std::path::PathBuf;

use pipeline::geometry::Rect;

use crate::durable::DurableError;
use crate::image::header::ImageError;

/// A chart cannot be opened or read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ChartError {
    /// A name or a request that no chart can have: an error of the command line.
    #[error("{0}")]
    Usage(String),
    /// No file or directory.
    #[error(
        "opening chart {path}: not found; expected a Zarr store (PATH or PATH//array), a .npy file, HDF5 (NetCDF-4), MATLAB (.mat), an ENVI header (.hdr), a multi-band TIFF, a spectral .exr, or a folder or pattern of pictures"
    )]
    NotFound {
        /// The requested path.
        path: PathBuf,
    },
    /// A file of a format that is not read.
    #[error("opening chart {path}: unsupported format {found}; supported: {supported}{convert}")]
    Unsupported {
        /// The file.
        path: PathBuf,
        /// Its format.
        found: String,
        /// Formats that are read.
        supported: String,
        /// How to convert it, after a semicolon; empty if unknown.
        convert: String,
    },
    /// Not a Zarr store.
    #[error(
        "opening chart {path}: {found}, expected the directory of a Zarr v2 or v3 store (zarr.json, .zgroup or .zarray), or of PNG or TIFF pictures, one per band"
    )]
    NotZarr {
        /// The requested path.
        path: PathBuf,
        /// What was found.
        found: String,
    },
    /// The group has no such array.
    #[error("opening chart {path}: no array {requested}; arrays found: {found}; select one by {path}//ARRAY or --var ARRAY", path = path.display())]
    NoArray {
        /// The group.
        path: PathBuf,
        /// The requested array.
        requested: String,
        /// Arrays found.
        found: String,
    },
    /// Metadata that are invalid or not supported.
    #[error("opening chart {path}, array {array:?}: {what}: expected {expected}, found {found}")]
    Metadata {
        /// The store.
        path: PathBuf,
        /// The array in it.
        array: String,
        /// Property.
        what: &'static str,
        /// Its expected value.
        expected: String,
        /// Its found value.
        found: String,
    },
    /// A file header that is invalid or not supported.
    #[error("opening chart {path}: {what}: expected {expected}, found {found}")]
    Header {
        /// The file.
        path: PathBuf,
        /// Property.
        what: &'static str,
        /// Its expected value.
        expected: String,
        /// Its found value.
        found: String,
    },
    /// A file shorter than its header implies, when it was opened or since.
    #[error(
        "reading chart {path}: expected {expected} bytes, found {found}; is the file truncated, or still being written?"
    )]
    Short {
        /// The file.
        path: PathBuf,
        /// Bytes that its header implies.
        expected: u64,
        /// Bytes that it has.
        found: u64,
    },
    /// A file changed after the chart was opened.
    #[error(
        "reading chart {path}: {what} since the chart was opened, so pixels of both versions may have been read; leave the chart unchanged and start again with --overwrite"
    )]
    Changed {
        /// The file.
        path: PathBuf,
        /// The change, as a clause: "it was removed".
        what: &'static str,
    },
    /// A file that does not decode.
    #[error(
        "reading {path}: the file is damaged or truncated: {reason}; restore it from its source, or write it again"
    )]
    Damaged {
        /// The file.
        path: PathBuf,
        /// The defect.
        reason: String,
    },
    /// Error of the file system or object store.
    #[error("reading chart: {0}")]
    Io(#[from] DurableError),
    /// A chunk that failed to decode.
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
        /// The defect.
        reason: String,
    },
    /// NaN or infinity.
    #[error(
        "reading chart {path}: {value} at band {band}, row {row}, column {column}; `lenscube run --nan zero` reads such pixels as 0 and counts them"
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
    /// A sample that the chart declares as no data.
    #[error(
        "reading chart {path}: no data at band {band}, row {row}, column {column}: the sample {value} is a declared fill value or outside the declared valid range; `lenscube run --nan zero` reads such pixels as 0 and counts them"
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
        /// The stored sample, before scaling.
        value: f64,
    },
    /// A value so large that sums over a tile may overflow.
    #[error(
        "reading chart {path}: {value:e} at band {band}, row {row}, column {column}: expected at most {largest:e} in magnitude, so that 32-bit sums do not overflow; if it stands for no data, declare it (attribute _FillValue, ENVI `data ignore value`) and give `lenscube run --nan zero`, else correct the chart"
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
        /// Maximum magnitude.
        largest: f32,
    },
    /// A missing chunk whose fill value stands for no data.
    #[error(
        "reading chart {path}, band {band}, {region}: the chunk is missing and the fill value {fill} stands for no data; complete the chart, or `lenscube run --nan zero` reads it as 0"
    )]
    MissingChunk {
        /// The missing file, or the one without the inner chunk.
        path: PathBuf,
        /// Band.
        band: usize,
        /// Pixels of the chunk.
        region: Rect,
        /// The fill value.
        fill: f64,
    },
    /// A request outside the chart, or a buffer of another size: an error of the caller.
    #[error(
        "reading chart {path}: band {band}, {rect} was requested into a buffer of {buffer} pixels; the chart has {bands} bands of {size}"
    )]
    Request {
        /// The array.
        path: PathBuf,
        /// Band.
        band: usize,
        /// Pixels.
        rect: Rect,
        /// Size of the buffer in pixels.
        buffer: usize,
        /// Bands of the chart.
        bands: usize,
        /// Size of the chart.
        size: pipeline::geometry::Size,
    },
    /// Not enough disk space for the temporary file.
    #[error(
        "chart {path}: a temporary copy of its bands needs {needed} bytes in {directory}, {free} are free; free some there"
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
    /// Whether the same call may succeed later without a change by the user.
    pub fn retryable(&self) -> bool {
        match self {
            Self::Io(e) => e.retryable(),
            Self::Space { .. } => true,
            _ => false,
        }
    }
}

impl From<ImageError> for ChartError {
    fn from(e: ImageError) -> Self {
        match e {
            ImageError::Header { path, what, expected, found } => {
                Self::Header { path, what, expected, found }
            }
            ImageError::Short { path, expected, found } => Self::Short { path, expected, found },
            ImageError::Damaged { path, reason } => Self::Damaged { path, reason },
            ImageError::Io(e) => Self::Io(e),
        }
    }
}
