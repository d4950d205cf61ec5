//! Free space of disks.

use anyhow::Result;
use formats::durable::{free_bytes, is_url, parent_of};
use std::path::Path;

/// Bytes free where a film or another output is written; `None` at a URL.
///
/// # Errors
/// The file system does not tell.
pub fn free_space(output: &Path) -> Result<Option<u64>> {
    Ok(if is_url(output) { None } else { Some(free_bytes(existing(output))?) })
}

/// The first existing path among `path` and the directories above it.
fn existing(path: &Path) -> &Path {
    let mut path = path;
    while !path.exists() && parent_of(path) != path {
        path = parent_of(path);
    }
    path
}
