//! The reduced chart with what surrounds it: one value at any place of the ideal plane, in chart pixels.
//!
//! Cells at the far edges that reach beyond the chart are completed, and a ring of cells is put around them, so that light between the centres of cells is bilinear
//! everywhere and each cell counts by its area. n of the s columns of a cell lie on the chart, with the mean v; e is the mean of the chart's last column there:
//!
//! | surround | completed cell | ring | beyond |
//! |---|---|---|---|
//! | black | v n/s | 0 | 0 |
//! | edge | (v n + e (s − n))/s | e | the ring |
//! | mirror | v | the cell beside it | the place mirrored about the chart's edge |
//!
//! Rows likewise, before the columns. Light of a chart in black surroundings is conserved: Σ over places = Σ over pixels.

use crate::geometry::Size;
use crate::reduced_chart::ReducedChart;
use crate::resample::Surround;

/// Completed cells with a ring around them.
pub struct ExtendedChart {
    chart: Size,
    side: f64,
    surround: Surround,
    /// Cells, without the ring.
    cells: Size,
    /// Row by row, with the ring.
    values: Vec<f32>,
}

/// A value of a cell of which `inside` of `side` rows or columns lie on the chart; `outermost` is that of the last of them.
fn completed(surround: Surround, value: f32, outermost: f32, inside: usize, side: usize) -> f32 {
    let (n, s) = (inside as f64, side as f64);
    let value = f64::from(value);
    match surround {
        _ if inside == side => value as f32,
        Surround::Black => (value * n / s) as f32,
        Surround::Edge => ((value * n + f64::from(outermost) * (s - n)) / s) as f32,
        Surround::Mirror => value as f32,
    }
}

/// The value of the ring beside a cell, with the chart's outermost pixels `outermost` there.
fn ring(surround: Surround, cell: f32, outermost: f32) -> f32 {
    match surround {
        Surround::Black => 0.0,
        Surround::Edge => outermost,
        Surround::Mirror => cell,
    }
}

impl ExtendedChart {
    /// Bytes of that of a chart of `chart` px in cells of `side` px.
    pub fn bytes(chart: Size, side: usize) -> usize {
        let cells = ReducedChart::cells(chart, side);
        4 * (cells.height + 2) * (cells.width + 2)
    }

    /// `reduced` in its `surround`.
    pub fn new(reduced: &ReducedChart, surround: Surround) -> Self {
        let (chart, side, cells) = (reduced.chart(), reduced.side(), reduced.size());
        let [left, right, top, bottom] = reduced.rims();
        // Rows and columns of the last cells that lie on the chart.
        let inside = (chart.height - (cells.height - 1) * side, chart.width - (cells.width - 1) * side);
        let width = cells.width + 2;
        let mut values = Vec::with_capacity((cells.height + 2) * width);
        // A row of cells with its ends: the value left of the chart, its cells, the value right of it, which also completes the last cell.
        let mut push = |first: f32, row: &[f32], last: f32| {
            let (end, row) = row.split_last().expect("a cell");
            let end = completed(surround, *end, last, inside.1, side);
            values.push(ring(surround, row.first().copied().unwrap_or(end), first));
            values.extend_from_slice(row);
            values.push(end);
            values.push(ring(surround, end, last));
        };
        let row = |i: usize| &reduced.values()[i * cells.width..][..cells.width];
        let last = cells.height - 1;
        // The last row with the rows below the chart.
        let below = |value: f32, outermost: f32| completed(surround, value, outermost, inside.0, side);
        let lowest: Vec<f32> =
            std::iter::zip(row(last), &bottom[1..]).map(|(value, rim)| below(*value, *rim)).collect();
        let ends = (below(left[last], bottom[0]), below(right[last], bottom[width - 1]));
        let beside = |cells: &[f32], ends: (f32, f32), rim: &[f32]| -> Vec<f32> {
            let cells = [&[ends.0], cells, &[ends.1]].concat();
            std::iter::zip(cells, rim).map(|(cell, rim)| ring(surround, cell, *rim)).collect()
        };
        let first = if last == 0 { (&lowest[..], ends) } else { (row(0), (left[0], right[0])) };
        let upper = beside(first.0, first.1, top);
        push(upper[0], &upper[1..width - 1], upper[width - 1]);
        for i in 0..last {
            push(left[i], row(i), right[i]);
        }
        push(ends.0, &lowest, ends.1);
        let lower = beside(&lowest, ends, bottom);
        push(lower[0], &lower[1..width - 1], lower[width - 1]);
        Self { chart, side: side as f64, surround, cells, values }
    }

    /// Rows and columns of the chart, in cells.
    pub fn size_in_cells(&self) -> [f64; 2] {
        [self.chart.height, self.chart.width].map(|pixels| pixels as f64 / self.side)
    }

    /// Value at chart coordinates (row, column), pixel centres at integers.
    #[inline]
    pub fn at(&self, row: f64, column: f64) -> f64 {
        self.at_cells(self.cells_at(row, column))
    }

    /// Chart coordinates (row, column) in cells from the centre of the ring's first on.
    #[inline]
    pub fn cells_at(&self, row: f64, column: f64) -> [f64; 2] {
        let place = |at: f64| (at + 0.5) / self.side + 0.5;
        [place(row), place(column)]
    }

    /// Value at a place in cells, as [`Self::cells_at`] has it.
    #[inline(always)]
    pub fn at_cells(&self, [y, x]: [f64; 2]) -> f64 {
        let (y, x) = match self.surround {
            Surround::Mirror => {
                let [height, width] = self.size_in_cells();
                (mirrored(y, height), mirrored(x, width))
            }
            _ => (y, x),
        };
        let (y, x) =
            (y.clamp(0.0, (self.cells.height + 1) as f64), x.clamp(0.0, (self.cells.width + 1) as f64));
        // Of 32 bits: processors have an instruction for it.
        let cell = |at: f64, cells: usize| (at as i32 as usize).min(cells);
        let (i, j) = (cell(y, self.cells.height), cell(x, self.cells.width));
        let (fy, fx) = (y - i as f64, x - j as f64);
        let width = self.cells.width + 2;
        let pairs = &self.values[i * width + j..][..width + 2];
        let line = |a: f32, b: f32| (1.0 - fx) * f64::from(a) + fx * f64::from(b);
        (1.0 - fy) * line(pairs[0], pairs[1]) + fy * line(pairs[width], pairs[width + 1])
    }

    /// The value that all places between `corners`, in cells, have, if they lie where the surroundings are the same everywhere; mirrored ones never are.
    pub fn even_between(&self, corners: &[[f64; 2]]) -> Option<f64> {
        let beyond = |axis: usize, cells: usize| {
            let last = (cells + 1) as f64;
            corners.iter().all(|at| at[axis] <= 0.0) || corners.iter().all(|at| at[axis] >= last)
        };
        let (rows, columns) = (beyond(0, self.cells.height), beyond(1, self.cells.width));
        match self.surround {
            Surround::Black => (rows || columns).then_some(0.0),
            Surround::Edge => (rows && columns).then(|| self.at_cells(corners[0])),
            Surround::Mirror => None,
        }
    }
}

/// A place in cells mirrored about ½ and `n` + ½, the edges of a chart of `n` cells, until it lies between them.
#[inline(always)]
fn mirrored(at: f64, n: f64) -> f64 {
    if (0.5..=n + 0.5).contains(&at) {
        return at;
    }
    let from_edge = (at - 0.5).rem_euclid(2.0 * n);
    from_edge.min(2.0 * n - from_edge) + 0.5
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::flow::{ChartSource, SourceSinkError};
    use crate::geometry::Rect;
    use std::sync::atomic::AtomicBool;

    const ALL: [Surround; 3] = [Surround::Edge, Surround::Black, Surround::Mirror];

    struct Drawn<F: Fn(usize, usize) -> f32>(Size, F);

    impl<F: Fn(usize, usize) -> f32 + Send + Sync> ChartSource for Drawn<F> {
        fn size(&self) -> Size {
            self.0
        }
        fn read(&self, _: usize, rect: Rect, out: &mut [f32]) -> Result<(), SourceSinkError> {
            for (y, row) in (rect.y as usize..).zip(out.chunks_exact_mut(rect.width)) {
                (rect.x as usize..).zip(row).for_each(|(x, to)| *to = self.1(y, x));
            }
            Ok(())
        }
    }

    fn extended(
        size: Size,
        side: usize,
        surround: Surround,
        value: impl Fn(usize, usize) -> f32 + Send + Sync,
    ) -> ExtendedChart {
        let chart = Drawn(size, value);
        let reduced = ReducedChart::read(&chart, 0, side, 1, &AtomicBool::new(false)).unwrap();
        ExtendedChart::new(&reduced, surround)
    }

    /// Sum over places of a regular grid of half pixels around the chart.
    fn sum(of: &ExtendedChart, size: Size) -> f64 {
        let places = |n: usize| (-80..2 * n as i64 + 80).map(|i| i as f64 / 2.0 - 0.25);
        places(size.height).map(|y| places(size.width).map(|x| of.at(y, x)).sum::<f64>()).sum::<f64>() / 4.0
    }

    #[test]
    fn light_of_any_pixel_in_black_surroundings_is_conserved() {
        for size in [Size::new(17, 33), Size::new(16, 24), Size::new(3, 5), Size::new(41, 1)] {
            for (row, column) in
                [(0, 0), (size.height - 1, size.width - 1), (size.height / 2, size.width - 1)]
            {
                let lit = move |y, x| if (y, x) == (row, column) { 5.0 } else { 0.0 };
                let found = sum(&extended(size, 8, Surround::Black, lit), size);
                assert!((found - 5.0).abs() < 1e-5, "{size}, pixel {row}, {column}: {found}");
            }
        }
    }

    /// A plane is interpolated exactly between the centres of complete cells.
    #[test]
    fn values_between_cells_are_bilinear() {
        let plane = |y: usize, x: usize| (y + 2 * x) as f32;
        for surround in ALL {
            let chart = extended(Size::new(64, 64), 8, surround, plane);
            for (row, column) in [(3.5, 3.5), (10.25, 40.0), (59.5, 20.125)] {
                assert!((chart.at(row, column) - (row + 2.0 * column)).abs() < 1e-5);
            }
        }
    }

    /// Beyond the chart: its outermost pixels, nothing, or the chart again.
    #[test]
    fn surroundings_are_those_of_the_outermost_pixels() {
        // Of 21 columns the last cell has 5.
        let (size, value) = (Size::new(30, 21), |y: usize, x: usize| (3 * y + 7 * x) as f32);
        let edge = extended(size, 8, Surround::Edge, value);
        assert!((edge.at(11.5, 60.0) - (3.0 * 11.5 + 7.0 * 20.0)).abs() < 1e-4);
        assert!((edge.at(11.5, -60.0) - 3.0 * 11.5).abs() < 1e-4);
        assert_eq!([edge.at(-60.0, -60.0), edge.at(99.0, 99.0)], [0.0, f64::from(value(29, 20))]);
        let black = extended(size, 8, Surround::Black, value);
        assert_eq!([black.at(11.5, 60.0), black.at(-30.0, 3.0)], [0.0, 0.0]);
        let mirror = extended(size, 8, Surround::Mirror, value);
        for (beyond, inside) in
            [((11.0, 25.0), (11.0, 16.0)), ((-6.0, 3.0), (5.0, 3.0)), ((33.0, -4.0), (26.0, 3.0))]
        {
            assert_eq!(mirror.at(beyond.0, beyond.1), mirror.at(inside.0, inside.1));
        }
    }

    /// A chart that is its own mirror image has mirrored values, if its cells are.
    #[test]
    fn even_charts_stay_even() {
        for surround in ALL {
            let chart = extended(Size::new(5, 7), 1, surround, |y, x| ((y + 1) * (x * (6 - x) + 1)) as f32);
            for x in [-3.0, 0.25, 1.5, 8.0] {
                assert!((chart.at(2.0, x) - chart.at(2.0, 6.0 - x)).abs() < 1e-9, "{surround:?}, {x}");
            }
        }
    }

    /// Where all places between corners have one value, each has it; elsewhere there is none.
    #[test]
    fn places_far_from_the_chart_have_one_value() {
        let (size, value) = (Size::new(30, 21), |y: usize, x: usize| (3 * y + 7 * x) as f32);
        let square = |row: f64, column: f64| {
            [(0.0, 0.0), (0.0, 9.0), (9.0, 0.0), (9.0, 9.0)].map(|(y, x)| (row + y, column + x))
        };
        let cases = [(-40.0, -40.0), (60.0, 50.0), (-40.0, 3.0), (11.0, 60.0), (11.0, 3.0), (-8.0, -8.0)];
        for surround in ALL {
            let chart = extended(size, 8, surround, value);
            let even = cases.map(|(row, column)| {
                let corners = square(row, column).map(|(row, column)| chart.cells_at(row, column));
                let even = chart.even_between(&corners)?;
                for (row, column) in square(row, column) {
                    assert_eq!(chart.at(row, column), even, "{surround:?}, {row}, {column}");
                }
                Some(even)
            });
            let expected = match surround {
                Surround::Edge => [true, true, false, false, false, false],
                Surround::Black => [true, true, true, true, false, false],
                Surround::Mirror => [false; 6],
            };
            assert_eq!(even.map(|even| even.is_some()), expected, "{surround:?}");
        }
    }

    #[test]
    fn a_uniform_chart_stays_uniform() {
        for surround in [Surround::Edge, Surround::Mirror] {
            let chart = extended(Size::new(13, 19), 8, surround, |_, _| 2.0);
            assert!((-20..40).all(|i| chart.at(f64::from(i), 1.7 * f64::from(i)) == 2.0));
        }
    }
}
