//! A depth array reduced to a picture while it is read: means over equal parts of it.

use pipeline::geometry::Size;

/// Sums over the parts.
pub struct Overview {
    chart: Size,
    /// Parts: rows and columns of the picture.
    pub size: Size,
    /// Part of a row for each column of the chart.
    columns: Vec<usize>,
    /// Pixels, sum of vergences, sum of blur radii of each part.
    parts: Vec<(u32, f64, f64)>,
    /// Pixels with a surface.
    pixels: u64,
    /// Of these, blurred by at most 1 px.
    pub sharp: u64,
    /// Sum of blur radii, px.
    pub blur_px: f64,
}

impl Overview {
    /// Nothing yet, for a chart of `chart` pixels in at most `side` parts a side.
    pub fn new(chart: Size, side: usize) -> Self {
        let longest = chart.height.max(chart.width);
        let reduced = |n: usize| if longest <= side { n } else { (n * side).div_ceil(longest) };
        let size = Size::new(reduced(chart.height), reduced(chart.width));
        let columns = (0..chart.width).map(|x| x * size.width / chart.width).collect();
        let parts = vec![(0, 0.0, 0.0); size.pixels()];
        Self { chart, size, columns, parts, pixels: 0, sharp: 0, blur_px: 0.0 }
    }

    /// Adds row `y` with vergences `row`, NaN where there is no surface, whose blur radii `blur_px` gives.
    pub fn add(&mut self, y: usize, row: &[f64], blur_px: impl Fn(f64) -> f64) {
        let first = y * self.size.height / self.chart.height * self.size.width;
        for (column, v) in std::iter::zip(&self.columns, row).filter(|(_, v)| !v.is_nan()) {
            let blur = blur_px(*v);
            let part = &mut self.parts[first + column];
            *part = (part.0 + 1, part.1 + v, part.2 + blur);
            self.pixels += 1;
            self.sharp += u64::from(blur <= 1.0);
            self.blur_px += blur;
        }
    }

    /// Mean vergence and blur radius of each part, row by row.
    pub fn means(&self) -> impl Iterator<Item = (f64, f64)> + '_ {
        self.parts.iter().map(|(n, v, blur)| (v / f64::from((*n).max(1)), blur / f64::from((*n).max(1))))
    }

    /// Pixels with a surface.
    pub fn pixels(&self) -> f64 {
        self.pixels as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_hold_the_means_of_their_pixels() {
        let mut overview = Overview::new(Size::new(4, 6), 3);
        assert_eq!(overview.size, Size::new(2, 3));
        for y in 0..4 {
            let row: Vec<f64> = (0..6).map(|x| f64::from(10 * (y / 2) + x / 2)).collect();
            overview.add(y as usize, &row, |v| 2.0 * v);
            overview.add(y as usize, &[f64::NAN; 6], |v| v);
        }
        assert_eq!(overview.pixels(), 24.0, "without pixels that have no surface");
        let means: Vec<_> = overview.means().collect();
        assert_eq!(means[..3], [(0.0, 0.0), (1.0, 2.0), (2.0, 4.0)]);
        assert_eq!(means[3..], [(10.0, 20.0), (11.0, 22.0), (12.0, 24.0)]);
        assert_eq!((overview.sharp, overview.blur_px), (4, 4.0 * 2.0 * 36.0));
        assert_eq!(Overview::new(Size::new(2, 2), 400).size, Size::new(2, 2));
    }
}
