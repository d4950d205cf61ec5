//! The stages of a job's bands, with the PSFs of its lens and its layers of light.

use crate::job::Job;
use crate::job::layers::{JobLayer, LayerInputs, remaining};
use crate::progress::interrupt;
use formats::durable::fault_point;
use formats::film::{FilmStore, FilmWriter};
use formats::group::GroupError;
use formats::lens::LensPackError;
use pipeline::band::BandStages;
use pipeline::clock::at_once;
use pipeline::depth::seen::SeenChart;
use pipeline::flow::{ChartSource, SourceSinkError};
use pipeline::layer::Layer;
use pipeline::psf::BandPsf;
use pipeline::psf::grid::NodeGrid;
use pipeline::psf::kernel::on_demand::PsfSource;
use pipeline::tails::TailKernels;
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Mutex};

/// A band's stages could not be constructed.
#[derive(Debug, thiserror::Error)]
pub enum StageError {
    /// Tables of the lens.
    #[error(transparent)]
    Lens(#[from] pipeline::lens::LensError),
    /// The lens pack.
    #[error(transparent)]
    Pack(#[from] LensPackError),
}

/// Constructs the stages of a band for the film of `job`, without its layers.
///
/// # Errors
/// The PSFs cannot be read.
pub fn stages(job: &Job, position: usize) -> Result<BandStages, StageError> {
    let sets = job.plans[position].psf_sets(&job.frame);
    of_sets(job, position, position, sets)
}

/// As [`stages`], also for films at other places; the band is called `id` in the cache of spectra.
///
/// # Errors
/// As there.
pub fn with_id(job: &Job, position: usize, id: usize) -> Result<BandStages, StageError> {
    let sets = job.plans[position].grid.as_ref().map_or(0, NodeGrid::psf_sets);
    of_sets(job, position, id, sets)
}

/// The stages with the PSFs of the first `sets` sets, unless they are those of depth nodes or read when they are needed.
fn of_sets(job: &Job, position: usize, id: usize, sets: usize) -> Result<BandStages, StageError> {
    let plan = &job.plans[position];
    let gain = job.gains[position] * remaining(&job.layers, job.film_bands[position]);
    if plan.depth.is_some() {
        let reader = job.lens.psf_reader(plan.lens_bands.first, 1);
        return Ok(plan.depth_stages(id, &job.frame, job.lens.lens(), &job.options, gain, reader));
    }
    if plan.reads_on_demand() {
        let reader = job.lens.psf_reader(plan.lens_bands.first, job.threads);
        let (sample, source) = (job.lens.lens().psf_sample, PsfSource::new(reader, job.threads));
        return Ok(plan.stages_on_demand(id, &job.frame, sample, &job.options, gain, &source));
    }
    let read_psfs = |band: usize| Ok(job.lens.planned_psfs(plan, band, sets, job.threads)?);
    plan.stages(id, &job.frame, &job.options, gain, read_psfs)
}

/// The stages of the band at `position` with the PSF stage `psf`, which films at other places have as well, without its layers.
pub fn with_psf(job: &Job, position: usize, psf: Option<Arc<BandPsf>>) -> BandStages {
    let gain = job.gains[position] * remaining(&job.layers, job.film_bands[position]);
    job.plans[position].stages_with_psf(&job.frame, &job.options, gain, psf)
}

/// The layers of the band at `position`, in the order in which they are added: each is read from the film, or computed and written to `film`. Of processes that need
/// one at once each computes the same bytes.
///
/// # Errors
/// A stored layer is damaged; the chart cannot be read; the film cannot be written.
pub fn layers(job: &Job, film: &FilmWriter<'_>, position: usize) -> Result<Vec<Layer>, SourceSinkError> {
    let store = film.store();
    let band = job.film_bands[position];
    let seen = job.depth.as_ref().filter(|depth| !depth.is_opaque());
    let seen = seen.map(|depth| SeenChart::new(job.chart.source(), depth.sheets()));
    let source = seen.as_ref().map_or_else(|| job.chart.source(), |seen| seen as &dyn ChartSource);
    let chart = (source, job.chart_bands[position]);
    let inputs = layer_inputs(job, position, chart, None, interrupt::cancel_flag());
    let layer = |(index, source): (usize, &dyn JobLayer)| {
        let coefficients = match store.read_layer(index, band)? {
            Some(stored) => stored,
            None => {
                let made = source.coefficients(&inputs)?;
                fault_point("layer-made");
                film.commit_beside(&store.encode_layer(index, band, &made))?;
                fault_point("layer-committed");
                made
            }
        };
        Ok(Layer::new(store.spec().layer_grid(index, band), source.taps(), coefficients))
    };
    job.layers.iter().map(AsRef::as_ref).enumerate().map(layer).collect()
}

/// The layers of the band at `position` of a film in memory, of the band `chart.1` of `chart.0`, whose tails have the kernels `tail_kernels`.
///
/// # Errors
/// The chart cannot be read.
pub fn layers_of_array(
    job: &Job,
    position: usize,
    chart: (&dyn ChartSource, usize),
    tail_kernels: Option<&TailKernels>,
    cancel: &AtomicBool,
) -> Result<Vec<Layer>, SourceSinkError> {
    let band = job.film_bands[position];
    let inputs = layer_inputs(job, position, chart, tail_kernels, cancel);
    let layer = |(index, source): (usize, &dyn JobLayer)| {
        let grid = job.film.layer_grid(index, band);
        Ok(Layer::new(grid, source.taps(), source.coefficients(&inputs)?))
    };
    job.layers.iter().map(AsRef::as_ref).enumerate().map(layer).collect()
}

/// What the layers of the band at `position` are computed from, of the band `chart.1` of `chart.0`.
fn layer_inputs<'a>(
    job: &'a Job,
    position: usize,
    (chart, chart_band): (&'a dyn ChartSource, usize),
    tail_kernels: Option<&'a TailKernels>,
    cancel: &'a AtomicBool,
) -> LayerInputs<'a> {
    let film_band = job.film_bands[position];
    LayerInputs {
        chart,
        reduced: &job.reduced,
        chart_band,
        film_band,
        frame: &job.frame,
        plan: &job.plans[position],
        tail_kernels,
        options: &job.options,
        gain: job.gains[position],
        remaining: remaining(&job.layers, film_band),
        threads: job.threads,
        cancel,
    }
}

/// Whether a layer of a band of `job` is not in `store` (`None`: the film is not there yet), per position.
///
/// # Errors
/// The store cannot be read.
pub fn without_layers(job: &Job, store: Option<&FilmStore>) -> Result<Vec<bool>, GroupError> {
    match store {
        Some(store) => job.film_bands.iter().map(|band| Ok(!store.has_layers(&[*band])?)).collect(),
        None => Ok(vec![!job.layers.is_empty(); job.film_bands.len()]),
    }
}

/// Constructs the stages of a band, with its layers, which are stored in `film`; `energy` receives the share of the light inside its PSF windows, the mean over the heights of
/// PSFs that were read.
pub fn prepare(
    job: &Job,
    film: &FilmWriter<'_>,
    position: usize,
    energy: &Mutex<Vec<Option<f64>>>,
) -> Result<BandStages, SourceSinkError> {
    let plan = &job.plans[position];
    // The PSFs of a band are made by one thread, its layers by several.
    let (stages, layers) = match job.layers.is_empty() {
        true => (stages(job, position), Ok(Vec::new())),
        false => at_once(|| stages(job, position), || layers(job, film, position)),
    };
    let stages = BandStages { layers: layers?, ..stages? };
    if let Some(psf) = &stages.psf {
        let in_windows = &plan.lens.psf_energy;
        let shares: Vec<f64> = match psf.is_in_memory() {
            true => {
                std::iter::zip(in_windows, psf.kernels().energy()).map(|(pack, crop)| pack * crop).collect()
            }
            // What `--psf-window` crops of PSFs that are not read yet is not known.
            false => in_windows.clone(),
        };
        let mean = shares.iter().sum::<f64>() / shares.len() as f64;
        energy.lock().expect("no panic while held")[position] = Some(mean);
    }
    Ok(stages)
}
