//! Baselines for benchmarks: the peak rate of the processor, and the algorithm of the published system.

mod peak;
mod strided;

pub use peak::fused_multiply_adds;
pub use strided::Strided;
