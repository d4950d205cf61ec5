//! Array files: names in a description, and their samples as f64.

use super::fits;
use crate::import::npy::{self, Npy};
use crate::import::{ImportError, npz, text};
use crate::toml_table::Field;
use std::fmt;
use std::path::{Component, Path, PathBuf};

/// The array of a file that holds several.
#[derive(Clone, Debug, PartialEq, Eq)]
enum Part {
    /// The only one.
    Only,
    /// Of this name (NPZ).
    Named(String),
    /// Of this number from 0 (FITS).
    Image(usize),
}

/// An array: its file, and its name or number there.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct ArrayName {
    pub path: PathBuf,
    part: Part,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Kind {
    Npy,
    Npz,
    Fits,
}

fn kind(path: &Path) -> Option<Kind> {
    let extension = path.extension()?.to_str()?.to_ascii_lowercase();
    match extension.as_str() {
        "npy" => Some(Kind::Npy),
        "npz" => Some(Kind::Npz),
        "fits" | "fit" | "fts" => Some(Kind::Fits),
        _ => None,
    }
}

impl ArrayName {
    /// The array `text` of the description at `path`, the value of `field`.
    pub fn new(path: &Path, field: &Field<'_>, text: &str) -> Result<Self, ImportError> {
        let (file, part) = match text.rsplit_once(':') {
            None => (text, None),
            Some((file, part)) => (file, Some(part)),
        };
        let plain =
            Path::new(file).components().all(|c| matches!(c, Component::Normal(_) | Component::CurDir));
        if !plain || file.contains('\0') {
            return Err(field.error("a file in the folder of the description, or below").into());
        }
        let kind = kind(Path::new(file));
        let part = match (kind, part) {
            (Some(_), None) => Part::Only,
            (Some(Kind::Npz), Some(name)) => Part::Named(name.to_owned()),
            (Some(Kind::Fits), Some(image)) => match image.parse() {
                Ok(image) => Part::Image(image),
                Err(_) => return Err(field.error("FILE.fits:IMAGE, the number of an image from 0").into()),
            },
            _ => return Err(field.error("a file NAME.npy, NAME.npz:ARRAY or NAME.fits:IMAGE").into()),
        };
        Ok(Self { path: path.parent().unwrap_or(Path::new("")).join(file), part })
    }

    /// Whether it is a FITS file without the number of an image.
    pub fn is_whole_fits(&self) -> bool {
        self.part == Part::Only && kind(&self.path) == Some(Kind::Fits)
    }

    /// The image `b` of its file.
    pub fn image(&self, b: usize) -> Self {
        Self { path: self.path.clone(), part: Part::Image(b) }
    }

    /// An error of this array.
    pub fn error(&self, problem: impl fmt::Display) -> ImportError {
        let problem = match &self.part {
            Part::Only => problem.to_string(),
            Part::Named(name) => format!("array `{name}` {problem}"),
            Part::Image(image) => format!("image {image} {problem}"),
        };
        ImportError::file(&self.path, problem)
    }

    fn read(&self) -> Result<Npy, ImportError> {
        match (kind(&self.path), &self.part) {
            (Some(Kind::Npz), part) => {
                let name = if let Part::Named(name) = part { Some(name.as_str()) } else { None };
                npz::array(&self.path, name)
            }
            (Some(Kind::Fits), part) => {
                let image = if let Part::Image(image) = part { Some(*image) } else { None };
                fits::image(&text::read_bytes(&self.path)?, image)
                    .map_err(|e| ImportError::file(&self.path, e))
            }
            _ => npy::parse(&text::read_bytes(&self.path)?).map_err(|e| ImportError::file(&self.path, e)),
        }
    }
}

/// Reads arrays; the last one is kept, since all bands may be in one.
#[derive(Default)]
pub(super) struct Loader {
    last: Option<(ArrayName, Npy)>,
}

impl Loader {
    /// The array `name`.
    pub fn load(&mut self, name: &ArrayName) -> Result<&Npy, ImportError> {
        let last = match self.last.take() {
            Some(last) if last.0 == *name => last,
            _ => (name.clone(), name.read()?),
        };
        Ok(&self.last.insert(last).1)
    }
}
