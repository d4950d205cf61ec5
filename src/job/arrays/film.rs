//! A film of arrays at one place of the lens's field.

use super::shared::SharedStages;
use crate::failure::{Coded, code, usage};
use crate::job::Job;
use crate::job::stages::layers_of_array;
use crate::job::tails::TAILS;
use anyhow::{Result, anyhow};
use formats::chart::{ArrayChart, ArrayPixels, Chart};
use pipeline::adjoint::{AdjointError, Kept, chart_of_film};
use pipeline::band::{BandPlan, BandStages};
use pipeline::buffer::ShardPixels;
use pipeline::executor::{BandWork, Work, run};
use pipeline::flow::{FilmSink, SourceSinkError};
use pipeline::geometry::{Rect, Size};
use pipeline::stages::{StageCompute, flags_of};
use pipeline::tails::TailKernels;
use pipeline::tiling::{FilmRegion, ShardId};
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Mutex};

/// A film of arrays, ready to be computed.
pub struct ArrayFilm {
    job: Job,
    stages: Vec<BandStages>,
    shared: Arc<SharedStages>,
    tails: Vec<Option<Arc<TailKernels>>>,
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
        let (stages, tails) = (shared.stages(&job), shared.tails(&job));
        Ok(Self { stages, tails, job, shared })
    }

    /// Limit of its memory, bytes.
    pub(super) fn memory(&self) -> u64 {
        self.job.memory.limit as u64
    }

    /// Whether its kernels are those of `set`.
    pub(super) fn shares(&self, set: &Arc<SharedStages>) -> bool {
        Arc::ptr_eq(&self.shared, set)
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

    /// Side of the PSF windows of band `band`, film pixels; 1 without the PSF stage.
    pub fn window_px(&self, band: usize) -> usize {
        self.stages[band].psf.as_ref().map_or(1, |psf| psf.blocks().window)
    }

    /// Notes on the job, those of `lenscube run`.
    pub fn notes(&self) -> &[String] {
        &self.job.notes
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
        let bands = self.job.plans.len();
        let count = self.count((arrays.len(), films.len()), bands);
        let all: Vec<usize> = (0..count * bands).map(|position| position % bands).collect();
        self.compute_bands(&all, true, arrays, films, cancel)
    }

    /// Computes the film of one array of band `band`, without light beside the image: of the PSFs the part in their windows.
    ///
    /// # Errors
    /// As [`ArrayFilm::compute`].
    ///
    /// # Panics
    /// As there.
    pub fn compute_in_windows(
        &self,
        band: usize,
        array: &[f32],
        film: &mut [f32],
        cancel: &AtomicBool,
    ) -> Result<()> {
        assert_eq!(self.count((array.len(), film.len()), 1), 1, "one array");
        self.compute_bands(&[band], false, array, film, cancel)
    }

    /// The films of arrays of `bands`, with their layers or without.
    fn compute_bands(
        &self,
        bands: &[usize],
        with_layers: bool,
        arrays: &[f32],
        films: &mut [f32],
        cancel: &AtomicBool,
    ) -> Result<()> {
        let job = &self.job;
        let chart: ArrayPixels<'_> = self.chart().with_pixels(arrays);
        let (rows, columns) = self.region().count();
        // A position is a band of an array.
        let band = |position: usize| BandWork {
            chart_band: position,
            tiling: job.plans[bands[position]].tiling,
            shards: (0..rows * columns)
                .map(|i| ShardId { position, region: 0, row: i / columns, col: i % columns })
                .collect(),
        };
        let work = Work {
            film: job.frame.film,
            regions: &job.regions,
            bands: (0..bands.len()).map(band).collect(),
            threads: job.threads,
            max_encoded_shards: job.memory.encoded_shards,
            gpus: &[],
            cancel,
        };
        let prepare = |position: usize| {
            let band = bands[position];
            let layers = match with_layers {
                true => layers_of_array(job, band, (&chart, position), self.tails[band].as_deref(), cancel)?,
                false => Vec::new(),
            };
            Ok(BandStages { layers, ..self.stages[band].clone() })
        };
        let compute = StageCompute::with_spectra(job.frame, Arc::clone(self.shared.spectra()), &prepare);
        let film = InMemoryFilm { region: self.region().rect, pixels: Mutex::new(films) };
        let summary = run(&work, &chart, &film, &compute, &())?;
        if summary.interrupted { Err(interrupted()) } else { Ok(()) }
    }

    /// The transpose of [`ArrayFilm::compute`]: from `films` to `arrays`. They are not complete when `cancel` ends the computation.
    ///
    /// # Errors
    /// Usage: layers of stray light, which have no transpose. A value that is not finite; cancelled (exit code 130).
    ///
    /// # Panics
    /// As there.
    pub fn adjoint(&self, films: &[f32], arrays: &mut [f32], cancel: &AtomicBool) -> Result<()> {
        let bands = self.job.plans.len();
        let count = self.count((arrays.len(), films.len()), bands);
        if let Some(layer) = self.job.layers.iter().find(|layer| layer.stored().name != TAILS) {
            return Err(usage(format!(
                "adjoint: the layer `{}` has no transpose; leave out {}",
                layer.stored().name,
                flags_of(&layer.stored().name)
            )));
        }
        let all: Vec<usize> = (0..count * bands).map(|position| position % bands).collect();
        self.adjoint_of_bands(&all, true, films, arrays, cancel)
    }

    /// The transpose of [`ArrayFilm::compute_in_windows`].
    ///
    /// # Errors
    /// A value that is not finite; cancelled (exit code 130).
    ///
    /// # Panics
    /// As there.
    pub fn adjoint_in_windows(
        &self,
        band: usize,
        film: &[f32],
        array: &mut [f32],
        cancel: &AtomicBool,
    ) -> Result<()> {
        assert_eq!(self.count((array.len(), film.len()), 1), 1, "one array");
        self.adjoint_of_bands(&[band], false, film, array, cancel)
    }

    /// The transposes of films of `bands`, with their tails or without.
    fn adjoint_of_bands(
        &self,
        bands: &[usize],
        with_tails: bool,
        films: &[f32],
        arrays: &mut [f32],
        cancel: &AtomicBool,
    ) -> Result<()> {
        let job = &self.job;
        if let Some(at) = films.iter().position(|value| !value.is_finite()) {
            return Err(anyhow!(
                "adjoint: {} at value {at} of the films, expected finite numbers",
                films[at]
            ));
        }
        let region = self.region().rect;
        let mut whole = vec![0.0; job.frame.film.pixels()];
        let of_film = films.chunks_exact(region.size().pixels());
        let of_array = arrays.chunks_exact_mut(job.frame.chart.pixels());
        for ((film, array), &band) in of_film.zip(of_array).zip(bands) {
            let film = in_whole(film, region, job.frame.film, &mut whole);
            let without;
            let plan = match with_tails || job.plans[band].tail.is_none() {
                true => &job.plans[band],
                false => {
                    without = BandPlan { tail: None, ..job.plans[band].clone() };
                    &without
                }
            };
            let kept = Kept { spectra: self.shared.spectra(), tails: self.tails[band].as_deref() };
            match chart_of_film(&job.frame, plan, &self.stages[band], kept, film, array, job.threads, cancel)
            {
                Err(AdjointError::Stopped) => return Err(interrupted()),
                done => done?,
            }
        }
        Ok(())
    }

    /// Film value per chart value on the axis, of band `band`.
    pub fn gain(&self, band: usize) -> f64 {
        self.job.gains[band]
    }

    /// Digest of the lens, of all its bands.
    ///
    /// # Errors
    /// The pack cannot be read.
    pub fn lens_digest(&self) -> Result<&str> {
        Ok(self.job.lens.digest()?)
    }

    /// Number of arrays of `in_arrays` values, and of films of `in_films`, of `bands` bands each.
    fn count(&self, (in_arrays, in_films): (usize, usize), bands: usize) -> usize {
        let of = |[_, height, width]: [usize; 3]| bands * height * width;
        let (of_array, of_film) = (of(self.chart_shape()), of(self.shape()));
        let count = in_arrays / of_array;
        assert_eq!((in_arrays, in_films), (count * of_array, count * of_film), "whole arrays and films");
        count
    }
}

fn interrupted() -> anyhow::Error {
    Coded { code: code::INTERRUPTED, message: "interrupted".into() }.into()
}

/// `part`, the pixels of `region` of a film of `size`, in the film `whole`, which is 0 elsewhere.
fn in_whole<'a>(part: &'a [f32], region: Rect, size: Size, whole: &'a mut [f32]) -> &'a [f32] {
    if region == size.rect() {
        return part;
    }
    for (y, row) in (region.y as usize..).zip(part.chunks_exact(region.width)) {
        whole[y * size.width + region.x as usize..][..region.width].copy_from_slice(row);
    }
    whole
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
