//! A film or chart as a stack of levels, each half as large as the one before, in tiles.
//!
//! Levels that a film's pyramid holds are read; those that are not there are the mean over 2 x 2 of the level before, made tile by
//! tile when they are asked for and kept while there is room: right, and as slow as reading all that lies below.
//! Colours are sums over bands, Σ w_b·L_b, taken before any tone: a tile is summed once for all exposures.

use crate::failure::usage;
use crate::open::Chart;
use anyhow::{Context, Result, bail};
use formats::chart::cache::Cache;
use formats::chart::{NanPolicy, split_array};
use formats::film::{FilmStore, PyramidState, halve, level_sizes};
use formats::picture::exposure::{Exposure, Levels};
use pipeline::colour::{Illuminant, srgb_weights};
use pipeline::geometry::{Rect, Size};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Side of a tile in pixels.
pub const TILE: usize = 256;
/// Luminance of linear sRGB (ITU-R BT.709).
const LUMINANCE: [f32; 3] = [0.2126, 0.7152, 0.0722];

/// What is shown of a stack.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Mode {
    /// All bands as an eye sees them, this light being white.
    Colour(Illuminant),
    /// One band.
    Band(usize),
}

/// Linear values: red, green and blue, or one grey.
pub enum Linear {
    /// Of all bands.
    Colour(Vec<[f32; 3]>),
    /// Of one.
    Grey(Vec<f32>),
}

/// The wish has been withdrawn.
#[derive(Debug, thiserror::Error)]
#[error("nobody waits for it any more")]
pub struct Stopped;

/// A film or chart in levels.
pub struct Stack {
    /// Name shown to people.
    pub name: String,
    /// Wavelength of each band, nm.
    pub wavelengths_nm: Vec<f64>,
    /// What there is of a pyramid.
    pub pyramid: PyramidState,
    /// Sizes of the levels, from full size on.
    pub sizes: Vec<Size>,
    stored: Vec<Option<Chart>>,
    /// Band of the store per band shown.
    bands: Vec<usize>,
    means: Cache<Vec<f32>, (usize, usize, (usize, usize))>,
    linear: Cache<Linear, (usize, Mode, (usize, usize))>,
}

/// The film and the number of its output that `PATH` or `PATH//array` names, if it is a film of ours.
pub fn film_of(spec: &str) -> Result<Option<(FilmStore, usize)>> {
    let (path, array) = split_array(spec);
    let store = match FilmStore::open(path.as_ref(), true) {
        Err(formats::film::FilmError::NotFilm { .. }) => return Ok(None),
        other => other?,
    };
    let names: Vec<&str> = store.spec().outputs.iter().map(|o| o.name.as_str()).collect();
    let output = match array {
        "" => 0,
        wanted => names.iter().position(|n| *n == wanted).ok_or_else(|| {
            usage(format!("film {path} has no array `{wanted}`; there are {}", names.join(", ")))
        })?,
    };
    Ok(Some((store, output)))
}

impl Stack {
    /// Opens a film, chart or drawn chart, to hold at most about `memory` bytes. `only`: these wavelengths, all of which it must have.
    pub fn open(spec: &str, wavelengths: Option<&str>, only: Option<&[f64]>, memory: usize) -> Result<Self> {
        let film = if spec.starts_with("gen:") { None } else { film_of(spec)? };
        let pyramid = film.as_ref().map_or(Ok(PyramidState::None), |(store, _)| store.pyramid())?;
        let open = |spec: &str, nm: Option<&str>, share: usize| {
            // Shards not yet made read as NaN: they are shown as missing, not refused.
            Chart::open(spec, nm, NanPolicy::Keep, memory / share)
        };
        let array = match &film {
            Some((store, output)) => format!("{}//{}", store.path().display(), store.level_path(*output, 0)),
            None => spec.to_owned(),
        };
        let full = open(&array, wavelengths, 4)?;
        let own = full.wavelengths_nm()?;
        let bands = match only {
            None => (0..own.len()).collect(),
            Some(nm) => bands_at(&own, nm, spec)?,
        };
        let sizes = level_sizes(full.size());
        let mut stored = vec![Some(full)];
        for level in 1..sizes.len() {
            let there = film.as_ref().filter(|_| pyramid == PyramidState::Complete);
            stored.push(match there {
                None => None,
                Some((store, output)) => {
                    let path = format!("{}//{}", store.path().display(), store.level_path(*output, level));
                    // Its bands are the film's, by number.
                    Some(open(&path, None, 4 * sizes.len()).context("opening the pyramid")?)
                }
            });
        }
        Ok(Self {
            name: spec.to_owned(),
            wavelengths_nm: bands.iter().map(|&b| own[b]).collect(),
            pyramid,
            sizes,
            stored,
            bands,
            means: Cache::new(memory / 4),
            linear: Cache::new(memory / 4),
        })
    }

    /// Full size.
    pub fn size(&self) -> Size {
        self.sizes[0]
    }

    /// Its pixels in full.
    fn full(&self) -> &Chart {
        self.stored[0].as_ref().expect("opened with it")
    }

    /// Whether its bands show anything to an eye.
    pub fn has_colour(&self) -> bool {
        self.weights(Illuminant::D65).iter().flatten().any(|w| *w != 0.0)
    }

    /// What its values are, if it tells.
    pub fn units(&self) -> Option<&str> {
        self.full().units()
    }

    /// Pixels of tile (`row`, `column`) of a level; `None` if there is no such tile.
    pub fn tile_rect(&self, level: usize, (row, column): (usize, usize)) -> Option<Rect> {
        let size = *self.sizes.get(level)?;
        let there = row < size.height.div_ceil(TILE) && column < size.width.div_ceil(TILE);
        let at = |k: usize| (k * TILE) as i64;
        there.then(|| Rect::new(at(row), at(column), TILE, TILE).intersect(size.rect()))
    }

    /// The values of one pixel, band by band.
    pub fn spectrum(&self, y: usize, x: usize, stop: &AtomicBool) -> Result<Vec<f32>> {
        let pixel = Rect::new(y as i64, x as i64, 1, 1);
        let value = |band: usize| {
            let mut out = [0f32];
            self.read(0, band, pixel, &mut out, stop).map(|()| out[0])
        };
        (0..self.bands.len()).map(value).collect()
    }

    /// A tile's linear values, kept for the next time.
    pub fn tile(
        &self,
        level: usize,
        at: (usize, usize),
        mode: Mode,
        stop: &AtomicBool,
    ) -> Result<Arc<Linear>> {
        let Some(rect) = self.tile_rect(level, at) else { bail!("no such tile") };
        let bytes = rect.size().pixels() * if matches!(mode, Mode::Band(_)) { 4 } else { 12 };
        self.linear.get((level, mode, at), || Ok((self.window(level, rect, mode, stop)?, bytes)))
    }

    /// The linear values of any part of a level.
    pub fn window(&self, level: usize, rect: Rect, mode: Mode, stop: &AtomicBool) -> Result<Linear> {
        let mut values = vec![0f32; rect.size().pixels()];
        let light = match mode {
            Mode::Band(band) => {
                self.read(level, band, rect, &mut values, stop)?;
                return Ok(Linear::Grey(values));
            }
            Mode::Colour(light) => light,
        };
        let mut sums = vec![[0f32; 3]; values.len()];
        for (band, w) in self.weights(light).into_iter().enumerate() {
            // What adds less than 1e-12 of the white cannot be seen, but would be read, and might be missing.
            if w.iter().all(|w| w.abs() <= 1e-12) {
                continue;
            }
            let w = w.map(|w| w as f32);
            self.read(level, band, rect, &mut values, stop)?;
            sums.iter_mut().zip(&values).for_each(|(p, &v)| (0..3).for_each(|c| p[c] += w[c] * v));
        }
        Ok(Linear::Colour(sums))
    }

    /// The exposure that makes the 99th percentile of the lit pixels white, judged from afar.
    pub fn exposure(&self, mode: Mode, stop: &AtomicBool) -> Result<f64> {
        let mut levels = Levels::default();
        match &*self.tile(self.sizes.len() - 1, (0, 0), mode, stop)? {
            Linear::Grey(values) => values.iter().for_each(|&v| levels.add(v)),
            Linear::Colour(values) => {
                values.iter().for_each(|p| levels.add((0..3).map(|c| LUMINANCE[c] * p[c]).sum()));
            }
        }
        Ok(Exposure::Auto.factor(&levels))
    }

    fn weights(&self, light: Illuminant) -> Vec<[f64; 3]> {
        srgb_weights(&self.wavelengths_nm, |nm| light.relative_power(nm) / 100.0)
    }

    /// Pixels of a band of any level.
    fn read(&self, level: usize, band: usize, rect: Rect, out: &mut [f32], stop: &AtomicBool) -> Result<()> {
        if stop.load(Ordering::Relaxed) {
            return Err(Stopped.into());
        }
        if let Some(chart) = &self.stored[level] {
            return chart
                .source()
                .read(self.bands[band], rect, out)
                .map_err(|e| anyhow::anyhow!("reading {}: {e}", self.name));
        }
        let tiles = |first: i64, end: i64| first as usize / TILE..(end as usize).div_ceil(TILE);
        for row in tiles(rect.y, rect.bottom()) {
            for column in tiles(rect.x, rect.right()) {
                let tile = self.tile_rect(level, (row, column)).context("no such tile")?;
                let means = self.mean(level, band, (row, column), stop)?;
                let part = tile.intersect(rect);
                for y in part.y..part.bottom() {
                    let from = (y - tile.y) as usize * tile.width + (part.x - tile.x) as usize;
                    let to = (y - rect.y) as usize * rect.width + (part.x - rect.x) as usize;
                    out[to..to + part.width].copy_from_slice(&means[from..from + part.width]);
                }
            }
        }
        Ok(())
    }

    /// A tile of a level that is not stored.
    fn mean(
        &self,
        level: usize,
        band: usize,
        at: (usize, usize),
        stop: &AtomicBool,
    ) -> Result<Arc<Vec<f32>>> {
        self.means.get((level, band, at), || {
            let rect = self.tile_rect(level, at).context("no such tile")?;
            let below = Rect::new(2 * rect.y, 2 * rect.x, 2 * rect.height, 2 * rect.width)
                .intersect(self.sizes[level - 1].rect());
            let mut pixels = vec![0f32; below.size().pixels()];
            self.read(level - 1, band, below, &mut pixels, stop)?;
            let mut means = vec![0f32; rect.size().pixels()];
            halve(&pixels, below.size(), &mut means);
            let bytes = means.len() * size_of::<f32>();
            Ok((means, bytes))
        })
    }
}

/// The bands at these wavelengths: the nearest within 1e-3 nm, and where several are equally near, each in turn.
fn bands_at(own: &[f64], wanted: &[f64], spec: &str) -> Result<Vec<usize>> {
    let band = |(i, &nm): (usize, &f64)| {
        let off = |b: usize| (own[b] - nm).abs();
        let nearest = (0..own.len()).filter(|&b| off(b) <= 1e-3).min_by(|&a, &b| off(a).total_cmp(&off(b)));
        let Some(nearest) = nearest else {
            return Err(usage(format!(
                "{spec} has no band at {nm} nm, which the film has; there are {} nm",
                pipeline::wavelengths::format(own)
            )));
        };
        let mut equal = (0..own.len()).filter(|&b| own[b] == own[nearest]);
        let turn = wanted[..i].iter().filter(|w| **w == nm).count();
        Ok(equal.clone().nth(turn).or(equal.next_back()).unwrap_or(nearest))
    };
    wanted.iter().enumerate().map(band).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bands_of_equal_or_close_wavelengths_keep_apart() {
        let at = |own: &[f64], wanted: &[f64]| bands_at(own, wanted, "chart").unwrap();
        assert_eq!(at(&[450.0, 550.0, 450.0], &[450.0, 450.0, 550.0]), [0, 2, 1]);
        assert_eq!(at(&[500.0, 500.0005], &[500.0005, 500.0]), [1, 0]);
        assert_eq!(at(&[500.0], &[500.0, 500.0]), [0, 0]);
        assert!(bands_at(&[500.0], &[501.0], "chart").is_err());
    }

    #[test]
    fn tiles_far_out_in_a_large_image_are_not_confused() {
        // 2^20 tiles across: a column beyond would be column 0 of the next row if both shared one number.
        let stack =
            Stack::open("gen:siemens?size=600x900&wavelengths=450,550", None, None, 64 << 20).unwrap();
        let (never, mode) = (AtomicBool::new(false), Mode::Band(0));
        let first = stack.tile(0, (0, 0), mode, &never).unwrap();
        let again =
            |key| stack.linear.get(key, || Ok::<_, anyhow::Error>((Linear::Grey(vec![7.0]), 4))).unwrap();
        assert!(Arc::ptr_eq(&first, &again((0, mode, (0, 0)))));
        assert!(!Arc::ptr_eq(&first, &again((0, mode, (0, 1 << 40)))));
        assert!(!Arc::ptr_eq(&again((0, mode, (1, 0))), &again((0, mode, (0, 1 << 20)))));
    }
}
