//! Tails of the PSFs of a job: the layer `veil_tail` of its film.

use super::bands::JobPlan;
use super::inputs::Inputs;
use crate::args::RunArgs;
use crate::failure::usage;
use crate::job::layers::{JobLayer, LayerInputs};
use crate::job::lens::{JobLens, UntracedLens};
use crate::progress::{number, plural};
use anyhow::Result;
use formats::film::{FilmLayer, FilmSpec};
use pipeline::flow::SourceSinkError;
use pipeline::layer::{BinGrid, Taps};
use pipeline::stage::Stage;
use pipeline::tails::{ChartCells, MAX_BIN_PX, TAIL_MARGIN_BINS, TailKernels, TailPlan};
use serde_json::json;

/// Name of the layer.
pub const TAILS: &str = "veil_tail";
/// Key of the identity of a job with tails, and version of their arithmetic: raised whenever the program computes other values of their layer.
pub const TAIL_LAYER_VERSION: (&str, u32) = ("tails_version", 2);

/// The tails of a job.
pub struct JobTail {
    stored: FilmLayer,
    making_bytes: usize,
    making_s: f64,
}

/// Whether the film of `args` has tails: the job admits them, and `lens` is a design or a pack with tails. It belongs to the identity of a job.
///
/// # Errors
/// Usage: a crop of PSF windows.
pub fn has_tails(args: &RunArgs, has_depth: bool, lens: &UntracedLens) -> Result<bool> {
    let has_tails = args.tracing.admits_tails(args.stages.contains(&Stage::Svpsf), has_depth)
        && match lens {
            UntracedLens::Design(_) => lens.is_symmetric(),
            UntracedLens::Pack(pack) => {
                pack.lens().depth.is_none() && pack.lens().bands.iter().any(|band| band.tail.is_some())
            }
        };
    if has_tails && args.psf_window.is_some() {
        return Err(usage("--psf-window requires --tails off: it cuts the windows from which tails begin"));
    }
    Ok(has_tails)
}

impl JobTail {
    /// The tails of the bands `plan` on a film of `inputs`, computed by `threads` threads; `None` if no band of the
    /// film has any. `planned_bins_px`: bins of all bands of the film, from a plan; empty without one, where this process has all bands.
    pub fn new(plan: &JobPlan, inputs: &Inputs, planned_bins_px: &[usize], threads: usize) -> Option<Self> {
        let tails = || plan.bands.iter().filter_map(|band| band.tail.as_ref());
        let (frame, chart) = (&inputs.frame, inputs.frame.chart);
        if tails().next().is_none() && planned_bins_px.is_empty() {
            return None;
        }
        let making_bytes =
            tails().map(|tail| tail.all_making_bytes(frame, chart, threads)).max().unwrap_or(0);
        let making_s = tails().map(|tail| tail.making_s()).fold(0.0, f64::max);
        let bands = inputs.selected_nm.len();
        let mut bin_px = match planned_bins_px.len() == bands {
            true => planned_bins_px.to_vec(),
            false => vec![MAX_BIN_PX; bands],
        };
        for (band, plan) in std::iter::zip(&inputs.film_bands, &plan.bands) {
            // Any of a band without tails.
            bin_px[*band] = plan.tail.as_ref().map_or(MAX_BIN_PX, TailPlan::bin_px);
        }
        let stored = FilmLayer {
            name: TAILS.into(),
            bin_px,
            margin_bins: TAIL_MARGIN_BINS,
            // It depends on the height, and is part of the PSF.
            share_taken: vec![0.0; bands],
            parts: [("tails".to_owned(), json!("of PSFs"))].into_iter().collect(),
        };
        Some(Self { stored, making_bytes, making_s })
    }
}

/// Bins of the layer of tails of `film` by band, film pixels; empty without one.
pub fn tail_bins_px(film: &FilmSpec) -> Vec<usize> {
    film.layers.iter().find(|layer| layer.name == TAILS).map_or(Vec::new(), |layer| layer.bin_px.clone())
}

impl JobLayer for JobTail {
    fn stored(&self) -> &FilmLayer {
        &self.stored
    }

    fn taps(&self) -> Taps {
        Taps::Lagrange
    }

    fn remaining(&self, _band: usize) -> f64 {
        1.0
    }

    fn making_bytes(&self) -> usize {
        self.making_bytes
    }

    fn making_s(&self) -> f64 {
        self.making_s
    }

    fn coefficients(&self, band: &LayerInputs<'_>) -> Result<Vec<f32>, SourceSinkError> {
        let LayerInputs { frame, plan, options, threads, .. } = *band;
        let Some(tail) = &plan.tail else {
            return Ok(vec![0.0; BinGrid::new(frame.film, MAX_BIN_PX, TAIL_MARGIN_BINS).size().pixels()]);
        };
        let surround = options.interpolation.surround;
        let chart = (band.chart, band.chart_band);
        let sides = tail.cells_px(frame);
        let cells = ChartCells::read(chart, sides, surround, options.simd, threads, band.cancel)?;
        let own;
        let kernels = match band.tail_kernels {
            Some(kernels) => kernels,
            None => {
                own = TailKernels::new(tail, options.simd);
                &own
            }
        };
        Ok(tail.layer(kernels, frame, &plan.lens, options, (cells, band.gain * band.remaining), threads))
    }
}

/// Error of edges, in percent of white, below which what has no tails has no note.
const MIN_ERROR_PERCENT: f64 = 0.05;

/// A note of what has no tails though they are asked for.
pub fn note(args: &RunArgs, plan: &JobPlan, has_depth: bool) -> Option<String> {
    if !args.tracing.tails || !args.stages.contains(&Stage::Svpsf) {
        return None;
    }
    let scaled = "the light of PSFs beyond their windows is scaled into them";
    if has_depth {
        return Some(format!("no tails of surfaces at distances: {scaled}"));
    }
    if !plan.lens.lens().is_symmetric() {
        return Some(format!("no tails of lenses without rotational symmetry: {scaled}"));
    }
    if args.tracing.integrated_bands().is_some() {
        return Some(format!("no tails of bands with --band-samples: {scaled}"));
    }
    let without = || plan.bands.iter().filter(|band| band.tail.is_none());
    let least = without().flat_map(|band| &band.lens.psf_energy).copied().fold(1.0, f64::min);
    let error = 50.0 * (1.0 - least);
    if error < MIN_ERROR_PERCENT {
        return None;
    }
    let first = without().next()?;
    let has_none = plan.bands.iter().all(|band| band.lens.tail.is_none());
    if matches!(plan.lens, JobLens::Pack(_)) && has_none {
        return Some(format!(
            "the lens pack has no tails: {scaled}, so edges are up to {error:.1} % of white wrong; `lenscube lens trace` makes a pack with tails"
        ));
    }
    Some(format!(
        "{} of {} (from {} nm on) without tails, as rays at the edge of the pupil land far beyond their windows, or windows have fewer than 11 film pixels (40 where rays land beyond them): \
         {scaled}, so edges are up to {error:.1} % of white wrong",
        plural(without().count(), "band"),
        plan.bands.len(),
        number(first.lens.wavelength_nm)
    ))
}
