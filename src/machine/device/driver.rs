//! Description of the NVIDIA driver: its own version, which the CUDA driver API does not report, and the CUDA version that it supports.

use pipeline::cuda::DeviceInfo;

/// File in which the kernel module of the driver reports its version, on Linux.
const KERNEL_MODULE: &str = "/proc/driver/nvidia/version";

/// E.g. `driver 580.159.04 (CUDA 13.0)`; `driver for CUDA 13.0` where the version of the driver cannot be read.
pub fn description(info: &DeviceInfo) -> String {
    let text = std::fs::read_to_string(KERNEL_MODULE).unwrap_or_default();
    let (major, minor) = info.driver_version;
    match version(&text) {
        Some(version) => format!("driver {version} (CUDA {major}.{minor})"),
        None => format!("driver for CUDA {major}.{minor}"),
    }
}

/// The version in the text of [`KERNEL_MODULE`].
fn version(text: &str) -> Option<&str> {
    let line = text.lines().find_map(|line| line.strip_prefix("NVRM version:"))?;
    let is_version = |word: &&str| word.contains('.') && word.chars().all(|c| c.is_ascii_digit() || c == '.');
    line.split_whitespace().find(is_version)
}

#[cfg(test)]
mod tests {
    use super::version;

    #[test]
    fn version_is_read_from_proprietary_and_open_modules() {
        let proprietary = "NVRM version: NVIDIA UNIX x86_64 Kernel Module  535.54.03  Tue Jun  6 22:20:39 UTC 2023\n\
                           GCC version:  gcc version 12.2.0 (Debian 12.2.0-14)\n";
        let open = "NVRM version: NVIDIA UNIX Open Kernel Module for x86_64  580.159.04  Release Build  (root@host)\n";
        assert_eq!([version(proprietary), version(open)], [Some("535.54.03"), Some("580.159.04")]);
        assert_eq!([version(""), version("GCC version:  gcc version 12.2.0\n")], [None; 2]);
    }
}
