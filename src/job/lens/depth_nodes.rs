//! Tracing of the depth nodes that the surfaces of a job need.
//!
//! 1. The nodes of the range are placed ([`pipeline::design::depth::nodes`]), without their PSFs; their vergences are cached.
//! 2. Nodes that bound no slab with surfaces are left out: an empty interval of distances becomes one slab.
//! 3. The others are traced one by one into the cache entry of the band; PSFs are read from there when a kernel is computed, so memory holds neither while
//!    they are traced nor afterwards more than a few of them.

use super::estimate::of_job;
use super::tracing::BandTracer;
use super::tracing_job::{TracedFor, TracingJob};
use crate::failure::usage;
use crate::job::lens::cache;
use crate::progress::{detail_line, log_line, number};
use anyhow::Result;
use formats::durable::free_bytes;
use formats::lens::{DepthBandValues, LensPack, PackAttributes};
use pipeline::design::DesignError;
use pipeline::design::depth::estimate::DepthEstimate;
use pipeline::design::depth::estimate::estimate;
use pipeline::design::depth::nodes::Placement;
use pipeline::design::depth::trace::{band, header, nodes};
use pipeline::design::trace::{BandReport, Progress, TraceOptions, lens_header, with_threads};
use pipeline::lens::PsfStack;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};

/// Samples of PSFs that a core computes in a second, for wide PSFs, measured on a Xeon with AVX-512.
pub const SAMPLES_PER_S: f64 = 2e7;

/// Samples per second and seconds for the pupil function of a PSF, of the PSFs of depth nodes: they share choices, so that fewer are computed than the estimate
/// counts. 4.5, 7.0, 3.1 and 17 core seconds of 22, 26, 34 and 147 nodes, estimated 4.1, 8.3, 4.8 and 17 (scripts/bench/2026-11-26-depth).
const OF_NODES: (f64, f64) = (3e7, 0.0033);

/// Seconds of one core from which on the trace of a band is announced.
const LONG_S: f64 = 10.0;

impl BandTracer<'_> {
    /// Band with the depth nodes that the surfaces of `depth` need, from the cache, or traced and stored there; `with` makes its attributes.
    pub(super) fn depth_band(
        &mut self,
        options: &TraceOptions,
        depth: &TracedFor<'_>,
        with: &dyn Fn(&[BandReport]) -> PackAttributes,
    ) -> Result<(String, LensPack)> {
        let TracingJob { system, frame, .. } = self.job;
        let (nm, threads) = (options.wavelengths_nm[0], self.threads);
        let all = self.placement(options, depth)?;
        let in_use = depth.surfaces.nodes_in_use(&all.vergence, depth.options.focus, frame.chart);
        let count = all.vergence.len();
        let placement = all.only(&in_use);
        detail_line(format!("{nm} nm: {} of {count} depth nodes are needed", placement.vergence.len()));
        let recipe = cache::recipe(system, options, None, Some((&depth.options, &placement.vergence)), false);
        if let Some(pack) = self.cache.find(&recipe, nm) {
            return Ok((recipe, pack));
        }
        self.announce();
        self.forecast(depth)?;
        let estimate = estimate(system, options, 0, &depth.options, &placement.vergence)?;
        let (seconds, text) = needed(&estimate, threads);
        let text = format!("{nm} nm: {text}");
        if seconds > LONG_S {
            log_line(text)
        } else {
            detail_line(text)
        }
        let free = free_bytes(self.cache.dir())?;
        if estimate.bytes > free {
            return Err(usage(format!(
                "the PSFs of the depth nodes at {nm} nm take about {:.1} GB, {} has {:.1} GB free: a larger --depth-tolerance, a scene of a shorter \
                 range of distances or a smaller film need less; XDG_CACHE_HOME sets another directory",
                estimate.bytes as f64 * 1e-9,
                self.cache.dir().display(),
                free as f64 * 1e-9
            )));
        }
        self.traced += 1;
        let (bar, nodes) = (&self.bar, placement.vergence.len());
        let pack = self.cache.insert(&recipe, &mut |pack| {
            let done = AtomicUsize::new(0);
            let mut progress = |p: Progress| {
                bar.step(format!("{nm} nm: depth node {} of {nodes}, {}", done.load(Relaxed) + 1, p.step));
            };
            let mut values = DepthBandValues::default();
            let (lens, report) = with_threads(threads, || {
                let head = (lens_header(system)?, header(system, &depth.options)?);
                let sink = |node: usize, stack: &PsfStack| {
                    done.store(node + 1, Relaxed);
                    values.add_node(stack);
                    pack.psf_of_node(0, node, stack)
                };
                let nodes = (&depth.options, placement.clone());
                let traced = band(system, options, 0, nodes, &mut progress, sink)?;
                Ok::<_, DesignError>(traced.into_lens(head))
            })?;
            let values = values.digest(&lens);
            Ok((lens, with(&[report]), Some(values)))
        })?;
        Ok((recipe, pack))
    }

    /// Passes the estimate of the depth nodes on, once.
    fn forecast(&mut self, depth: &TracedFor<'_>) -> Result<()> {
        let Some(before_trace) = depth.before_trace else { return Ok(()) };
        if std::mem::replace(&mut self.is_forecast, true) {
            return Ok(());
        }
        match with_threads(self.threads, || of_job(&self.job, *depth)) {
            Ok(found) => before_trace(&found),
            // It is an error of the trace as well, or none.
            Err(_) => Ok(()),
        }
    }

    /// Depth nodes of the whole range, from the cache, or determined and stored there.
    fn placement(&mut self, options: &TraceOptions, depth: &TracedFor<'_>) -> Result<Placement> {
        let recipe = cache::recipe(self.job.system, options, None, Some((&depth.options, &[])), false);
        if let Some(placement) = self.cache.find_nodes(&recipe) {
            return Ok(placement);
        }
        self.announce();
        self.forecast(depth)?;
        self.bar.step(format!("{} nm: placing depth nodes", number(options.wavelengths_nm[0])));
        let place = || nodes(self.job.system, options, 0, &depth.options);
        let placement = with_threads(self.threads, place)?;
        self.cache.insert_nodes(&recipe, &placement)?;
        Ok(placement)
    }
}

/// Core seconds that depth nodes take to trace.
pub fn trace_core_s(estimate: &DepthEstimate) -> f64 {
    estimate.samples / OF_NODES.0 + estimate.computed as f64 * OF_NODES.1
}

/// Seconds on `cores` cores that depth nodes take to trace, and what they need.
pub fn needed(estimate: &DepthEstimate, cores: usize) -> (f64, String) {
    let DepthEstimate { nodes, psfs, window_px, bytes, .. } = *estimate;
    let core_s = trace_core_s(estimate);
    let text = format!(
        "estimated from rays: about {nodes} depth nodes, {psfs} PSFs, windows of {} to {} px, {:.1} GB uncompressed, {core_s:.0} core seconds",
        window_px.0,
        window_px.1,
        bytes as f64 * 1e-9
    );
    (core_s / cores as f64, text)
}
