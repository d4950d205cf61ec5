//! What a reader of meshes may use: memory, and folders of other files.

use pipeline::scratch::Scratch;
use std::path::PathBuf;

/// Limits of reading a mesh.
#[derive(Clone, Debug)]
pub struct Limits {
    /// Maximum size of one decoded data URI or texture, in bytes.
    pub max_bytes: u64,
    /// Maximum memory of all: files while they are read, geometry, textures; bytes.
    pub max_total_bytes: u64,
    /// Where lists beyond memory are.
    pub scratch: Scratch,
    /// Folders outside the mesh's own whose files the mesh may name.
    pub allow_paths: Vec<PathBuf>,
    /// Whether a missing texture is grey instead of an error.
    pub missing_textures_grey: bool,
}

impl Limits {
    /// Of a command that may use `memory_bytes`: all of it together, a quarter for one texture or data URI; all in memory, no other folders, missing
    /// textures are errors.
    pub fn of_memory(memory_bytes: u64) -> Self {
        Self {
            max_bytes: memory_bytes / 4,
            max_total_bytes: memory_bytes,
            scratch: Scratch::default(),
            allow_paths: Vec::new(),
            missing_textures_grey: false,
        }
    }
}
