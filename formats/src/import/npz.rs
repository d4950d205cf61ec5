//! One NumPy archive of tables and windows (`numpy.savez`), for B wavelengths and K heights.
//!
//! | array | shape | |
//! |---|---|---|
//! | `wavelength_nm` or `wavelength_um` | (B) | f4 is rounded to 1e-3 nm: 0.4 µm is 400 nm |
//! | `ideal_height_mm` | (K) or (B, K) | f·tan(field) with f = `efl_mm`, unless `distortion_focal_length_mm` is in the archive |
//! | `image_height_mm` or `real_height_mm` | (B, K) | REAL chief-ray heights: of the field points and of the PSFs |
//! | `relative_illumination` or `ri` | (B, K) | 1 on axis |
//! | `psf` | (B, K, n, n) | top row first; the side of the field point is given by `--psf-outward` |
//! | `psf_energy` or `energy_in_window` | (B, K) | share of all the light in the window; optional |
//! | `efl_mm`, `psf_pitch_um` or `pixel_um` | () | `f_number`, `primary_nm` too, or by option |
//!
//! With a `--distortion-focal-mm` other than the archive's f, ideal heights are scaled to it: field angles are kept.

use super::npy::{self, Npy};
use super::write::{Imported, ReadWindows, SparseBand, SparseLens, Windows};
use super::{ImportError, ImportOptions, MAX_ARRAY_BYTES, MAX_COUNT, MAX_SIDE};
use serde_json::json;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{Cursor, Read, Seek};
use std::path::Path;
use zip::ZipArchive;
use zip::read::ZipFile;

/// Maximum expansion of Deflate: 1032 bytes from one.
const MAX_DEFLATE_RATIO: u64 = 1032;

/// Reads an archive.
///
/// # Errors
/// [`ImportError`].
pub fn open(path: &Path, options: &ImportOptions) -> Result<Imported, ImportError> {
    read(path, File::open(path).map_err(ImportError::io(path, "read"))?, options)
}

/// Reads an archive in memory; `path` is its name in errors.
///
/// # Errors
/// [`ImportError`].
pub fn open_bytes(path: &Path, bytes: &[u8], options: &ImportOptions) -> Result<Imported, ImportError> {
    read(path, Cursor::new(bytes), options)
}

/// The arrays of an archive that are used.
struct Arrays<'a> {
    path: &'a Path,
    found: BTreeMap<String, Npy>,
}

/// Names of the arrays that are used.
const KNOWN: [&str; 16] = [
    "wavelength_nm",
    "wavelength_um",
    "ideal_height_mm",
    "image_height_mm",
    "real_height_mm",
    "relative_illumination",
    "ri",
    "psf",
    "psf_energy",
    "energy_in_window",
    "efl_mm",
    "psf_pitch_um",
    "pixel_um",
    "f_number",
    "primary_nm",
    "distortion_focal_length_mm",
];

fn read<R: Read + Seek>(path: &Path, from: R, options: &ImportOptions) -> Result<Imported, ImportError> {
    let mut archive = ZipArchive::new(from).map_err(|e| damaged(path, &e))?;
    let mut arrays = Arrays { path, found: BTreeMap::new() };
    let mut total_bytes = 0;
    for i in 0..archive.len() {
        let entry = archive.by_index(i).map_err(|e| damaged(path, &e))?;
        let Some(name) = array_name(&entry) else { continue };
        if !KNOWN.contains(&name.as_str()) || (name == "psf" && options.without_psf) {
            continue;
        }
        let array = read_array(path, entry, &name, &mut total_bytes)?;
        arrays.found.insert(name, array);
    }
    convert(arrays, options)
}

/// The array `name` of the archive `path`; without a name the only one.
///
/// # Errors
/// [`ImportError`]: there is none, or the archive is damaged.
pub(super) fn array(path: &Path, name: Option<&str>) -> Result<Npy, ImportError> {
    let file = File::open(path).map_err(ImportError::io(path, "read"))?;
    let mut archive = ZipArchive::new(file).map_err(|e| damaged(path, &e))?;
    let mut names = Vec::new();
    for i in 0..archive.len() {
        names.extend(array_name(&archive.by_index(i).map_err(|e| damaged(path, &e))?).map(|name| (i, name)));
    }
    let found = match (name, &names[..]) {
        (Some(name), all) => all.iter().find(|(_, n)| n == name),
        (None, [one]) => Some(one),
        (None, _) => None,
    };
    let Some((i, found)) = found else {
        let list: Vec<String> = names.iter().take(20).map(|(_, n)| format!("`{n}`")).collect();
        let expected = name.map_or("one array; name it by FILE.npz:ARRAY".into(), |name| format!("`{name}`"));
        let problem = format!("has the arrays {}, expected {expected}", list.join(", "));
        return Err(ImportError::file(path, problem));
    };
    read_array(path, archive.by_index(*i).map_err(|e| damaged(path, &e))?, found, &mut 0)
}

fn damaged(path: &Path, e: &dyn std::fmt::Display) -> ImportError {
    ImportError::file(path, format!("is no .npz archive, or a damaged one: {e}"))
}

/// The name of an entry without `.npy`.
fn array_name<R: Read>(entry: &ZipFile<'_, R>) -> Option<String> {
    entry.name().ok().and_then(|n| n.strip_suffix(".npy").map(String::from))
}

/// Reads an entry; its bytes are added to `total_bytes`, which are bounded.
fn read_array<R: Read>(
    path: &Path,
    entry: ZipFile<'_, R>,
    name: &str,
    total_bytes: &mut u64,
) -> Result<Npy, ImportError> {
    let (claimed, compressed) = (entry.size(), entry.compressed_size());
    *total_bytes = claimed.saturating_add(*total_bytes);
    if *total_bytes > MAX_ARRAY_BYTES
        || claimed > compressed.saturating_mul(MAX_DEFLATE_RATIO).saturating_add(1024)
    {
        let problem = format!("{name}.npy declares {claimed} bytes, more than the archive can contain");
        return Err(ImportError::file(path, problem));
    }
    let mut bytes = Vec::new();
    entry.take(claimed.saturating_add(1)).read_to_end(&mut bytes).map_err(|e| damaged(path, &e))?;
    npy::parse(&bytes).map_err(|e| ImportError::file(path, format!("{name}.npy {e}")))
}

impl Arrays<'_> {
    /// The first of `names` that is in the archive.
    fn first_of(&self, names: &[&'static str]) -> Result<(&'static str, &Npy), ImportError> {
        let found = names.iter().find_map(|n| self.found.get(*n).map(|a| (*n, a)));
        found.ok_or_else(|| ImportError::file(self.path, format!("has no array `{}`", names.join("` or `"))))
    }

    fn bad(&self, name: &str, problem: String) -> ImportError {
        ImportError::file(self.path, format!("array `{name}` {problem}"))
    }

    /// A finite array of one of these shapes.
    fn shaped(&self, names: &[&'static str], shapes: &[&[usize]]) -> Result<&Npy, ImportError> {
        let (name, array) = self.first_of(names)?;
        if !shapes.contains(&array.shape.as_slice()) {
            return Err(self.bad(name, format!("has shape {:?}, expected {:?}", array.shape, shapes[0])));
        }
        match array.values.iter().position(|v| !v.is_finite()) {
            Some(i) => Err(self.bad(name, format!("has {} at index {i}", array.values[i]))),
            None => Ok(array),
        }
    }

    /// As [`Arrays::shaped`]; `None` if none of `names` is in the archive.
    fn optional(&self, names: &[&'static str], shapes: &[&[usize]]) -> Result<Option<&Npy>, ImportError> {
        let present = names.iter().any(|n| self.found.contains_key(*n));
        present.then(|| self.shaped(names, shapes)).transpose()
    }

    fn scalar(&self, names: &[&'static str]) -> Result<Option<f64>, ImportError> {
        Ok(self.optional(names, &[&[], &[1]])?.and_then(|a| a.values.first().copied()))
    }
}

fn convert(mut arrays: Arrays<'_>, options: &ImportOptions) -> Result<Imported, ImportError> {
    let path = arrays.path;
    let sample = options.required_sample(path)?;
    let (name, waves) = arrays.first_of(&["wavelength_nm", "wavelength_um"])?;
    let (bands, per_um) = (waves.values.len(), if name == "wavelength_um" { 1000.0 } else { 1.0 });
    let heights =
        arrays.first_of(&["image_height_mm", "real_height_mm"])?.1.shape.get(1).copied().unwrap_or(0);
    if !(1..=MAX_COUNT).contains(&bands) || !(2..=MAX_COUNT).contains(&heights) {
        let problem = format!("has {bands} wavelengths and {heights} heights, expected 1 and 2 at least");
        return Err(ImportError::file(path, problem));
    }
    let waves = arrays.shaped(&["wavelength_nm", "wavelength_um"], &[&[bands]])?;
    let rounded = |nm: f64| if waves.single { (nm * 1000.0).round_ties_even() / 1000.0 } else { nm };
    let nm: Vec<f64> = waves.values.iter().map(|w| rounded(w * per_um)).collect();
    if let Some(b) = (1..bands).find(|&b| nm[b] <= nm[b - 1]) {
        return Err(arrays.bad(name, format!("does not ascend at index {b}")));
    }
    let efl = options.focal_length(path, arrays.scalar(&["efl_mm"])?)?;
    let archive_focal = arrays.scalar(&["distortion_focal_length_mm"])?.unwrap_or(efl);
    let focal = options.distortion_focal_length_mm.unwrap_or(archive_focal);
    let (f_number, solid_angle_sr) = options.aperture(path, efl, arrays.scalar(&["f_number"])?)?;
    let primary = options.primary_nm(path, arrays.scalar(&["primary_nm"])?)?;
    let table = [bands, heights];
    let ideal = arrays.shaped(&["ideal_height_mm"], &[&[heights], &table])?;
    let real = arrays.shaped(&["image_height_mm", "real_height_mm"], &[&table])?;
    let ri = arrays.shaped(&["relative_illumination", "ri"], &[&table])?;
    let energy = arrays.optional(&["psf_energy", "energy_in_window"], &[&table])?;
    let row = |a: &Npy, b: usize| {
        let b = if a.shape.len() == 1 { 0 } else { b };
        a.values[b * heights..][..heights].to_vec()
    };
    let selected = options.selected_bands(bands)?;
    let sparse_bands: Vec<SparseBand> = selected
        .iter()
        .map(|&b| {
            let ideal: Vec<f64> = row(ideal, b).iter().map(|h| h * (focal / archive_focal)).collect();
            SparseBand {
                wavelength_nm: nm[b],
                distortion: (ideal.clone(), row(real, b)),
                illumination: (ideal, row(ri, b)),
                psf_height_mm: row(real, b),
                psf_energy: energy.map_or(Vec::new(), |e| row(e, b)),
                cra_deg: Vec::new(),
            }
        })
        .collect();
    let file = path.file_name().map(|n| n.to_string_lossy());
    let read_windows = match options.without_psf {
        true => Box::new(|_| Ok(Windows::default())) as ReadWindows,
        false => window_reader(&mut arrays, options, (bands, heights), selected)?,
    };
    let lens = SparseLens {
        path: path.into(),
        name: path.file_stem().map_or("lens".into(), |n| n.to_string_lossy().into_owned()),
        distortion_focal_length_mm: focal,
        effective_focal_length_mm: efl,
        f_number,
        solid_angle_sr,
        primary_wavelength_nm: primary,
        object_distance_mm: None,
        magnification: 0.0,
        sample,
        bands: sparse_bands,
        source: json!({ "format": "NumPy archive", "file": file }),
        notes: vec!["the archive has no object distance: infinity is assumed".into()],
    };
    Imported::new(lens, options, read_windows)
}

/// Takes the windows out of the archive.
fn window_reader(
    arrays: &mut Arrays<'_>,
    options: &ImportOptions,
    (bands, heights): (usize, usize),
    selected: Vec<usize>,
) -> Result<ReadWindows, ImportError> {
    let path = arrays.path.to_path_buf();
    let pitch = arrays.scalar(&["psf_pitch_um", "pixel_um"])?;
    let pitch = pitch.ok_or_else(|| ImportError::file(&path, "has no array `psf_pitch_um` or `pixel_um`"))?;
    let layout = options.layout(options.required_outward(&path)?);
    let psf = arrays.found.remove("psf").ok_or_else(|| ImportError::file(&path, "has no array `psf`"))?;
    let side = match psf.shape[..] {
        [b, k, n, m] if (b, k) == (bands, heights) && n == m && (1..=MAX_SIDE).contains(&n) => n,
        _ => {
            let shape = &psf.shape;
            let problem = format!("array `psf` has shape {shape:?}, expected [{bands}, {heights}, n, n]");
            return Err(ImportError::file(&path, problem));
        }
    };
    Ok(Box::new(move |b| {
        let mut windows = Windows::default();
        for k in 0..heights {
            let window = psf.window(selected[b] * heights + k, (side, side)).map_err(|problem| {
                ImportError::file(&path, format!("array `psf`, band {}, height {k}: {problem}", selected[b]))
            })?;
            windows.push(&path, window, pitch, layout)?;
        }
        Ok(windows)
    }))
}
