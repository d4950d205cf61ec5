//! `lenscube --version`: the build, and what it uses on this machine.

use pipeline::cuda::ptx;
use pipeline::simd::{Isa, Simd};
use std::sync::LazyLock;

/// The lines after the program's name.
pub fn long() -> &'static str {
    static TEXT: LazyLock<String> = LazyLock::new(lines);
    &TEXT
}

fn lines() -> String {
    let isas = Isa::ALL.map(Isa::name).join(", ");
    let kernels = ptx::version(&ptx::PSF).map_or_else(
        || "none".to_owned(),
        |(version, target)| {
            let cubins: Vec<_> =
                ptx::PSF.cubins.iter().map(|((major, minor), _)| format!("{major}.{minor}")).collect();
            let (oldest, cubins) = (capability(target), cubins.join(", "));
            format!("PTX {version} for compute capability {oldest} and newer; cubins for {cubins}")
        },
    );
    [
        env!("CARGO_PKG_VERSION").to_owned(),
        format!("commit:       {}", env!("LENSCUBE_COMMIT")),
        format!("build:        {}, {}", env!("LENSCUBE_TARGET"), env!("LENSCUBE_COMPILER")),
        format!("features:     {}", env!("LENSCUBE_FEATURES")),
        format!("SIMD:         {} in use, of {isas}", Simd::detect().isa().name()),
        format!("CUDA kernels: {kernels}"),
    ]
    .join("\n")
}

/// `8.0` of `sm_80`.
fn capability(target: &str) -> String {
    let digits = target.trim_start_matches("sm_");
    match digits.len().checked_sub(1).and_then(|n| digits.split_at_checked(n)) {
        Some((major, minor)) => format!("{major}.{minor}"),
        None => target.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn version_names_build_instruction_set_and_kernels() {
        let text = long();
        assert!(text.starts_with(env!("CARGO_PKG_VERSION")), "{text}");
        for part in [
            "commit:",
            "rustc 1.",
            "features:",
            "portable",
            "PTX 8.2 for compute capability 8.0",
            "cubins for 8.0",
        ] {
            assert!(text.contains(part), "{part} in {text}");
        }
        assert_eq!(capability("sm_120"), "12.0");
    }
}
