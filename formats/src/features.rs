//! Cargo features that a build may lack.

/// What an error says of a feature that this build lacks.
pub fn missing(feature: &str) -> String {
    format!(
        "this build of lenscube lacks the feature `{feature}`; build it by `cargo install --path . --features {feature}` (or --all-features)"
    )
}
