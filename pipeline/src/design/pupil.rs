//! The open (unvignetted) part of the pupil, the rays over it, their light, and the pupil function.

pub mod bundle;
pub(super) mod chebyshev;
pub(super) mod disc;
pub(super) mod edge;
pub(super) mod function;
pub mod illumination;
pub(super) mod openings;
pub(super) mod pupils;
pub mod quadrature;
pub mod rim;
#[cfg(test)]
pub(super) mod test_lenses;

pub use openings::{Pupil, PupilNode, Segment};
