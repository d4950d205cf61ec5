//! Where the pixels of a part of the restored picture lie on the film, and their start values.
//!
//! ```text
//! start(p) = film(q')/(gain · R(q'))      q: the place of the film that shows p; q' the nearest place of the film; film bilinear between pixel centres
//! p is shown if q lies on the film       up to half a pixel beyond the centres of its border pixels
//! ```
//! Places are given on a grid of [`STEP`] px, and are linear between its points: a map of a lens differs from that by far less than 0.01 px.

use crate::geometry::{Rect, Size};

/// Step of the grid, px.
pub const STEP: usize = 8;

/// The place of a pixel; beyond the film's border as far as the pixel lies beyond what the border shows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    /// Row on the film.
    pub row: f64,
    /// Column on the film.
    pub column: f64,
    /// Relative illumination there.
    pub illumination: f64,
}

/// The places of the pixels of a part of the picture.
#[derive(Clone, Debug)]
pub struct Places {
    grid_of: Grid,
    grid: Vec<Place>,
}

/// The grid of a part: its points have coordinates that are multiples of [`STEP`], so that a pixel has the same place in every part.
#[derive(Clone, Copy, Debug)]
struct Grid {
    size: Size,
    /// Pixels from the first point to the first pixel: row, column.
    offset: (usize, usize),
    rows: usize,
    columns: usize,
}

impl Grid {
    fn new(rect: Rect) -> Self {
        let offset = |first: i64| first.rem_euclid(STEP as i64) as usize;
        let offset = (offset(rect.y), offset(rect.x));
        let count = |offset: usize, n: usize| (offset + n - 1).div_ceil(STEP) + 1;
        Self {
            size: rect.size(),
            offset,
            rows: count(offset.0, rect.height),
            columns: count(offset.1, rect.width),
        }
    }
}

impl Places {
    /// The points (row, column) of the picture of which the places are needed, for the part `rect`.
    pub fn points(rect: Rect) -> Vec<(f64, f64)> {
        let Grid { offset, rows, columns, .. } = Grid::new(rect);
        let at = |first: i64, offset: usize, k: usize| (first + (k * STEP) as i64 - offset as i64) as f64;
        (0..rows)
            .flat_map(|i| (0..columns).map(move |j| (at(rect.y, offset.0, i), at(rect.x, offset.1, j))))
            .collect()
    }

    /// Of the part `rect`, with the places of its points.
    ///
    /// # Panics
    /// Another number of places.
    pub fn new(rect: Rect, grid: Vec<Place>) -> Self {
        let grid_of = Grid::new(rect);
        assert_eq!(grid.len(), grid_of.rows * grid_of.columns, "a place for each point");
        Self { grid_of, grid }
    }

    /// Calls `f` for each pixel with its place, row by row.
    fn each(&self, mut f: impl FnMut(Place)) {
        let Grid { size, offset, rows, columns } = self.grid_of;
        let mix = |a: Place, b: Place, t: f64| Place {
            row: a.row + t * (b.row - a.row),
            column: a.column + t * (b.column - a.column),
            illumination: a.illumination + t * (b.illumination - a.illumination),
        };
        // The point before a position, the one after it, and the share of that.
        let between = |at: usize, count: usize| {
            (at / STEP, (at / STEP + 1).min(count - 1), (at % STEP) as f64 / STEP as f64)
        };
        let mut line = vec![self.grid[0]; columns];
        for y in 0..size.height {
            let (above, below, down) = between(y + offset.0, rows);
            for (x, to) in line.iter_mut().enumerate() {
                *to = mix(self.grid[above * columns + x], self.grid[below * columns + x], down);
            }
            for x in 0..size.width {
                let (left, right, across) = between(x + offset.1, columns);
                f(mix(line[left], line[right], across));
            }
        }
    }

    /// Which pixels of `rect`, in the part, a film of size `film` shows.
    pub fn shown(&self, rect: Rect, film: Size) -> Vec<bool> {
        let mut shown = Vec::with_capacity(self.grid_of.size.pixels());
        let width = self.grid_of.size.width;
        let on = |at: f64, side: usize| at >= -0.5 && at <= side as f64 - 0.5;
        self.each(|place| {
            let (y, x) = ((shown.len() / width) as i64, (shown.len() % width) as i64);
            let is_inside = (rect.y..rect.bottom()).contains(&y) && (rect.x..rect.right()).contains(&x);
            shown.push(is_inside && on(place.row, film.height) && on(place.column, film.width));
        });
        shown
    }

    /// Start values of `film`, the pixels of `rect` of the film, whose values are `gain` per chart value on the axis.
    pub fn start(&self, film: &[f32], rect: Rect, gain: f64) -> Vec<f64> {
        let Size { height, width } = rect.size();
        let mut start = Vec::with_capacity(self.grid_of.size.pixels());
        self.each(|place| {
            let row = (place.row - rect.y as f64).clamp(0.0, (height - 1) as f64);
            let column = (place.column - rect.x as f64).clamp(0.0, (width - 1) as f64);
            let (top, left) = (row as usize, column as usize);
            let (down, across) = (row - top as f64, column - left as f64);
            let (bottom, right) = ((top + 1).min(height - 1), (left + 1).min(width - 1));
            let value = |y: usize, x: usize| f64::from(film[y * width + x]);
            let upper = value(top, left) * (1.0 - across) + value(top, right) * across;
            let lower = value(bottom, left) * (1.0 - across) + value(bottom, right) * across;
            start.push((upper * (1.0 - down) + lower * down) / (gain * place.illumination));
        });
        start
    }
}
