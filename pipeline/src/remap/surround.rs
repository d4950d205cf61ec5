//! Rectangles of a chart that extend beyond it.

use crate::buffer::resize_exact;
use crate::flow::{ChartSource, SourceSinkError};
use crate::geometry::{Rect, Size};
use crate::resample::Surround;

/// Fills `out` (row-major) with band `band` of `chart` on `rect`, with its `surround` outside the chart; `inside` is a buffer.
///
/// # Errors
/// Errors of `chart`.
pub(crate) fn read_with_surround(
    chart: &dyn ChartSource,
    band: usize,
    rect: Rect,
    surround: Surround,
    out: &mut [f32],
    inside: &mut Vec<f32>,
) -> Result<(), SourceSinkError> {
    let size = chart.size();
    if size.rect().contains(rect) {
        return chart.read(band, rect, out);
    }
    let range = |first: i64, count: usize, n: usize| {
        let indices = (0..count as i64).filter_map(|i| surround.index(first + i, n));
        indices.fold(None, |range: Option<(usize, usize)>, i| {
            Some(range.map_or((i, i), |(a, b)| (a.min(i), b.max(i))))
        })
    };
    let rows = range(rect.y, rect.height, size.height);
    let cols = range(rect.x, rect.width, size.width);
    let (Some((y0, y1)), Some((x0, x1))) = (rows, cols) else {
        out.fill(0.0);
        return Ok(());
    };
    let part = Rect::new(y0 as i64, x0 as i64, y1 - y0 + 1, x1 - x0 + 1);
    resize_exact(inside, part.size().pixels());
    chart.read(band, part, &mut inside[..part.size().pixels()])?;
    for (y, to) in out.chunks_exact_mut(rect.width).enumerate() {
        let Some(row) = surround.index(rect.y + y as i64, size.height) else {
            to.fill(0.0);
            continue;
        };
        let from = &inside[(row - y0) * part.width..][..part.width];
        for (x, to) in to.iter_mut().enumerate() {
            *to = surround.index(rect.x + x as i64, size.width).map_or(0.0, |col| from[col - x0]);
        }
    }
    Ok(())
}

/// The transpose of [`read_with_surround`]: adds `values` (row-major) on `rect` to the pixels of `chart`, of `size`, that they are copies of.
///
/// Copies of one pixel in a row, and in the rows after it, are summed in f64 before they are added: beyond the edge of a chart there may be millions.
pub(crate) fn add_with_surround(
    (values, rect): (&[f32], Rect),
    surround: Surround,
    (chart, size): (&mut [f32], Size),
) {
    let columns: Vec<Option<usize>> =
        (0..rect.width as i64).map(|x| surround.index(rect.x + x, size.width)).collect();
    let (Some(first), Some(last)) = (columns.iter().flatten().min(), columns.iter().flatten().max()) else {
        return;
    };
    let mut sums = vec![0.0; last + 1 - first];
    let rows = |y: usize| surround.index(rect.y + y as i64, size.height);
    for (y, line) in values.chunks_exact(rect.width).enumerate() {
        let Some(row) = rows(y) else { continue };
        for (column, value) in columns.iter().zip(line) {
            if let Some(column) = column {
                sums[column - first] += f64::from(*value);
            }
        }
        if y + 1 < rect.height && rows(y + 1) == Some(row) {
            continue;
        }
        let to = &mut chart[row * size.width + first..][..sums.len()];
        for (to, sum) in to.iter_mut().zip(&mut sums) {
            *to += std::mem::take(sum) as f32;
        }
    }
}
