//! Lists of a mesh that do not fit into memory: the folder of their file, the disk space for it.

use crate::failure::{Coded, code, usage};
use crate::machine::disk::existing;
use crate::machine::free_space;
use crate::progress::data_size;
use anyhow::{Result, anyhow};
use formats::durable::{is_url, link_target, parent_of};
use pipeline::scene::sheets::SettingsError;
use pipeline::scratch::{Scratch, ScratchError};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

/// Bytes of a triangle while the mesh is placed before the camera and its tiles are listed, its vertices included.
const TRIANGLE_BYTES: u64 = 88;

/// Folder of what does not fit into memory: that of the scene, as far as it exists, or the system's for temporary files where none is made.
pub fn folder(out: Option<&Path>) -> PathBuf {
    let out = out.filter(|out| !is_url(out));
    out.map_or_else(std::env::temp_dir, |out| existing(parent_of(&link_target(out))).to_owned())
}

/// Fails if the lists of `triangles` do not fit into memory and the disk has no space for them.
///
/// # Errors
/// Exit code 75.
pub fn check_space(scratch: &Scratch, folder: &Path, triangles: u64) -> Result<()> {
    let bytes = triangles.saturating_mul(TRIANGLE_BYTES);
    let free = if scratch.takes(bytes) { free_space(folder)? } else { None };
    match free.filter(|free| bytes > *free) {
        None => Ok(()),
        Some(free) => Err(Coded {
            code: code::RETRY,
            message: format!(
                "{triangles} triangles take {} in memory or in a scratch file in {}, where {} are free; free some space, or give more with --memory",
                data_size(bytes),
                folder.display(),
                data_size(free)
            ),
        }
        .into()),
    }
}

/// A scratch file that cannot be made; a full disk may have space later.
pub fn no_space(e: &ScratchError) -> anyhow::Error {
    match e.kind {
        ErrorKind::StorageFull | ErrorKind::QuotaExceeded => {
            Coded { code: code::RETRY, message: e.to_string() }.into()
        }
        _ => anyhow!("{e}"),
    }
}

/// A renderer that cannot be made.
pub fn no_renderer(e: SettingsError) -> anyhow::Error {
    match e {
        SettingsError::Scratch(e) => no_space(&e),
        e => usage(e.to_string()),
    }
}
