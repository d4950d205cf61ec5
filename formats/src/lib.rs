//! x

pub mod lens;
