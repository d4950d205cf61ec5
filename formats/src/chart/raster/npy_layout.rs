//! Layout of a chart in a NumPy file: (bands, rows, columns) or (rows, columns).

use super::layout::{Interleave, RasterLayout};
use crate::npy::{self, HeaderError};

/// Parses the first bytes of a file.
pub(super) fn parse(head: &[u8]) -> Result<RasterLayout, HeaderError> {
    let npy::Header { sample, little_endian, shape, offset } = npy::header(head)?;
    let shape = match *shape {
        [rows, columns] => [1, rows, columns],
        [bands, rows, columns] => [bands, rows, columns],
        _ => {
            return Err(("shape", "(bands, rows, columns) or (rows, columns)".into(), format!("{shape:?}")));
        }
    };
    Ok(RasterLayout { shape, interleave: Interleave::Bsq, sample, little_endian, offset: offset as u64 })
}
