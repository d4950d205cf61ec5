//! Depth nodes of a lens: where they lie ([`nodes`]), what they need ([`estimate`]) and their PSFs ([`trace`]).

pub mod estimate;
pub mod nodes;
pub mod trace;
