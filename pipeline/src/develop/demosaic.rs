//! Demosaicing: every plane at every pixel, from a mosaic in which each pixel has one.
//!
//! *Malvar*: H. S. Malvar, L. He, R. Cutler, "High-quality linear interpolation for demosaicing of Bayer-patterned color images", ICASSP
//! 2004, figure 2 (gains 1/2, 5/8, 3/4); 5 × 5 pixels, Bayer patterns only.
//! *Bilinear*: a pixel's own value where it has the plane, else the mean of its neighbours within one period that have it, weighted by the
//! triangle (1 − |dy|/Py)·(1 − |dx|/Px); any pattern. Of a Bayer pattern it is the usual bilinear interpolation.
//! *Superpixel*: a period becomes one pixel, each plane the mean of its pixels.
//! Rows come with a halo; beyond the raw they are mirrored about the outermost pixel's centre, which keeps a pattern of period 2 in step.

use super::error::DevelopError;

/// How planes are interpolated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Demosaic {
    /// Gradient-corrected, for Bayer patterns.
    Malvar,
    /// Linear over one period, for any pattern.
    Bilinear,
    /// One pixel per period.
    Superpixel,
}

/// Planes of a mosaic's pixels over one period.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PlanePattern {
    /// Rows of a period.
    pub rows: usize,
    /// Columns of a period.
    pub columns: usize,
    /// Plane numbers, row by row.
    pub planes: Vec<usize>,
    /// Number of planes.
    pub count: usize,
}

impl PlanePattern {
    /// Plane of a pixel.
    pub fn at(&self, row: usize, column: usize) -> usize {
        self.planes[row % self.rows * self.columns + column % self.columns]
    }

    /// Whether it is a Bayer pattern: planes 0, 1, 1, 2 with plane 1 on a diagonal.
    pub fn is_bayer(&self) -> bool {
        let p = &self.planes;
        let diagonal =
            |a: usize, b: usize, c: usize, d: usize| p[a] == 1 && p[b] == 1 && p[c] + p[d] == 2 && p[c] != 1;
        (self.rows, self.columns, self.count) == (2, 2, 3) && (diagonal(0, 3, 1, 2) || diagonal(1, 2, 0, 3))
    }

    /// Fails if `method` cannot be applied.
    pub(super) fn check(&self, method: Demosaic) -> Result<(), DevelopError> {
        match method == Demosaic::Malvar && !self.is_bayer() {
            true => {
                Err(DevelopError::NotBayer { rows: self.rows, columns: self.columns, planes: self.count })
            }
            false => Ok(()),
        }
    }

    /// Pixels beyond a pixel that `method` reads.
    pub fn halo(&self, method: Demosaic) -> usize {
        match method {
            Demosaic::Malvar => 2,
            Demosaic::Bilinear => self.rows.max(self.columns) - 1,
            Demosaic::Superpixel => 0,
        }
    }
}

/// Index of pixel `i` of `n`, mirrored about the centres of the outermost ones.
pub fn mirrored(i: i64, n: usize) -> usize {
    if n == 1 {
        return 0;
    }
    let period = 2 * (n as i64 - 1);
    let k = i.rem_euclid(period);
    (if k < n as i64 { k } else { period - k }) as usize
}

/// One row of a Bayer mosaic. `rows`: five rows, each with two pixels of halo on either side; `out`: a row of each plane.
pub(super) fn malvar_row(
    rows: [&[f32]; 5],
    pattern: &PlanePattern,
    (y, x0): (usize, usize),
    out: &mut [Vec<f32>],
    scratch: &mut [Vec<f32>; 4],
) {
    let n = rows[0].len() - 4;
    let [a, b, c, d, e] = rows.map(|r| &r[..n + 4]);
    for buffer in scratch.iter_mut() {
        buffer.resize(n, 0.0);
    }
    let [green, beside, above, across] = scratch.each_mut().map(|v| &mut v[..n]);
    for i in 0..n {
        let (v, up2, down2, left2, right2) = (c[i + 2], a[i + 2], e[i + 2], c[i], c[i + 4]);
        let (up, down, left, right) = (b[i + 2], d[i + 2], c[i + 1], c[i + 3]);
        let cross2 = up2 + down2 + left2 + right2;
        let diagonal = b[i + 1] + b[i + 3] + d[i + 1] + d[i + 3];
        green[i] = (4.0 * v + 2.0 * (up + down + left + right) - cross2) / 8.0;
        beside[i] =
            (5.0 * v + 4.0 * (left + right) - diagonal - (left2 + right2) + (up2 + down2) / 2.0) / 8.0;
        above[i] = (5.0 * v + 4.0 * (up + down) - diagonal - (up2 + down2) + (left2 + right2) / 2.0) / 8.0;
        across[i] = (6.0 * v + 2.0 * diagonal - 1.5 * cross2) / 8.0;
    }
    // The colour of this row beside green.
    let of_row = if pattern.at(y, 0) == 1 { pattern.at(y, 1) } else { pattern.at(y, 0) };
    let first_green = usize::from(pattern.at(y, x0) != 1);
    for i in (first_green..n).step_by(2) {
        out[1][i] = c[i + 2];
        out[of_row][i] = beside[i];
        out[2 - of_row][i] = above[i];
    }
    for i in (1 - first_green..n).step_by(2) {
        out[of_row][i] = c[i + 2];
        out[1][i] = green[i];
        out[2 - of_row][i] = across[i];
    }
}

/// Neighbours of a pixel that have a plane: row and column offset, weight.
type Taps = Vec<(i32, i32, f32)>;

/// Bilinear interpolation of a pattern.
#[derive(Clone, Debug)]
pub(super) struct Bilinear {
    pattern: PlanePattern,
    /// Of each phase of the pattern and plane: neighbours and the sum of their weights.
    taps: Vec<(Taps, f32)>,
}

impl Bilinear {
    pub(super) fn new(pattern: &PlanePattern) -> Self {
        let mut taps = Vec::new();
        for phase in 0..pattern.rows * pattern.columns {
            let at = (phase / pattern.columns, phase % pattern.columns);
            for plane in 0..pattern.count {
                // Far from the border: nothing is mirrored.
                let far = |k: usize, period: usize| k + period;
                let own = |y: i64, x: i64| pattern.at(y as usize, x as usize);
                let centre = (far(at.0, pattern.rows), far(at.1, pattern.columns));
                taps.push(taps_of(pattern, plane, centre, own));
            }
        }
        Self { pattern: pattern.clone(), taps }
    }

    /// One row of a mosaic of `size` (rows, columns) pixels. `rows`: the row `y` and those of the halo above and below, each from `halo`
    /// pixels before column `x0`; `out`: a row of each plane.
    pub(super) fn row(
        &self,
        rows: &[&[f32]],
        (y, x0): (usize, usize),
        size: (usize, usize),
        out: &mut [Vec<f32>],
    ) {
        let p = &self.pattern;
        let halo = rows.len() / 2;
        let inside = |i: usize, n: usize, period: usize| i + 1 >= period && i + period <= n;
        let inner_row = inside(y, size.0, p.rows);
        for i in 0..rows[0].len() - 2 * halo {
            let x = x0 + i;
            let own = p.at(y, x);
            let inner = inner_row && inside(x, size.1, p.columns);
            let phase = y % p.rows * p.columns + x % p.columns;
            for (plane, out) in out.iter_mut().enumerate() {
                if plane == own {
                    out[i] = rows[halo][i + halo];
                    continue;
                }
                let at_border;
                let (taps, sum) = match inner {
                    true => &self.taps[phase * p.count + plane],
                    false => {
                        let mirrored = |a: i64, b: i64| p.at(mirrored(a, size.0), mirrored(b, size.1));
                        at_border = taps_of(p, plane, (y, x), mirrored);
                        &at_border
                    }
                };
                let value = |(dy, dx, w): &(i32, i32, f32)| {
                    let row = rows[(halo as i64 + i64::from(*dy)) as usize];
                    w * row[((i + halo) as i64 + i64::from(*dx)) as usize]
                };
                out[i] = taps.iter().map(value).sum::<f32>() / sum;
            }
        }
    }
}

fn taps_of(
    p: &PlanePattern,
    plane: usize,
    (y, x): (usize, usize),
    plane_at: impl Fn(i64, i64) -> usize,
) -> (Taps, f32) {
    let (py, px) = (p.rows as i64, p.columns as i64);
    let mut taps = Vec::new();
    for dy in 1 - py..py {
        for dx in 1 - px..px {
            if plane_at(y as i64 + dy, x as i64 + dx) == plane {
                let weight = (1.0 - dy.abs() as f64 / py as f64) * (1.0 - dx.abs() as f64 / px as f64);
                taps.push((dy as i32, dx as i32, weight as f32));
            }
        }
    }
    let sum = taps.iter().map(|t| t.2).sum();
    (taps, sum)
}

/// One row of superpixels. `rows`: the rows of one period; `out`: a row of each plane.
pub(super) fn superpixel_row(rows: &[&[f32]], pattern: &PlanePattern, out: &mut [Vec<f32>]) {
    let p = pattern;
    for (plane, out) in out.iter_mut().enumerate() {
        let own: Vec<(usize, usize)> = (0..p.rows * p.columns)
            .filter(|k| p.planes[*k] == plane)
            .map(|k| (k / p.columns, k % p.columns))
            .collect();
        for (i, out) in out.iter_mut().enumerate() {
            let sum: f32 = own.iter().map(|(y, x)| rows[*y][i * p.columns + x]).sum();
            *out = sum / own.len() as f32;
        }
    }
}
