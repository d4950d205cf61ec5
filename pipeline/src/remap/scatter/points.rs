//! Coordinates of the pixels of a film rectangle as the SIMD engines have them, one by one.

use super::super::extent::GROUP;
use super::super::lanes::{Expand, Pixels};
use super::super::map::{ANCHOR_SPACING_PX, Points};
use crate::geometry::Rect;
use crate::simd::lanes::{Lanes, MAX_LANES, SimdOp};

/// Expands anchors to the coordinates of the pixels of `rect`.
pub(super) struct ExpandPoints<'a, E> {
    pub(super) anchors: E,
    pub(super) rect: Rect,
    pub(super) to: &'a mut Points,
}

impl<V: Lanes, E: Expand> SimdOp<V> for ExpandPoints<'_, E> {
    #[inline(always)]
    fn run(self) {
        let Self { anchors, rect, to } = self;
        to.resize(rect);
        let (x0, count) = anchors.blocks();
        for row in 0..rect.height {
            let line = anchors.line::<V>(row);
            for (g, group) in anchors.groups(row).iter().enumerate() {
                for i in 0..GROUP.min(count - g * GROUP) {
                    let block = x0 + ((g * GROUP + i) * ANCHOR_SPACING_PX) as i64 - rect.x;
                    for first in (0..ANCHOR_SPACING_PX).step_by(V::LANES) {
                        let pixels = anchors.pixels::<V>(&line, (g, group), i, first);
                        store(&pixels, (row * to.stride, rect.width), block + first as i64, to);
                    }
                }
            }
        }
    }
}

/// Stores those of the pixels from column `x` of a row on that lie in it; the row has `width` pixels, from `row` on.
#[inline(always)]
fn store<V: Lanes>(pixels: &Pixels<V>, (row, width): (usize, usize), x: i64, to: &mut Points) {
    if x >= 0 && x as usize + V::LANES <= width {
        let at = row + x as usize;
        V::store_i32(pixels.rows, &mut to.row[at..]);
        V::store_i32(pixels.cols, &mut to.col[at..]);
        pixels.row_fraction.store(&mut to.row_fraction[at..]);
        pixels.col_fraction.store(&mut to.col_fraction[at..]);
        pixels.gain.store(&mut to.gain[at..]);
        return;
    }
    let (mut cells, mut values) = ([[0; MAX_LANES]; 2], [[0.0; MAX_LANES]; 3]);
    V::store_i32(pixels.rows, &mut cells[0]);
    V::store_i32(pixels.cols, &mut cells[1]);
    pixels.row_fraction.store(&mut values[0]);
    pixels.col_fraction.store(&mut values[1]);
    pixels.gain.store(&mut values[2]);
    let lanes = V::LANES as i64;
    let (from, end) = ((-x).clamp(0, lanes) as usize, (width as i64 - x).clamp(0, lanes) as usize);
    if from >= end {
        return;
    }
    let at = row + (x + from as i64) as usize;
    let count = end - from;
    to.row[at..][..count].copy_from_slice(&cells[0][from..end]);
    to.col[at..][..count].copy_from_slice(&cells[1][from..end]);
    to.row_fraction[at..][..count].copy_from_slice(&values[0][from..end]);
    to.col_fraction[at..][..count].copy_from_slice(&values[1][from..end]);
    to.gain[at..][..count].copy_from_slice(&values[2][from..end]);
}
