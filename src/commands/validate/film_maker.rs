//! Simulated films: each made by the code of `lenscube run`, read back and removed.

use crate::args::{Device, EngineArg, ProgressArg, RunArgs};
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
        // A temporary name: after a kill the next run in this directory removes the film.
        let path = self.dir.join(temp_name());
        let pixels = self.film_at(&path, chart, stages, rects, full_band);
        let removed = FilmStore::remove(&path);
        // An error of the run comes before one of the removal.
        let pixels = pixels?;
        removed?;
        Ok(pixels)
    }

    fn film_at(
        &self,
        path: &Path,
        chart: &str,
        stages: &[Stage],
        rects: &[Rect],
        full_band: Option<usize>,
    ) -> Result<RegionPixels> {
        let job = RunArgs {
            lens: self.lens.clone(),
            stages: stages.to_vec(),
            bands: full_band.map(|band| format!("#{band}")),
            roi: if full_band.is_none() { rects.to_vec() } else { Vec::new() },
            no_fsync: true,
            threads: Some(self.threads),
            memory: self.memory,
            device: self.device.clone(),
            engine: self.engine,
            ..RunArgs::new(chart, path)
        };
        let code = as_step(|| run::run_job(&job, None, ProgressArg::None))
            .with_context(|| format!("simulating the film of {chart}"))?;
        if code != 0 {
            let message = "interrupted; run the same command again to start over".into();
            return Err(Coded { code, message }.into());
        }
        let regions = rects.iter().enumerate().map(|(i, rect)| {
            let (array, part) = match full_band {
                Some(_) => ("film".to_owned(), *rect),
                None => (format!("roi_{i}"), rect.size().rect()),
            };
            let options =
                ChartOptions { cache_bytes: 64 << 20, nan: NanPolicy::Keep, ..ChartOptions::default() };
            let store = ChartStore::open(&format!("{}//{array}", path.display()), options)?;
            let bands = (0..store.bands()).map(|band| {
                let mut pixels = vec![0f32; part.size().pixels()];
                store.read_rect(band, part, &mut pixels)?;
                Ok(pixels)
            });
            bands.collect::<Result<Vec<_>>>()
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
