//! Extrapolation of a surface beyond its pixels: push-pull over a pyramid that is aligned to the film.
//!
//! With the weight w in 0 to 1 and the values x (light, vergence) of a sample:
//!
//!     pull, fine to coarse, over 2 × 2 samples      x' = Σ(w x)/Σw,   w' = min(1, Σw)
//!     push, coarse to fine                          x ← w x + (1 − w) up(x')
//! up interpolates bilinearly (weights 9/16, 3/16, 3/16, 1/16) between the coarse samples that have a value. Level l has one sample per 2^l × 2^l film
//! pixels, the first one at film pixel 0. With L = ⌈log2(2 reach)⌉ levels every pixel within `reach` of a known one gets a value, which depends on
//! pixels less than 2·2^L away: a result depends neither on tiles nor on regions of the film.
//!
//! Source: Gortler et al., "The lumigraph", SIGGRAPH 1996, section 3.4.2; Kraus and Strengert, "Pyramid filters based on bilinear interpolation",
//! GRAPP 2007. Executable form in f64: tests/golden/depth/hidden_surface.py.

use crate::geometry::Rect;
use crate::remap::resize_exact;

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

/// Samples of a level.
#[derive(Debug, Default)]
struct Level {
    w: Vec<f32>,
    /// Weight times light, weight times vergence.
    x: [Vec<f32>; 2],
}

/// The levels of an extrapolation on a film rectangle.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Pyramid {
    /// Samples of every level that there are: those of the film with its margin, completed to whole samples of the last level.
    all: Vec<Rect>,
    /// Samples of every level on which the rectangle depends.
    needed: Vec<Rect>,
}

/// Light, vergence and whether there is a value, of a pixel.
pub(super) type Extrapolated = (f32, f32, bool);

/// Number of levels for a reach of `reach` px.
pub(super) fn levels(reach: usize) -> u32 {
    (2 * reach.max(1)).next_power_of_two().trailing_zeros()
}

impl Pyramid {
    /// Of `levels` levels, for the pixels `rect` of `film`, the film with its margin.
    pub(super) fn new(film: Rect, rect: Rect, levels: u32) -> Self {
        let side = 1i64 << levels;
        let whole = |first: i64, end: i64| (first.div_euclid(side) * side, -(-end).div_euclid(side) * side);
        let (rows, cols) = (whole(film.y, film.bottom()), whole(film.x, film.right()));
        let samples =
            |level: u32| from_ends((rows.0 >> level, rows.1 >> level), (cols.0 >> level, cols.1 >> level));
        let all: Vec<Rect> = (0..=levels).map(samples).collect();
        // A sample needs the coarse one that it lies in and the one beside it.
        let coarse = |first: i64, end: i64| ((first - 1).div_euclid(2), end.div_euclid(2) + 1);
        let mut needed = vec![rect];
        for of_level in &all[1..] {
            let fine = needed[needed.len() - 1];
            let more = from_ends(coarse(fine.y, fine.bottom()), coarse(fine.x, fine.right()));
            needed.push(more.intersect(*of_level));
        }
        Self { all, needed }
    }

    /// The pixels whose values are needed.
    pub(super) fn pixels(&self) -> Rect {
        self.under(0)
    }

    /// Samples of `level` under the samples that are needed of the last one.
    fn under(&self, level: usize) -> Rect {
        let last = self.needed.len() - 1;
        let (side, rect) = (1i64 << (last - level), self.needed[last]);
        from_ends((rect.y * side, rect.bottom() * side), (rect.x * side, rect.right() * side))
    }
}

fn from_ends(rows: (i64, i64), cols: (i64, i64)) -> Rect {
    Rect::new(rows.0, cols.0, (rows.1 - rows.0) as usize, (cols.1 - cols.0) as usize)
}

/// Buffers of an extrapolation.
#[derive(Debug, Default)]
pub(super) struct Extrapolation {
    levels: Vec<Level>,
}

impl Extrapolation {
    /// Extrapolates `known` on the film rectangle `from`, outside of which nothing is known; calls `each` with the index in the rectangle of `pyramid` and
    /// its value for every pixel.
    pub(super) fn run(
        &mut self,
        known: &Known,
        from: Rect,
        pyramid: &Pyramid,
        mut each: impl FnMut(usize, Extrapolated),
    ) {
        let last = pyramid.needed.len() - 1;
        self.levels.resize_with(last.max(self.levels.len()), Level::default);
        for level in 1..=last {
            let rect = pyramid.under(level);
            match level {
                1 => self.levels[0].pull(rect, |y, x| known.sample(from, y, x)),
                _ => {
                    let (fine, coarse) = self.levels.split_at_mut(level - 1);
                    let (fine, of_fine) = (&fine[level - 2], pyramid.under(level - 1));
                    coarse[0].pull(rect, |y, x| fine.sample(of_fine, y, x));
                }
            }
        }
        for level in (1..last).rev() {
            let (fine, coarse) = self.levels.split_at_mut(level);
            let (fine, of_fine) = (&mut fine[level - 1], pyramid.under(level));
            let up = Up { level: &coarse[0], rect: pyramid.under(level + 1), all: pyramid.all[level + 1] };
            let needed = pyramid.needed[level];
            for y in needed.y..needed.bottom() {
                for x in needed.x..needed.right() {
                    let Some(value) = up.at(y, x) else { continue };
                    let i = index(of_fine, y, x);
                    let missing = 1.0 - fine.w[i];
                    fine.x[0][i] += missing * value[0];
                    fine.x[1][i] += missing * value[1];
                    fine.w[i] = 1.0;
                }
            }
        }
        let up = Up { level: &self.levels[0], rect: pyramid.under(1), all: pyramid.all[1] };
        let rect = pyramid.needed[0];
        for y in rect.y..rect.bottom() {
            for x in rect.x..rect.right() {
                let (w, light, vergence) = known.sample(from, y, x);
                let value = match up.at(y, x) {
                    Some(up) => (light + (1.0 - w) * up[0], vergence + (1.0 - w) * up[1], true),
                    None if w > 0.0 => (light / w, vergence / w, true),
                    None => (0.0, 0.0, false),
                };
                each(index(rect, y, x), value);
            }
        }
    }
}

fn index(rect: Rect, y: i64, x: i64) -> usize {
    (y - rect.y) as usize * rect.width + (x - rect.x) as usize
}

impl Known {
    /// Weight, weight times light and weight times vergence of a pixel.
    fn sample(&self, from: Rect, y: i64, x: i64) -> (f32, f32, f32) {
        if !from.contains(Rect::new(y, x, 1, 1)) {
            return (0.0, 0.0, 0.0);
        }
        let i = index(from, y, x);
        let a = self.a[i];
        // Sheets that cover a pixel together may sum to more than 1.
        let scale = if a > 1.0 { 1.0 / a } else { 1.0 };
        (a.min(1.0), self.c[i] * scale, self.v[i] * scale)
    }
}

impl Level {
    fn sample(&self, rect: Rect, y: i64, x: i64) -> (f32, f32, f32) {
        let i = index(rect, y, x);
        (self.w[i], self.x[0][i], self.x[1][i])
    }

    /// Computes the samples `rect` from the finer ones.
    fn pull(&mut self, rect: Rect, fine: impl Fn(i64, i64) -> (f32, f32, f32)) {
        let n = rect.size().pixels();
        resize_exact(&mut self.w, n);
        self.x.iter_mut().for_each(|x| resize_exact(x, n));
        for y in rect.y..rect.bottom() {
            for x in rect.x..rect.right() {
                let (fy, fx) = (2 * y, 2 * x);
                let four = [fine(fy, fx), fine(fy, fx + 1), fine(fy + 1, fx), fine(fy + 1, fx + 1)];
                let sum = four.iter().fold((0.0, 0.0, 0.0), |s, v| (s.0 + v.0, s.1 + v.1, s.2 + v.2));
                let saturated = sum.0.min(1.0);
                let scale = if sum.0 > 0.0 { saturated / sum.0 } else { 0.0 };
                let i = index(rect, y, x);
                (self.w[i], self.x[0][i], self.x[1][i]) = (saturated, sum.1 * scale, sum.2 * scale);
            }
        }
    }
}

/// Bilinear interpolation of a level to twice the samples.
struct Up<'a> {
    level: &'a Level,
    rect: Rect,
    all: Rect,
}

impl Up<'_> {
    /// The value at a fine sample; `None` if no coarse one beside it has a value.
    fn at(&self, y: i64, x: i64) -> Option<[f32; 2]> {
        let pair = |at: i64, first: i64, end: i64| {
            let (own, beside) = (at.div_euclid(2), if at.rem_euclid(2) == 0 { -1 } else { 1 });
            (own, (own + beside).clamp(first, end - 1))
        };
        let (rows, cols) = (pair(y, self.all.y, self.all.bottom()), pair(x, self.all.x, self.all.right()));
        let around =
            [(rows.0, cols.0, 9.0), (rows.0, cols.1, 3.0), (rows.1, cols.0, 3.0), (rows.1, cols.1, 1.0)];
        let (mut share, mut sum) = (0.0, [0.0; 2]);
        for (y, x, weight) in around {
            let (w, light, vergence) = self.level.sample(self.rect, y, x);
            if w > 0.0 {
                share += weight;
                sum[0] += weight * (light / w);
                sum[1] += weight * (vergence / w);
            }
        }
        (share > 0.0).then(|| sum.map(|v| v / share))
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

    fn values(known: &Known, from: Rect, film: Rect, rect: Rect, levels: u32) -> Vec<Extrapolated> {
        let mut out = vec![(0.0, 0.0, false); rect.size().pixels()];
        let pyramid = Pyramid::new(film, rect, levels);
        Extrapolation::default().run(known, from, &pyramid, |i, v| out[i] = v);
        out
    }

    #[test]
    fn a_uniform_surface_is_continued_over_the_reach() {
        let film = Rect::new(-7, -7, 120, 130);
        let hole = |y: i64, x: i64| (30..62).contains(&y) && (40..72).contains(&x);
        let known = of(film, |y, x| if hole(y, x) { (0.0, 0.0, 0.0) } else { (1.0, 0.75, 0.5) });
        for (light, vergence, found) in values(&known, film, film, film, levels(16)) {
            assert!(found && (light - 0.75).abs() < 1e-6 && (vergence - 0.5).abs() < 1e-6);
        }
        assert_eq!([0, 1, 2, 16, 17].map(levels), [1, 1, 2, 5, 6]);
    }

    #[test]
    fn a_part_of_the_film_has_the_values_of_the_whole() {
        let film = Rect::new(-9, -9, 150, 170);
        let noise = |y: i64, x: i64| ((y * 37 + x * 101 + (y * x) % 13) % 17) as f32 / 17.0;
        let known_at = |y: i64, x: i64| (y + 2 * x) % 23 < 3;
        let value = |y, x| {
            let a = if known_at(y, x) { 0.1 + noise(y, x) } else { 0.0 };
            (a, a * noise(x, y), a * noise(y + 1, x))
        };
        let whole = of(film, value);
        let levels = levels(9);
        let expected = values(&whole, film, film, film, levels);
        for part in [Rect::new(40, 50, 31, 29), Rect::new(-9, -9, 20, 11), Rect::new(130, 140, 11, 21)] {
            let from = Pyramid::new(film, part, levels).pixels().intersect(film);
            assert!(from.size().pixels() < film.size().pixels());
            let found = values(&of(from, value), from, film, part, levels);
            for y in 0..part.height {
                let i = index(film, part.y + y as i64, part.x);
                assert_eq!(&found[y * part.width..][..part.width], &expected[i..][..part.width], "{part}");
            }
        }
    }
}
