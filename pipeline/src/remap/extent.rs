//! Bounds of chart coordinates, accumulated by lane.

/// Anchors computed together.
pub(super) const GROUP: usize = 8;

/// One f64 per anchor of a group.
pub(super) type Lane = [f64; GROUP];

#[inline(always)]
pub(super) fn lower(min: &mut f64, v: f64) {
    *min = if v < *min { v } else { *min };
}

#[inline(always)]
pub(super) fn raise(max: &mut f64, v: f64) {
    *max = if v > *max { v } else { *max };
}

/// Minima and maxima of chart coordinates so far, by lane.
pub(super) struct ChartExtent {
    pub(super) row: (Lane, Lane),
    pub(super) col: (Lane, Lane),
}

impl ChartExtent {
    pub(super) fn empty() -> Self {
        let none = ([f64::INFINITY; GROUP], [f64::NEG_INFINITY; GROUP]);
        Self { row: none, col: none }
    }

    /// Includes spans (minimum, maximum) of rows and columns.
    pub(super) fn include(&mut self, row: (f64, f64), col: (f64, f64)) {
        self.row.0[0] = self.row.0[0].min(row.0);
        self.row.1[0] = self.row.1[0].max(row.1);
        self.col.0[0] = self.col.0[0].min(col.0);
        self.col.1[0] = self.col.1[0].max(col.1);
    }

    /// Minimum and maximum cell of rows and of columns.
    pub(super) fn cells(&self) -> ((i64, i64), (i64, i64)) {
        let over_lanes = |(low, high): &(Lane, Lane)| {
            let min = low.iter().copied().fold(f64::INFINITY, f64::min);
            let max = high.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            (min.floor() as i64, max.floor() as i64)
        };
        (over_lanes(&self.row), over_lanes(&self.col))
    }
}
