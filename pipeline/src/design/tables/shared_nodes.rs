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
}

impl SharedNodes {
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
        // Nodes do not depend on the other wavelengths.
        let options = TraceOptions { wavelengths_nm: vec![nearest], ..options.clone() };
        let known = self.0.iter().find(|n| n.nm == nearest && n.options == options);
        let there = match known {
            Some(nodes) => nodes.chosen.clone(),
            None if nearest == nm => {
                let chosen = trace.choose(sampled, report)?;
                self.0.push(Nodes { nm, options, chosen: Some(chosen.clone()) });
                return Ok(chosen);
            }
            None => {
                // An error there is none of this band.
                let chosen = nodes_at(trace, nearest, &options, report).ok();
                self.0.push(Nodes { nm: nearest, options, chosen: chosen.clone() });
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

/// Chooses nodes at `nm`.
fn nodes_at(
    trace: &LensTrace<'_>,
    nm: f64,
    options: &TraceOptions,
    report: &mut dyn FnMut(&'static str, usize),
) -> Result<Chosen, DesignError> {
    let plain = LensTrace::new(trace.system, options)?;
    let trace = if trace.has_base_nodes { plain.with_base_nodes() } else { plain };
    let tracer = Tracer::new(trace.system, nm / 1e3)?;
    let mut sampled = trace.sampled(&tracer, report)?;
    trace.choose(&mut sampled, report)
}
