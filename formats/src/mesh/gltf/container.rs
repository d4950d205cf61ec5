//! The parts of a file: JSON text, or a binary container of it and a buffer (glTF 2.0, 4: GLB, version 2, little-endian).

use super::super::context::Context;
use super::super::error::MeshError;

/// First bytes of a binary container.
const MAGIC: &[u8; 4] = b"glTF";
/// Magic number, version, length.
const HEADER_BYTES: usize = 12;
/// Length and type of a chunk.
const CHUNK_HEADER_BYTES: usize = 8;

/// The parts of a file.
pub(super) struct Container<'a> {
    /// JSON text.
    pub(super) json: &'a [u8],
    /// The buffer without a name.
    pub(super) binary: Option<&'a [u8]>,
}

/// Splits the `bytes` of a file.
///
/// # Errors
/// Another version, lengths beyond the file, a first chunk that is not JSON.
pub(super) fn split<'a>(context: &Context<'_>, bytes: &'a [u8]) -> Result<Container<'a>, MeshError> {
    if !bytes.starts_with(MAGIC) {
        return Ok(Container { json: bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes), binary: None });
    }
    let version =
        u32_at(bytes, 4).ok_or_else(|| short(context, "header", HEADER_BYTES as u64, bytes.len()))?;
    if version != 2 {
        let way_out = "convert it to glTF 2.0".into();
        let (place, found) = ("header".into(), format!("version {version} of the binary container"));
        return Err(MeshError::Unsupported { path: context.path.into(), place, found, way_out });
    }
    let length =
        u32_at(bytes, 8).ok_or_else(|| short(context, "header", HEADER_BYTES as u64, bytes.len()))?;
    let whole =
        bytes.get(..length as usize).ok_or_else(|| short(context, "header", length.into(), bytes.len()))?;
    if whole.len() < bytes.len() {
        context.note(format!("{} bytes behind the declared length are ignored", bytes.len() - whole.len()));
    }
    let rest = whole
        .get(HEADER_BYTES..)
        .ok_or_else(|| short(context, "header", HEADER_BYTES as u64, whole.len()))?;
    let (json, mut rest) = chunk(context, rest, "chunk 0")?
        .ok_or_else(|| context.invalid("chunk 0", "a chunk of type JSON", "no chunk"))?;
    if json.0 != *b"JSON" {
        return Err(context.invalid(
            "chunk 0",
            "type JSON",
            format!("{:?}", String::from_utf8_lossy(&json.0)),
        ));
    }
    let mut number = 1;
    while let Some((found, after)) = chunk(context, rest, &format!("chunk {number}"))? {
        // Only the second chunk may be the buffer; others are of extensions.
        if number == 1 && found.0 == *b"BIN\0" {
            return Ok(Container { json: json.1, binary: Some(found.1) });
        }
        (rest, number) = (after, number + 1);
    }
    Ok(Container { json: json.1, binary: None })
}

/// Type and content of a chunk.
type Chunk<'a> = ([u8; 4], &'a [u8]);

/// The chunk at the start of `bytes` and what follows it; `None` at the end.
fn chunk<'a>(
    context: &Context<'_>,
    bytes: &'a [u8],
    place: &str,
) -> Result<Option<(Chunk<'a>, &'a [u8])>, MeshError> {
    if bytes.is_empty() {
        return Ok(None);
    }
    let header = bytes
        .first_chunk::<CHUNK_HEADER_BYTES>()
        .ok_or_else(|| short(context, place, CHUNK_HEADER_BYTES as u64, bytes.len()))?;
    let &[a, b, c, d, ref kind @ ..] = header;
    let length = u32::from_le_bytes([a, b, c, d]);
    let content = &bytes[CHUNK_HEADER_BYTES..];
    let (content, after) = content
        .split_at_checked(length as usize)
        .ok_or_else(|| short(context, place, length.into(), content.len()))?;
    Ok(Some(((*kind, content), after)))
}

fn u32_at(bytes: &[u8], at: usize) -> Option<u32> {
    bytes.get(at..).and_then(|b| b.first_chunk()).map(|&b| u32::from_le_bytes(b))
}

fn short(context: &Context<'_>, place: &str, expected: u64, found: usize) -> MeshError {
    context.invalid(place, format!("{expected} bytes"), format!("{found}; is the file truncated?"))
}
