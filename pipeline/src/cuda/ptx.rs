//! The compiled kernels; `scripts/ptx` makes them.

/// Stages 1-2, of `remap.cu`.
pub const REMAP: &str = include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/ptx/remap.ptx"));
/// Stage 3, of `psf.cu`.
pub const PSF: &str = include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/ptx/psf.ptx"));
