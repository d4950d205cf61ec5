//! Raws of other cameras: a DNG, developed by its own white and matrices, and its planes as they are.

use anyhow::{Result, anyhow};
use formats::dng::CameraRaw;
use pipeline::develop::{Demosaic, Development, Recipe, Shading};
use pipeline::geometry::{Rect, Size};
use pipeline::sensor::Pattern;
use std::path::Path;

/// Names of the planes of a colour raw.
const PLANES: [&str; 3] = ["R", "G", "B"];

/// A DNG, ready to be developed.
pub struct DngPicture {
    /// The file.
    pub raw: CameraRaw,
    /// Of a raw of one sample a pixel.
    development: Option<Development>,
    gains: [f64; 3],
    rows: [[f64; 3]; 3],
}

/// Pixels (row, column, value) of a plane, in linear DN above black.
pub struct DngPlane {
    /// Its name.
    pub name: &'static str,
    /// Its pixels.
    pub pixels: Vec<(f64, f64, f64)>,
    /// Saturated ones among them.
    pub saturated: usize,
}

impl DngPicture {
    /// Reads a file.
    ///
    /// # Errors
    /// A file that is damaged, or not supported.
    pub fn open(path: &Path) -> Result<Self> {
        let raw = CameraRaw::open(path)?;
        let one = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let (neutral, rows) = raw.profile.map_or(([1.0; 3], one), |p| (p.neutral, p.rows));
        // The neutral is at most 1: the least gain is 1.
        let gains = neutral.map(|n| 1.0 / n);
        let development = match (raw.samples, raw.pattern) {
            (1, pattern) => Some(development(&raw, pattern, gains, rows)?),
            _ => None,
        };
        Ok(Self { raw, development, gains, rows })
    }

    /// Its size.
    pub fn size(&self) -> Size {
        self.raw.size()
    }

    /// Channels of the developed picture: 3, or 1 for grey.
    pub fn channels(&self) -> usize {
        self.development.as_ref().map_or(3, Development::channels)
    }

    /// Linear values of a part of the developed picture.
    pub fn linear(&self, part: Rect) -> Vec<f32> {
        if let Some(development) = &self.development {
            let raw = self.raw.linear(development.needs(part));
            return development.develop(&raw, Shading::None, part);
        }
        let ranges = self.raw.ranges();
        let mix = |pixel: &[f32]| {
            let balanced: [f64; 3] =
                std::array::from_fn(|c| (f64::from(pixel[c]) / ranges[c] * self.gains[c]).min(1.0));
            self.rows.map(|row| std::iter::zip(row, balanced).map(|(m, v)| m * v).sum::<f64>() as f32)
        };
        self.raw.linear(part).chunks_exact(3).flat_map(mix).collect()
    }

    /// The planes of a part, not demosaiced.
    pub fn planes(&self, part: Rect) -> Vec<DngPlane> {
        let (samples, ranges) = (self.raw.samples, self.raw.ranges());
        let names: &[&'static str] = if self.channels() == 1 { &["grey"] } else { &PLANES };
        let empty = |name: &&'static str| DngPlane { name, pixels: Vec::new(), saturated: 0 };
        let mut all: Vec<DngPlane> = names.iter().map(empty).collect();
        for (i, value) in self.raw.linear(part).into_iter().enumerate() {
            let (pixel, sample) = (i / samples, i % samples);
            let (y, x) = (part.y + (pixel / part.width) as i64, part.x + (pixel % part.width) as i64);
            let plane = self.raw.pattern.map_or(sample, |p| p[(y % 2 * 2 + x % 2) as usize]);
            let of = &mut all[plane];
            of.pixels.push((y as f64, x as f64, f64::from(value)));
            of.saturated += usize::from(f64::from(value) >= ranges[sample]);
        }
        all
    }
}

fn development(
    raw: &CameraRaw,
    pattern: Option<[usize; 4]>,
    gains: [f64; 3],
    rows: [[f64; 3]; 3],
) -> Result<Development> {
    let grey = Pattern { rows: 1, columns: 1, channels: vec![0] };
    let recipe = Recipe {
        size: raw.size(),
        plane_of: if pattern.is_some() { vec![0, 1, 2] } else { vec![0] },
        black_white_dn: (0.0, raw.ranges()[0]),
        limit: 1.0,
        gains: if pattern.is_some() { gains.to_vec() } else { vec![1.0] },
        bin: false,
        demosaic: if pattern.is_some() { Demosaic::Malvar } else { Demosaic::Bilinear },
        matrix: if pattern.is_some() { rows.map(|r| r.to_vec()).to_vec() } else { vec![vec![1.0]] },
        exposure: 1.0,
        pattern: pattern.map_or(grey, |p| Pattern { rows: 2, columns: 2, channels: p.to_vec() }),
    };
    Development::new(recipe, (0, 0)).map_err(|e| anyhow!("developing the DNG {}: {e}", raw.path().display()))
}
