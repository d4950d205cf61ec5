//! The tables of a band of a [`crate::lens::Lens`]: window chosen by energy, heights and azimuths by error; and those of depth nodes.

mod band_mean;
mod cells;
mod dense;
pub mod depth;
pub(in crate::design) mod difference;
mod estimate;
mod film_samples;
pub(in crate::design) mod grid;
pub(in crate::design) mod kernels;
mod lens_header;
mod options;
mod placement;
mod probing;
pub(in crate::design) mod refine;
mod relaxation;
pub(in crate::design) mod sampled;
mod shared_nodes;
pub mod trace;
pub(in crate::design) mod window;
