//! Errors of reading a mesh: the file, the place in it, what was expected and found, and the way out.

use std::path::{Path, PathBuf};

use crate::mesh_name::extension;
use pipeline::scratch::ScratchError;

/// A file in messages: the mesh, or what it names.
fn named(path: &Path) -> String {
    let what = match &*extension(path) {
        "mtl" => "materials",
        "bin" => "buffer",
        "png" | "jpg" | "jpeg" | "webp" | "ktx" | "ktx2" | "dds" | "gif" | "bmp" | "tif" | "tiff" | "tga"
        | "exr" | "hdr" | "avif" | "heif" => "texture",
        _ => "mesh",
    };
    format!("{what} {}", path.display())
}

/// A mesh cannot be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum MeshError {
    /// Error of the operating system.
    #[error("reading {path}: cannot {action}: {source}", path = named(.path))]
    Io {
        /// The file.
        path: PathBuf,
        /// The operation, a verb.
        action: &'static str,
        /// Its cause.
        source: std::io::Error,
    },
    /// Content that the format does not allow.
    #[error("reading {path}, {place}: expected {expected}, found {found}", path = named(.path))]
    Invalid {
        /// The file.
        path: PathBuf,
        /// Object and property, or line and column.
        place: String,
        /// What is expected there.
        expected: String,
        /// What is there.
        found: String,
    },
    /// Valid content that is not read.
    #[error("reading {path}, {place}: {found} is not supported; {way_out}", path = named(.path))]
    Unsupported {
        /// The file.
        path: PathBuf,
        /// Object or property.
        place: String,
        /// What is not supported.
        found: String,
        /// What to do, an imperative.
        way_out: String,
    },
    /// An extension without which the file cannot be read.
    #[error("reading {path}: it requires the extension {name}, which is not supported; {way_out}", path = named(.path))]
    Extension {
        /// The file.
        path: PathBuf,
        /// The extension, in quotation marks.
        name: String,
        /// What to do, an imperative.
        way_out: &'static str,
    },
    /// A name of another file that is refused.
    #[error("reading {path}, {place}: {uri} is refused: {reason}; {way_out}", path = named(.path))]
    Refused {
        /// The file.
        path: PathBuf,
        /// Object that names it.
        place: String,
        /// The name, in quotation marks.
        uri: String,
        /// Why.
        reason: &'static str,
        /// What to do, an imperative.
        way_out: &'static str,
    },
    /// A file of the mesh that is not there.
    #[error("reading {path}, {place}: {file} is not there; {way_out}", path = named(.path), file = file.display())]
    Missing {
        /// The mesh.
        path: PathBuf,
        /// Object that names it.
        place: String,
        /// The missing file.
        file: PathBuf,
        /// What to do, an imperative.
        way_out: &'static str,
    },
    /// A picture that does not decode.
    #[error(
        "reading {path}, {place}: the picture is damaged or truncated: {reason}; restore it from its source, or write it again",
        path = named(.path)
    )]
    Picture {
        /// The mesh, or the picture's own file.
        path: PathBuf,
        /// The picture.
        place: String,
        /// The defect.
        reason: String,
    },
    /// More memory than allowed.
    #[error(
        "reading {path}, {place}: it takes {needed} bytes of memory, allowed are {allowed}; give more with --memory",
        path = named(.path)
    )]
    Memory {
        /// The file.
        path: PathBuf,
        /// What takes them.
        place: String,
        /// Bytes needed, with those in use.
        needed: u64,
        /// Bytes allowed.
        allowed: u64,
    },
    /// There is no disk space for what does not fit into memory.
    #[error(transparent)]
    Scratch(#[from] ScratchError),
    /// A mesh without a triangle.
    #[error("reading {path}: no triangles: found {found}", path = named(.path))]
    Empty {
        /// The file.
        path: PathBuf,
        /// What it holds.
        found: String,
    },
}
