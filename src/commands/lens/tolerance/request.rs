//! A batch of lenses that is asked for.

use crate::args::ToleranceArgs;
use crate::job::lens::drawn::ReadTolerances;
use pipeline::design::System;
use pipeline::design::tolerance::statistics::Better;
use pipeline::design::tolerance::{Criterion, CriterionKind, Tolerances};

/// A batch that is asked for.
pub struct Request<'a> {
    /// The command line.
    pub args: &'a ToleranceArgs,
    /// The description of the errors.
    pub read: &'a ReadTolerances,
    /// The nominal lens with its errors.
    pub system: &'a System,
    pub tolerances: &'a Tolerances,
    /// REAL height of the film's corner.
    pub corner_mm: f64,
}

impl Request<'_> {
    /// What lenses are judged by.
    pub fn criterion(&self) -> &Criterion {
        &self.read.file.criterion
    }

    /// Whether a great criterion is good.
    pub fn better(&self) -> Better {
        match self.criterion().kind {
            CriterionKind::Mtf { .. } => Better::Greater,
            _ => Better::Less,
        }
    }
}
