//! Values of a texture between its texels and levels.
//!
//! Texture coordinates (u, v) are 0…1 across and down, so that at a level of W × H texels the centre of texel (i, j) is at u = (i + ½)/W, v = (j + ½)/H.
//! Trilinear: between the four nearest texels of two levels. Nearest: the texel that contains the place, where the texture is magnified (level 0); it is
//! the filter for magnification alone, as `magFilter` of glTF 2.0.

use super::{Level, Pyramid, texel_of};
use crate::scene::description::Wrap;

impl Pyramid {
    /// Linear red, green, blue and alpha at `uv` and `level` (0: one texel a pixel, +1: two), which is limited to the levels that exist.
    pub fn sample(&self, uv: [f64; 2], level: f64, wrap: [Wrap; 2], nearest: bool) -> [f64; 4] {
        let last = (self.levels() - 1) as f64;
        // NaN, too, is level 0.
        let level = if level > 0.0 { level.min(last) } else { 0.0 };
        let uv = [folded(uv[0], wrap[0]), folded(uv[1], wrap[1])];
        if nearest && level == 0.0 {
            let (width, height) = self.size(0);
            let index = |k: usize, n: usize| wrapped(floor(uv[k] * n as f64) as i64, n, wrap[k]);
            return self.texel(0, index(0, width), index(1, height));
        }
        let lower = floor(level);
        let share = level - lower;
        let near = self.bilinear(lower as usize, uv, wrap);
        if share == 0.0 {
            return near;
        }
        let far = self.bilinear(lower as usize + 1, uv, wrap);
        std::array::from_fn(|c| near[c] + share * (far[c] - near[c]))
    }

    fn bilinear(&self, level: usize, uv: [f64; 2], wrap: [Wrap; 2]) -> [f64; 4] {
        let (width, height) = self.size(level);
        let ([x0, x1], tx) = neighbours(uv[0], width, wrap[0]);
        let ([y0, y1], ty) = neighbours(uv[1], height, wrap[1]);
        let places = [y0 * width + x0, y0 * width + x1, y1 * width + x0, y1 * width + x1];
        match level.checked_sub(1).and_then(|l| self.means.get(l)) {
            None => mixed(places.map(|i| self.decode(self.picture.texels[i])), tx, ty),
            Some(Level { channels: 4, values, .. }) => {
                mixed(places.map(|i| texel_of::<4>(values, i)), tx, ty)
            }
            Some(Level { values, .. }) => {
                let [r, g, b] = mixed(places.map(|i| texel_of::<3>(values, i)), tx, ty);
                [r, g, b, 1.0]
            }
        }
    }
}

/// The value between two texels of one row and two below them.
fn mixed<const N: usize>([a, b, c, d]: [[f32; N]; 4], tx: f64, ty: f64) -> [f64; N] {
    std::array::from_fn(|k| {
        let [a, b, c, d] = [a[k], b[k], c[k], d[k]].map(f64::from);
        let (top, bottom) = (a + tx * (b - a), c + tx * (d - c));
        top + ty * (bottom - top)
    })
}

/// The two texels of a side of `n` about the folded coordinate `u`, and the share of the second.
fn neighbours(u: f64, n: usize, wrap: Wrap) -> ([usize; 2], f64) {
    let place = u * n as f64 - 0.5;
    let first = floor(place);
    ([first as i64, first as i64 + 1].map(|i| wrapped(i, n, wrap)), place - first)
}

/// The coordinate in the first period, so that it and the indices of its texels are small numbers.
fn folded(u: f64, wrap: Wrap) -> f64 {
    match wrap {
        Wrap::Repeat => u - floor(u),
        Wrap::Mirror => u - 2.0 * floor(u / 2.0),
        Wrap::Clamp => u.clamp(0.0, 1.0),
    }
}

/// The method of f64 is a call without SSE 4.1, ten in each lookup.
fn floor(v: f64) -> f64 {
    // From 2⁵² on every number is whole.
    if v.abs() >= (1u64 << 52) as f64 {
        return v;
    }
    let toward_zero = v as i64 as f64;
    if toward_zero > v { toward_zero - 1.0 } else { toward_zero }
}

/// The texel of a side of `n` (1 or more) that texel `i` beyond it stands for.
pub fn wrapped(i: i64, n: usize, wrap: Wrap) -> usize {
    let n = n as i64;
    if (0..n).contains(&i) {
        return i as usize;
    }
    let index = match wrap {
        Wrap::Repeat => i.rem_euclid(n),
        Wrap::Mirror => {
            let at = i.rem_euclid(2 * n);
            at.min(2 * n - 1 - at)
        }
        Wrap::Clamp => i.clamp(0, n - 1),
    };
    index as usize
}
