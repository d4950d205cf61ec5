//! Where paths lead, and how two of them are related.

use formats::durable::{is_url, link_target, parent_of};
use std::fs::{self, Metadata};
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

/// The path with its links resolved, as far as it exists; also a link to a file that does not exist yet.
pub fn resolve_links(path: &Path) -> PathBuf {
    if is_url(path) {
        return path.into();
    }
    let target = link_target(&std::path::absolute(path).unwrap_or(path.into()));
    let parent = parent_of(&target);
    match (target.canonicalize(), target.file_name()) {
        (Ok(real), _) => real,
        (Err(_), _) if parent == target => target,
        (Err(_), Some(name)) => resolve_links(parent).join(name),
        // `..` behind a directory that does not exist yet.
        (Err(_), None) => parent_of(&resolve_links(parent)).into(),
    }
}

/// How an output is related to another path.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Relation {
    /// The same path.
    Same,
    /// Lies in it.
    Inside,
    /// Contains it.
    Around,
    /// The same file by another name, or that of a file in it.
    Linked,
}

/// A path with links resolved.
#[derive(Debug)]
pub struct Place {
    /// The resolved path, or a URL.
    pub path: PathBuf,
    metadata: Option<Metadata>,
}

impl Place {
    /// Resolves `path`.
    pub fn new(path: &Path) -> Self {
        let path = resolve_links(path);
        Self { metadata: fs::metadata(&path).ok(), path }
    }

    /// How this output is related to `other`; `None`: not at all.
    pub fn relation_to(&self, other: &Self) -> Option<Relation> {
        match () {
            () if self.path == other.path => Some(Relation::Same),
            () if self.path.starts_with(&other.path) => Some(Relation::Inside),
            () if other.path.starts_with(&self.path) => Some(Relation::Around),
            () if self.is_linked_to(other) => Some(Relation::Linked),
            () => None,
        }
    }

    fn is_linked_to(&self, other: &Self) -> bool {
        let (Some(own), Some(theirs)) = (&self.metadata, &other.metadata) else { return false };
        // A directory has one path, once links are resolved; of a file with one name nothing needs to be searched.
        own.is_file() && own.nlink() > 1 && holds(&other.path, theirs, own)
    }
}

/// Whether `file` is the file at `path`, or one in the directory there; links in a directory are not followed.
fn holds(path: &Path, metadata: &Metadata, file: &Metadata) -> bool {
    if !metadata.is_dir() {
        return (metadata.dev(), metadata.ino()) == (file.dev(), file.ino());
    }
    let mut entries = fs::read_dir(path).into_iter().flatten().flatten();
    entries.any(|entry| entry.metadata().is_ok_and(|metadata| holds(&entry.path(), &metadata, file)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::symlink;

    #[test]
    fn links_of_all_kinds_are_resolved() {
        let folder = tempfile::tempdir().unwrap();
        let root = folder.path().canonicalize().unwrap();
        let at = |name: &str| root.join(name);
        fs::create_dir_all(at("store/c")).unwrap();
        fs::write(at("store/c/0"), "").unwrap();
        symlink(at("store"), at("link")).unwrap();
        symlink("store/new", at("dangling")).unwrap();
        symlink("loop", at("loop")).unwrap();
        fs::hard_link(at("store/c/0"), at("hard")).unwrap();
        for (a, b, expected) in [
            ("store/c/0", "link/c/0", Some(Relation::Same)),
            ("link/c/1", "store", Some(Relation::Inside)),
            ("link/none/such", "store", Some(Relation::Inside)),
            ("none/../store", "store", Some(Relation::Same)),
            ("dangling", "store", Some(Relation::Inside)),
            ("dangling", "link/new", Some(Relation::Same)),
            ("link", "store/c/0", Some(Relation::Around)),
            ("hard", "store", Some(Relation::Linked)),
            ("hard", "link/c/0", Some(Relation::Linked)),
            ("store-2", "store", None),
            ("loop", "store", None),
        ] {
            assert_eq!(Place::new(&at(a)).relation_to(&Place::new(&at(b))), expected, "{a}, {b}");
        }
        let url = |text: &str| Place::new(Path::new(text));
        assert_eq!(url("s3://b/film").relation_to(&url("s3://b/film/roi_0")), Some(Relation::Around));
        assert_eq!(url("s3://b/film-2").relation_to(&url("s3://b/film")), None);
    }
}
