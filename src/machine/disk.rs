//! Free space of disks.

use anyhow::Result;
use formats::durable::{free_bytes, is_url, parent_of};
use std::path::Path;

/// Bytes free where a film or another output is written; `None` at a URL.
///
/// # Errors
/// The file system does not tell.
pub fn free_space(output: &Path) -> Result<Option<u64>> {
    if is_url(output) {
        return Ok(None);
    }
    let mut path = existing(output);
    loop {
        match free_bytes(path) {
            // Another process has removed it since.
            Err(_) if !path.exists() && parent_of(path) != path => path = existing(path),
            found => return Ok(Some(found?)),
        }
    }
}

/// The first existing path among `path` and the directories above it.
pub fn existing(path: &Path) -> &Path {
    let mut path = path;
    while !path.exists() && parent_of(path) != path {
        path = parent_of(path);
    }
    path
}
