//! A film of arrays at one place of the lens's field.

use super::shared::SharedStages;
use crate::failure::{Coded, code, usage};
use crate::job::Job;
use crate::job::stages::layers_of_array;
use anyhow::Result;
use formats::chart::{ArrayChart, ArrayPixels, Chart};
use pipeline::band::BandStages;
use pipeline::buffer::ShardPixels;
use pipeline::executor::{BandWork, Work, run};
use pipeline::flow::{FilmSink, SourceSinkError};
use pipeline::geometry::{Rect, Size};
use pipeline::stages::StageCompute;
use pipeline::tiling::{FilmRegion, ShardId};
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Mutex};

/// A film of arrays, ready to be computed.
pub struct ArrayFilm {
    job: Job,
    stages: Vec<BandStages>,
    shared: Arc<SharedStages>,
}

impl ArrayFilm {
    /// The film of `job`, one of [`Job::of_arrays`].
    ///
    /// # Errors
    /// Usage: several regions. The lens changed.
    pub(super) fn new(job: Job, shared: Arc<SharedStages>) -> Result<Self> {
        if job.regions.len() != 1 {
            return Err(usage(format!(
                "roi: expected one rectangle of the film, found {}",
                job.regions.len()
            )));
        }
        job.lens.check_unchanged()?;
        Ok(Self { stages: shared.stages(&job), job, shared })
    }

    /// Bands, rows and columns of its arrays.
    pub fn chart_shape(&self) -> [usize; 3] {
        let Size { height, width } = self.job.frame.chart;
        [self.job.plans.len(), height, width]
    }

    /// Bands, rows and columns of what it computes.
    pub fn shape(&self) -> [usize; 3] {
        let Rect { height, width, .. } = self.region().rect;
        [self.job.plans.len(), height, width]
    }

    /// Optical axis (x, y) in film pixels.
    pub fn axis_px(&self) -> (f64, f64) {
        let (y, x) = self.job.frame.axis_px;
        (x, y)
    }

    /// Side of the PSF windows of band `band`, film pixels; 1 without the PSF stage.
    pub fn window_px(&self, band: usize) -> usize {
        self.stages[band].psf.as_ref().map_or(1, |psf| psf.blocks().window)
    }

    /// Share of the light of the PSFs of band `band` that is inside their windows, by REAL height of the nodes, mm.
    pub fn psf_energy(&self, band: usize) -> (&[f64], &[f64]) {
        let tables = &self.job.plans[band].lens;
        (&tables.psf_height_mm, &tables.psf_energy)
    }

    /// Notes on the job, those of `lenscube run`.
    pub fn notes(&self) -> &[String] {
        &self.job.notes
    }

    /// Name of the instruction set that computes it.
    pub fn engine(&self) -> String {
        self.job.engine.to_string()
    }

    fn region(&self) -> &FilmRegion {
        &self.job.regions[0]
    }

    fn chart(&self) -> &ArrayChart {
        match &self.job.chart {
            Chart::Array(chart) => chart,
            _ => unreachable!("a job of arrays"),
        }
    }

    /// Computes the films of `arrays`, one or several of [`ArrayFilm::chart_shape`] one after the other, into `films`, as many of [`ArrayFilm::shape`].
    /// They are not complete when `cancel` ends the computation.
    ///
    /// # Errors
    /// A pixel of an array that is not valid; cancelled (exit code 130).
    ///
    /// # Panics
    /// The lengths are not those of as many arrays and films.
    pub fn compute(&self, arrays: &[f32], films: &mut [f32], cancel: &AtomicBool) -> Result<()> {
        let of = |shape: [usize; 3]| shape.iter().product::<usize>();
        let (of_array, of_film) = (of(self.chart_shape()), of(self.shape()));
        let count = arrays.len() / of_array;
        assert_eq!(
            (arrays.len(), films.len()),
            (count * of_array, count * of_film),
            "whole arrays and films"
        );
        let job = &self.job;
        let bands = job.plans.len();
        let chart: ArrayPixels<'_> = self.chart().with_pixels(arrays);
        let (rows, columns) = self.region().count();
        // A position is a band of an array.
        let band = |position: usize| BandWork {
            chart_band: position,
            tiling: job.plans[position % bands].tiling,
            shards: (0..rows * columns)
                .map(|i| ShardId { position, region: 0, row: i / columns, col: i % columns })
                .collect(),
        };
        let work = Work {
            film: job.frame.film,
            regions: &job.regions,
            bands: (0..count * bands).map(band).collect(),
            threads: job.threads,
            max_encoded_shards: job.memory.encoded_shards,
            gpus: &[],
            cancel,
        };
        let prepare = |position: usize| {
            let band = position % bands;
            let layers = layers_of_array(job, band, (&chart, position), cancel)?;
            Ok(BandStages { layers, ..self.stages[band].clone() })
        };
        let compute = StageCompute::with_spectra(job.frame, Arc::clone(&self.shared.spectra), &prepare);
        let film = InMemoryFilm { region: self.region().rect, pixels: Mutex::new(films) };
        let summary = run(&work, &chart, &film, &compute, &())?;
        match summary.interrupted {
            true => Err(Coded { code: code::INTERRUPTED, message: "interrupted".into() }.into()),
            false => Ok(()),
        }
    }
}

/// Films in memory, (position, row, column) of a region.
struct InMemoryFilm<'a> {
    region: Rect,
    pixels: Mutex<&'a mut [f32]>,
}

impl FilmSink for InMemoryFilm<'_> {
    type Encoded = ();

    fn encode(&self, id: ShardId, rect: Rect, pixels: &ShardPixels) -> Result<(), SourceSinkError> {
        let Size { height, width } = self.region.size();
        let (y, x) = ((rect.y - self.region.y) as usize, (rect.x - self.region.x) as usize);
        let mut all = self.pixels.lock().expect("no panic while held");
        let film = &mut all[id.position * height * width..][..height * width];
        for row in 0..rect.height {
            film[(y + row) * width + x..][..rect.width].copy_from_slice(&pixels.row(row)[..rect.width]);
        }
        Ok(())
    }

    fn commit(&self, (): ()) -> Result<u64, SourceSinkError> {
        Ok(0)
    }

    fn writers(&self) -> usize {
        1
    }
}
