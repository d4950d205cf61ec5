//! Extrapolation of a surface beyond its pixels: means over ever wider surroundings, the nearest known pixels first.
//!
//! With the weight w in 0 to 1 and the values x (light, vergence) of a film pixel, level 0 being the known pixels, and the filter
//! B_l = [1 2 1]/4 of rows and of columns whose taps are 2^l pixels apart:
//!
//! ```text
//! w_l+1   = min(1, 4·(B_l ∗ w_l)),   x_l+1 = (B_l ∗ (w_l x_l))/(B_l ∗ w_l)
//! value   = Σ_l T_l w_l x_l/Σ_l T_l w_l,   T_l = Π_{k<l} (1 − w_k)
//! ```
//! No level has fewer samples than the film: a result follows a shift of the surface by whole pixels, wherever the film and its tiles begin. With
//! L = ⌈log2(reach + 1)⌉ levels every pixel within `reach` of a known one gets a value, which depends on pixels at most 2^L − 1 rows and columns away.
//!
//! Sources: Knutsson and Westin, "Normalized and differential convolution", CVPR 1993; Shensa, "The discrete wavelet transform: wedding the à trous and
//! Mallat algorithms", IEEE Transactions on Signal Processing 40, 1992. Executable form in f64: tests/golden/depth/hidden_surface.py.

use super::planes::for_each_row;
use crate::buffer::resize_exact;
use crate::geometry::{Rect, Size};

/// Pixels of the surface that is extrapolated, on a film rectangle.
#[derive(Debug, Default)]
pub(super) struct Known {
    /// Share of each pixel.
    pub(super) a: Vec<f32>,
    /// Share times light.
    pub(super) c: Vec<f32>,
    /// Share times vergence, 1/m.
    pub(super) v: Vec<f32>,
}

/// Light, vergence and whether there is a value, of a pixel.
pub(super) type Extrapolated = (f32, f32, bool);

/// Gain of the weights from level to level.
const GAIN: f32 = 4.0;

/// Number of levels for a reach of `reach` px.
pub(super) fn levels(reach: usize) -> u32 {
    (reach.max(1) + 1).next_power_of_two().trailing_zeros()
}

/// Rows and columns from a pixel to those that its value depends on, at most, with `levels` levels.
pub(super) const fn support(levels: u32) -> usize {
    (1 << levels) - 1
}

/// Buffers of an extrapolation.
#[derive(Debug, Default)]
pub(super) struct Extrapolation {
    /// Weight, weight times light and weight times vergence of the present level.
    level: [Vec<f32>; 3],
    /// A plane of it, filtered along its rows.
    along: Vec<f32>,
    /// T, and the sums of T·w, T·w·light and T·w·vergence.
    passing: Vec<f32>,
    sums: [Vec<f32>; 3],
}

impl Extrapolation {
    /// Extrapolates `known` on the film rectangle `from`, which contains `part` grown by the support of `levels` levels, to the pixels of `part`; calls
    /// `each` with the index in `part` and the value of each.
    pub(super) fn run(
        &mut self,
        known: &Known,
        from: Rect,
        (part, levels): (Rect, u32),
        mut each: impl FnMut(usize, Extrapolated),
    ) {
        let mut beyond = support(levels);
        self.begin(known, from, part.grown(beyond));
        let n = part.size().pixels();
        for sum in self.sums.iter_mut().chain([&mut self.passing]) {
            resize_exact(sum, n);
            sum.fill(0.0);
        }
        self.passing.fill(1.0);
        self.add(part, beyond);
        for level in 0..levels {
            let step = 1 << level;
            let size = part.grown(beyond).size();
            self.level.iter_mut().for_each(|plane| smooth(plane, size, step, &mut self.along));
            beyond -= step;
            self.saturate();
            self.add(part, beyond);
        }
        let [weight, light, vergence] = &self.sums;
        for (i, w) in weight.iter().enumerate() {
            let is_found = *w > 0.0;
            each(i, if is_found { (light[i] / w, vergence[i] / w, true) } else { (0.0, 0.0, false) });
        }
    }

    /// Level 0 on `rect`.
    fn begin(&mut self, known: &Known, from: Rect, rect: Rect) {
        let [w, light, vergence] = &mut self.level;
        for plane in [&mut *w, &mut *light, &mut *vergence] {
            resize_exact(plane, rect.size().pixels());
        }
        for_each_row(from, rect, |first, to, width| {
            for (i, k) in (first..first + width).zip(to..) {
                let a = known.a[i];
                // Sheets that cover a pixel together may sum to more than 1.
                let scale = if a > 1.0 { 1.0 / a } else { 1.0 };
                (w[k], light[k], vergence[k]) = (a.min(1.0), known.c[i] * scale, known.v[i] * scale);
            }
        });
    }

    /// Weights of filtered ones.
    fn saturate(&mut self) {
        let [w, light, vergence] = &mut self.level;
        for (w, (light, vergence)) in w.iter_mut().zip(light.iter_mut().zip(vergence)) {
            let saturated = (GAIN * *w).min(1.0);
            let scale = if *w > 0.0 { saturated / *w } else { 0.0 };
            (*w, *light, *vergence) = (saturated, *light * scale, *vergence * scale);
        }
    }

    /// Adds the present level, on `part` grown by `beyond`, to the sums.
    fn add(&mut self, part: Rect, beyond: usize) {
        for_each_row(part.grown(beyond), part, |first, to, width| {
            for (i, k) in (first..first + width).zip(to..) {
                let passing = self.passing[k];
                for (sum, level) in self.sums.iter_mut().zip(&self.level) {
                    sum[k] += passing * level[i];
                }
                self.passing[k] = passing * (1.0 - self.level[0][i]);
            }
        });
    }
}

/// Filters `plane` of `size` pixels by [1 2 1]/4 along rows and columns, taps `step` px apart: it then has `step` fewer pixels at each side.
fn smooth(plane: &mut Vec<f32>, size: Size, step: usize, along: &mut Vec<f32>) {
    let (width, height) = (size.width - 2 * step, size.height - 2 * step);
    let filter = |to: &mut [f32], before: &[f32], at: &[f32], after: &[f32]| {
        for (to, (at, ends)) in to.iter_mut().zip(at.iter().zip(before.iter().zip(after))) {
            *to = 0.5 * at + 0.25 * (ends.0 + ends.1);
        }
    };
    resize_exact(along, size.height * width);
    for (row, to) in plane.chunks_exact(size.width).zip(along.chunks_exact_mut(width)) {
        filter(to, row, &row[step..], &row[2 * step..]);
    }
    resize_exact(plane, height * width);
    for (y, to) in plane.chunks_exact_mut(width).enumerate() {
        let row = |y: usize| &along[y * width..][..width];
        filter(to, row(y), row(y + step), row(y + 2 * step));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(film: Rect, value: impl Fn(i64, i64) -> (f32, f32, f32)) -> Known {
        let mut known = Known::default();
        for y in film.y..film.bottom() {
            for x in film.x..film.right() {
                let (a, c, v) = value(y, x);
                known.a.push(a);
                known.c.push(c);
                known.v.push(v);
            }
        }
        known
    }

    /// The values of `part` of a surface that `value` gives everywhere.
    fn values(value: impl Fn(i64, i64) -> (f32, f32, f32), part: Rect, levels: u32) -> Vec<Extrapolated> {
        let from = part.grown(support(levels));
        let mut out = vec![(0.0, 0.0, false); part.size().pixels()];
        Extrapolation::default().run(&of(from, value), from, (part, levels), |i, v| out[i] = v);
        out
    }

    #[test]
    fn a_uniform_surface_is_continued_over_the_reach_and_no_farther_than_its_support() {
        assert_eq!([0, 1, 2, 3, 4, 16, 31, 32].map(levels), [1, 1, 2, 2, 3, 5, 5, 6]);
        // Known left of column 20.
        let value = |_, x: i64| if x < 20 { (1.0, 0.75, 0.5) } else { (0.0, 0.0, 0.0) };
        let film = Rect::new(-7, -7, 12, 80);
        for (i, (light, vergence, found)) in values(value, film, levels(16)).into_iter().enumerate() {
            let distance = (i % 80) as i64 - 7 - 19;
            assert_eq!(found, distance <= support(levels(16)) as i64, "{distance}");
            assert!(!found || (light - 0.75).abs() < 1e-6 && (vergence - 0.5).abs() < 1e-6);
        }
    }

    /// A surface with holes.
    fn noise(y: i64, x: i64) -> (f32, f32, f32) {
        let noise = |y: i64, x: i64| ((y * 37 + x * 101 + (y * x) % 13) % 17).abs() as f32 / 17.0;
        let a = if (y + 2 * x).rem_euclid(23) < 3 { 0.1 + noise(y, x) } else { 0.0 };
        (a, a * noise(x, y), a * noise(y + 1, x))
    }

    #[test]
    fn a_part_of_the_film_has_the_values_of_the_whole() {
        let (film, levels) = (Rect::new(-9, -9, 90, 110), levels(9));
        let whole = values(noise, film, levels);
        for part in [Rect::new(40, 50, 31, 29), Rect::new(-9, -9, 20, 11), Rect::new(61, 71, 20, 30)] {
            let found = values(noise, part, levels);
            for y in 0..part.height {
                let first = (part.y - film.y) as usize + y;
                let i = first * film.width + (part.x - film.x) as usize;
                assert_eq!(&found[y * part.width..][..part.width], &whole[i..][..part.width], "{part}");
            }
        }
    }

    #[test]
    fn a_surface_that_moves_by_whole_pixels_takes_its_values_along() {
        let (film, levels) = (Rect::new(3, 5, 40, 50), levels(13));
        let expected = values(noise, film, levels);
        for (dy, dx) in [(1, 0), (0, 1), (-3, 7), (8, 16)] {
            let moved = Rect::new(film.y + dy, film.x + dx, film.height, film.width);
            assert_eq!(values(|y, x| noise(y - dy, x - dx), moved, levels), expected, "{dy}, {dx}");
        }
    }
}
