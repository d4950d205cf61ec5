//! Candidates of marks: run lengths 1:1:3:1:1 along rows, then along rays in all directions.
//!
//! Every straight line through the centre of concentric squares of sides 3, 5 and 7 crosses their borders at distances in the ratio
//! 1.5 : 2.5 : 3.5 on both sides, for any rotation and (to first order) perspective. A row that meets the pattern gives a position, which is moved
//! to the middle of its crossings; it is a mark if [`RAYS`] rays meet the ratios and opposite rays have the same length. Of the
//! positions of a row only those near no mark that is already found are followed, so that the work is that of reading the pixels.

use super::threshold::Bitmap;
use crate::real;

/// Directions of the rays of a mark, and those of them that may fail: they can cross a corner that blur has closed.
const RAYS: usize = 32;
const MAX_FAILED: usize = 3;
/// Distance of the samples along a ray, px.
const STEP_PX: f64 = 0.25;
/// Shortest run of one module, px: below it, the mean over 3 × 3 pixels removes the pattern.
const MIN_MODULE_PX: f64 = 2.0;

/// Concentric squares.
#[derive(Clone, Copy, Debug)]
pub(super) struct Mark {
    /// (row, column), within about a pixel.
    pub(super) centre: (f64, f64),
    /// Mean distance from the centre to the outer square's border, px.
    pub(super) reach_px: f64,
    /// Whether its inner square is light.
    pub(super) light: bool,
}

/// All marks of a picture.
pub(super) fn marks(map: &Bitmap) -> Vec<Mark> {
    let mut found: Vec<Mark> = Vec::new();
    for y in 0..map.size().height {
        let row = map.row(y);
        // The last five runs, oldest first, and the number of runs that ended.
        let (mut runs, mut ended, mut start) = ([0usize; 5], 0usize, 0usize);
        for x in 1..row.len() {
            if row[x] == row[x - 1] {
                continue;
            }
            runs.rotate_left(1);
            runs[4] = x - start;
            (start, ended) = (x, ended + 1);
            // The first run begins at the picture's border and may be part of a longer one.
            if ended < 6 || !is_pattern(&runs) {
                continue;
            }
            let column = (x - runs[4] - runs[3]) as f64 - runs[2] as f64 / 2.0 - 0.5;
            let (at, light) = ((y as f64, column), row[x - 1]);
            let known = |m: &Mark| real::hypot(m.centre.0 - at.0, m.centre.1 - at.1) < m.reach_px;
            if !found.iter().any(known) {
                let longest = 2.0 * runs.iter().sum::<usize>() as f64;
                found.extend(mark(map, at, light, longest).filter(|m| {
                    !found
                        .iter()
                        .any(|f| real::hypot(m.centre.0 - f.centre.0, m.centre.1 - f.centre.1) < f.reach_px)
                }));
            }
        }
    }
    found
}

/// Whether five runs are 1:1:3:1:1 within about half a module.
fn is_pattern(runs: &[usize; 5]) -> bool {
    let module = runs.iter().sum::<usize>() as f64 / 7.0;
    let near = |run: usize, modules: f64| {
        (run as f64 - modules * module).abs() <= 0.5 + 0.45 * module * modules.min(2.0)
    };
    module >= MIN_MODULE_PX && std::iter::zip(runs, [1.0, 1.0, 3.0, 1.0, 1.0]).all(|(r, m)| near(*r, m))
}

/// The mark about a position whose pixels are `light`.
fn mark(map: &Bitmap, at: (f64, f64), light: bool, longest_px: f64) -> Option<Mark> {
    let mut centre = at;
    for direction in [(1.0, 0.0), (0.0, 1.0), (1.0, 0.0)] {
        let (ahead, behind): ([f64; 3], [f64; 3]) = (
            crossings(map, centre, direction, light, longest_px)?,
            crossings(map, centre, (-direction.0, -direction.1), light, longest_px)?,
        );
        let shift = (ahead[2] - behind[2]) / 2.0;
        centre = (centre.0 + shift * direction.0, centre.1 + shift * direction.1);
    }
    // About a circle's centre r(φ) = R − δ·e(φ) for a position off by δ: the mean of r·e is −δ/2.
    for _ in 0..2 {
        let rays = rays(map, centre, light, longest_px);
        let (mut shift, mut count) = ((0.0, 0.0), 0.0);
        for i in 0..RAYS / 2 {
            if let (Some(a), Some(b)) = (rays[i], rays[i + RAYS / 2]) {
                let (sin, cos) = direction(i);
                shift = (shift.0 + (a[2] - b[2]) * sin, shift.1 + (a[2] - b[2]) * cos);
                count += 1.0;
            }
        }
        if count < (RAYS / 2 - MAX_FAILED) as f64 {
            return None;
        }
        centre = (centre.0 + shift.0 / count, centre.1 + shift.1 / count);
    }
    let rays = rays(map, centre, light, longest_px);
    let good = |r: &[f64; 3]| {
        let tolerance = 0.1 + 0.75 / r[2];
        (r[0] / r[2] - 3.0 / 7.0).abs() < tolerance && (r[1] / r[2] - 5.0 / 7.0).abs() < tolerance
    };
    let lengths: Vec<f64> = rays.iter().flatten().filter(|r| good(r)).map(|r| r[2]).collect();
    let symmetric = (0..RAYS / 2).filter(|&i| match (rays[i], rays[i + RAYS / 2]) {
        (Some(a), Some(b)) => (a[2] - b[2]).abs() < 0.15 * (a[2] + b[2]) / 2.0 + 1.0,
        _ => false,
    });
    let enough = lengths.len() >= RAYS - MAX_FAILED && symmetric.count() >= RAYS / 2 - MAX_FAILED;
    enough.then(|| Mark { centre, reach_px: lengths.iter().sum::<f64>() / lengths.len() as f64, light })
}

/// Sine and cosine of the direction of ray `i`, from +column towards +row.
fn direction(i: usize) -> (f64, f64) {
    real::sin_cos(std::f64::consts::TAU * i as f64 / RAYS as f64)
}

fn rays(map: &Bitmap, centre: (f64, f64), light: bool, longest_px: f64) -> [Option<[f64; 3]>; RAYS] {
    std::array::from_fn(|i| crossings(map, centre, direction(i), light, longest_px))
}

/// Distances from a position along a unit vector (row, column) at which the pixels change from `light` for the first `N` times; `None` if they
/// do not up to `longest_px` or the picture's border.
pub(super) fn crossings<const N: usize>(
    map: &Bitmap,
    from: (f64, f64),
    along: (f64, f64),
    light: bool,
    longest_px: f64,
) -> Option<[f64; N]> {
    let mut found = [0.0; N];
    let (mut count, mut colour) = (0, light);
    for step in 0..=(longest_px / STEP_PX) as usize {
        let s = step as f64 * STEP_PX;
        if map.at((from.0 + s * along.0, from.1 + s * along.1))? != colour {
            if step == 0 {
                return None;
            }
            found[count] = s - STEP_PX / 2.0;
            (count, colour) = (count + 1, !colour);
            if count == N {
                return Some(found);
            }
        }
    }
    None
}
