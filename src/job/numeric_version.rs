//! Version of the arithmetic of jobs.

/// Version of the arithmetic of flat charts: raised whenever the program computes other pixel values for the same job.
const NUMERIC_VERSION: u32 = 4;
/// That of surfaces at several distances, at least [`NUMERIC_VERSION`].
const DEPTH_NUMERIC_VERSION: u32 = 7;

/// Version of the arithmetic of a job with surfaces at several distances, or without.
pub const fn numeric_version(has_depth: bool) -> u32 {
    if has_depth { DEPTH_NUMERIC_VERSION } else { NUMERIC_VERSION }
}
