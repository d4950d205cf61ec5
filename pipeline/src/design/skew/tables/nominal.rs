//! Nodes and windows of the nominal lens, which its built lenses begin with.

use super::super::system::BuiltLens;
use crate::design::prescription::error::DesignError;
use crate::design::rays::ray::Tracer;
use crate::design::tables::grid::Chosen;
use crate::design::tables::trace::{LensTrace, SharedNodes, TraceOptions};

/// Nodes and window of the nominal lens at a wavelength.
#[derive(Clone, Debug)]
pub(super) struct Nominal {
    pub(super) chosen: Chosen,
    /// Window and that in which errors of kernels are measured, film pixels.
    pub(super) window_px: usize,
    pub(super) core_px: usize,
    pub(super) pitch_um: f64,
}

/// Nodes and windows of the nominal lens of one design, found so far: for all built lenses of a batch, which have the same options.
#[derive(Debug, Default)]
pub struct NominalNodes {
    shared: SharedNodes,
    known: Vec<(TraceOptions, usize, Nominal)>,
}

impl NominalNodes {
    /// Those of band `index`.
    pub(super) fn of(
        &mut self,
        lens: &BuiltLens,
        options: &TraceOptions,
        index: usize,
        report: &mut dyn FnMut(&'static str, usize),
    ) -> Result<Nominal, DesignError> {
        let known = self.known.iter().find(|(known, band, _)| *band == index && known == options);
        if let Some((_, _, nominal)) = known {
            return Ok(nominal.clone());
        }
        let nm = options.wavelengths_nm[index];
        let trace = LensTrace::new(lens.nominal(), options)?.with_base_nodes();
        let tracer = Tracer::new(lens.nominal(), nm / 1e3)?;
        let mut sampled = trace.sampled(&tracer, None, report)?;
        let chosen = self.shared.choose(&trace, nm, &mut sampled, report)?;
        let pitch_um = sampled.grid.pitch_um();
        let nominal = Nominal { chosen, window_px: sampled.window_px, core_px: sampled.core.px, pitch_um };
        self.known.push((options.clone(), index, nominal.clone()));
        Ok(nominal)
    }
}
