//! Step 4: the film's layout, the lens ready at the job's wavelengths, and the plan of each band (tables, FFT blocks, tiles).

use super::arguments::Arguments;
use super::depth_forecast::DepthForecast;
use super::film::{gain, regions};
use super::inputs::Inputs;
use super::window_light;
use crate::job::lens::{EstimatedLens, JobLens, TracedFor, UntracedLens};
use crate::progress::log_line;
use anyhow::Result;
use formats::film::FilmSpec;
use formats::lens::LensPackError;
use pipeline::band::{BandPlan, Options};
use pipeline::tiling::FilmRegion;

/// The planned bands of a job, and its film.
pub struct JobPlan {
    /// The lens; a design is traced.
    pub lens: JobLens,
    /// Plan per band.
    pub bands: Vec<BandPlan>,
    /// Film value per chart value on the axis, per band.
    pub gains: Vec<f64>,
    /// Layout of the film.
    pub film: FilmSpec,
    /// Regions of the film to compute.
    pub regions: Vec<FilmRegion>,
}

impl JobPlan {
    /// Plans the job of `inputs` with the layout `film`, traces `lens` if it is a design.
    ///
    /// # Errors
    /// The lens does not cover film or wavelengths; tracing failed.
    pub fn new(
        arguments: &Arguments<'_>,
        inputs: &Inputs,
        lens: UntracedLens,
        film: FilmSpec,
    ) -> Result<Self> {
        let (args, frame, options) = (arguments.given, &inputs.frame, &arguments.options);
        let nm = inputs.wavelengths_nm();
        let before_trace = |found: &EstimatedLens| {
            let forecast = DepthForecast::of_nodes((arguments, inputs, &film), found)?;
            log_line(forecast.text());
            Ok(())
        };
        let depth = match &inputs.depth {
            None => None,
            Some(depth) => {
                let options = lens.depth_options(&args.surfaces, depth.range)?;
                Some(TracedFor { surfaces: &depth.surfaces, options, before_trace: Some(&before_trace) })
            }
        };
        let lens = JobLens::new(lens, frame, &nm, options, arguments.threads, depth);
        let lens = lens.map_err(|e| window_light::with_likely_pitch(args, e))?;
        let plan = |&nm: &f64| {
            let plan = match &inputs.depth {
                None => BandPlan::new(frame, lens.lens(), nm, options),
                Some(depth) => BandPlan::with_depth(frame, lens.lens(), nm, options, &depth.surfaces),
            };
            plan.map_err(|e| window_light::with_likely_pitch(args, e.into()))
        };
        let bands: Vec<BandPlan> = nm.iter().map(plan).collect::<Result<_>>()?;
        let gains = bands.iter().map(|b| gain(args.film_units, b, frame)).collect();
        let regions = regions(&film);
        Ok(Self { lens, bands, gains, film, regions })
    }

    /// Puts the tails of PSFs on the film, of the bands that have any.
    pub fn add_tails(&mut self, inputs: &Inputs, options: &Options) {
        self.bands.iter_mut().for_each(|band| band.add_tail(&inputs.frame, options));
    }
}

/// What a process needs from a plan to do some of its bands.
#[derive(Clone, Copy)]
pub struct PlannedBands<'a> {
    /// Bands of the film that the process computes, ascending.
    pub bands: &'a [usize],
    /// [`JobLens::band_digest`] of every band of the film.
    pub lens_bands: &'a [String],
    /// Bins of the layer of tails by band of the film, film pixels; empty without one.
    pub tail_bins_px: &'a [usize],
    /// Digest of the complete lens.
    pub lens_digest: &'a str,
    /// Whether the kernels of a band of the film are made from coarse samples.
    pub is_coarse: bool,
}

impl PlannedBands<'_> {
    /// The planned lens's digest if the lens at hand has the planned bands, else the digest of the first band that differs.
    ///
    /// # Errors
    /// The lens cannot be read.
    pub fn lens_digest(&self, lens: &JobLens, plans: &[BandPlan]) -> Result<String, LensPackError> {
        for (band, plan) in std::iter::zip(self.bands, plans) {
            let found = lens.band_digest(plan.lens_bands)?;
            if self.lens_bands.get(*band) != Some(&found) {
                return Ok(found);
            }
        }
        Ok(self.lens_digest.to_owned())
    }
}
