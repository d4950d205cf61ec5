//! Development: from the raw mosaic of a sensor to linear sRGB, and to the integers of a picture.
//!
//! ```text
//! v        = (raw − black)/(white − black)              not cut at 0
//! balanced = min(v · white gain of the filter, limit)   least gain 1: clipped highlights stay neutral; limit 1, more for merged frames
//! shaded   = balanced / S(filter, row, column)          shading, 1 unless asked for
//! planes   = demosaic(shaded)                           demosaic
//! rgb      = M · planes · 2^EV                          matrix: 3 × n, rows sum to 1
//! picture  = ⌊n · tone(rgb) + ½⌋                        tone: per channel, cut at 0 and 1
//! ```
//!
//! Binning takes the mean of v over 2 × 2 pixels of one filter, before the gain. All values are f32. Pixels of the raw array count from its
//! first pixel; the pattern is that of the sensor, so a region of a raw (`roi_0`) develops as that part of the whole, except at its border.
//! Not included (aesthetic choices): denoising, sharpening, tone curves, gamut mapping. Tests: against the model in float64.

pub mod defects;
mod demosaic;
mod error;
pub mod matrix;
pub mod merge;
pub mod profile;
pub mod shading;
pub mod tone;

pub use demosaic::{Demosaic, PlanePattern, mirrored};
pub use error::DevelopError;
pub use matrix::ColourMatrix;
pub use shading::LensShading;
pub use tone::{Quantizer, Tone};

use crate::geometry::{Rect, Size};
use crate::sensor::Pattern;
use demosaic::{Bilinear, malvar_row, superpixel_row};

/// What a development depends on, besides the raw.
#[derive(Clone, Debug)]
pub struct Recipe {
    /// Size of the raw array.
    pub size: Size,
    /// Filters of the array's pixels, from its first pixel on.
    pub pattern: Pattern,
    /// Plane of each filter.
    pub plane_of: Vec<usize>,
    /// Digital number of no light, and of saturation.
    pub black_white_dn: (f64, f64),
    /// Greatest value; 1 is saturation.
    pub limit: f64,
    /// White gain of each filter.
    pub gains: Vec<f64>,
    /// Mean of 2 × 2 pixels of one filter.
    pub bin: bool,
    /// Interpolation of the planes.
    pub demosaic: Demosaic,
    /// Rows of the colour matrix: three, or one for grey.
    pub matrix: Vec<Vec<f64>>,
    /// Factor on the linear values, 2^EV.
    pub exposure: f64,
}

/// Values of a flat that a development divides by.
#[derive(Clone, Copy, Debug)]
pub struct Flat<'a> {
    /// Digital numbers of [`Development::needs`].
    pub raw: &'a [f32],
    /// Black and white of the flat, DN.
    pub black_white_dn: (f64, f64),
    /// Its value in the middle of the picture, per filter.
    pub middle: &'a [f32],
}

/// What light is divided by.
#[derive(Clone, Copy, Debug)]
pub enum Shading<'a> {
    /// Nothing.
    None,
    /// The relative illumination of a lens.
    Lens(&'a LensShading),
    /// A raw of a uniform chart.
    Flat(Flat<'a>),
}

/// A development, ready to run.
#[derive(Clone, Debug)]
pub struct Development {
    recipe: Recipe,
    /// Filters and planes of the mosaic, after binning.
    pattern: Pattern,
    planes: PlanePattern,
    /// Size of the mosaic, after binning.
    mosaic: Size,
    /// First row and column of the raw that binning uses.
    first: (usize, usize),
    bilinear: Option<Bilinear>,
}

impl Development {
    /// Checks a recipe. `origin`: (row, column) of the array's first pixel on the sensor.
    ///
    /// # Errors
    /// [`DevelopError`].
    pub fn new(mut recipe: Recipe, origin: (usize, usize)) -> Result<Self, DevelopError> {
        let (pattern, first, mosaic) = match recipe.bin {
            false => (rolled(&recipe.pattern, origin), (0, 0), recipe.size),
            true => {
                // Blocks begin at even pixels of the sensor.
                let first = (origin.0 % 2, origin.1 % 2);
                let inner = (origin.0 + first.0, origin.1 + first.1);
                let pattern = binned(&rolled(&recipe.pattern, inner)).ok_or(DevelopError::Bin)?;
                let side = |n: usize, first: usize| n.saturating_sub(first) / 2;
                (
                    pattern,
                    first,
                    Size::new(side(recipe.size.height, first.0), side(recipe.size.width, first.1)),
                )
            }
        };
        if mosaic.height < pattern.rows || mosaic.width < pattern.columns {
            let (rows, columns) = (pattern.rows, pattern.columns);
            return Err(DevelopError::TooSmall { size: mosaic, rows, columns });
        }
        let planes = PlanePattern {
            rows: pattern.rows,
            columns: pattern.columns,
            planes: pattern.channels.iter().map(|c| recipe.plane_of[*c]).collect(),
            count: recipe.plane_of.iter().max().map_or(0, |p| p + 1),
        };
        // One plane everywhere needs no interpolation.
        if planes.count == 1 && recipe.demosaic == Demosaic::Malvar {
            recipe.demosaic = Demosaic::Bilinear;
        }
        planes.check(recipe.demosaic)?;
        let bilinear = (recipe.demosaic == Demosaic::Bilinear).then(|| Bilinear::new(&planes));
        Ok(Self { recipe, pattern, planes, mosaic, first, bilinear })
    }

    /// Size of the picture.
    pub fn size(&self) -> Size {
        match self.recipe.demosaic {
            Demosaic::Superpixel => {
                Size::new(self.mosaic.height / self.planes.rows, self.mosaic.width / self.planes.columns)
            }
            _ => self.mosaic,
        }
    }

    /// Channels of the picture: 3, or 1 for grey.
    pub fn channels(&self) -> usize {
        self.recipe.matrix.len()
    }

    /// Pixels of the mosaic under a part of the picture, halo included.
    fn mosaic_rect(&self, out: Rect) -> Rect {
        let (py, px) = (self.planes.rows, self.planes.columns);
        match self.recipe.demosaic {
            Demosaic::Superpixel => {
                Rect::new(out.y * py as i64, out.x * px as i64, out.height * py, out.width * px)
            }
            method => out.grown(self.planes.halo(method)).intersect(self.mosaic.rect()),
        }
    }

    /// Pixels of the raw array under a part of the picture.
    pub fn needs(&self, out: Rect) -> Rect {
        let m = self.mosaic_rect(out);
        let (y, x) = (self.first.0 as i64, self.first.1 as i64);
        match self.recipe.bin {
            false => m,
            true => Rect::new(2 * m.y + y, 2 * m.x + x, 2 * m.height, 2 * m.width),
        }
    }

    /// Linear values of the part `out` of the picture, pixel by pixel, from the digital numbers of [`Development::needs`].
    ///
    /// # Panics
    /// If the lengths do not fit.
    pub fn develop(&self, raw: &[f32], shading: Shading<'_>, out: Rect) -> Vec<f32> {
        let rect = self.mosaic_rect(out);
        let mut values = self.values(raw, self.needs(out), self.recipe.black_white_dn);
        self.balance(&mut values, rect);
        self.shade(&mut values, rect, shading, out);
        let halo = self.planes.halo(self.recipe.demosaic);
        let padded = match self.recipe.demosaic {
            Demosaic::Superpixel => values,
            _ => self.padded(&values, rect, out.grown(halo)),
        };
        let width = padded.len() / (self.rows_of(out) + 2 * halo);
        let row = |y: usize| &padded[y * width..][..width];
        let channels = self.channels();
        let mut linear = vec![0.0; out.size().pixels() * channels];
        let mut planes = vec![vec![0.0; out.width]; self.planes.count];
        let mut scratch: [Vec<f32>; 4] = Default::default();
        let matrix: Vec<Vec<f32>> =
            self.recipe.matrix.iter().map(|r| r.iter().map(|v| *v as f32).collect()).collect();
        for (i, line) in linear.chunks_mut(out.width * channels).enumerate() {
            let at = (out.y as usize + i, out.x as usize);
            match (self.recipe.demosaic, &self.bilinear) {
                (Demosaic::Malvar, _) => {
                    let rows = std::array::from_fn(|k| row(i + k));
                    malvar_row(rows, &self.planes, at, &mut planes, &mut scratch);
                }
                (Demosaic::Superpixel, _) => {
                    let rows: Vec<&[f32]> =
                        (0..self.planes.rows).map(|k| row(i * self.planes.rows + k)).collect();
                    superpixel_row(&rows, &self.planes, &mut planes);
                }
                (Demosaic::Bilinear, bilinear) => {
                    let rows: Vec<&[f32]> = (0..=2 * halo).map(|k| row(i + k)).collect();
                    let bilinear = bilinear.as_ref().expect("made with the method");
                    bilinear.row(&rows, at, (self.mosaic.height, self.mosaic.width), &mut planes);
                }
            }
            mix(&matrix, &planes, self.recipe.exposure as f32, line);
        }
        linear
    }

    /// Rows of the mosaic under the rows of a part of the picture, without halo.
    fn rows_of(&self, out: Rect) -> usize {
        match self.recipe.demosaic {
            Demosaic::Superpixel => out.height * self.planes.rows,
            _ => out.height,
        }
    }

    /// v of the mosaic's pixels under the pixels `rect` of the raw.
    pub fn values(&self, raw: &[f32], rect: Rect, (black, white): (f64, f64)) -> Vec<f32> {
        assert_eq!(raw.len(), rect.size().pixels());
        let (black, range) = (black as f32, (white - black) as f32);
        if !self.recipe.bin {
            return raw.iter().map(|v| (v - black) / range).collect();
        }
        let pairs = raw.chunks_exact(2 * rect.width);
        pairs
            .flat_map(|two| {
                let (a, b) = two.split_at(rect.width);
                std::iter::zip(a.chunks_exact(2), b.chunks_exact(2))
                    .map(|(a, b)| ((a[0] + a[1] + b[0] + b[1]) * 0.25 - black) / range)
            })
            .collect()
    }

    /// Filter of a pixel of the mosaic.
    pub fn filter(&self, row: usize, column: usize) -> usize {
        self.pattern.channel(row, column)
    }

    /// Size of the mosaic, after binning.
    pub fn mosaic(&self) -> Size {
        self.mosaic
    }

    fn balance(&self, values: &mut [f32], rect: Rect) {
        let gains: Vec<f32> = self.recipe.gains.iter().map(|g| *g as f32).collect();
        let limit = self.recipe.limit as f32;
        let row = |y: usize| (0..rect.width).map(|x| gains[self.filter(y, rect.x as usize + x)]).collect();
        let rows: Vec<Vec<f32>> = (0..self.pattern.rows).map(row).collect();
        for (line, y) in std::iter::zip(values.chunks_mut(rect.width), rect.y as usize..) {
            let gains = &rows[y % self.pattern.rows];
            std::iter::zip(line, gains).for_each(|(v, gain)| *v = (*v * gain).min(limit));
        }
    }

    fn shade(&self, values: &mut [f32], rect: Rect, shading: Shading<'_>, out: Rect) {
        let place = |k: usize| (rect.y as usize + k / rect.width, rect.x as usize + k % rect.width);
        match shading {
            Shading::None => {}
            Shading::Lens(lens) => values.iter_mut().enumerate().for_each(|(k, v)| {
                let (y, x) = place(k);
                *v /= lens.divisor(self.filter(y, x), y, x);
            }),
            Shading::Flat(flat) => {
                let own = self.values(flat.raw, self.needs(out), flat.black_white_dn);
                values.iter_mut().zip(own).enumerate().for_each(|(k, (v, f))| {
                    let (y, x) = place(k);
                    *v /= (f / flat.middle[self.filter(y, x)]).max(shading::MIN_DIVISOR);
                });
            }
        }
    }

    /// Values of `rect`, laid out for `grown`, mirrored where that leaves the mosaic.
    fn padded(&self, values: &[f32], rect: Rect, grown: Rect) -> Vec<f32> {
        let columns: Vec<usize> =
            (grown.x..grown.right()).map(|x| mirrored(x, self.mosaic.width) - rect.x as usize).collect();
        let mut padded = Vec::with_capacity(grown.size().pixels());
        for y in grown.y..grown.bottom() {
            let row = mirrored(y, self.mosaic.height) - rect.y as usize;
            let row = &values[row * rect.width..][..rect.width];
            let inner = (rect.x - grown.x) as usize;
            padded.extend(columns[..inner].iter().map(|x| row[*x]));
            padded.extend_from_slice(row);
            padded.extend(columns[inner + rect.width..].iter().map(|x| row[*x]));
        }
        padded
    }
}

/// A row of the picture from a row of each plane.
fn mix(matrix: &[Vec<f32>], planes: &[Vec<f32>], exposure: f32, line: &mut [f32]) {
    if let ([a, b, c], [r, g, p]) = (matrix, planes) {
        for (i, out) in line.as_chunks_mut::<3>().0.iter_mut().enumerate() {
            let (x, y, z) = (r[i], g[i], p[i]);
            *out = [a, b, c].map(|m| (m[0] * x + m[1] * y + m[2] * z) * exposure);
        }
        return;
    }
    for (i, out) in line.chunks_mut(matrix.len()).enumerate() {
        for (out, row) in std::iter::zip(out, matrix) {
            *out = std::iter::zip(row, planes).map(|(m, p)| m * p[i]).sum::<f32>() * exposure;
        }
    }
}

/// The pattern as it begins at a pixel.
fn rolled(p: &Pattern, (row, column): (usize, usize)) -> Pattern {
    let channels = (0..p.rows * p.columns).map(|k| p.channel(row + k / p.columns, column + k % p.columns));
    Pattern { channels: channels.collect(), ..p.clone() }
}

/// The pattern of 2 × 2 blocks; `None` if a block has several filters.
fn binned(p: &Pattern) -> Option<Pattern> {
    let side = |n: usize| if n.is_multiple_of(2) { n / 2 } else { n };
    let (rows, columns) = (side(p.rows), side(p.columns));
    let block = |k: usize| {
        let (y, x) = (2 * (k / columns), 2 * (k % columns));
        let first = p.channel(y, x);
        [(0, 1), (1, 0), (1, 1)].iter().all(|(dy, dx)| p.channel(y + dy, x + dx) == first).then_some(first)
    };
    Some(Pattern { rows, columns, channels: (0..rows * columns).map(block).collect::<Option<_>>()? })
}

#[cfg(test)]
mod tests;
