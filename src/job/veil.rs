//! Scatter and veiling glare of a job: the layer `veil` of its film.

use crate::args::{BinArg, RunArgs};
use crate::failure::usage;
use crate::job::ghosts::JobGhosts;
use crate::job::inputs::Inputs;
use crate::job::layers::{JobLayer, LayerInputs};
use crate::job::lens::UntracedLens;
use crate::progress::{log_line, number};
use anyhow::Result;
use formats::film::FilmLayer;
use pipeline::depth::seen::SeenChart;
use pipeline::design::ghost::rings::RingOperator;
use pipeline::flow::SourceSinkError;
use pipeline::geometry::Frame;
use pipeline::layer::Taps;
use pipeline::reduced_chart::ReducedChart;
use pipeline::stage::Stage;
use pipeline::veil::{ExpectedIndex, VEIL_MARGIN_BINS, VeilMaker, VeilPlan, VeilShares};
use serde_json::{Map, Value, json};
use std::sync::Once;

/// Name of the layer.
pub const VEIL: &str = "veil";
/// Key and version of glare and scatter in the identity of a job; incremented when their values change.
const VEIL_VERSION: (&str, u32) = ("veil_version", 3);

/// The veil of a job.
pub struct JobVeil {
    maker: VeilMaker,
    /// Per band of the film.
    shares: Vec<VeilShares>,
    ghosts: Option<JobGhosts>,
    stored: FilmLayer,
    making_bytes: usize,
    /// Whether the expected index was printed.
    is_noted: Once,
}

impl JobVeil {
    /// The veil of `args` on the film of `inputs`, computed by `threads` threads; `None` without one.
    ///
    /// # Errors
    /// Usage: shares, bins or reach that do not fit.
    fn new(
        args: &RunArgs,
        inputs: &Inputs,
        threads: usize,
        ghosts: Option<JobGhosts>,
    ) -> Result<Option<Self>> {
        let (frame, scatter) = (&inputs.frame, inputs.scatter.as_ref());
        let bands = inputs.selected_nm.len();
        if let Some(contradiction) = args.veil.contradiction() {
            return Err(usage(contradiction));
        }
        if !args.veil.is_on() {
            return Ok(None);
        }
        let asked = scatter.map(|scatter| scatter.asked);
        let shape = asked.map(|s| (s.shoulder_um * 1e-3, s.slope, s.reach_mm));
        let bin_px = bin_px(args, frame);
        let plan = VeilPlan::new(frame, bin_px, shape).map_err(|e| match asked {
            Some(asked) => usage(format!("--scatter {asked} with --veil-bin {bin_px}: {e}")),
            None => usage(format!("--veil-bin {bin_px}: {e}")),
        })?;
        let glare = args.veil.glare();
        let of_band =
            |band| VeilShares { glare, scatter: scatter.map_or(0.0, |scatter| scatter.shares[band]) };
        let shares: Vec<VeilShares> = (0..bands).map(of_band).collect();
        let scattered = scatter.map(|scatter| ("scatter", scatter.described()));
        let parts = scattered.into_iter().chain((glare > 0.0).then(|| ("glare", json!(glare))));
        let stored = FilmLayer {
            name: VEIL.into(),
            bin_px: vec![bin_px; bands],
            margin_bins: VEIL_MARGIN_BINS,
            share_taken: shares.iter().map(VeilShares::taken).collect(),
            parts: parts
                .map(|(name, share)| (name.to_owned(), share))
                .chain(ghosts.iter().map(|ghosts| ("ghosts".to_owned(), ghosts.part())))
                .collect(),
        };
        let of_ghosts = ghosts.as_ref().map_or(0, JobGhosts::making_bytes);
        let of_surfaces = match inputs.depth.as_ref().is_some_and(|depth| !depth.is_opaque()) {
            true => threads * SeenChart::bytes(ReducedChart::block_pixels()),
            false => 0,
        };
        let making_bytes = plan.making_bytes(frame.chart, threads) + of_ghosts + of_surfaces;
        Ok(Some(Self {
            maker: VeilMaker::new(plan),
            shares,
            ghosts,
            stored,
            making_bytes,
            is_noted: Once::new(),
        }))
    }

    /// Prints the expected veiling glare index of a band.
    fn note_index(&self, band: &LayerInputs<'_>, operator: Option<&RingOperator>) {
        let (shares, scatter) = (self.shares[band.film_band], self.maker.plan().scatter);
        let lens = &band.plan.lens;
        let illumination = |real_mm: f64| match band.options.stages.has(Stage::Ri) {
            true => lens.illumination_at(real_mm),
            false => 1.0,
        };
        let index = ExpectedIndex::new(band.frame, illumination, shares, scatter, operator);
        let parts = [("ghosts", index.ghosts), ("scatter", index.scatter), ("glare", index.glare)];
        let parts: Vec<String> = parts
            .into_iter()
            .filter(|(_, part)| *part > 0.0)
            .map(|(name, part)| format!("{name} {:.3} %", 100.0 * part))
            .collect();
        log_line(format!(
            "note: expected veiling glare index on the axis at {} nm: {} (black disc of 5 % of the film's height in white)",
            number(lens.wavelength_nm),
            parts.join(" + ")
        ));
    }
}

/// Side of the bins, film pixels.
fn bin_px(args: &RunArgs, frame: &Frame) -> usize {
    match args.veil.veil_bin {
        Some(BinArg::Px(px)) => px,
        Some(BinArg::Auto) | None => VeilPlan::usual_bin_px(frame.film),
    }
}

/// The veil of a job, with its ghosts, as a layer.
///
/// # Errors
/// As [`JobVeil::new`] and [`JobGhosts::new`].
pub fn layer(
    args: &RunArgs,
    inputs: &Inputs,
    lens: &UntracedLens,
    threads: usize,
) -> Result<Option<Box<dyn JobLayer>>> {
    let ghosts = JobGhosts::new(args, lens, &inputs.frame, &inputs.selected_nm, threads)?;
    Ok(JobVeil::new(args, inputs, threads, ghosts)?.map(|veil| Box::new(veil) as _))
}

/// What the veil adds to the identity of a job: nothing without one.
pub fn identity(args: &RunArgs, inputs: &Inputs) -> Map<String, Value> {
    let (frame, mut map) = (&inputs.frame, Map::new());
    if !args.veil.is_on() {
        return map;
    }
    if args.veil.glare() > 0.0 {
        map.insert("veiling_glare".into(), args.veil.glare().into());
    }
    if args.veil.glare() > 0.0 || args.veil.scattered().is_some() {
        map.insert(VEIL_VERSION.0.into(), VEIL_VERSION.1.into());
    }
    let bin_px = bin_px(args, frame);
    if bin_px != VeilPlan::usual_bin_px(frame.film) {
        map.insert("veil_bin".into(), bin_px.into());
    }
    map.extend(inputs.scatter.iter().map(|scatter| ("scatter".to_owned(), scatter.identity())));
    map.extend(inputs.ghosts.iter().map(|ghosts| ("ghosts".to_owned(), ghosts.clone())));
    map
}

impl JobLayer for JobVeil {
    fn stored(&self) -> &FilmLayer {
        &self.stored
    }

    fn taps(&self) -> Taps {
        Taps::BSpline
    }

    fn remaining(&self, band: usize) -> f64 {
        1.0 - self.shares[band].taken()
    }

    fn making_bytes(&self) -> usize {
        self.making_bytes
    }

    fn making_s(&self) -> f64 {
        self.maker.plan().making_s() + self.ghosts.as_ref().map_or(0.0, JobGhosts::making_s)
    }

    fn ghosts(&self) -> Option<&JobGhosts> {
        self.ghosts.as_ref()
    }

    fn coefficients(&self, band: &LayerInputs<'_>) -> Result<Vec<f32>, SourceSinkError> {
        let LayerInputs { chart, chart_band, film_band, frame, plan, options, gain, threads, .. } = *band;
        let side = self.maker.plan().reduced_px;
        let read = || ReducedChart::read(chart, chart_band, side, threads, band.cancel);
        let reduced = band.reduced.get(chart.size(), chart_band, side, read)?;
        let operator = self.ghosts.as_ref().map(|ghosts| ghosts.operator(plan)).transpose()?;
        self.is_noted.call_once(|| self.note_index(band, operator.as_ref()));
        Ok(self.maker.layer(
            frame,
            &plan.lens,
            options,
            (gain, self.shares[film_band]),
            &reduced,
            operator.as_ref(),
            threads,
        ))
    }
}
