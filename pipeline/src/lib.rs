//! lenscube's physics and flow: what happens to the light, in order; knows no file.

pub mod design;
pub mod flow;
pub mod geometry;
pub mod lens;
