//! Depth nodes of a lens: where they lie ([`nodes`]) and their PSFs ([`trace`]).

pub mod nodes;
pub mod trace;
