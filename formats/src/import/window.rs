//! Conversion of a PSF window from the layout of its file to that of a pack: top row first, field point on +x, odd, sum 1.
//!
//! Design programs count y upwards, a pack counts rows downwards. A window with its bottom row first is mirrored; then a rotation
//! by a multiple of 90° brings the side `outward` (away from the optical axis) to the right. Nothing is interpolated, so the
//! centroid relative to the chief ray is rotated exactly.
//!
//! An even window has no middle sample. *Pad* and *crop* are for a chief ray on sample N/2 from 0 (Zemax, Code V): a row and a
//! column of zeros are appended, or the first ones dropped. *Shift* is for a chief ray between the four middle samples: the
//! window is moved by half a sample with the weights (−1, 9, 9, −1)/16 along both axes (cubic interpolation), which keep its
//! sum, its centroid (relative to the chief ray) and its variance.

/// Order of the rows in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RowOrder {
    /// Row of largest y first.
    Top,
    /// Row of smallest y first.
    Bottom,
}

/// Side of the chief ray that points away from the optical axis, with the top row on top.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outward {
    /// Field point on +x.
    Right,
    /// Field point on −y.
    Down,
    /// Field point on −x.
    Left,
    /// Field point on +y.
    Up,
}

/// Position of the chief ray in an even window, and conversion to an odd one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EvenWindow {
    /// On sample N/2 from 0; a row and a column of zeros are appended.
    Pad,
    /// On sample N/2 from 0; the first row and column are dropped.
    Crop,
    /// Between the four middle samples; the window is moved by half a sample.
    Shift,
}

/// A window in the layout of its file.
#[derive(Clone, Debug, PartialEq)]
pub struct Window {
    /// Rows.
    pub rows: usize,
    /// Columns.
    pub columns: usize,
    /// Samples, row by row.
    pub samples: Vec<f64>,
    /// Row and column of the chief ray from 0, if stated in the file.
    pub centre: Option<(usize, usize)>,
}

/// Layout of windows in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Layout {
    /// Order of the rows.
    pub rows: RowOrder,
    /// Side of the field point.
    pub outward: Outward,
    /// Conversion of even windows.
    pub even: Option<EvenWindow>,
    /// Whether windows are made exactly symmetric about the meridian.
    pub symmetric: bool,
}

/// An odd window of sum 1.
#[derive(Clone, Debug, PartialEq)]
pub struct NormalisedWindow {
    /// Side, odd.
    pub size: usize,
    /// Samples, row down, field point on +x.
    pub samples: Vec<f32>,
}

impl Window {
    /// The window in the layout of a pack.
    ///
    /// # Errors
    /// The window is not square, or even without [`Layout::even`], or has no positive finite sum.
    pub fn normalised(mut self, layout: Layout) -> Result<NormalisedWindow, String> {
        if self.rows * self.columns != self.samples.len() || self.samples.is_empty() {
            let (count, rows, columns) = (self.samples.len(), self.rows, self.columns);
            return Err(format!("has {count} samples, expected {rows} × {columns}"));
        }
        if self.rows != self.columns {
            return Err(format!("is {} × {}, expected a square", self.rows, self.columns));
        }
        let middle = matches!(layout.even, Some(EvenWindow::Pad | EvenWindow::Crop));
        if self.centre.is_none() && self.rows.is_multiple_of(2) && middle {
            self.centre = Some((self.rows / 2, self.rows / 2));
        }
        if layout.rows == RowOrder::Bottom {
            let columns = self.columns;
            self.samples = self.samples.chunks_exact(columns).rev().flatten().copied().collect();
            self.centre = self.centre.map(|(r, c)| (self.rows - 1 - r.min(self.rows - 1), c));
        }
        let (size, samples) = self.centred(layout.even)?;
        let mut out = rotated(&samples, size, layout.outward);
        if layout.symmetric {
            out = (0..size * size)
                .map(|i| 0.5 * (out[i] + out[(size - 1 - i / size) * size + i % size]))
                .collect();
        }
        let total: f64 = out.iter().sum();
        if !(total.is_finite() && total > 0.0) {
            return Err(format!("has the sum {total}, expected a positive number"));
        }
        // Windows whose sum is already 1 keep their bits.
        let scale = if (total - 1.0).abs() <= 1e-3 { 1.0 } else { total };
        let mut samples: Vec<f32> = out.iter().map(|v| (v / scale) as f32).collect();
        let sum: f64 = samples.iter().map(|&v| f64::from(v)).sum();
        if (sum - 1.0).abs() > 1e-6 {
            samples.iter_mut().for_each(|v| *v = (f64::from(*v) / sum) as f32);
        }
        match samples.iter().all(|v| v.is_finite()) {
            true => Ok(NormalisedWindow { size, samples }),
            false => Err("has samples beyond the range of f32".into()),
        }
    }

    /// Side and samples of an odd window with the chief ray in the middle.
    fn centred(&self, even: Option<EvenWindow>) -> Result<(usize, Vec<f64>), String> {
        let n = self.rows;
        let shift = even == Some(EvenWindow::Shift);
        let (r, c) = match self.centre {
            Some(_) if shift => {
                return Err(
                    "states its centre sample; `--even-window shift` is for windows without one".into()
                );
            }
            Some((r, c)) if r < n && c < n => (r, c),
            Some((r, c)) => {
                let (r, c) = (r + 1, c + 1);
                return Err(format!(
                    "states row {r}, column {c} as its centre, outside its {n} × {n} samples"
                ));
            }
            None if n % 2 == 1 => (n / 2, n / 2),
            None if shift => return Ok((n + 3, self.half_sample())),
            None => {
                return Err(format!(
                    "is {n} × {n}, so no sample is in the middle; give the position of the chief ray by `--even-window`"
                ));
            }
        };
        let half = match even {
            Some(EvenWindow::Crop) => r.min(c).min(n - 1 - r).min(n - 1 - c),
            _ => r.max(c).max(n - 1 - r).max(n - 1 - c),
        } as isize;
        let size = 2 * half as usize + 1;
        let sample = |y: isize, x: isize| {
            let (y, x) = (y + r as isize, x + c as isize);
            let inside = (0..n as isize).contains(&y) && (0..n as isize).contains(&x);
            if inside { self.samples[y as usize * n + x as usize] } else { 0.0 }
        };
        let samples = (-half..=half).flat_map(|y| (-half..=half).map(move |x| (y, x)));
        Ok((size, samples.map(|(y, x)| sample(y, x)).collect()))
    }

    /// Moved by half a sample along both axes: N × N → (N + 3) × (N + 3).
    fn half_sample(&self) -> Vec<f64> {
        const TAPS: [f64; 4] = [-1.0 / 16.0, 9.0 / 16.0, 9.0 / 16.0, -1.0 / 16.0];
        let (n, m) = (self.rows, self.rows + 3);
        let mut wide = vec![0.0; n * m];
        for y in 0..n {
            for x in 0..n {
                for (k, tap) in TAPS.iter().enumerate() {
                    wide[y * m + x + k] += tap * self.samples[y * n + x];
                }
            }
        }
        let mut out = vec![0.0; m * m];
        for y in 0..n {
            for (k, tap) in TAPS.iter().enumerate() {
                for x in 0..m {
                    out[(y + k) * m + x] += tap * wide[y * m + x];
                }
            }
        }
        out
    }
}

/// Rotated by a multiple of 90° so that `side` is on the right.
fn rotated(from: &[f64], n: usize, side: Outward) -> Vec<f64> {
    let last = n - 1;
    (0..n * n)
        .map(|i| {
            let (r, c) = (i / n, i % n);
            from[match side {
                Outward::Right => r * n + c,
                Outward::Down => c * n + last - r,
                Outward::Left => (last - r) * n + last - c,
                Outward::Up => (last - c) * n + r,
            }]
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const LAYOUT: Layout =
        Layout { rows: RowOrder::Top, outward: Outward::Right, even: None, symmetric: false };

    fn window(n: usize, bright: &[(usize, usize, f64)]) -> Window {
        let mut samples = vec![0.0; n * n];
        bright.iter().for_each(|&(r, c, v)| samples[r * n + c] = v);
        Window { rows: n, columns: n, samples, centre: None }
    }

    fn centroid(w: &NormalisedWindow) -> (f64, f64) {
        let half = (w.size / 2) as f64;
        w.samples.iter().enumerate().fold((0.0, 0.0), |(x, y), (i, &v)| {
            let v = f64::from(v);
            (x + v * ((i % w.size) as f64 - half), y + v * ((i / w.size) as f64 - half))
        })
    }

    #[test]
    fn outward_side_is_rotated_to_the_right() {
        // A bright sample outward and a weaker one 90° clockwise from it.
        let cases = [
            (Outward::Right, (2, 4), (4, 2)),
            (Outward::Down, (4, 2), (2, 0)),
            (Outward::Left, (2, 0), (0, 2)),
            (Outward::Up, (0, 2), (2, 4)),
        ];
        for (outward, tail, mark) in cases {
            let w = window(5, &[(tail.0, tail.1, 3.0), (mark.0, mark.1, 1.0)]);
            let out = w.normalised(Layout { outward, ..LAYOUT }).unwrap();
            assert_eq!(out.samples[2 * 5 + 4], 0.75, "{outward:?}");
            assert_eq!(out.samples[4 * 5 + 2], 0.25, "{outward:?}");
        }
        let bottom = window(5, &[(0, 2, 1.0)]);
        let layout = Layout { rows: RowOrder::Bottom, outward: Outward::Down, ..LAYOUT };
        assert_eq!(bottom.normalised(layout).unwrap().samples[2 * 5 + 4], 1.0);
    }

    #[test]
    fn even_windows_become_odd_about_their_chief_ray() {
        let w = window(4, &[(2, 2, 3.0), (2, 3, 1.0)]);
        assert!(w.clone().normalised(LAYOUT).unwrap_err().contains("--even-window"));
        for (even, size) in [(EvenWindow::Pad, 5), (EvenWindow::Crop, 3)] {
            let out = w.clone().normalised(Layout { even: Some(even), ..LAYOUT }).unwrap();
            assert_eq!((out.size, centroid(&out)), (size, (0.25, 0.0)), "{even:?}");
        }
        let out = w.clone().normalised(Layout { even: Some(EvenWindow::Shift), ..LAYOUT }).unwrap();
        let (x, y) = centroid(&out);
        assert!(out.size == 7 && (x - 0.75).abs() < 1e-7 && (y - 0.5).abs() < 1e-7, "{x} {y}");
    }

    #[test]
    fn stated_centre_is_the_middle_and_outside_is_an_error() {
        let mut w = window(4, &[(2, 1, 1.0)]);
        w.centre = Some((2, 1));
        let out = w.clone().normalised(LAYOUT).unwrap();
        assert_eq!((out.size, out.samples[2 * 5 + 2]), (5, 1.0));
        let layout = Layout { rows: RowOrder::Bottom, ..LAYOUT };
        assert_eq!(centroid(&w.clone().normalised(layout).unwrap()), (0.0, 0.0));
        w.centre = Some((4, 0));
        assert!(w.normalised(LAYOUT).unwrap_err().contains("row 5, column 1"));
    }
}
