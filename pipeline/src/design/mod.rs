//! Tables of a lens by ray tracing from its prescription.
//!
//! 1. A reader per file format ([`zmx`], [`codev`], [`oslo`], [`table`], [`optiland`]; [`zar`] archives) gives the prescription, [`agf`], [`glass`] and
//!    [`glass_library`] its glasses, as a [`system::System`]; `write` of [`zmx`], [`table`] and [`optiland`] is the inverse. [`shelf`] has built-in lenses.
//! 2. [`paraxial`]: pupils and focal lengths by first-order optics; [`mod@describe`] lists them.
//! 3. [`ray`]: real rays from a field point through each [`surface`], with derivatives by [`scalar`]; `aim` finds the pupil of each field
//!    point, `field` the field point of an image height, `aiming_check` whether paraxial aiming is accurate enough.
//!    `ray_budget`: the rays that a search may aim. [`crossing`]: surfaces that cross.
//! 4. [`pupil`]: the open (unvignetted) part of the pupil and its sampling. [`bundle`]: its rays. `pupil_disc`: those over the whole pupil.
//! 5. [`illumination`]: RI, the light of a bundle per area of the film. [`psf`]: a Huygens sum over its rays, by [`nufft`] and `fourier`. [`spots`]: spot
//!    diagrams and best focus. [`field_figures`]: figures from rays alone. [`image_circle`]: where vignetting ends the field.
//!    `pupils`: the pupil functions of a band, interpolated between traced heights. [`pupil_stack`]: those of its PSFs.
//! 6. [`mod@trace`]: the tables of one band of a [`crate::lens::Lens`]: window chosen by energy, heights and azimuths by error.
//!
//! Coordinates: z along the light, the field point's image on +x; symmetric about the meridian y = 0. mm, wavelengths in µm.

pub mod agf;
mod aim;
mod aiming_check;
pub mod bundle;
mod chebyshev;
pub mod codev;
pub mod crossing;
pub mod depth;
pub mod describe;
mod draft;
pub mod error;
mod estimate;
mod field;
pub mod field_figures;
pub mod film_pixel;
mod fourier;
pub mod glass;
pub mod glass_library;
mod grid;
mod ideal_lens;
pub mod illumination;
pub mod image_circle;
mod kernels;
mod launch;
pub mod model_glass;
pub mod nufft;
pub mod optiland;
mod options;
pub mod oslo;
pub mod paraxial;
pub mod psf;
pub mod pupil;
mod pupil_disc;
mod pupil_function;
pub mod pupil_stack;
mod pupils;
pub mod quadrature;
pub mod ray;
mod ray_budget;
pub mod reading;
mod refine;
mod refocus;
pub mod scalar;
mod shared_nodes;
pub mod shelf;
pub mod spots;
mod straight_axis;
pub mod surface;
pub mod system;
pub mod table;
pub mod text;
pub mod trace;
mod wavelets;
mod window;
pub mod writing;
pub mod zar;
pub mod zmx;

pub use describe::{Description, describe};
pub use error::DesignError;
pub use reading::ReadOptions;
pub use system::System;
pub use trace::{TraceOptions, trace_lens};
