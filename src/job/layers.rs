//! Layers of light of a job: each is computed before the tiles of a band, stored with the film, and added to its shards ([`super::stages`]).

use super::ghosts::JobGhosts;
use super::reduced::ReducedCharts;
use formats::film::FilmLayer;
use pipeline::band::{BandPlan, Options};
use pipeline::flow::{ChartSource, SourceSinkError};
use pipeline::geometry::Frame;
use pipeline::layer::Taps;
use pipeline::tails::TailKernels;
use std::sync::atomic::AtomicBool;

/// How a job makes one of its layers.
pub trait JobLayer: Send + Sync {
    /// As the film stores it.
    fn stored(&self) -> &FilmLayer;

    /// Its interpolation.
    fn taps(&self) -> Taps;

    /// Share of the light of the image that remains in the image of `band` of the film, at all heights.
    fn remaining(&self, band: usize) -> f64;

    /// Bytes while the layer of a band is computed.
    fn making_bytes(&self) -> usize;

    /// Core seconds of computing the layer of a band, the reading of the chart left out.
    fn making_s(&self) -> f64;

    /// The ghosts that it has.
    fn ghosts(&self) -> Option<&JobGhosts> {
        None
    }

    /// The coefficients of a band, row by row. They depend on the job alone.
    ///
    /// # Errors
    /// The chart cannot be read; stopped.
    fn coefficients(&self, band: &LayerInputs<'_>) -> Result<Vec<f32>, SourceSinkError>;
}

/// What the layers of a band are computed from.
pub struct LayerInputs<'a> {
    /// The chart; of surfaces at several distances what is seen of them.
    pub chart: &'a dyn ChartSource,
    /// Its reduced bands.
    pub reduced: &'a ReducedCharts,
    /// Band of the chart.
    pub chart_band: usize,
    /// Band of the film.
    pub film_band: usize,
    /// Film, axis, place of the chart.
    pub frame: &'a Frame,
    /// The band's plan.
    pub plan: &'a BandPlan,
    /// The kernels of its tails, if other films have used them.
    pub tail_kernels: Option<&'a TailKernels>,
    /// Stages and interpolation.
    pub options: &'a Options,
    /// Film value per chart value on the axis.
    pub gain: f64,
    /// Share of the light of the image that all layers leave in the image.
    pub remaining: f64,
    /// Threads that read the chart.
    pub threads: usize,
    /// Stops the computation.
    pub cancel: &'a AtomicBool,
}

/// Share of the light of the image that remains in the image of `band` of the film.
pub fn remaining(layers: &[Box<dyn JobLayer>], band: usize) -> f64 {
    layers.iter().map(|layer| layer.remaining(band)).product()
}
