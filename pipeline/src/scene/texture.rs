//! Textures: a decoded picture and its means over larger and larger areas (mip levels), in linear light.
//!
//! Level 0 is the picture, sRGB coded, 4 bytes a texel. A side of n texels has m = max(1, ⌊n/2⌋) texels at the next level, each the exact mean over
//! n/m texels of the side:
//!
//! ```text
//! n = 2m       texels 2i, 2i + 1           with weights 1/2, 1/2
//! n = 2m + 1   texels 2i, 2i + 1, 2i + 2   with weights (m − i)/n, m/n, (i + 1)/n
//! n = 1        the texel
//! ```
//! so that every level has the mean of the picture and covers the same square of texture coordinates. Levels from 1 on are f32: three channels, or four if
//! alpha is not 1 everywhere; in all 8 or 9.3 bytes a texel. Alpha is straight: colours are not weighted with it, as in the glTF 2.0 specification.
//! Not modelled: filters wider than a box; anisotropic footprints. Source of levels and wrap modes: OpenGL 4.6, sections 8.14.2 and 8.14.3.

mod footprint;
mod lookup;

pub use footprint::{Footprint, Projection, level_of};
pub use lookup::wrapped;

use super::description::Texture;
use crate::colour::srgb_decode;
use rayon::prelude::*;
use std::sync::OnceLock;

/// A picture that is no texture.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum TextureError {
    /// Without texels.
    #[error("texture `{name}` has no texels: it is {width} × {height}")]
    Empty {
        /// Its name.
        name: String,
        /// Columns.
        width: usize,
        /// Rows.
        height: usize,
    },
    /// Sides that are not those of the texels.
    #[error("texture `{name}` has {found} texels; expected {width} × {height}")]
    Size {
        /// Its name.
        name: String,
        /// Columns.
        width: usize,
        /// Rows.
        height: usize,
        /// Texels.
        found: usize,
    },
}

/// The mip levels of a texture.
pub struct Pyramid {
    picture: Texture,
    /// Levels from 1 on.
    means: Vec<Level>,
    has_alpha: bool,
    /// [`decoded`].
    decoded: &'static [f32; 256],
}

/// A mip level from 1 on.
struct Level {
    width: usize,
    height: usize,
    channels: usize,
    /// (row, column, channel), linear.
    values: Vec<f32>,
}

impl Pyramid {
    /// Computes the levels of `picture`.
    ///
    /// # Errors
    /// [`TextureError`] if its texels are none or not width × height.
    pub fn new(picture: Texture) -> Result<Self, TextureError> {
        let Texture { width, height, ref texels, .. } = picture;
        if width == 0 || height == 0 {
            return Err(TextureError::Empty { name: picture.name, width, height });
        }
        if width.checked_mul(height) != Some(texels.len()) {
            return Err(TextureError::Size { found: texels.len(), name: picture.name, width, height });
        }
        let has_alpha = texels.iter().any(|t| t[3] != u8::MAX);
        let channels = if has_alpha { 4 } else { 3 };
        let decoded = decoded();
        let mut means: Vec<Level> = Vec::new();
        let (mut w, mut h) = (width, height);
        while w > 1 || h > 1 {
            let next = match means.last() {
                None => Level::means_of((w, h), channels, |i, c| match c {
                    3 => f32::from(texels[i][3]) / 255.0,
                    c => decoded[usize::from(texels[i][c])],
                }),
                Some(last) => Level::means_of((w, h), channels, |i, c| last.values[i * channels + c]),
            };
            (w, h) = (next.width, next.height);
            means.push(next);
        }
        Ok(Self { picture, means, has_alpha, decoded })
    }

    /// Its name for messages.
    pub fn name(&self) -> &str {
        &self.picture.name
    }

    /// Number of levels, 1 or more.
    pub fn levels(&self) -> usize {
        self.means.len() + 1
    }

    /// Columns and rows of a level; the last one's beyond it.
    pub fn size(&self, level: usize) -> (usize, usize) {
        match level.min(self.means.len()) {
            0 => (self.picture.width, self.picture.height),
            l => (self.means[l - 1].width, self.means[l - 1].height),
        }
    }

    /// Whether a texel is not opaque.
    pub fn has_alpha(&self) -> bool {
        self.has_alpha
    }

    /// Bytes of all levels.
    pub fn bytes(&self) -> usize {
        4 * self.picture.texels.len() + self.means.iter().map(|l| 4 * l.values.len()).sum::<usize>()
    }

    /// Bytes of all levels of a picture of `texels` texels, for plans; those of one with sides that are powers of 2, rounded up.
    pub fn bytes_of(texels: usize, has_alpha: bool) -> usize {
        let means = if has_alpha { 16 } else { 12 };
        texels.saturating_mul(4).saturating_add((texels / 3 + 1).saturating_mul(means))
    }

    /// Linear red, green, blue and alpha of a texel.
    fn texel(&self, level: usize, column: usize, row: usize) -> [f64; 4] {
        let values = match level.min(self.means.len()) {
            0 => self.decode(self.picture.texels[row * self.picture.width + column]),
            l => {
                let Level { width, channels, ref values, .. } = self.means[l - 1];
                let i = row * width + column;
                match channels {
                    4 => texel_of::<4>(values, i),
                    _ => {
                        let [r, g, b] = texel_of::<3>(values, i);
                        [r, g, b, 1.0]
                    }
                }
            }
        };
        values.map(f64::from)
    }

    /// Of level 0.
    fn decode(&self, [r, g, b, a]: [u8; 4]) -> [f32; 4] {
        let linear = |code: u8| self.decoded[usize::from(code)];
        [linear(r), linear(g), linear(b), f32::from(a) / 255.0]
    }
}

impl Level {
    /// The next level of one of `width` × `height` texels, whose value of texel and channel is `value`.
    fn means_of(
        (width, height): (usize, usize),
        channels: usize,
        value: impl Fn(usize, usize) -> f32 + Sync,
    ) -> Self {
        let (w, h) = ((width / 2).max(1), (height / 2).max(1));
        let mut values = vec![0.0; w * h * channels];
        values.par_chunks_exact_mut(w * channels).enumerate().for_each(|(row, out)| {
            let rows = taps(row, height);
            for (column, out) in out.chunks_exact_mut(channels).enumerate() {
                let columns = taps(column, width);
                for (c, out) in out.iter_mut().enumerate() {
                    let mut sum = 0.0;
                    for (r, weight) in rows.into_iter().flatten() {
                        let of_row = columns
                            .into_iter()
                            .flatten()
                            .fold(0.0, |s, (x, w)| s + w * f64::from(value(r * width + x, c)));
                        sum += weight * of_row;
                    }
                    *out = sum as f32;
                }
            }
        });
        Self { width: w, height: h, channels, values }
    }
}

/// Texel `i` of values of `N` channels.
fn texel_of<const N: usize>(values: &[f32], i: usize) -> [f32; N] {
    values.as_chunks().0[i]
}

/// Texels of a side of `n` that texel `i` of the next level is the mean of, with their weights.
fn taps(i: usize, n: usize) -> [Option<(usize, f64)>; 3] {
    if n == 1 {
        return [Some((0, 1.0)), None, None];
    }
    let (m, first) = (n / 2, 2 * i);
    if n == 2 * m {
        return [Some((first, 0.5)), Some((first + 1, 0.5)), None];
    }
    let share = |parts: usize| parts as f64 / n as f64;
    [Some((first, share(m - i))), Some((first + 1, share(m))), Some((first + 2, share(i + 1)))]
}

/// Linear values of the 256 codes of sRGB.
fn decoded() -> &'static [f32; 256] {
    static DECODED: OnceLock<[f32; 256]> = OnceLock::new();
    DECODED.get_or_init(|| std::array::from_fn(|code| srgb_decode(code as f64 / 255.0) as f32))
}

#[cfg(test)]
mod tests;
