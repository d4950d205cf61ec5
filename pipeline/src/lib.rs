//! lenscube's physics and flow: what happens to the light, in order; knows no file.

pub mod chart;
pub mod colour;
pub mod flow;
pub mod geometry;
pub mod lens;
pub mod wavelengths;
