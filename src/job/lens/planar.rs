//! A lens without rotational symmetry, ready to be traced at the wavelengths of a job.

use super::asymmetric::AsymmetricLens;
use super::built::recorded;
use super::tracing_job::TracingJob;
use anyhow::Result;
use formats::lens::{PackAttributes, ReferencePoint};
use pipeline::design::skew::error::SkewError;
use pipeline::design::skew::grid::GridTrace;
use pipeline::design::skew::map::FilmRange;
use pipeline::design::skew::system::BuiltLens;
use pipeline::design::skew::tables::{NominalNodes, SkewTrace};
use pipeline::design::tolerance::Compensated;
use pipeline::design::trace::{OnProgress, TraceOptions, TracedBand, with_threads};
use pipeline::lens::Lens;
use serde_json::Value;

/// A lens without rotational symmetry, ready to be traced.
pub(super) enum PlanarLens<'a> {
    /// As built: adjusted once for its film (focus, tilt, place), its errors as recorded, and the nodes of its nominal lens.
    Built { compensated: Box<Compensated>, errors: Value, nodes: NominalNodes },
    /// By design.
    Design(&'a BuiltLens),
}

impl<'a> PlanarLens<'a> {
    /// `lens` for the film of `job`, adjusted by `threads` threads.
    ///
    /// # Errors
    /// A lens that loses its light.
    pub(super) fn new(job: &TracingJob<'_>, lens: &'a AsymmetricLens, threads: usize) -> Result<Self> {
        Ok(match lens {
            AsymmetricLens::Design(lens) => Self::Design(lens),
            AsymmetricLens::Drawn(drawn) => {
                let corner_mm = job.frame.farthest_mm(job.frame.film.rect());
                let compensated = Box::new(with_threads(threads, || drawn.compensated(corner_mm))?);
                Self::Built { compensated, errors: drawn.record.clone(), nodes: NominalNodes::default() }
            }
        })
    }

    /// Notes on what was adjusted.
    pub(super) fn notes(&self) -> &[String] {
        match self {
            Self::Built { compensated, .. } => &compensated.notes,
            Self::Design(_) => &[],
        }
    }

    /// The lens that is traced.
    pub(super) fn lens(&self) -> &BuiltLens {
        match self {
            Self::Built { compensated, .. } => &compensated.lens,
            Self::Design(lens) => lens,
        }
    }

    /// `attributes` with its errors and with what was adjusted.
    pub(super) fn record(&self, attributes: PackAttributes) -> PackAttributes {
        match self {
            Self::Built { compensated, errors, .. } => recorded(attributes, errors.clone(), compensated),
            Self::Design(_) => {
                PackAttributes { reference_point: Some(ReferencePoint::ChiefRay), ..attributes }
            }
        }
    }

    /// Its first band of `options` with a map over `range`, and the lens without bands.
    pub(super) fn trace(
        &mut self,
        options: &TraceOptions,
        range: FilmRange,
        progress: OnProgress<'_>,
    ) -> Result<(Lens, TracedBand), SkewError> {
        match self {
            Self::Built { compensated, nodes, .. } => {
                let trace = SkewTrace::new(&compensated.lens, options, range)?;
                let band = trace.band(0, nodes, progress)?;
                Ok((trace.header()?, band))
            }
            Self::Design(lens) => {
                let trace = GridTrace::new(lens, options, range)?;
                let band = trace.band(0, progress)?;
                Ok((trace.header()?, band))
            }
        }
    }
}
