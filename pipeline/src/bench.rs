//! What speed is measured against: the processor's own peak, and the algorithm of the published system.
//!
//! Nothing here makes a film.

mod peak;
mod strided;

pub use peak::fused_multiply_adds;
pub use strided::Strided;
