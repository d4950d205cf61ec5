//! Tables of a lens by ray tracing from its prescription. Readers of lens files: package `formats`.
//!
//! Layers; none imports from one below it in this table but in tests:
//!
//! | layer | modules |
//! |---|---|
//! | [`prescription`] | [`system`] (surfaces, aperture, fields), [`shape`] of a surface, [`freeform`] shapes, [`pose`]s and outlines of a design without symmetry ([`asymmetry`]), [`glass`]es, their built-in table ([`glass_library`]) and [`model_glass`]es, their [`absorption`], the [`coating`]s of surfaces and of a lens ([`coatings`]), [`error`] |
//! | [`rays`] | [`paraxial`]: pupils and focal lengths. [`ray`]: real rays through each `surface`, with derivatives by `scalar`; `aim` finds the pupil of each field point, `field` the field point of an image height; `losses`: light lost on the way; `ray_budget`: the rays that a search may aim |
//! | [`pupil`] | the open part of the pupil and its sampling; [`bundle`]: its rays; [`rim`]: its outermost rays, working F-numbers; [`illumination`]: RI, the light of a bundle per area of the film; `function`, `disc`, `pupils`: pupil functions, also between traced heights |
//! | [`figures`] | [`mod@describe`]: first-order data; [`spots`], [`pattern_spot`]: spot diagrams and best focus; [`wavefront`], [`zernike`]; [`field_curvature`]; [`cardinal`], [`paraxial_rays`], [`seidel`]: first and third order; [`field_figures`]; [`image_circle`]; [`image_cone`]: directions at the film; [`light`]: transmission; [`roughness`]: scattered light; [`crossing`]: surfaces that cross; `aiming_check`: whether paraxial aiming is accurate enough; `refocus`: the film at another focus |
//! | [`psf`] | a Huygens sum over rays, by `nufft` and `fourier`; [`field_psf`]: PSF of one field point, its encircled energy and MTF; [`film_pixel`]: shares per film pixel; [`pupil_stack`]: PSFs computed from stored pupil functions |
//! | [`ghost`] | light of two reflections: paths, their rays and light, first order; the operator from rings of a scene to rings of a film |
//! | [`tables`] | [`mod@trace`]: the tables of one band; `window`, `grid`, `refine`: window, heights and azimuths by error; [`depth`]: depth nodes |
//!
//! Coordinates: z along the light, the field point's image on +x; symmetric about the meridian y = 0. mm, wavelengths in µm.

pub mod figures;
pub mod ghost;
pub mod prescription;
pub mod psf;
pub mod pupil;
pub mod rays;
pub mod skew;
pub mod tables;
pub mod tolerance;

pub use figures::{
    cardinal, crossing, describe, field_curvature, field_figures, image_circle, image_cone, light,
    paraxial_rays, pattern_spot, pinhole, roughness, seidel, spots, wavefront, zernike,
};
pub use prescription::{
    absorption, asymmetry, coating, coatings, error, freeform, glass, glass_library, model_glass, pose,
    shape, system,
};
pub use psf::{field_psf, film_pixel, pupil_stack};
pub use pupil::{bundle, illumination, quadrature, rim};
pub use rays::{paraxial, ray};
pub use tables::{depth, trace};

pub use describe::{Description, describe};
pub use error::DesignError;
pub use system::System;
pub use trace::{TraceOptions, trace_lens};
