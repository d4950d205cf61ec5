//! PSF nodes that neighbouring bands share.
//!
//! Most of the PSFs that a band computes serve the choice of its nodes ([`super::grid`]), which changes little with the wavelength. Nodes are
//! therefore chosen at multiples of [`STEP_NM`]; a band takes those of the nearest one if their error at a few cells, measured at its
//! own wavelength, is about the same ([`grid::adopt`]), and else chooses its own. So the nodes of a band depend on its wavelength alone, whatever
//! other bands are traced with it.

#[cfg(doc)]
use super::grid;
use super::grid::Chosen;
use super::options::{Azimuths, PsfHeights, TraceOptions};
use super::sampled::Sampled;
use super::trace::LensTrace;
use super::window::Found;
use crate::design::prescription::error::DesignError;
use crate::design::rays::ray::Tracer;

/// Distance of the wavelengths at which nodes are chosen, nm.
const STEP_NM: f64 = 50.0;

/// The wavelength at which the nodes of the band at `nm` are chosen, nm.
fn nearest(nm: f64) -> f64 {
    STEP_NM * (nm / STEP_NM).round().max(1.0)
}

/// The wavelengths at which the nodes of ascending `bands_nm` are chosen, nm.
pub fn node_wavelengths(bands_nm: &[f64]) -> Vec<f64> {
    let mut all: Vec<f64> = bands_nm.iter().map(|nm| nearest(*nm)).collect();
    all.dedup();
    all
}

/// Nodes chosen so far for one lens.
#[derive(Debug, Default)]
pub struct SharedNodes(Vec<Nodes>);

/// Nodes at a wavelength with some options; none if the lens cannot be traced there.
#[derive(Debug)]
struct Nodes {
    nm: f64,
    options: TraceOptions,
    chosen: Option<Chosen>,
    /// What determined the windows there, until a band of this wavelength is traced.
    windows: Option<Found>,
}

/// `options` for one wavelength: what is chosen there does not depend on the others.
fn options_at(nm: f64, options: &TraceOptions) -> TraceOptions {
    TraceOptions { wavelengths_nm: vec![nm], ..options.clone() }
}

impl SharedNodes {
    /// What determined the windows of `trace` at `nm`, if nodes of other bands were chosen there and no band has taken it.
    pub(super) fn windows(&mut self, trace: &LensTrace<'_>, nm: f64) -> Option<Found> {
        let options = options_at(nm, trace.options);
        self.0.iter_mut().find(|nodes| nodes.nm == nm && nodes.options == options)?.windows.take()
    }

    /// The nodes of the band at `nm`.
    pub(in crate::design) fn choose(
        &mut self,
        trace: &LensTrace<'_>,
        nm: f64,
        sampled: &mut Sampled<'_>,
        report: &mut dyn FnMut(&'static str, usize),
    ) -> Result<Chosen, DesignError> {
        let options = trace.options;
        let is_given =
            matches!((&options.heights, options.azimuths), (PsfHeights::Given(_), Azimuths::Given(_)));
        if is_given {
            return trace.choose(sampled, report);
        }
        let nearest = nearest(nm);
        let options = options_at(nearest, options);
        let known = self.0.iter().find(|n| n.nm == nearest && n.options == options);
        let there = match known {
            Some(nodes) => nodes.chosen.clone(),
            None if nearest == nm => {
                let chosen = trace.choose(sampled, report)?;
                self.0.push(Nodes { nm, options, chosen: Some(chosen.clone()), windows: None });
                return Ok(chosen);
            }
            None => {
                // An error there is none of this band.
                let (chosen, windows) = nodes_at(trace, nearest, &options, report).ok().unzip();
                let windows = windows.flatten();
                self.0.push(Nodes { nm: nearest, options, chosen: chosen.clone(), windows });
                chosen
            }
        };
        if nearest == nm {
            return there.map_or_else(|| trace.choose(sampled, report), Ok);
        }
        if let Some(there) = there
            && let Some(chosen) = trace.adopt(sampled, &there, report)?
        {
            return Ok(chosen);
        }
        trace.choose(sampled, report)
    }
}

/// Chooses nodes at `nm`; with what determined the windows there.
fn nodes_at(
    trace: &LensTrace<'_>,
    nm: f64,
    options: &TraceOptions,
    report: &mut dyn FnMut(&'static str, usize),
) -> Result<(Chosen, Option<Found>), DesignError> {
    let plain = LensTrace::new(trace.system, options)?;
    let trace = if trace.has_base_nodes { plain.with_base_nodes() } else { plain };
    let tracer = Tracer::new(trace.system, nm / 1e3)?;
    let mut sampled = trace.sampled(&tracer, None, report)?;
    let chosen = trace.choose(&mut sampled, report)?;
    Ok((chosen, sampled.found))
}
