//! Layout of a chart in a NumPy file: two or three axes, in C or Fortran order.

use super::layout::RasterLayout;
use crate::chart::axes::AxisOrder;
use crate::npy::{self, HeaderError};

/// Parses the first bytes of a file whose axes are `declared`, else (bands, rows, columns) or (rows, columns).
pub(super) fn parse(head: &[u8], declared: Option<&AxisOrder>) -> Result<RasterLayout, HeaderError> {
    let npy::Header { sample, little_endian, shape, offset, fortran } = npy::header(head)?;
    if !(2..=3).contains(&shape.len()) {
        return Err(("shape", "(bands, rows, columns) or (rows, columns)".into(), format!("{shape:?}")));
    }
    let order = match declared {
        Some(order) if order.rank() != shape.len() => {
            return Err((
                "shape",
                format!("{} axes, as in --axes {order}", order.rank()),
                format!("{shape:?}"),
            ));
        }
        Some(order) => order.clone(),
        None => match AxisOrder::spatial_first(&shape) {
            Some(found) => return Err(("shape", "(bands, rows, columns)".into(), found)),
            None => AxisOrder::standard(shape.len()),
        },
    };
    let in_memory = if fortran { order.reversed() } else { order.clone() };
    Ok(RasterLayout {
        shape: order.to_chart(&shape, 1),
        interleave: in_memory.interleave(),
        sample,
        little_endian,
        offset: offset as u64,
    })
}
