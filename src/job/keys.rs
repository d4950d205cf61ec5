//! Keys of a job's identity, and what the command line calls them; what of the input files it has.

/// Key of the modification times of the input files.
pub const MTIMES: &str = "chart_mtimes";
/// Key of the digests of the input files' bytes, of a job with `--check-input`; it has no modification times.
pub const DIGEST: &str = "chart_digest";
/// Key of the digest of a sample of the input files' bytes, of a job with modification times.
pub const SAMPLE: &str = "chart_sample";

/// Key of the ghosts, whose parts are an object.
pub const GHOSTS: &str = "ghosts";

/// What of the input files is in an identity.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FileState {
    /// Modification times: films of versions without samples.
    Times,
    /// Modification times, and a digest of a sample of the bytes.
    TimesAndSample,
    /// A digest of all bytes: `--check-input`.
    Digest,
}

/// A key of the identity or layout in the words of the command line.
pub fn argument(key: &str) -> String {
    match key {
        "chart" => "chart".into(),
        MTIMES => "modification times of the chart".into(),
        DIGEST | SAMPLE => "content of the chart".into(),
        "chart_bands" => "--bands".into(),
        "lens_name" | "lens_digest" => format!("--lens ({})", key.trim_start_matches("lens_")),
        // A film of a version without tails has none.
        "tails" => "--tails (a film without tails: --tails off)".into(),
        "rois" => "--roi".into(),
        "axis_px" => "--axis".into(),
        "center_mm" => "--center".into(),
        "ghosts.design" => "--coatings or --lens of the ghosts (digest)".into(),
        "ghosts.rings" => "--ghost-rings".into(),
        "ghosts.sensor_reflectance" => "--sensor-reflectance".into(),
        "tails_version" => "version of the tails of PSFs".into(),
        "kernels_version" => "version of the kernels of wide PSFs".into(),
        "veil_version" => "version of glare and scatter".into(),
        "ghosts.version" => "version of the ghosts".into(),
        "numeric_version" => "numeric version of the program".into(),
        "units" | "wavelengths" | "outputs" => key.into(),
        other => format!("--{}", other.replace('_', "-")),
    }
}
