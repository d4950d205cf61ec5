//! A NumPy file as a chart: (bands, rows, columns) or (rows, columns).

use super::{Interleave, RasterLayout};
use crate::npy::{self, Fault};

/// The layout that the first bytes of a file tell.
pub(super) fn layout(head: &[u8]) -> Result<RasterLayout, Fault> {
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
