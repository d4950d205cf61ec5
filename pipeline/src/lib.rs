//! lenscube's physics and flow: what happens to the light, in order; knows no file.

pub mod band;
pub mod buffer;
pub mod executor;
pub mod field;
pub mod flow;
pub mod geometry;
pub mod lens;
pub mod overlap_add;
pub mod plan;
pub mod psf;
pub mod resample;
pub mod scene;
