//! Films and raws, opened to report on them: a damaged one is a finding (exit code 4).

use crate::failure::{Coded, code};
use anyhow::Result;
use formats::film::FilmStore;
use formats::group::GroupError;
use formats::raw::RawStore;
use formats::scene::SceneStore;
use std::path::Path;

/// Opens a film to report on it: a missing film is a failure (exit code 1), a damaged one a finding (4).
///
/// # Errors
/// As described; the store cannot be read.
pub fn film(path: &Path) -> Result<FilmStore> {
    opened_film(FilmStore::open(path, true))
}

/// As [`film`], of a film that was opened otherwise.
///
/// # Errors
/// As [`film`].
pub fn opened_film(film: Result<FilmStore, GroupError>) -> Result<FilmStore> {
    film.map_err(|e| {
        let code = match &e {
            GroupError::Damaged { .. } | GroupError::ArrayMetadata { .. } | GroupError::Attributes { .. } => {
                code::WRONG
            }
            GroupError::NotOfKind { .. } => code::FAILED,
            _ => return e.into(),
        };
        Coded { code, message: e.to_string() }.into()
    })
}

/// As [`opened_film`], where the command takes other `kinds` of groups as well, which were looked for before.
///
/// # Errors
/// As [`film`].
pub fn opened_of_kinds(kinds: &str, film: Result<FilmStore, GroupError>) -> Result<FilmStore> {
    match film {
        Err(GroupError::NotOfKind { path, found, .. }) => {
            let path = path.display();
            let message = format!(
                "opening {path}: found {found}, expected {kinds} of this program; nothing was changed"
            );
            Err(Coded { code: code::FAILED, message }.into())
        }
        film => opened_film(film),
    }
}

/// The raw at `path`; `None` if it is none.
///
/// # Errors
/// A damaged one (4); the store cannot be read.
pub fn raw(path: &Path) -> Result<Option<RawStore>> {
    opened_raw(path, RawStore::open)
}

/// As [`raw`], opened by `open`.
pub fn opened_raw(
    path: &Path,
    open: impl Fn(&Path, bool) -> Result<RawStore, GroupError>,
) -> Result<Option<RawStore>> {
    opened(RawStore::is_one(path), || open(path, true))
}

/// The scene at `path`, opened by `open`; `None` if it is none.
///
/// # Errors
/// As [`raw`].
pub fn opened_scene(
    path: &Path,
    open: impl Fn(&Path, bool) -> Result<SceneStore, GroupError>,
) -> Result<Option<SceneStore>> {
    opened(SceneStore::is_one(path), || open(path, true))
}

/// What `open` opens, if it is of its kind.
fn opened<T>(
    is_one: Result<bool, GroupError>,
    open: impl Fn() -> Result<T, GroupError>,
) -> Result<Option<T>> {
    if !is_one.unwrap_or(false) {
        return Ok(None);
    }
    open().map(Some).map_err(|e| match e {
        GroupError::Damaged { .. } | GroupError::ArrayMetadata { .. } => {
            Coded { code: code::WRONG, message: e.to_string() }.into()
        }
        e => e.into(),
    })
}
