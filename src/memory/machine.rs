//! Memory of this machine and of this process, as the system reports it.

/// Half of the available memory, at most 4 GiB.
pub fn default_limit() -> u64 {
    bytes_of("/proc/meminfo", "MemAvailable:").map_or(2 << 30, |bytes| bytes / 2).min(4 << 30)
}

/// Memory of this machine, bytes, where the system reports it.
pub fn machine_memory() -> Option<u64> {
    bytes_of("/proc/meminfo", "MemTotal:")
}

/// The bytes of `entry` in a file of `NAME: N kB` lines.
fn bytes_of(file: &str, entry: &str) -> Option<u64> {
    let text = std::fs::read_to_string(file).ok()?;
    let line = text.lines().find(|l| l.starts_with(entry))?;
    Some(line.split_whitespace().nth(1)?.parse::<u64>().ok()? << 10)
}

/// Peak resident memory of this process so far, bytes, where the system reports it.
pub fn peak_resident() -> Option<u64> {
    bytes_of("/proc/self/status", "VmHWM:")
}
