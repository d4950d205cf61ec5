//! The map of a band: of a lens with rotational symmetry, or of one without.

use super::map::{Map, Points};
use super::planar::PlanarChartMap;
use super::reach::Span;
use crate::field::planar::FilmRow;
use crate::geometry::Rect;

/// Map from film pixels to chart pixels.
#[derive(Clone, Copy, Debug)]
pub(crate) enum ChartMap<'a> {
    Radial(Map<'a>),
    Planar(PlanarChartMap<'a>),
}

impl ChartMap<'_> {
    /// Chart row, chart column and gain (R × film units) of the film pixel (y, x).
    #[inline]
    pub(crate) fn at(&self, y: i64, x: i64) -> (f64, f64, f64) {
        self.at_place(y as f64, x as f64)
    }

    /// As [`ChartMap::at`], between film pixels.
    #[inline]
    pub(crate) fn at_place(&self, y: f64, x: f64) -> (f64, f64, f64) {
        match self {
            Self::Radial(map) => map.at_place(y, x),
            Self::Planar(map) => map.at_place(y, x),
        }
    }

    /// Fills `to` with the pixels of `rect`; `row` is a buffer.
    pub(super) fn fill(&self, rect: Rect, to: &mut Points, row: &mut FilmRow) {
        match self {
            Self::Radial(map) => map.fill(rect, to),
            Self::Planar(map) => map.fill(rect, to, row),
        }
    }

    /// Chart rows, chart columns and gains of the film pixels from (y, x) on; `row` is a buffer.
    pub(super) fn fill_line(&self, y: i64, x: i64, to: &mut [(f64, f64, f64)], row: &mut FilmRow) {
        match self {
            Self::Radial(map) => (x..).zip(to).for_each(|(x, to)| *to = map.at(y, x)),
            Self::Planar(map) => map.fill_line(y, x, to, row),
        }
    }

    /// Bounds of the chart rows and columns of the pixels of `rect`.
    pub(super) fn bound(&self, rect: Rect) -> (Span, Span) {
        match self {
            Self::Radial(map) => map.bound(rect),
            Self::Planar(map) => map.bound(rect),
        }
    }
}
