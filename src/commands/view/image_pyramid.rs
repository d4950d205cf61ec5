//! Film, raw or chart as a pyramid of levels, each half as large as the previous one, in tiles.
//!
//! Stored levels of a film or raw are read. Other levels are means over 2 x 2 pixels of the previous level (of a raw: over pixels of one
//! filter), computed tile by tile on request and cached; that takes as long as reading all pixels below the tile. Colours are sums over bands, Σ w_b·L_b, before exposure and
//! gamma, so a tile is summed once for all exposures.

use super::mosaic::Mosaic;
use crate::camera::frame::array_index;
use crate::failure::usage;
use crate::open::{self, Chart, ChartFlags};
use anyhow::{Context, Result, bail};
use formats::chart::cache::Cache;
use formats::chart::{AxisOrder, NanPolicy, split_array};
use formats::film::FilmStore;
use formats::picture::exposure::{Exposure, Levels};
use formats::pyramid::{PyramidState, halve, level_sizes};
use formats::raw::{halve_mosaic, mosaic_below};
use pipeline::colour::{Illuminant, srgb_weights};
use pipeline::geometry::{Rect, Size};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Side of a tile in pixels.
pub const TILE: usize = 256;
/// Luminance of linear sRGB (ITU-R BT.709).
const LUMINANCE: [f32; 3] = [0.2126, 0.7152, 0.0722];

/// Display mode.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Mode {
    /// All bands as colours of the CIE 1931 observer, with this light as white.
    Colour(Illuminant),
    /// One band; of a raw, the mosaic of one frame.
    Band(usize),
    /// A frame of a raw, developed with this light as white.
    Developed(usize, Illuminant),
}

/// Linear values of a region.
pub enum LinearValues {
    /// Red, green, blue: sums over all bands.
    Colour(Vec<[f32; 3]>),
    /// Red, green, blue of a developed raw, which are cut at 1 and 0.
    Developed(Vec<[f32; 3]>),
    /// One band.
    Grey(Vec<f32>),
}

/// Error of a cancelled request.
#[derive(Debug, thiserror::Error)]
#[error("the request was cancelled")]
pub struct Cancelled;

/// Film, raw or chart in levels.
pub struct ImagePyramid {
    pub name: String,
    /// Wavelength of each band, nm; of a raw: numbers of its frames.
    pub wavelengths_nm: Vec<f64>,
    /// Sensor and recipes of a raw.
    pub mosaic: Option<Mosaic>,
    /// State of the stored levels.
    pub stored_levels: PyramidState,
    /// Sizes of the levels, from full size on.
    pub sizes: Vec<Size>,
    /// Store of each level; none where the level is computed.
    stored: Vec<Option<Chart>>,
    /// Band of the store for each band shown.
    bands: Vec<usize>,
    /// Tiles of computed levels by level, band and (row, column).
    means: Cache<Vec<f32>, (usize, usize, (usize, usize))>,
    /// Tiles of linear values by level, mode and (row, column).
    linear: Cache<LinearValues, (usize, Mode, (usize, usize))>,
}

/// The film `PATH` or `PATH//array` and the index of its output; none if the path is not a film.
pub fn open_film(spec: &str) -> Result<Option<(FilmStore, usize)>> {
    let (path, array) = split_array(spec);
    let store = match FilmStore::open(path.as_ref(), true) {
        Err(formats::group::GroupError::NotOfKind { .. }) => return Ok(None),
        other => other?,
    };
    let names: Vec<&str> = store.spec().outputs.iter().map(|o| o.name.as_str()).collect();
    let output = array_index("film", path, &names, array)?;
    Ok(Some((store, output)))
}

impl ImagePyramid {
    /// Opens a film, chart or generated chart with caches of about `memory` bytes. `only`: use the bands at these wavelengths, all
    /// of which must exist.
    /// A chart without wavelengths has these.
    pub fn open(
        spec: &str,
        (wavelengths, axes): (Option<&str>, Option<&AxisOrder>),
        only: Option<&[f64]>,
        memory: usize,
    ) -> Result<Self> {
        let generated = spec.starts_with("gen:");
        let film = if generated { None } else { open_film(spec)? };
        let mosaic = if generated || film.is_some() { None } else { Mosaic::open(spec)? };
        let stored_levels = match (&film, &mosaic) {
            (Some((store, _)), _) => store.pyramid().state()?,
            (_, Some(mosaic)) => mosaic.state,
            _ => PyramidState::None,
        };
        let open = |level: usize, share: usize| match (&film, &mosaic) {
            (Some((store, output)), _) => {
                let array =
                    format!("{}//{}", store.path().display(), store.pyramid().level_path(*output, level));
                // The bands of a level have the order of the film's. Shards that do not exist yet are NaN and shown as missing.
                open::chart(&array, wavelengths.filter(|_| level == 0), NanPolicy::Keep, memory / share)
            }
            (_, Some(mosaic)) => Ok(Chart::Store(Box::new(mosaic.level(level, memory / share)?))),
            _ => {
                let flags = |wavelengths| ChartFlags {
                    wavelengths,
                    axes,
                    nan: NanPolicy::Keep,
                    cache_bytes: memory / share,
                    ..ChartFlags::default()
                };
                let chart = open::chart_with(spec, &flags(wavelengths));
                let lacks =
                    |chart: &Result<Chart>| chart.as_ref().map_or(true, |c| c.wavelengths_nm().is_err());
                match only
                    .map(pipeline::wavelengths::format)
                    .filter(|_| wavelengths.is_none() && lacks(&chart))
                {
                    None => chart,
                    Some(nm) => open::chart_with(spec, &flags(Some(&nm))),
                }
            }
        };
        let full = open(0, 4)?;
        let all_nm = full.wavelengths_nm()?;
        let bands = match only {
            None => (0..all_nm.len()).collect(),
            Some(nm) => bands_at(&all_nm, nm, spec)?,
        };
        let mut sizes = level_sizes(full.size());
        if let Some(mosaic) = &mosaic {
            // A smaller level has no pixels of some filters.
            let whole = |s: &Size| s.height >= mosaic.period.0 && s.width >= mosaic.period.1;
            sizes.truncate(sizes.iter().take_while(|s| whole(s)).count().max(1));
        }
        let mut stored = vec![Some(full)];
        for level in 1..sizes.len() {
            let stored_level =
                (stored_levels == PyramidState::Complete).then(|| open(level, 4 * sizes.len()));
            stored.push(stored_level.transpose().context("opening the pyramid")?);
        }
        Ok(Self {
            name: spec.to_owned(),
            wavelengths_nm: bands.iter().map(|&b| all_nm[b]).collect(),
            mosaic,
            stored_levels,
            sizes,
            stored,
            bands,
            means: Cache::new(memory / 4),
            linear: Cache::new(memory / 4),
        })
    }

    pub fn size(&self) -> Size {
        self.sizes[0]
    }

    fn full(&self) -> &Chart {
        self.stored[0].as_ref().expect("level 0 is always stored")
    }

    /// Whether any band is in the visible range.
    pub fn has_colour(&self) -> bool {
        self.weights(Illuminant::D65).iter().flatten().any(|w| *w != 0.0)
    }

    /// Units of the values, if known.
    pub fn units(&self) -> Option<&str> {
        self.full().units()
    }

    /// Pixels of tile (`row`, `column`) of a level; none if the tile does not exist.
    pub fn tile_rect(&self, level: usize, (row, column): (usize, usize)) -> Option<Rect> {
        let size = *self.sizes.get(level)?;
        let exists = row < size.height.div_ceil(TILE) && column < size.width.div_ceil(TILE);
        let first = |k: usize| (k * TILE) as i64;
        exists.then(|| Rect::new(first(row), first(column), TILE, TILE).intersect(size.rect()))
    }

    /// Values of one pixel, band by band.
    pub fn spectrum(&self, y: usize, x: usize, cancel: &AtomicBool) -> Result<Vec<f32>> {
        let pixel = Rect::new(y as i64, x as i64, 1, 1);
        let value = |band: usize| {
            let mut out = [0f32];
            self.read(0, band, pixel, &mut out, cancel).map(|()| out[0])
        };
        (0..self.bands.len()).map(value).collect()
    }

    /// Linear values of a tile, cached.
    pub fn tile(
        &self,
        level: usize,
        position: (usize, usize),
        mode: Mode,
        cancel: &AtomicBool,
    ) -> Result<Arc<LinearValues>> {
        let Some(rect) = self.tile_rect(level, position) else { bail!("no such tile") };
        let bytes = rect.size().pixels() * if matches!(mode, Mode::Band(_)) { 4 } else { 12 };
        self.linear.get((level, mode, position), || Ok((self.region(level, rect, mode, cancel)?, bytes)))
    }

    /// Linear values of a region of a level.
    pub fn region(&self, level: usize, rect: Rect, mode: Mode, cancel: &AtomicBool) -> Result<LinearValues> {
        let mut values = vec![0f32; rect.size().pixels()];
        let light = match mode {
            Mode::Band(band) => {
                self.read(level, band, rect, &mut values, cancel)?;
                self.mosaic.iter().for_each(|mosaic| mosaic.normalize(&mut values));
                return Ok(LinearValues::Grey(values));
            }
            Mode::Developed(frame, light) => {
                let mosaic = self.mosaic.as_ref().context("not a raw")?;
                let development = mosaic.development(self.sizes[level], light)?;
                let needs = development.needs(rect);
                values.resize(needs.size().pixels(), 0.0);
                self.read(level, frame, needs, &mut values, cancel)?;
                return Ok(LinearValues::Developed(mosaic.develop(&development, &mut values, rect)));
            }
            Mode::Colour(light) => light,
        };
        let mut sums = vec![[0f32; 3]; values.len()];
        for (band, w) in self.weights(light).into_iter().enumerate() {
            // A band with weights below 1e-12 is invisible; it is not read, as its pixels might be missing.
            if w.iter().all(|w| w.abs() <= 1e-12) {
                continue;
            }
            let w = w.map(|w| w as f32);
            self.read(level, band, rect, &mut values, cancel)?;
            sums.iter_mut().zip(&values).for_each(|(p, &v)| (0..3).for_each(|c| p[c] += w[c] * v));
        }
        Ok(LinearValues::Colour(sums))
    }

    /// Exposure that maps the 99th percentile of the nonzero pixels of the smallest level to white; 1 for a raw, whose white is known.
    pub fn exposure(&self, mode: Mode, cancel: &AtomicBool) -> Result<f64> {
        if self.mosaic.is_some() {
            return Ok(1.0);
        }
        let mut levels = Levels::default();
        match &*self.tile(self.sizes.len() - 1, (0, 0), mode, cancel)? {
            LinearValues::Grey(values) => values.iter().for_each(|&v| levels.add(v)),
            LinearValues::Colour(values) | LinearValues::Developed(values) => {
                values.iter().for_each(|p| levels.add((0..3).map(|c| LUMINANCE[c] * p[c]).sum()));
            }
        }
        Ok(Exposure::Auto.factor(&levels))
    }

    fn weights(&self, light: Illuminant) -> Vec<[f64; 3]> {
        srgb_weights(&self.wavelengths_nm, |nm| light.relative_power(nm) / 100.0)
    }

    /// Pixels of a band of any level.
    fn read(
        &self,
        level: usize,
        band: usize,
        rect: Rect,
        out: &mut [f32],
        cancel: &AtomicBool,
    ) -> Result<()> {
        if cancel.load(Ordering::Relaxed) {
            return Err(Cancelled.into());
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
                let means = self.mean(level, band, (row, column), cancel)?;
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

    /// Tile of a computed level, cached.
    fn mean(
        &self,
        level: usize,
        band: usize,
        position: (usize, usize),
        cancel: &AtomicBool,
    ) -> Result<Arc<Vec<f32>>> {
        self.means.get((level, band, position), || {
            let rect = self.tile_rect(level, position).context("no such tile")?;
            let size = self.sizes[level - 1];
            let below = match &self.mosaic {
                Some(mosaic) => mosaic_below(rect, size, mosaic.period),
                None => {
                    Rect::new(2 * rect.y, 2 * rect.x, 2 * rect.height, 2 * rect.width).intersect(size.rect())
                }
            };
            let mut pixels = vec![0f32; below.size().pixels()];
            self.read(level - 1, band, below, &mut pixels, cancel)?;
            let mut means = vec![0f32; rect.size().pixels()];
            match &self.mosaic {
                Some(mosaic) => halve_mosaic(&pixels, below, mosaic.period, rect, &mut means),
                None => halve(&pixels, below.size(), &mut means),
            }
            let bytes = means.len() * size_of::<f32>();
            Ok((means, bytes))
        })
    }
}

/// Indices of the bands at the wavelengths `requested`: the nearest within 1e-3 nm. Bands of equal wavelength are used in order for
/// repeated requests.
fn bands_at(all_nm: &[f64], requested: &[f64], spec: &str) -> Result<Vec<usize>> {
    let band = |(i, &nm): (usize, &f64)| {
        let distance = |b: usize| (all_nm[b] - nm).abs();
        let near = (0..all_nm.len()).filter(|&b| distance(b) <= 1e-3);
        let Some(nearest) = near.min_by(|&a, &b| distance(a).total_cmp(&distance(b))) else {
            return Err(usage(format!(
                "{spec} has no band at {nm} nm, which the film has; its bands are at {} nm",
                pipeline::wavelengths::format(all_nm)
            )));
        };
        let mut equal = (0..all_nm.len()).filter(|&b| all_nm[b] == all_nm[nearest]);
        let repeated = requested[..i].iter().filter(|r| **r == nm).count();
        Ok(equal.clone().nth(repeated).or(equal.next_back()).unwrap_or(nearest))
    };
    requested.iter().enumerate().map(band).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bands_of_equal_or_close_wavelengths_are_distinguished() {
        let at = |all_nm: &[f64], requested: &[f64]| bands_at(all_nm, requested, "chart").unwrap();
        assert_eq!(at(&[450.0, 550.0, 450.0], &[450.0, 450.0, 550.0]), [0, 2, 1]);
        assert_eq!(at(&[500.0, 500.0005], &[500.0005, 500.0]), [1, 0]);
        assert_eq!(at(&[500.0], &[500.0, 500.0]), [0, 0]);
        assert!(bands_at(&[500.0], &[501.0], "chart").is_err());
    }

    #[test]
    fn tiles_of_a_very_large_image_have_separate_cache_keys() {
        // A packed key of 20 bits per coordinate would confuse column 2^20 with column 0 of the next row.
        let pyramid =
            ImagePyramid::open("gen:siemens?size=900x600&wavelengths=450,550", (None, None), None, 64 << 20)
                .unwrap();
        let (cancel, mode) = (AtomicBool::new(false), Mode::Band(0));
        let first = pyramid.tile(0, (0, 0), mode, &cancel).unwrap();
        let again = |key| {
            pyramid.linear.get(key, || Ok::<_, anyhow::Error>((LinearValues::Grey(vec![7.0]), 4))).unwrap()
        };
        assert!(Arc::ptr_eq(&first, &again((0, mode, (0, 0)))));
        assert!(!Arc::ptr_eq(&first, &again((0, mode, (0, 1 << 40)))));
        assert!(!Arc::ptr_eq(&again((0, mode, (1, 0))), &again((0, mode, (0, 1 << 20)))));
    }
}
