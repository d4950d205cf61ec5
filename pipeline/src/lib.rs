//! lenscube's physics and flow: what happens to the light, in order; knows no file.

pub mod buffer;
pub mod flow;
pub mod geometry;
pub mod lens;
pub mod psf;
pub mod simd;
