//! Attributes of a `.npy` file, whose header has none: a JSON object in `NAME.npy.attributes.json` beside it. Those of the CF conventions that
//! define its values apply ([`conventions`](super::super::conventions)); others are ignored.

use std::path::{Path, PathBuf};

use serde_json::{Map, Value};

use super::open::read_start;
use crate::chart::conventions::parse_values;
use crate::chart::error::ChartError;
use crate::chart::file_change::WatchedFile;
use crate::chart::header::header_error;
use crate::chart::values::Values;
use crate::sample::RasterSample;

/// Maximum size of the file.
const MAX_BYTES: u64 = 16 << 20;

/// What the attributes of a `.npy` file declare.
pub(super) struct Attributes {
    /// Conversion of samples.
    pub(super) values: Values,
    /// Their file.
    pub(super) file: WatchedFile,
    /// A note on scale and offset.
    pub(super) note: Option<String>,
}

/// The attributes of the `.npy` file `path` with samples of type `sample`, if it has any.
///
/// # Errors
/// [`ChartError`] if it cannot be read, or an attribute is not valid.
pub(super) fn read(path: &Path, sample: RasterSample) -> Result<Option<Attributes>, ChartError> {
    let file = beside(path);
    if !file.try_exists().unwrap_or(true) {
        return Ok(None);
    }
    let text = read_start(&file, MAX_BYTES)?;
    let attributes: Map<String, Value> = serde_json::from_slice(&text)
        .map_err(|e| header_error(&file, "attributes", "a JSON object", e.to_string()))?;
    let values =
        parse_values(&attributes, sample, None).map_err(|(what, e, f)| header_error(&file, what, e, f))?;
    let note = values.scaling.first().map(|(scale, offset)| {
        format!(
            "the chart's samples are scaled (scale_factor, add_offset): value = sample · {scale} + {offset}"
        )
    });
    Ok(Some(Attributes { values, note, file: WatchedFile::header(&file, MAX_BYTES, &text) }))
}

/// The file with the attributes of the `.npy` file `path`, which need not exist.
pub(super) fn beside(path: &Path) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(".attributes.json");
    name.into()
}
