//! The compiled kernels; `scripts/ptx` makes them.

/// Remap stage: `remap.cu`.
pub const REMAP: &str = include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/ptx/remap.ptx"));
/// PSF stage: `psf.cu`.
pub const PSF: &str = include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/ptx/psf.ptx"));
