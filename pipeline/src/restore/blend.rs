//! Tiles of a picture that overlap, and their weights, which sum to 1 at every pixel.
//!
//! ```text
//! core k = [k·side, (k + 1)·side) ∩ picture        weight along an axis: from 0 to 1 over `overlap` px around each border of cores, as sin²; 1 at the picture's border
//! w_k(y, x) = w_k(y) · w_k(x)
//! ```

use crate::geometry::{Rect, Size};
use crate::real;
use std::f64::consts::FRAC_PI_2;

/// The tiles of a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Tiles {
    /// The picture.
    pub picture: Size,
    /// Side of a core, px.
    pub side: usize,
    /// Width of the overlap, px, even and at most `side`.
    pub overlap: usize,
}

impl Tiles {
    /// Cores of the tiles whose weight is not 0 somewhere in `rect`.
    pub fn reaching(&self, rect: Rect) -> impl Iterator<Item = Rect> + '_ {
        let wide = rect.grown(self.overlap / 2).intersect(self.picture.rect());
        let side = self.side as i64;
        let along = move |first: i64, end: i64| first.div_euclid(side)..(end - 1).div_euclid(side) + 1;
        along(wide.y, wide.bottom()).flat_map(move |row| {
            along(wide.x, wide.right()).map(move |column| {
                let core = Rect::new(row * side, column * side, self.side, self.side);
                core.intersect(self.picture.rect())
            })
        })
    }

    /// Pixels of the picture at which the tile of `core` has a weight.
    pub fn extent(&self, core: Rect) -> Rect {
        core.grown(self.overlap / 2).intersect(self.picture.rect())
    }

    /// Weights of the tile of `core` at the rows and at the columns of `rect`.
    pub fn weights(&self, core: Rect, rect: Rect) -> [Vec<f64>; 2] {
        let Size { height, width } = self.picture;
        let down = |y: i64| self.along((core.y, core.bottom()), height as i64, y);
        let across = |x: i64| self.along((core.x, core.right()), width as i64, x);
        [(rect.y..rect.bottom()).map(down).collect(), (rect.x..rect.right()).map(across).collect()]
    }

    /// Adds `values`, the pixels of the tile of `core` in its extent, by their weights to `out`, pixels of `rect`.
    pub fn add(&self, core: Rect, values: &[f64], rect: Rect, out: &mut [f32]) {
        let extent = self.extent(core);
        let part = extent.intersect(rect);
        let [rows, columns] = self.weights(core, part);
        for (y, down) in (part.y..part.bottom()).zip(rows) {
            let from = &values[(y - extent.y) as usize * extent.width + (part.x - extent.x) as usize..];
            let to = &mut out[(y - rect.y) as usize * rect.width + (part.x - rect.x) as usize..];
            for ((to, from), across) in to.iter_mut().zip(from).zip(&columns) {
                *to += (down * across * from) as f32;
            }
        }
    }

    fn along(&self, (first, end): (i64, i64), length: i64, at: i64) -> f64 {
        let half = self.overlap as i64 / 2;
        // Position in the overlap around a border, from its first pixel.
        let rise = |border: i64| {
            let t = (at - (border - half)) as f64 + 0.5;
            match self.overlap as f64 {
                0.0 => f64::from(u8::from(at >= border)),
                overlap => real::sin(FRAC_PI_2 * (t / overlap).clamp(0.0, 1.0)).powi(2),
            }
        };
        let up = if first == 0 { 1.0 } else { rise(first) };
        let down = if end == length { 1.0 } else { 1.0 - rise(end) };
        up * down
    }
}
