//! Opening flat files.

use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, AtomicUsize};

use pipeline::bounds;
use pipeline::geometry::Size;
use serde_json::json;

use super::attributes::{self, Attributes};
use super::layout::RasterLayout;
use super::mapped::MappedFile;
use super::{RasterChart, envi, npy_layout};
use crate::chart::axes::AxisOrder;
use crate::chart::error::ChartError;
use crate::chart::file_change::{WatchedFile, modified_json};
use crate::chart::header::{FileArray, check_wavelengths, header_error, open_regular};
use crate::chart::options::NanPolicy;
use crate::chart::values::Values;
use crate::durable::DurableError;
use crate::npy;

/// Maximum size of an ENVI header.
const MAX_HEADER_BYTES: u64 = 16 << 20;
/// Maximum size of a file, beyond that of any disk.
const MAX_FILE_BYTES: u64 = 1 << 60;

/// Content of a header besides the layout.
#[derive(Default)]
struct Description {
    wavelengths_nm: Option<Vec<f64>>,
    values: Values,
    units: Option<String>,
    array: Option<FileArray>,
    notes: Vec<String>,
    header: Option<WatchedFile>,
}

impl RasterChart {
    /// Whether `path` is a file that [`RasterChart::open`] supports, by its extension or an ENVI header beside it.
    pub fn is_supported_path(path: &Path) -> bool {
        path.is_file() && (is_npy(path) || is_envi_header(path) || envi::header_of(path).is_some())
    }

    /// [`RasterChart::open_with_axes`] without declared axes.
    ///
    /// # Errors
    /// As there.
    pub fn open(path: &Path, nan: NanPolicy) -> Result<Self, ChartError> {
        Self::open_with_axes(path, None, nan)
    }

    /// Opens a `.npy` file, whose axes are `axes` or else (bands, rows, columns), with the attributes beside it; an ENVI header, or the data
    /// file beside one.
    ///
    /// # Errors
    /// [`ChartError`] if the header is invalid or not supported, or the file is shorter than the header implies.
    pub fn open_with_axes(path: &Path, axes: Option<&AxisOrder>, nan: NanPolicy) -> Result<Self, ChartError> {
        if is_npy(path) {
            let head = read_start(path, npy::MAX_HEADER_BYTES)?;
            let layout =
                npy_layout::parse(&head, axes).map_err(|(what, e, f)| header_error(path, what, e, f))?;
            let declared = attributes::read(path, layout.sample)?;
            let description = declared.map(|Attributes { values, file, note }| Description {
                values,
                notes: note.into_iter().collect(),
                header: Some(file),
                ..Description::default()
            });
            return Self::map(path, layout, description.unwrap_or_default(), nan);
        }
        if axes.is_some() {
            let found = "--axes for an ENVI file, whose header declares the order (interleave)";
            return Err(header_error(path, "axes", "those of the header", found));
        }
        let hdr = if is_envi_header(path) { Some(path.to_path_buf()) } else { envi::header_of(path) };
        let hdr: PathBuf = hdr.ok_or_else(|| {
            header_error(path, "file", "a .npy file or one with an ENVI header (.hdr)", "neither")
        })?;
        let text = read_start(&hdr, MAX_HEADER_BYTES)?;
        let envi = envi::parse(&String::from_utf8_lossy(&text))
            .map_err(|(what, e, f)| header_error(&hdr, what, e, f))?;
        let data = if is_envi_header(path) { envi::data_of(path) } else { Some(path.to_path_buf()) };
        let data =
            data.ok_or_else(|| header_error(&hdr, "data file", "a file beside it of the same name", "none"))?;
        let envi::Envi { layout, wavelengths_nm, values, notes } = envi;
        let header = Some(WatchedFile::header(&hdr, MAX_HEADER_BYTES, &text));
        let description = Description { wavelengths_nm, values, notes, header, ..Description::default() };
        Self::map(&data, layout, description, nan)
    }

    /// Opens raw samples.
    ///
    /// # Errors
    /// As [`RasterChart::open`].
    pub fn raw(path: &Path, layout: RasterLayout, nan: NanPolicy) -> Result<Self, ChartError> {
        Self::map(path, layout, Description::default(), nan)
    }

    /// Opens samples of `layout` in an array of a file of another format, which declares wavelengths, conversion, unit and notes.
    #[cfg(feature = "hdf5")]
    pub(in crate::chart) fn described(
        array: FileArray,
        path: &Path,
        layout: RasterLayout,
        (wavelengths_nm, values, units, notes): (Option<Vec<f64>>, Values, Option<String>, Vec<String>),
        nan: NanPolicy,
    ) -> Result<Self, ChartError> {
        let array = Some(array);
        Self::map(
            path,
            layout,
            Description { wavelengths_nm, values, units, array, notes, header: None },
            nan,
        )
    }

    fn map(
        path: &Path,
        layout: RasterLayout,
        description: Description,
        nan: NanPolicy,
    ) -> Result<Self, ChartError> {
        let Description { wavelengths_nm, values, units, array, notes, header } = description;
        let [bands, rows, columns] = layout.shape;
        if let Err(e) = bounds::chart_size(bands, Size::new(rows, columns)) {
            return Err(header_error(path, e.bound.name, e.bound.to_string(), e.found));
        }
        let Some(expected) = layout.end().filter(|n| *n <= MAX_FILE_BYTES) else {
            return Err(header_error(path, "shape", "at most 2^60 bytes", format!("{:?}", layout.shape)));
        };
        check_wavelengths(path, wavelengths_nm.as_deref().unwrap_or_default())?;
        let file = open_regular(path)?;
        let meta = file.metadata().map_err(|e| DurableError::io("look up", path, 0, e))?;
        if meta.len() < expected {
            return Err(ChartError::Short { path: path.into(), expected, found: meta.len() });
        }
        let identity = (
            json!({
                "raster": layout.identity(),
                "bytes": meta.len(),
                "wavelengths_nm": wavelengths_nm,
                "values": values.identity(),
            }),
            modified_json(&meta),
        );
        let files = header.into_iter().chain([WatchedFile::data(path, &meta)]).collect();
        let map = MappedFile::new(file, expected).map_err(|e| DurableError::io("map", path, expected, e))?;
        Ok(Self {
            path: path.into(),
            map,
            entries: (0..bands).map(Some).collect(),
            sample: layout.sample,
            layout,
            nan,
            wavelengths_nm,
            values,
            units,
            array,
            notes,
            replaced: AtomicU64::new(0),
            bytes_read: AtomicU64::new(0),
            released_rows: (0..bands).map(|_| AtomicUsize::new(0)).collect(),
            identity,
            files,
        })
    }
}

fn is_npy(path: &Path) -> bool {
    has_extension(path, "npy")
}

fn is_envi_header(path: &Path) -> bool {
    has_extension(path, "hdr")
}

fn has_extension(path: &Path, extension: &str) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case(extension))
}

/// The other file of an ENVI pair, the data of a header or the header of data; the attributes of a `.npy` file, whether or not they exist.
pub fn beside(path: &Path) -> Option<PathBuf> {
    match () {
        () if is_npy(path) => Some(attributes::beside(path)),
        () if is_envi_header(path) => envi::data_of(path),
        () => envi::header_of(path),
    }
}

/// The first bytes of a file, at most `limit`.
pub(super) fn read_start(path: &Path, limit: u64) -> Result<Vec<u8>, ChartError> {
    let mut bytes = Vec::new();
    let read = open_regular(path)?.take(limit).read_to_end(&mut bytes);
    read.map_err(|e| DurableError::io("read", path, 0, e))?;
    Ok(bytes)
}
