//! An error: what of which part, between which limits.

use super::law::Limits;
use super::quantity::Quantity;

/// The point that an element is tilted about: on the axis, at the NOMINAL place of a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pivot {
    /// Surface number.
    pub surface: usize,
    /// Distance behind its vertex, mm.
    pub offset_mm: f64,
}

/// The part that an error belongs to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Target {
    /// Surfaces that move as one body.
    Element {
        /// Number of its first surface.
        first: usize,
        /// Number of its last surface.
        last: usize,
        /// What it is tilted about.
        pivot: Pivot,
    },
    /// A surface by its number; poses are about its vertex.
    Surface(usize),
    /// The gap behind a surface.
    Gap {
        /// Number of the surface in front of it.
        after: usize,
        /// Number of the surface in front of the later gap that takes its error up; else all surfaces behind it and the film
        /// move.
        absorb: Option<usize>,
    },
    /// The glass behind a surface, by its number.
    Glass(usize),
    /// The film.
    Film,
}

impl Target {
    /// The element of surfaces first..last with the default pivot, the vertex of the first.
    pub fn element(first: usize, last: usize) -> Self {
        Self::Element { first, last, pivot: Pivot { surface: first, offset_mm: 0.0 } }
    }

    /// Its part of the identifier: kind and surfaces.
    pub(super) fn name(&self) -> String {
        match *self {
            Self::Element { first, last, .. } if first == last => format!("element {first}"),
            Self::Element { first, last, .. } => format!("element {first}-{last}"),
            Self::Surface(surface) => format!("surface {surface}"),
            Self::Gap { after, .. } => format!("gap {after}"),
            Self::Glass(after) => format!("glass {after}"),
            Self::Film => "film".to_owned(),
        }
    }

    /// Order of targets: elements, the outermost first; surfaces, gaps, glasses by number; the film.
    pub(super) fn rank(&self) -> Rank {
        match *self {
            Self::Element { first, last, pivot } => {
                // Shifted bits order numbers of either sign.
                let bits = (pivot.offset_mm + 0.0).to_bits() as i64;
                let offset = bits ^ (((bits >> 63) as u64) >> 1) as i64;
                Rank(0, usize::MAX - last.saturating_sub(first), first, pivot.surface, offset)
            }
            Self::Surface(surface) => Rank(1, surface, 0, 0, 0),
            Self::Gap { after, absorb } => Rank(2, after, absorb.unwrap_or(0), 0, 0),
            Self::Glass(after) => Rank(3, after, 0, 0, 0),
            Self::Film => Rank(4, 0, 0, 0, 0),
        }
    }
}

/// Place of a target in the order of [`Target::rank`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub(super) struct Rank(usize, usize, usize, usize, i64);

/// An error that is drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tolerance {
    /// What has it.
    pub target: Target,
    /// What it changes.
    pub quantity: Quantity,
    /// Between which limits, in the unit of the quantity.
    pub limits: Limits,
}

impl Tolerance {
    /// Its identifier, without the number of a repeated one: `element 7-9/decentre_x`.
    pub(super) fn id(&self) -> String {
        format!("{}/{}", self.target.name(), self.quantity.name())
    }
}
