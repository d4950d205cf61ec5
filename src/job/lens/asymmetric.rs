//! A design traced over the area of a film: as built, with manufacturing errors, or without rotational symmetry by design.

use super::drawn::DrawnLens;
use crate::failure::usage;
use anyhow::Result;
use pipeline::design::System;
use pipeline::design::skew::error::SkewError;
use pipeline::design::skew::system::BuiltLens;

/// A lens without rotational symmetry.
pub enum AsymmetricLens {
    /// As built: drawn from the manufacturing errors of a symmetric design.
    Drawn(Box<DrawnLens>),
    /// By design.
    Design(Box<BuiltLens>),
}

impl AsymmetricLens {
    /// The straightened lens of `system`, whose first-order figures hold, and the lens itself if it has no symmetry.
    ///
    /// # Errors
    /// Usage: parts that such lenses do not have; a film that no chief ray reaches.
    pub fn of_design(system: System) -> Result<(System, Option<Self>)> {
        match system.asymmetry {
            None => Ok((system, None)),
            Some(_) => {
                let lens = BuiltLens::of_design(&system).map_err(|e| match e {
                    SkewError::Unsupported { .. } => usage(e.to_string()),
                    other => other.into(),
                })?;
                Ok((system.straightened(), Some(Self::Design(Box::new(lens)))))
            }
        }
    }

    /// Whether it is a design with rotational symmetry after all: a drawn lens without errors.
    pub fn is_symmetric(&self) -> bool {
        matches!(self, Self::Drawn(drawn) if drawn.is_nominal())
    }

    /// The lens, `name` on the command line, in messages.
    pub fn named(&self, name: &str) -> String {
        match self {
            Self::Drawn(_) => format!("`{name}` with the drawn errors of --tolerances"),
            Self::Design(_) => format!("`{name}`"),
        }
    }

    /// The lens without symmetry by design.
    pub fn design(&self) -> Option<&BuiltLens> {
        match self {
            Self::Drawn(_) => None,
            Self::Design(lens) => Some(lens),
        }
    }
}
