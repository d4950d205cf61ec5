//! The pictures of a recipe: files, folders, patterns and lists; and their pixels as bands.

use super::bands::Bands;
use crate::failure::usage;
use crate::open;
use anyhow::{Context, Result, anyhow};
use formats::chart::image::{ImageFile, Transfer};
use formats::chart::{Chart, NanPolicy};
use formats::dataset::matching;
use formats::dataset::recipe::PicturesTable;
use formats::durable::{parent_of, read_file_at_most};
use pipeline::geometry::{Rect, Size};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// Endings of what is taken from a folder.
const ENDINGS: [&str; 16] = [
    "png", "jpg", "jpeg", "webp", "tif", "tiff", "exr", "zarr", "hdr", "npy", "mat", "h5", "hdf5", "nc",
    "img", "bil",
];
/// Endings of pictures in colour, unless they are charts.
const PICTURES: [&str; 7] = ["png", "jpg", "jpeg", "webp", "tif", "tiff", "exr"];
/// Largest list that is read, bytes.
const MAX_LIST: u64 = 256 << 20;

/// The files that `table` names, sorted within each of its entries, each once; relative names start at `folder`.
///
/// # Errors
/// Usage: a name without a file.
pub fn files(table: &PicturesTable, folder: &Path) -> Result<Vec<PathBuf>> {
    let mut known = BTreeSet::new();
    let mut all = Vec::new();
    for name in &table.files.0 {
        let found = match name.strip_prefix('@') {
            Some(list) => listed(&folder.join(list))?,
            None => named(name, folder)?,
        };
        all.extend(found.into_iter().filter(|path| known.insert(path.clone())));
    }
    Ok(all)
}

fn named(name: &str, folder: &Path) -> Result<Vec<PathBuf>> {
    let path = folder.join(name);
    let none = |what: &str| usage(format!("pictures.files: {}: {what}", path.display()));
    let is_chart = |path: &Path| has_ending(path, &ENDINGS);
    if path.is_file() || path.is_dir() && is_chart(&path) {
        return Ok(vec![path]);
    }
    if path.is_dir() {
        let entries =
            std::fs::read_dir(&path).with_context(|| format!("pictures.files: {}", path.display()))?;
        let mut all: Vec<PathBuf> = entries.map(|entry| Ok(entry?.path())).collect::<std::io::Result<_>>()?;
        all.retain(|path| is_chart(path));
        all.sort();
        return if all.is_empty() {
            Err(none("expected pictures or cubes in the folder, found none"))
        } else {
            Ok(all)
        };
    }
    let pattern = path.to_str().ok_or_else(|| none("the name must be UTF-8"))?;
    let found = matching(pattern).map_err(|e| none(&format!("no such file, and no pattern: {e}")))?;
    if found.is_empty() {
        return Err(none("no such file or folder, and no file matches it as a pattern"));
    }
    Ok(found)
}

/// The files that a list names, one a line; relative names start at its folder.
fn listed(path: &Path) -> Result<Vec<PathBuf>> {
    let shown = || format!("pictures.files: list {}", path.display());
    let bytes = read_file_at_most(path, MAX_LIST).with_context(shown)?;
    let bytes =
        bytes.ok_or_else(|| usage(format!("{}: expected at most {MAX_LIST} bytes, found more", shown())))?;
    let text = String::from_utf8(bytes).map_err(|_| usage(format!("{}: expected text in UTF-8", shown())))?;
    let lines = text.lines().map(str::trim).filter(|line| !line.is_empty() && !line.starts_with('#'));
    Ok(lines.map(|line| parent_of(path).join(line)).collect())
}

fn has_ending(path: &Path, endings: &[&str]) -> bool {
    path.extension().is_some_and(|e| endings.contains(&&*e.to_string_lossy().to_ascii_lowercase()))
}

/// A picture or a cube whose header has been read.
pub enum Picture {
    /// In colour or grey.
    Image(ImageFile),
    /// Its name, and the chart of bands.
    Cube(String, Box<Chart>),
}

impl Picture {
    /// Opens `path`.
    ///
    /// # Errors
    /// It cannot be read.
    pub fn open(path: &Path) -> Result<Self> {
        let name = path.to_str().ok_or_else(|| anyhow!("{}: the name must be UTF-8", path.display()))?;
        if has_ending(path, &PICTURES) && path.is_file() {
            let is_image = match ImageFile::open(path) {
                Ok(file) if file.spectral().is_none() => return Ok(Self::Image(file)),
                Ok(_) => None,
                Err(e) => Some(e),
            };
            // A TIFF or OpenEXR of bands; if it is neither, the error of the picture.
            return match (open::chart(name, None, NanPolicy::Error, 0), is_image) {
                (Ok(chart), _) => Ok(Self::Cube(name.into(), Box::new(chart))),
                (Err(_), Some(e)) => Err(e.into()),
                (Err(e), None) => Err(e),
            };
        }
        Ok(Self::Cube(name.into(), Box::new(open::chart(name, None, NanPolicy::Error, 0)?)))
    }

    /// Its size.
    pub fn size(&self) -> Size {
        match self {
            Self::Image(file) => file.size(),
            Self::Cube(_, chart) => chart.size(),
        }
    }

    /// Wavelengths of a cube, nm.
    ///
    /// # Errors
    /// It has none.
    pub fn wavelengths_nm(&self) -> Result<Option<Vec<f64>>> {
        match self {
            Self::Image(_) => Ok(None),
            Self::Cube(name, chart) => wavelengths_of(name, chart).map(Some),
        }
    }

    /// The pixels of `part` as `bands`, one after the other.
    ///
    /// # Errors
    /// It does not decode; a cube without these wavelengths.
    pub fn bands(self, part: Rect, bands: &Bands) -> Result<Vec<f32>> {
        match self {
            Self::Image(_) if !bands.are_of_colours() => Err(anyhow!(
                "expected a cube, as the first of pictures.files is, found a picture in colour or grey"
            )),
            Self::Image(file) => {
                let channels = if file.is_grey() { 1 } else { 3 };
                let linear = file.linear_part(Transfer::Srgb, part)?;
                Ok(bands.of_colours(&linear, channels, part.size().pixels()))
            }
            Self::Cube(name, chart) => {
                let nm = wavelengths_of(&name, &chart)?;
                let mut out = vec![0.0; bands.wavelengths_nm().len() * part.size().pixels()];
                for (band, to) in
                    bands.wavelengths_nm().iter().zip(out.chunks_exact_mut(part.size().pixels()))
                {
                    let found = nm.iter().position(|v| (v - band).abs() < 1e-3).ok_or_else(|| {
                        anyhow!("expected a band of {band} nm, as the first cube or `wavelengths_nm` has, found {}", pipeline::wavelengths::format(&nm))
                    })?;
                    chart.source().read(found, part, to).map_err(anyhow::Error::from_boxed)?;
                }
                Ok(out)
            }
        }
    }
}

/// Wavelengths of the cube `name`, nm.
fn wavelengths_of(name: &str, cube: &Chart) -> Result<Vec<f64>> {
    cube.wavelengths_nm().map_err(|e| open::without_chart_flags(&["--wavelengths"], name, e.into()))
}

/// The pixels of a mask as whole numbers, and the largest that its format has.
///
/// # Errors
/// It is no picture in grey, or of another size.
pub fn mask(path: &Path, size: Size, part: Rect) -> Result<(Vec<u16>, u16)> {
    let file = ImageFile::open(path)?;
    if !file.is_grey() || file.size() != size {
        let kind = if file.is_grey() { "grey" } else { "colour" };
        return Err(anyhow!(
            "mask {}: expected a picture in grey of {size} px, found {kind} of {}",
            path.display(),
            file.size()
        ));
    }
    let white = file.white();
    let shares = file.linear_part(Transfer::Linear, part)?;
    Ok((shares.iter().map(|v| (v * f32::from(white)).round() as u16).collect(), white))
}
