//! Names of other files in a mesh (RFC 3986; data URIs: RFC 2397).
//!
//! A mesh of unknown origin must not make the program read any file: a name is relative, stays in the mesh's folder, also through
//! symbolic links, or leads into a folder that the user allows. Other schemes than `data:` are refused.

use std::borrow::Cow;
use std::path::{Path, PathBuf};

use base64::Engine;
use base64::alphabet::STANDARD;
use base64::engine::{DecodePaddingMode, GeneralPurpose, GeneralPurposeConfig};

use super::context::Context;
use super::error::MeshError;
use super::shown::shown;

/// Base64 (RFC 4648) with or without padding, as programs write it.
const BASE64: GeneralPurpose = GeneralPurpose::new(
    &STANDARD,
    GeneralPurposeConfig::new()
        .with_decode_padding_mode(DecodePaddingMode::Indifferent)
        .with_decode_allow_trailing_bits(true),
);

/// Maximum length of a file name with its folders (Linux: PATH_MAX).
const MAX_NAME_BYTES: usize = 4096;

/// A file that a mesh names.
pub(super) struct NamedFile {
    /// Name for messages and lists.
    pub(super) named: PathBuf,
    /// Path without links; `None` if there is no such file.
    pub(super) opened: Option<PathBuf>,
}

/// Whether `uri` holds its data itself.
pub(super) fn is_data(uri: &str) -> bool {
    uri.get(..5).is_some_and(|scheme| scheme.eq_ignore_ascii_case("data:"))
}

/// Content of a data URI. The memory counts as in use until the caller releases it.
///
/// # Errors
/// No data, invalid base64, or more than the limits.
pub(super) fn decode_data(context: &Context<'_>, place: &str, uri: &str) -> Result<Vec<u8>, MeshError> {
    let invalid = |expected: &str, found: String| context.invalid(place, expected, found);
    let Some((kind, data)) = uri.split_once(',') else {
        return Err(invalid("a data URI, data:TYPE;base64,DATA", shown(uri)));
    };
    let is_base64 =
        kind.len() >= 7 && kind.get(kind.len() - 7..).is_some_and(|end| end.eq_ignore_ascii_case(";base64"));
    let bytes = if is_base64 { data.len() as u64 / 4 * 3 + 3 } else { data.len() as u64 };
    context.check_single(bytes, place)?;
    // A copy without percent escapes.
    let copied = if data.contains('%') { data.len() as u64 } else { 0 };
    context.charge(bytes + copied, || place.into())?;
    let escaped =
        if data.contains('%') { percent_decoded(data) } else { Some(Cow::Borrowed(data.as_bytes())) };
    let raw = escaped.ok_or_else(|| invalid("two hexadecimal digits after each %", shown(uri)))?;
    let decoded = match is_base64 {
        false => raw.into_owned(),
        true => BASE64.decode(&*raw).map_err(|e| invalid("base64 data", format!("{} ({e})", shown(uri))))?,
    };
    context.release(copied);
    Ok(decoded)
}

/// The file that `uri` names relative to the mesh's folder.
///
/// # Errors
/// Refused names.
pub(super) fn find(context: &Context<'_>, place: &str, uri: &str) -> Result<NamedFile, MeshError> {
    let refused = |reason, way_out| MeshError::Refused {
        path: context.path.into(),
        place: place.into(),
        uri: shown(uri),
        reason,
        way_out,
    };
    if uri.is_empty() || uri.len() > MAX_NAME_BYTES {
        return Err(context.invalid(
            place,
            format!("a file name of 1 to {MAX_NAME_BYTES} bytes"),
            shown(uri),
        ));
    }
    if has_scheme(uri) {
        return Err(refused(
            "only files and data: are read",
            "download the file and name it relative to the mesh",
        ));
    }
    let decoded = percent_decoded(uri)
        .and_then(|bytes| String::from_utf8(bytes.into_owned()).ok())
        .filter(|name| !name.contains('\0'))
        .ok_or_else(|| {
            refused(
                "it is no URI",
                "write % as %25 and other special characters as % and two hexadecimal digits, in UTF-8",
            )
        })?;
    let is_absolute = decoded.starts_with(['/', '\\']) || Path::new(&decoded).is_absolute();
    let leaves = decoded.split(['/', '\\']).any(|component| component == "..");
    let allowed = &context.limits.allow_paths;
    if allowed.is_empty() && is_absolute {
        return Err(refused(
            "it is absolute",
            "name it relative to the mesh, or allow its folder with --allow-path DIR",
        ));
    }
    if allowed.is_empty() && leaves {
        return Err(refused(
            "it has `..`",
            "put the file into the mesh's folder, or allow its folder with --allow-path DIR",
        ));
    }
    let folder = match context.path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    };
    let named = folder.join(&decoded);
    let io = |source| MeshError::Io { path: named.clone(), action: "find it", source };
    let opened = match named.canonicalize() {
        Ok(opened) => opened,
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(NamedFile { named, opened: None }),
        Err(e) => return Err(io(e)),
    };
    let is_within = |folder: &Path| folder.canonicalize().is_ok_and(|folder| opened.starts_with(folder));
    let is_own = !is_absolute && !leaves && is_within(folder);
    if !is_own && !allowed.iter().any(|folder| is_within(folder)) {
        return Err(refused(
            "it leads out of the mesh's folder",
            "put the file there, or allow its folder with --allow-path DIR",
        ));
    }
    Ok(NamedFile { named, opened: Some(opened) })
}

/// Whether `uri` starts with a scheme (RFC 3986, 3.1); a Windows drive does.
fn has_scheme(uri: &str) -> bool {
    uri.split_once(':').is_some_and(|(scheme, _)| {
        scheme.starts_with(|c: char| c.is_ascii_alphabetic())
            && scheme.chars().all(|c| c.is_ascii_alphanumeric() || matches!(c, '+' | '-' | '.'))
    })
}

/// `text` with each %XX as its byte; `None` if two hexadecimal digits do not follow a %.
fn percent_decoded(text: &str) -> Option<Cow<'_, [u8]>> {
    let bytes = text.as_bytes();
    if !bytes.contains(&b'%') {
        return Some(Cow::Borrowed(bytes));
    }
    let digit = |at: usize| bytes.get(at).and_then(|&b| char::from(b).to_digit(16));
    let mut decoded = Vec::with_capacity(bytes.len());
    let mut at = 0;
    while let Some(&byte) = bytes.get(at) {
        match byte {
            b'%' => {
                decoded.push(u8::try_from(16 * digit(at + 1)? + digit(at + 2)?).ok()?);
                at += 3;
            }
            _ => {
                decoded.push(byte);
                at += 1;
            }
        }
    }
    Some(Cow::Owned(decoded))
}
