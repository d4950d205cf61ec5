//! Films for measuring: each made by `lenscube run`, as typed, read back and removed.

use crate::args::{Cli, Command, Device, EngineArg};
use crate::failure::{Coded, usage};
use crate::run;
use anyhow::{Context, Result};
use clap::Parser;
use formats::chart::{ChartOptions, ChartStore, NanPolicy};
use formats::durable::temp_name;
use formats::film::FilmStore;
use pipeline::geometry::Rect;
use std::path::{Path, PathBuf};

/// How films are made.
#[derive(Clone, Debug)]
pub struct Films {
    /// The lens.
    pub lens: String,
    /// Where they lie.
    pub dir: PathBuf,
    /// Whole films instead of windows.
    pub full: bool,
    /// Bands.
    pub bands: usize,
    /// Worker threads.
    pub threads: usize,
    /// Memory to stay within.
    pub memory: Option<u64>,
    /// What computes.
    pub device: Device,
    /// Its engine.
    pub engine: EngineArg,
}

/// The pixels of windows: by band, by window.
pub type Shots = Vec<Vec<Vec<f32>>>;

impl Films {
    /// Makes the film of `chart` by `stages` and reads the windows `rects` of it.
    pub fn shoot(&self, chart: &str, stages: &str, rects: &[Rect]) -> Result<Shots> {
        if !self.full {
            return self.film(chart, stages, rects, None);
        }
        // One band at a time: a whole film of all bands would take 25 GB.
        let mut shots = Vec::new();
        for band in 0..self.bands {
            shots.extend(self.film(chart, stages, rects, Some(band))?);
        }
        Ok(shots)
    }

    fn film(&self, chart: &str, stages: &str, rects: &[Rect], whole: Option<usize>) -> Result<Shots> {
        // A name that no film of the user's has; after a kill the next run in this directory sweeps it.
        let path = self.dir.join(temp_name());
        let shots = self.film_at(&path, chart, stages, rects, whole);
        // The error that matters is already in hand; a film that never began is not there.
        let removed = FilmStore::remove_film(&path);
        let shots = shots?;
        removed?;
        Ok(shots)
    }

    fn film_at(
        &self,
        path: &Path,
        chart: &str,
        stages: &str,
        rects: &[Rect],
        whole: Option<usize>,
    ) -> Result<Shots> {
        let mut words: Vec<String> =
            ["lenscube", "run", "--lens", &self.lens, "--stages", stages, "--no-fsync"]
                .map(String::from)
                .into();
        match whole {
            Some(band) => words.extend(["--bands".into(), band.to_string()]),
            None => {
                for r in rects {
                    words.extend(["--roi".into(), format!("{},{},{},{}", r.x, r.y, r.width, r.height)]);
                }
            }
        }
        words.extend(["--threads".into(), self.threads.to_string()]);
        if let Some(memory) = self.memory {
            words.extend(["--memory".into(), memory.to_string()]);
        }
        words.extend(["--device".into(), self.device.to_string()]);
        words.extend(["--engine".into(), self.engine.to_string(), "--".into(), chart.into()]);
        words.push(path.to_string_lossy().into_owned());
        let Command::Run(args) = Cli::try_parse_from(words)?.command else {
            unreachable!("`run` is typed above")
        };
        let code = run::command(&args).with_context(|| format!("making the film of {chart}"))?;
        if code != 0 {
            return Err(Coded { code, message: "interrupted; the same command starts anew".into() }.into());
        }
        let shots = rects.iter().enumerate().map(|(i, rect)| {
            let (array, part) = match whole {
                Some(_) => ("film".to_owned(), *rect),
                None => (format!("roi_{i}"), rect.size().rect()),
            };
            let options = ChartOptions { cache_bytes: 64 << 20, nan: NanPolicy::Keep, wavelengths_nm: None };
            let store = ChartStore::open(&format!("{}//{array}", path.display()), options)?;
            let bands = (0..store.bands()).map(|band| {
                let mut pixels = vec![0f32; part.size().pixels()];
                store.read_rect(band, part, &mut pixels)?;
                Ok(pixels)
            });
            bands.collect::<Result<Vec<_>>>()
        });
        let shots: Vec<Vec<Vec<f32>>> = shots.collect::<Result<_>>()?;
        let bands = shots.first().map_or(0, Vec::len);
        let mut of_band: Shots = vec![Vec::new(); bands];
        for shot in shots {
            for (band, pixels) in shot.into_iter().enumerate() {
                of_band[band].push(pixels);
            }
        }
        Ok(of_band)
    }
}

/// Fails on a window that leaves the film: nothing could be measured there.
pub fn on_film(rect: Rect, size: usize, what: &str) -> Result<Rect> {
    if pipeline::geometry::Size::new(size, size).rect().contains(rect) {
        return Ok(rect);
    }
    Err(usage(format!(
        "{what}: its window, {rect}, leaves the film of {size} x {size} px; take a larger --size"
    )))
}
