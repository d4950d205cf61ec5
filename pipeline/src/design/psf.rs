//! The PSF of a field point from its pupil function, and its shares per film pixel.

pub mod field_psf;
pub mod film_pixel;
mod fourier;
pub(super) mod huygens;
pub(super) mod middle;
pub mod nufft;
pub mod pupil_stack;
mod spreading;
pub(in crate::design) mod squares;
pub(super) mod tails;
mod wavelets;

pub use super::pupil::function::PupilFunction;
pub use huygens::{PsfGrid, PsfScratch};
pub use wavelets::Wavelet;
