//! Which files a mesh may name.
//!
//! A reference is a path relative to the folder of the file that has it; `\` separates folders like `/`. Refused are URLs, paths with a
//! drive, absolute paths, and those that leave the folder by `..` or by a symbolic link, unless they end in an allowed folder. If a name
//! does not exist, one that differs in upper and lower case only is taken.

use std::path::{Component, Path, PathBuf};

use super::context::Context;
use super::error::MeshError;
use super::shown::shown;

/// Way out of a refusal.
const WAY_OUT: &str = "put the file into the mesh's folder and name it without a folder, or allow its folder with --allow-path DIR";

/// A file that may be read.
#[derive(Debug, PartialEq)]
pub(super) struct Found {
    pub path: PathBuf,
    /// Whether its name differs from the reference in upper and lower case.
    pub other_case: bool,
}

/// The file that `reference`, at `place` of `file`, names.
///
/// # Errors
/// [`MeshError::Refused`]; [`MeshError::Missing`] if there is none.
pub(super) fn resolve(
    context: &Context<'_>,
    file: &Path,
    place: &str,
    reference: &str,
) -> Result<Found, MeshError> {
    let allow_paths = &context.limits.allow_paths;
    let refused = |reason| MeshError::Refused {
        path: file.into(),
        place: place.into(),
        uri: shown(reference),
        reason,
        way_out: WAY_OUT,
    };
    let name = reference.trim().trim_matches('"').replace('\\', "/");
    if name.is_empty() || name.contains(char::is_control) {
        return Err(refused("it is not a file name"));
    }
    if let Some(reason) = scheme(&name) {
        return Err(refused(reason));
    }
    let folder = match file.parent() {
        Some(parent) if parent != Path::new("") => parent,
        _ => Path::new("."),
    };
    let relative = Path::new(&name);
    let target = folder.join(relative);
    let roots = || std::iter::once(folder).chain(allow_paths.iter().map(PathBuf::as_path));
    if !roots().any(|root| without_dots(&target).starts_with(without_dots(root))) {
        return Err(refused(match relative.is_absolute() {
            true => "it is an absolute path",
            false => "it leaves the folder of the mesh by `..`",
        }));
    }
    let missing = || MeshError::Missing {
        path: file.into(),
        place: place.into(),
        file: folder.join(relative),
        way_out: "restore it, or read the mesh without it by --missing-textures grey",
    };
    let (path, other_case) = match target.exists() {
        true => (target, false),
        false if relative.is_absolute() => return Err(missing()),
        false => (in_other_case(folder, relative).ok_or_else(missing)?, true),
    };
    let real = path.canonicalize().map_err(|_| missing())?;
    let is_inside = |root: &Path| root.canonicalize().is_ok_and(|root| real.starts_with(root));
    if !roots().any(is_inside) {
        return Err(refused("it is a link out of the folder of the mesh"));
    }
    Ok(Found { path, other_case })
}

/// Why a name that starts with a scheme or drive and a colon is refused.
fn scheme(name: &str) -> Option<&'static str> {
    let (before, _) = name.split_once(':')?;
    let mut characters = before.chars();
    let is_scheme = characters.next()?.is_ascii_alphabetic()
        && characters.all(|c| c.is_ascii_alphanumeric() || matches!(c, '+' | '-' | '.'));
    is_scheme.then_some(match before.len() {
        1 => "it is an absolute path with a drive",
        _ => "it is a URL",
    })
}

/// An absolute path without `.` and `..`, regardless of symbolic links.
fn without_dots(path: &Path) -> PathBuf {
    let mut plain = PathBuf::new();
    for component in std::path::absolute(path).unwrap_or_else(|_| path.into()).components() {
        match component {
            Component::CurDir => {}
            Component::ParentDir => {
                plain.pop();
            }
            other => plain.push(other),
        }
    }
    plain
}

/// The first path, by name, that differs from `relative` in case only.
fn in_other_case(folder: &Path, relative: &Path) -> Option<PathBuf> {
    let mut path = folder.to_path_buf();
    for component in relative.components() {
        let exact = path.join(component);
        if exact.exists() {
            path = exact;
            continue;
        }
        let wanted = component.as_os_str().to_str()?.to_lowercase();
        let entries = std::fs::read_dir(&path).ok()?.filter_map(|e| e.ok()?.file_name().into_string().ok());
        path.push(entries.filter(|name| name.to_lowercase() == wanted).min()?);
    }
    Some(path)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::Limits;

    fn find(file: &Path, reference: &str, allow: &[PathBuf]) -> Result<Found, MeshError> {
        let limits = Limits { allow_paths: allow.to_vec(), ..Limits::of_memory(1 << 20) };
        resolve(&Context::new(file, &limits), file, "line 7", reference)
    }

    fn reason(file: &Path, reference: &str, allow: &[PathBuf]) -> &'static str {
        match find(file, reference, allow) {
            Err(MeshError::Refused { reason, uri, place, .. }) => {
                assert_eq!((uri, place.as_str()), (shown(reference), "line 7"));
                reason
            }
            other => panic!("{reference}: {other:?}"),
        }
    }

    #[test]
    fn references_out_of_the_folder_are_refused_by_name() {
        let folder = tempfile::tempdir().unwrap();
        let inside = folder.path().join("model");
        std::fs::create_dir_all(inside.join("sub")).unwrap();
        std::fs::write(folder.path().join("secret.png"), "").unwrap();
        let file = inside.join("a.obj");
        for (reference, expected) in [
            ("http://example.org/a.png", "it is a URL"),
            ("file:///etc/passwd", "it is a URL"),
            ("data:image/png;base64,AAAA", "it is a URL"),
            (r"C:\textures\a.png", "it is an absolute path with a drive"),
            ("/etc/passwd", "it is an absolute path"),
            (r"\\server\a.png", "it is an absolute path"),
            ("../secret.png", "it leaves the folder of the mesh by `..`"),
            (r"sub\..\..\secret.png", "it leaves the folder of the mesh by `..`"),
            ("", "it is not a file name"),
            ("a\0b", "it is not a file name"),
        ] {
            assert_eq!(reason(&file, reference, &[]), expected, "{reference}");
        }
        let allow = [folder.path().to_path_buf()];
        let found = find(&file, "../secret.png", &allow).unwrap();
        assert!(found.path.ends_with("model/../secret.png"));
        let absolute = folder.path().join("secret.png");
        assert_eq!(find(&file, absolute.to_str().unwrap(), &allow).unwrap().path, absolute);
    }

    #[cfg(unix)]
    #[test]
    fn links_out_of_the_folder_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let inside = folder.path().join("model");
        std::fs::create_dir_all(inside.join("real")).unwrap();
        std::fs::write(folder.path().join("secret.png"), "").unwrap();
        std::fs::write(inside.join("real/a.png"), "").unwrap();
        std::os::unix::fs::symlink(folder.path(), inside.join("out")).unwrap();
        std::os::unix::fs::symlink("real", inside.join("in")).unwrap();
        let file = inside.join("a.obj");
        assert_eq!(reason(&file, "out/secret.png", &[]), "it is a link out of the folder of the mesh");
        assert!(find(&file, "in/a.png", &[]).is_ok());
        let allow = [folder.path().to_path_buf()];
        assert!(find(&file, "out/secret.png", &allow).is_ok());
    }

    #[test]
    fn backslashes_and_other_case_are_accepted() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::create_dir(folder.path().join("Textures")).unwrap();
        std::fs::write(folder.path().join("Textures/Wood Élm.PNG"), "").unwrap();
        let file = folder.path().join("a.obj");
        let found = |reference| find(&file, reference, &[]);
        let path = folder.path().join("Textures/Wood Élm.PNG");
        assert_eq!(found(r"Textures\Wood Élm.PNG").unwrap(), Found { path: path.clone(), other_case: false });
        assert_eq!(found(r".\textures\wood élm.png").unwrap(), Found { path, other_case: true });
        assert!(matches!(found("wood.png"), Err(MeshError::Missing { .. })));
    }
}
