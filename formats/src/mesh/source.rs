//! The files that a mesh consists of, with size and digest.

use std::fs::File;
use std::io::{ErrorKind, Read};
use std::path::{Path, PathBuf};

use super::context::Context;
use super::error::MeshError;
use super::grow;
use pipeline::scratch::List;

/// A file that was read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SourceFile {
    /// Its name: as given, or as the mesh names it in its folder.
    pub path: PathBuf,
    /// Its size.
    pub bytes: u64,
    /// Digest of its bytes.
    pub blake3: blake3::Hash,
}

/// Extension of the format that the first bytes of `path` are of, if they are of one: of glTF the binary form, PLY. What cannot be read has none.
pub(super) fn signature(path: &Path) -> Option<&'static str> {
    let mut first = [0; 4];
    // Opening a pipe would wait for its writer.
    let file = std::fs::metadata(path).ok()?.is_file().then(|| File::open(path))?.ok()?;
    file.take(first.len() as u64).read_exact(&mut first).ok()?;
    match &first {
        b"glTF" => Some("glb"),
        b"ply\n" | b"ply\r" => Some("ply"),
        _ => None,
    }
}

/// Reads the regular file `opened` and lists it as `named`. The memory counts as in use until the caller releases it.
///
/// # Errors
/// It cannot be read, changes meanwhile, or is larger than the memory left.
pub(super) fn read_file(context: &Context<'_>, named: &Path, opened: &Path) -> Result<List<u8>, MeshError> {
    let io = |action| move |source| MeshError::Io { path: named.into(), action, source };
    // Before it is opened: opening a pipe waits for its writer.
    let metadata = std::fs::metadata(opened).map_err(io("open it"))?;
    if !metadata.is_file() {
        return Err(io("open it")(std::io::Error::other("it is not a regular file")));
    }
    let length = metadata.len();
    let mut bytes = grow::zeros(context, &format!("file {}", named.display()), length)?;
    let mut file = File::open(opened).map_err(io("open it"))?;
    let changed = || io("read it")(std::io::Error::other("it changed while it was read"));
    file.read_exact(&mut bytes).map_err(|e| match e.kind() {
        ErrorKind::UnexpectedEof => changed(),
        _ => io("read it")(e),
    })?;
    if file.read(&mut [0]).map_err(io("read it"))? > 0 {
        return Err(changed());
    }
    let source = SourceFile { path: named.into(), bytes: length, blake3: blake3::hash(&bytes) };
    let mut sources = context.sources.borrow_mut();
    if !sources.contains(&source) {
        sources.push(source);
    }
    Ok(bytes)
}
