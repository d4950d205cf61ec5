//! Tables of a lens by ray tracing from its prescription.
//!
//! 1. [`zmx`] or [`codev`] reads the prescription, [`agf`], [`glass`] and [`glass_library`] its glasses, into a [`system::System`].
//! 2. [`paraxial`]: pupils and focal lengths by first-order optics; [`mod@describe`] lists them.
//! 3. [`ray`]: real rays from a field point through each [`surface`], with derivatives by [`scalar`].
//! 4. [`pupil`]: the open (unvignetted) part of the pupil and its sampling.
//! 5. [`illumination`]: RI, the area of the pupil in direction cosines. [`psf`]: a Huygens sum over its rays, by [`nufft`]. [`spots`]: spot
//!    diagrams and best focus.
//! 6. [`mod@trace`]: the tables of one band of a [`crate::lens::Lens`]: window chosen by energy, heights and azimuths by error.
//!
//! Coordinates: z along the light, the field point's image on +x; symmetric about the meridian y = 0. mm, wavelengths in µm.

pub mod agf;
pub mod codev;
pub mod describe;
mod draft;
pub mod error;
pub mod film_pixel;
pub mod glass;
pub mod glass_library;
mod grid;
pub mod illumination;
pub mod nufft;
mod options;
pub mod paraxial;
pub mod psf;
pub mod pupil;
pub mod ray;
mod refocus;
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
