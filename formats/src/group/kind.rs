//! The kinds of groups.

use std::fmt;

/// Names of the layers of light of films, in the order in which they are added.
pub(crate) const LAYER_NAMES: [&str; 2] = ["veil_tail", "veil"];

/// Kind of a group.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GroupKind {
    /// The image that a lens forms on the sensor plane.
    Film,
    /// The digital numbers of a sensor.
    Raw,
    /// The surfaces of a mesh as the lens's pinhole sees them.
    Scene,
}

impl GroupKind {
    /// Attribute `schema`.
    pub const fn schema(self) -> &'static str {
        match self {
            Self::Film => "lenscube/film/1",
            Self::Raw => "lenscube/raw/1",
            Self::Scene => "lenscube/scene/1",
        }
    }

    /// The command that makes such groups.
    pub(super) const fn command(self) -> &'static str {
        match self {
            Self::Film => "run",
            Self::Raw => "sensor",
            Self::Scene => "scene",
        }
    }
}

impl fmt::Display for GroupKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Film => "film",
            Self::Raw => "raw",
            Self::Scene => "scene",
        })
    }
}
