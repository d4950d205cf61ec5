//! Centre of a mark to a few hundredths of a pixel: lines through the borders of its three squares.
//!
//! Straight lines stay straight in perspective, so that the image of a square's centre is the intersection of the diagonals of its image. (The
//! centroid of the image is not: it differs by side²/12 times the gradient of the scale.) In oblique coordinates (s, t) along the mark's own axes,
//! which lead to its two neighbours,
//! ```text
//! s_border(t) = s₀ + ∫ (v(s, t) − v_out)/(v_in − v_out) ds,   over s₀ .. s₁, half of it on each side of the border as found before
//! ```
//! on lines of constant t over the middle 3/4 of a side; v_in and v_out half a module from the border or farther. A line is fitted to each side, about the
//! expected border and then about the line. The centre is the mean of those of the three squares, weighted by their sides. An error in the level of a ring moves
//! its two borders in opposite directions, and cancels in part; the error by blur is that of all four sides of a square, and cancels. Levels are of each line,
//! so that shading cancels.

use crate::geometry::Size;

/// Samples per pixel along a line.
const SAMPLES: f64 = 4.0;
/// Largest length over which a border is integrated in each pass, px to each side: a long one reaches a border that is off, a short one has less noise.
const MAX_HALF_PX: [f64; 3] = [f64::INFINITY, 3.0, 1.5];
/// Part of a side that is used.
const USED: f64 = 0.75;

/// A mark's surroundings: its unit vectors (row, column) along the chart's columns and rows, and the distances of the borders along them.
pub(super) struct Axes {
    pub(super) centre: (f64, f64),
    pub(super) u: (f64, f64),
    pub(super) v: (f64, f64),
    pub(super) half_u_px: f64,
    pub(super) half_v_px: f64,
}

/// The centre (row, column) of a mark; `None` if its borders have no contrast or leave the picture.
pub(super) fn centre(luma: &[f32], size: Size, axes: &Axes) -> Option<(f64, f64)> {
    let at = |s: f64, t: f64| {
        let row = axes.centre.0 + s * axes.u.0 + t * axes.v.0;
        let column = axes.centre.1 + s * axes.u.1 + t * axes.v.1;
        sample(luma, size, row, column)
    };
    let (mut s, mut t, mut weights) = (0.0, 0.0, 0.0);
    for half_modules in [1.5, 2.5, 3.5] {
        let middle = square(half_modules, axes.half_u_px, axes.half_v_px, at)?;
        s += half_modules * middle.0;
        t += half_modules * middle.1;
        weights += half_modules;
    }
    let (s, t) = (s / weights, t / weights);
    let centre = (axes.centre.0 + s * axes.u.0 + t * axes.v.0, axes.centre.1 + s * axes.u.1 + t * axes.v.1);
    (centre.0.is_finite() && centre.1.is_finite()).then_some(centre)
}

/// Intersection (s, t) of the diagonals of one of the squares; `a` and `b` are the distances of the outer square's borders.
fn square(half_modules: f64, a: f64, b: f64, at: impl Fn(f64, f64) -> Option<f64>) -> Option<(f64, f64)> {
    // s = line(t) and t = line(s).
    let right = side(half_modules, a, b, &at)?;
    let left = side(half_modules, a, b, |s, t| at(-s, t))?.map(|v| -v);
    let below = side(half_modules, b, a, |t, s| at(s, t))?;
    let above = side(half_modules, b, a, |t, s| at(s, -t))?.map(|v| -v);
    let corner = |s: [f64; 2], t: [f64; 2]| {
        // s = s₀ + s₁·t, t = t₀ + t₁·s
        let x = (s[0] + s[1] * t[0]) / (1.0 - s[1] * t[1]);
        (x, t[0] + t[1] * x)
    };
    let (p, q) = (corner(left, above), corner(right, below));
    let (g, h) = (corner(right, above), corner(left, below));
    // p + k·(q − p) on the line g h.
    let (d, e) = ((q.0 - p.0, q.1 - p.1), (h.0 - g.0, h.1 - g.1));
    let k = ((g.0 - p.0) * e.1 - (g.1 - p.1) * e.0) / (d.0 * e.1 - d.1 * e.0);
    Some((p.0 + k * d.0, p.1 + k * d.1))
}

/// Distance of a border from the centre as a line over the position along it: [at 0, per px].
fn side(
    half_modules: f64,
    outer_px: f64,
    along_px: f64,
    at: impl Fn(f64, f64) -> Option<f64>,
) -> Option<[f64; 2]> {
    let (module_px, length) = (outer_px / 3.5, USED * along_px * half_modules / 3.5);
    let lines = (2.0 * length).ceil().max(4.0) as usize;
    let mut line = [half_modules * module_px, 0.0];
    for longest_px in MAX_HALF_PX {
        let places = (0..=lines).map(|i| length * (2.0 * i as f64 / lines as f64 - 1.0));
        let reach = (0.5 * module_px).min(longest_px);
        let border = |t: f64| {
            let expected = line[0] + line[1] * t;
            Some((t, border(half_modules, module_px, expected, reach, |s| at(s, t))?))
        };
        // Lines on which noise or dirt hides the border are left out, up to a quarter of them.
        let borders: Vec<(f64, f64)> = places.filter_map(border).collect();
        if borders.len() < (3 * lines).div_ceil(4) {
            return None;
        }
        line = fit(&borders);
    }
    Some(line)
}

/// Least squares of a straight line: [at 0, slope].
fn fit(points: &[(f64, f64)]) -> [f64; 2] {
    let n = points.len() as f64;
    let mean = |f: fn(&(f64, f64)) -> f64| points.iter().map(f).sum::<f64>() / n;
    let (mt, ms) = (mean(|p| p.0), mean(|p| p.1));
    let (tt, ts) =
        points.iter().fold((0.0, 0.0), |(a, b), (t, s)| (a + (t - mt) * (t - mt), b + (t - mt) * (s - ms)));
    [ms - ts / tt * mt, ts / tt]
}

/// Position of a border on one line, about `expected` and within `reach` of it.
fn border(
    half_modules: f64,
    module: f64,
    expected: f64,
    reach: f64,
    at: impl Fn(f64) -> Option<f64>,
) -> Option<f64> {
    let mean = |from: f64, to: f64| {
        let n = ((to - from) * SAMPLES).ceil().max(1.0);
        let step = (to - from) / n;
        let sum: f64 = (0..n as usize).map(|i| at(from + (i as f64 + 0.5) * step)).sum::<Option<f64>>()?;
        Some(sum / n)
    };
    // Modules from the border: the innermost square and the surround are wider than a ring.
    let within = if half_modules < 2.0 { (-1.2, -0.5) } else { (-0.7, -0.3) };
    let beyond = if half_modules > 3.0 { (0.5, 1.3) } else { (0.3, 0.7) };
    let inner = mean(expected + within.0 * module, expected + within.1 * module)?;
    let outer = mean(expected + beyond.0 * module, expected + beyond.1 * module)?;
    let share = (mean(expected - reach, expected + reach)? - outer) / (inner - outer);
    let border = expected - reach + 2.0 * reach * share;
    ((border - expected).abs() <= module).then_some(border)
}

/// The picture at a position, linear between pixel centres.
fn sample(luma: &[f32], size: Size, row: f64, column: f64) -> Option<f64> {
    let (y, x) = (row.floor(), column.floor());
    if y < 0.0 || x < 0.0 || y + 1.0 >= size.height as f64 || x + 1.0 >= size.width as f64 {
        return None;
    }
    let (fy, fx) = (row - y, column - x);
    let first = y as usize * size.width + x as usize;
    let pixel = |i: usize| f64::from(luma[i]);
    let line = |i: usize| pixel(i) + fx * (pixel(i + 1) - pixel(i));
    let (top, bottom) = (line(first), line(first + size.width));
    Some(top + fy * (bottom - top))
}
