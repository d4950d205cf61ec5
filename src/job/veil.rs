//! Scatter and veiling glare of a job: the layer `veil` of its film.

use crate::args::{BinArg, RunArgs};
use crate::failure::usage;
use crate::job::ghosts::JobGhosts;
use crate::job::layers::{JobLayer, LayerInputs};
use anyhow::Result;
use formats::film::FilmLayer;
use formats::object;
use pipeline::flow::SourceSinkError;
use pipeline::geometry::Frame;
use pipeline::layer::Taps;
use pipeline::reduced_chart::ReducedChart;
use pipeline::veil::{VEIL_MARGIN_BINS, VeilMaker, VeilPlan, VeilShares};
use serde_json::{Map, Value, json};

/// Name of the layer.
const NAME: &str = "veil";

/// The veil of a job.
pub struct JobVeil {
    maker: VeilMaker,
    shares: VeilShares,
    ghosts: Option<JobGhosts>,
    stored: FilmLayer,
    making_bytes: usize,
}

impl JobVeil {
    /// The veil of `args` on the film of `frame` in `bands` bands, computed by `threads` threads; `None` without one.
    ///
    /// # Errors
    /// Usage: shares, bins or reach that do not fit.
    pub fn new(
        args: &RunArgs,
        frame: &Frame,
        bands: usize,
        threads: usize,
        ghosts: Option<JobGhosts>,
    ) -> Result<Option<Self>> {
        if let Some(contradiction) = args.veil.contradiction() {
            return Err(usage(contradiction));
        }
        if !args.veil.is_on() {
            return Ok(None);
        }
        let scatter = args.veil.scattered();
        let shape = scatter.map(|s| (s.shoulder_um * 1e-3, s.slope, s.reach_mm));
        let bin_px = bin_px(args, frame);
        let plan = VeilPlan::new(frame, bin_px, shape).map_err(|e| match scatter {
            Some(scatter) => usage(format!("--scatter {scatter} with --veil-bin {bin_px}: {e}")),
            None => usage(format!("--veil-bin {bin_px}: {e}")),
        })?;
        let shares =
            VeilShares { glare: args.veil.glare(), scatter: scatter.map_or(0.0, |scatter| scatter.share) };
        let parts = [("scatter", shares.scatter), ("glare", shares.glare)];
        let parts = parts.into_iter().filter(|part| part.1 > 0.0);
        let stored = FilmLayer {
            name: NAME.into(),
            bin_px: vec![bin_px; bands],
            margin_bins: VEIL_MARGIN_BINS,
            share_taken: vec![shares.taken(); bands],
            parts: parts
                .map(|(name, share)| (name.to_owned(), json!(share)))
                .chain(ghosts.iter().map(|ghosts| ("ghosts".to_owned(), ghosts.part())))
                .collect(),
        };
        let of_ghosts = ghosts.as_ref().map_or(0, JobGhosts::making_bytes);
        let making_bytes = plan.making_bytes(frame.chart, threads) + of_ghosts;
        Ok(Some(Self { maker: VeilMaker::new(plan), shares, ghosts, stored, making_bytes }))
    }
}

/// Side of the bins, film pixels.
fn bin_px(args: &RunArgs, frame: &Frame) -> usize {
    match args.veil.veil_bin {
        Some(BinArg::Px(px)) => px,
        Some(BinArg::Auto) | None => VeilPlan::usual_bin_px(frame.film),
    }
}

/// What the veil adds to the identity of a job: nothing without one.
pub fn identity(args: &RunArgs, frame: &Frame) -> Map<String, Value> {
    let mut map = Map::new();
    if !args.veil.is_on() {
        return map;
    }
    if args.veil.glare() > 0.0 {
        map.insert("veiling_glare".into(), args.veil.glare().into());
    }
    if let Some(scatter) = args.veil.scattered() {
        let shape = object! {
            "share": scatter.share,
            "r0_um": scatter.shoulder_um,
            "slope": scatter.slope,
            "reach_mm": scatter.reach_mm,
        };
        map.insert("scatter".into(), shape.into());
    }
    let bin_px = bin_px(args, frame);
    if bin_px != VeilPlan::usual_bin_px(frame.film) {
        map.insert("veil_bin".into(), bin_px.into());
    }
    map
}

impl JobLayer for JobVeil {
    fn stored(&self) -> &FilmLayer {
        &self.stored
    }

    fn taps(&self) -> Taps {
        Taps::BSpline
    }

    fn remaining(&self, _band: usize) -> f64 {
        1.0 - self.shares.taken()
    }

    fn making_bytes(&self) -> usize {
        self.making_bytes
    }

    fn making_s(&self) -> f64 {
        self.maker.plan().making_s() + self.ghosts.as_ref().map_or(0.0, JobGhosts::making_s)
    }

    fn coefficients(&self, band: &LayerInputs<'_>) -> Result<Vec<f32>, SourceSinkError> {
        let LayerInputs { chart, chart_band, frame, plan, options, gain, threads, cancel } = *band;
        let reduced = ReducedChart::read(chart, chart_band, self.maker.plan().reduced_px, threads, cancel)?;
        let operator =
            self.ghosts.as_ref().map(|ghosts| ghosts.operator(plan.lens.wavelength_nm)).transpose()?;
        Ok(self.maker.layer(
            frame,
            &plan.lens,
            options,
            (gain, self.shares),
            &reduced,
            operator.as_ref(),
            threads,
        ))
    }
}
