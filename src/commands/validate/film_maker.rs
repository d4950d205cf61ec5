//! Simulated films: each made by the code of `lenscube run`, read back and removed.

use crate::args::{CoatingsArg, Device, EngineArg, ProgressArg, RunArgs, TracingArgs, VeilArgs};
use crate::commands::run;
use crate::failure::{Coded, usage};
use crate::progress::as_step;
use anyhow::{Context, Result};
use formats::chart::{ChartOptions, ChartStore, NanPolicy};
use formats::durable::temp_name;
use formats::film::FilmStore;
use pipeline::geometry::{Rect, Size};
use pipeline::stage::Stage;
use std::path::{Path, PathBuf};

/// Settings of the simulated films.
#[derive(Clone, Debug)]
pub struct FilmMaker {
    /// Name or path of the lens.
    pub lens: String,
    /// Coatings of a design.
    pub coatings: CoatingsArg,
    /// Directory of the temporary films.
    pub dir: PathBuf,
    /// Complete films instead of regions.
    pub full: bool,
    pub bands: usize,
    pub threads: usize,
    /// Memory limit of a run, bytes.
    pub memory: Option<u64>,
    pub device: Device,
    pub engine: EngineArg,
}

/// Pixels of film regions: by band, by region.
pub type RegionPixels = Vec<Vec<Vec<f32>>>;

impl FilmMaker {
    /// Simulates the film of `chart` by `stages` and reads its regions `rects`.
    pub fn simulate(&self, chart: &str, stages: &[Stage], rects: &[Rect]) -> Result<RegionPixels> {
        if !self.full {
            return self.film(chart, stages, rects, None);
        }
        // One band at a time: a complete film of all bands would take 25 GB.
        let mut pixels = Vec::new();
        for band in 0..self.bands {
            pixels.extend(self.film(chart, stages, rects, Some(band))?);
        }
        Ok(pixels)
    }

    /// Regions of a temporary film: a film of these regions, or the complete film of one band.
    fn film(
        &self,
        chart: &str,
        stages: &[Stage],
        rects: &[Rect],
        full_band: Option<usize>,
    ) -> Result<RegionPixels> {
        self.with_temporary(|path| self.film_at(path, chart, stages, rects, full_band))
    }

    /// What `make` makes of a film at the path that it gets, which is removed.
    fn with_temporary<T>(&self, make: impl FnOnce(&Path) -> Result<T>) -> Result<T> {
        // A temporary name: after a kill the next run in this directory removes the film.
        let path = self.dir.join(temp_name());
        let made = make(&path);
        let removed = FilmStore::remove(&path);
        // An error of the run comes before one of the removal.
        let made = made?;
        removed?;
        Ok(made)
    }

    fn film_at(
        &self,
        path: &Path,
        chart: &str,
        stages: &[Stage],
        rects: &[Rect],
        full_band: Option<usize>,
    ) -> Result<RegionPixels> {
        let regions_of_film = if full_band.is_none() { rects } else { &[] };
        self.run(path, chart, stages, (full_band, VeilArgs::default()), regions_of_film)?;
        let regions = rects.iter().enumerate().map(|(i, rect)| match full_band {
            Some(_) => read_region(path, "film", *rect),
            None => read_region(path, &format!("roi_{i}"), rect.size().rect()),
        });
        let regions: Vec<Vec<Vec<f32>>> = regions.collect::<Result<_>>()?;
        let bands = regions.first().map_or(0, Vec::len);
        let mut by_band: RegionPixels = vec![Vec::new(); bands];
        for region in regions {
            for (band, pixels) in region.into_iter().enumerate() {
                by_band[band].push(pixels);
            }
        }
        Ok(by_band)
    }

    /// Makes the film at `path`: of one band, or of all, with `veil`; of the regions `rects`, or complete without any.
    fn run(
        &self,
        path: &Path,
        chart: &str,
        stages: &[Stage],
        (band, veil): (Option<usize>, VeilArgs),
        rects: &[Rect],
    ) -> Result<()> {
        let job = RunArgs {
            lens: self.lens.clone(),
            tracing: TracingArgs { coatings: self.coatings.clone(), ..TracingArgs::default() },
            stages: stages.to_vec(),
            bands: band.map(|band| format!("#{band}")),
            roi: rects.to_vec(),
            veil,
            no_fsync: true,
            threads: Some(self.threads),
            memory: self.memory,
            device: self.device.clone(),
            engine: self.engine,
            ..RunArgs::new(chart, path)
        };
        let code = as_step(|| run::run_job(&job, None, ProgressArg::None))
            .with_context(|| format!("simulating the film of {chart}"))?;
        match code {
            0 => Ok(()),
            code => {
                let message = "interrupted; run the same command again to start over".into();
                Err(Coded { code, message }.into())
            }
        }
    }

    /// Regions of the film of one band with a veil, and the sum of its layer.
    pub fn veiled(
        &self,
        chart: &str,
        stages: &[Stage],
        (band, veil): (usize, VeilArgs),
        rects: &[Rect],
    ) -> Result<VeiledFilm> {
        self.with_temporary(|path| {
            self.run(path, chart, stages, (Some(band), veil), rects)?;
            let read = |(i, rect): (usize, &Rect)| {
                Ok(read_region(path, &format!("roi_{i}"), rect.size().rect())?.swap_remove(0))
            };
            let regions = rects.iter().enumerate().map(read).collect::<Result<_>>()?;
            let store = FilmStore::open(path, false)?;
            let layer = store.read_layer(0, 0)?.context("the film has no layer")?;
            let grid = store.spec().layer_grid(0, 0);
            let (bins, area) = (grid.bins(), (grid.bin_px * grid.bin_px) as f64);
            let rows = layer.chunks_exact(grid.size().width).skip(grid.margin).take(bins.height);
            let of_film = rows.flat_map(|row| &row[grid.margin..][..bins.width]);
            let sum: f64 = of_film.map(|coefficient| f64::from(*coefficient)).sum();
            Ok(VeiledFilm { regions, layer_sum: area * sum, layer_px2: area * bins.pixels() as f64 })
        })
    }
}

/// A film with a veil.
pub struct VeiledFilm {
    /// Pixels of its regions.
    pub regions: Vec<Vec<f32>>,
    /// Sum of its layer over the bins of the film, in film values × px².
    pub layer_sum: f64,
    /// Area of these bins, px².
    pub layer_px2: f64,
}

/// Pixels of `part` of the array `array` of the film at `path`, by band.
fn read_region(path: &Path, array: &str, part: Rect) -> Result<Vec<Vec<f32>>> {
    let options = ChartOptions { cache_bytes: 64 << 20, nan: NanPolicy::Keep, ..ChartOptions::default() };
    let store = ChartStore::open(&format!("{}//{array}", path.display()), options)?;
    let bands = (0..store.bands()).map(|band| {
        let mut pixels = vec![0f32; part.size().pixels()];
        store.read_rect(band, part, &mut pixels)?;
        Ok(pixels)
    });
    bands.collect()
}

/// `rect`, if it lies inside a film of `size` x `size` px; a usage error otherwise.
pub fn inside_film(rect: Rect, size: usize, what: &str) -> Result<Rect> {
    if Size::new(size, size).rect().contains(rect) {
        return Ok(rect);
    }
    Err(usage(format!(
        "{what}: the measured region, {rect}, is not inside the film of {size}x{size} px; choose a larger --film-size"
    )))
}
