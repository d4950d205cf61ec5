//! The tables of a band of a [`crate::lens::Lens`]: window chosen by energy, heights and azimuths by error; and those of depth nodes.

mod band_mean;
pub mod depth;
mod estimate;
mod grid;
mod kernels;
mod options;
mod refine;
mod shared_nodes;
pub mod trace;
mod window;
