//! The compiled kernels; `scripts/ptx` makes them.

/// Remap stage: `remap.cu`.
pub const REMAP: &str = include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/ptx/remap.ptx"));
/// PSF stage: `psf.cu`.
pub const PSF: &str = include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/ptx/psf.ptx"));

/// Overlap-add: `overlap_add.cu`.
pub const OVERLAP_ADD: &str = include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/ptx/overlap_add.ptx"));

/// The version of the PTX language that `kernels` are written in, e.g. `8.2`, and their oldest target, e.g. `sm_80`.
pub fn version(kernels: &str) -> Option<(&str, &str)> {
    let value = |key: &str| kernels.lines().find_map(|line| line.strip_prefix(key)).map(str::trim);
    Some((value(".version ")?, value(".target ")?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_kernel_has_one_version() {
        assert_eq!(version(REMAP), Some(("8.2", "sm_80")));
        assert_eq!([version(PSF), version(OVERLAP_ADD)], [version(REMAP); 2]);
        assert_eq!(version("no kernel"), None);
    }
}
