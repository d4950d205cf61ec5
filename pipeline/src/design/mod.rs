//! A lens from its prescription: what a design program knows of it, traced here.
//!
//! 1. [`zmx`] reads the prescription, [`agf`] and [`glass`] its glasses, into a [`system::System`].
//! 2. [`paraxial`]: first-order optics places the pupils and gives the focal lengths; [`mod@describe`] shows them.
//! 3. [`ray`]: real rays from a field point through [`surface`] after surface; [`scalar`] lets them carry derivatives.
//! 4. [`pupil`]: the open part of the pupil (apertures vignette) and where to sample it.
//! 5. [`illumination`]: RI = its area in direction cosines. [`psf`]: a Huygens sum over its rays, by [`nufft`]. [`spots`]: geometry.
//! 6. [`mod@trace`]: pitch and window by the light they hold, heights and azimuths by error; one band of a [`crate::lens::Lens`] at a time.
//!
//! Frame: z along the light, the field point's image on +x; the meridian y = 0 mirrors everything. mm, wavelengths in µm.

pub mod agf;
pub mod describe;
pub mod error;
pub mod film_pixel;
pub mod glass;
mod grid;
pub mod illumination;
pub mod nufft;
pub mod paraxial;
pub mod psf;
pub mod pupil;
pub mod ray;
pub mod scalar;
pub mod spots;
pub mod surface;
pub mod system;
pub mod text;
pub mod trace;
pub mod zmx;

pub use describe::{Description, describe};
pub use error::DesignError;
pub use system::System;
pub use trace::{TraceOptions, trace_lens};
