//! One NumPy archive of tables and windows (`numpy.savez`), for B wavelengths and K heights.
//!
//! | array | shape | |
//! |---|---|---|
//! | `wavelength_nm` or `wavelength_um` | (B) | f4 is rounded to 1e-3 nm: 0.4 µm is 400 nm |
//! | `ideal_height_mm` | (K) or (B, K) | f·tan(field) with f = `efl_mm`, unless `distortion_focal_length_mm` is in the archive |
//! | `image_height_mm` or `real_height_mm` | (B, K) | REAL chief-ray heights: of the field points and of the PSFs |
//! | `relative_illumination` or `ri` | (B, K) | 1 on axis |
//! | `psf` | (B, K, n, n) | first row on top; the side of the field point is told by `--psf-outward` |
//! | `psf_energy` or `energy_in_window` | (B, K) | share of all the light in the window; may be missing |
//! | `efl_mm`, `psf_pitch_um` or `pixel_um` | () | `f_number`, `primary_nm` too, or by option |
//!
//! With `--distortion-focal-mm` other than the archive's f, ideal heights are scaled to it: the field angles stay.

use super::npy::{self, Npy};
use super::window::Window;
use super::write::{Fetch, Given, GivenBand, Imported, Windows, row_order, told};
use super::{ImportError, ImportOptions, MAX_FILE, MOST, WIDEST};
use serde_json::{Map, json};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{Cursor, Read, Seek};
use std::path::Path;
use zip::ZipArchive;

/// Deflate makes at most 1032 bytes of one.
const DEFLATE_MOST: u64 = 1032;

/// Reads an archive.
///
/// # Errors
/// [`ImportError`].
pub fn open(path: &Path, options: &ImportOptions) -> Result<Imported, ImportError> {
    let io = |source| ImportError::Io { path: path.into(), action: "read", source };
    read(path, File::open(path).map_err(io)?, options)
}

/// Reads an archive in memory; `path` is what errors call it.
///
/// # Errors
/// [`ImportError`].
pub fn open_bytes(path: &Path, bytes: &[u8], options: &ImportOptions) -> Result<Imported, ImportError> {
    read(path, Cursor::new(bytes), options)
}

/// The archive's arrays that are asked for.
struct Arrays<'a> {
    path: &'a Path,
    found: BTreeMap<String, Npy>,
}

const KNOWN: [&str; 15] = [
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
    "distortion_focal_length_mm",
];

fn read<R: Read + Seek>(path: &Path, from: R, options: &ImportOptions) -> Result<Imported, ImportError> {
    let zip_error = |e: &dyn std::fmt::Display| {
        ImportError::file(path, format!("is no .npz archive, or a damaged one: {e}"))
    };
    let mut archive = ZipArchive::new(from).map_err(|e| zip_error(&e))?;
    let mut arrays = Arrays { path, found: BTreeMap::new() };
    let mut held = 0;
    for i in 0..archive.len() {
        let entry = archive.by_index(i).map_err(|e| zip_error(&e))?;
        let Some(name) = entry.name().ok().and_then(|n| n.strip_suffix(".npy").map(String::from)) else {
            continue;
        };
        if !KNOWN.contains(&name.as_str()) || (name == "psf" && options.without_psf) {
            continue;
        }
        let (claim, packed) = (entry.size(), entry.compressed_size());
        held = claim.saturating_add(held);
        if held > MAX_FILE || claim > packed.saturating_mul(DEFLATE_MOST).saturating_add(1024) {
            return Err(ImportError::file(
                path,
                format!("{name}.npy claims {claim} bytes, more than the archive can hold"),
            ));
        }
        let mut bytes = Vec::new();
        entry.take(claim.saturating_add(1)).read_to_end(&mut bytes).map_err(|e| zip_error(&e))?;
        let array = npy::parse(&bytes).map_err(|e| ImportError::file(path, format!("{name}.npy {e}")))?;
        arrays.found.insert(name, array);
    }
    imported(arrays, options)
}

impl Arrays<'_> {
    fn any(&self, names: &[&'static str]) -> Result<(&'static str, &Npy), ImportError> {
        let found = names.iter().find_map(|n| self.found.get(*n).map(|a| (*n, a)));
        found.ok_or_else(|| ImportError::file(self.path, format!("has no array `{}`", names.join("` or `"))))
    }

    fn bad(&self, name: &str, problem: String) -> ImportError {
        ImportError::file(self.path, format!("array `{name}` {problem}"))
    }

    /// A finite array of one of these shapes.
    fn shaped(&self, names: &[&'static str], shapes: &[&[usize]]) -> Result<&Npy, ImportError> {
        let (name, array) = self.any(names)?;
        if !shapes.contains(&array.shape.as_slice()) {
            return Err(self.bad(name, format!("has shape {:?}, expected {:?}", array.shape, shapes[0])));
        }
        match array.values.iter().position(|v| !v.is_finite()) {
            Some(i) => Err(self.bad(name, format!("has {} at index {i}", array.values[i]))),
            None => Ok(array),
        }
    }

    fn scalar(&self, names: &[&'static str]) -> Result<Option<f64>, ImportError> {
        match names.iter().any(|n| self.found.contains_key(*n)) {
            true => Ok(self.shaped(names, &[&[], &[1]])?.values.first().copied()),
            false => Ok(None),
        }
    }
}

fn imported(mut arrays: Arrays<'_>, options: &ImportOptions) -> Result<Imported, ImportError> {
    let path = arrays.path;
    let sample = options.told_sample(path)?;
    let (name, waves) = arrays.any(&["wavelength_nm", "wavelength_um"])?;
    let (bands, per_um) = (waves.values.len(), if name == "wavelength_um" { 1000.0 } else { 1.0 });
    let heights = arrays.any(&["image_height_mm", "real_height_mm"])?.1.shape.get(1).copied().unwrap_or(0);
    if !(1..=MOST).contains(&bands) || !(2..=MOST).contains(&heights) {
        return Err(ImportError::file(
            path,
            format!("has {bands} wavelengths and {heights} heights, expected 1 and 2 at least"),
        ));
    }
    let waves = arrays.shaped(&["wavelength_nm", "wavelength_um"], &[&[bands]])?;
    let rounded = |nm: f64| if waves.single { (nm * 1000.0).round_ties_even() / 1000.0 } else { nm };
    let nm: Vec<f64> = waves.values.iter().map(|w| rounded(w * per_um)).collect();
    if let Some(b) = (1..bands).find(|&b| nm[b] <= nm[b - 1]) {
        return Err(arrays.bad(name, format!("does not ascend at index {b}")));
    }
    let efl = told(
        path,
        options.effective_focal_length_mm,
        arrays.scalar(&["efl_mm"])?,
        "the focal length",
        "--efl-mm",
    )?;
    let archive_focal = arrays.scalar(&["distortion_focal_length_mm"])?.unwrap_or(efl);
    let focal = options.distortion_focal_length_mm.unwrap_or(archive_focal);
    let (f_number, solid_angle_sr) = options.aperture(path, efl, arrays.scalar(&["f_number"])?)?;
    let primary = told(path, options.primary_wavelength_nm, None, "the primary wavelength", "--primary-nm")?;
    let table = [bands, heights];
    let ideal = arrays.shaped(&["ideal_height_mm"], &[&[heights], &table])?;
    let real = arrays.shaped(&["image_height_mm", "real_height_mm"], &[&table])?;
    let ri = arrays.shaped(&["relative_illumination", "ri"], &[&table])?;
    let energies = ["psf_energy", "energy_in_window"];
    let energy = match energies.iter().any(|n| arrays.found.contains_key(*n)) {
        true => Some(arrays.shaped(&energies, &[&table])?),
        false => None,
    };
    let row = |a: &Npy, b: usize| {
        let b = if a.shape.len() == 1 { 0 } else { b };
        a.values[b * heights..][..heights].to_vec()
    };
    let chosen = options.chosen(bands)?;
    let given: Vec<GivenBand> = chosen
        .iter()
        .map(|&b| {
            let ideal: Vec<f64> = row(ideal, b).iter().map(|h| h * (focal / archive_focal)).collect();
            GivenBand {
                wavelength_nm: nm[b],
                distortion: (ideal.clone(), row(real, b)),
                illumination: (ideal, row(ri, b)),
                psf_height_mm: row(real, b),
                psf_energy: energy.map_or(Vec::new(), |e| row(e, b)),
            }
        })
        .collect();
    let mut source = Map::new();
    source.insert("format".into(), json!("NumPy archive"));
    source.insert("file".into(), json!(path.file_name().map(|n| n.to_string_lossy())));
    source.insert("psf_rows".into(), json!(row_order(options)));
    let fetch = match options.without_psf {
        true => Box::new(|_| Ok(Windows::default())) as Fetch,
        false => fetch(&mut arrays, options, (bands, heights), chosen)?,
    };
    let given = Given {
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
        bands: given,
        source,
        notes: vec!["the archive tells no object distance: infinity was taken".into()],
    };
    Imported::new(given, options, fetch)
}

fn fetch(
    arrays: &mut Arrays<'_>,
    options: &ImportOptions,
    (bands, heights): (usize, usize),
    chosen: Vec<usize>,
) -> Result<Fetch, ImportError> {
    let path = arrays.path.to_path_buf();
    let pitch = arrays.scalar(&["psf_pitch_um", "pixel_um"])?;
    let pitch = pitch.ok_or_else(|| ImportError::file(&path, "has no array `psf_pitch_um` or `pixel_um`"))?;
    let layout = options.layout(options.told_outward(&path)?);
    let psf = arrays.found.remove("psf").ok_or_else(|| ImportError::file(&path, "has no array `psf`"))?;
    let side = match psf.shape[..] {
        [b, k, n, m] if (b, k) == (bands, heights) && n == m && (1..=WIDEST).contains(&n) => n,
        _ => {
            let shape = &psf.shape;
            return Err(ImportError::file(
                &path,
                format!("array `psf` has shape {shape:?}, expected [{bands}, {heights}, n, n]"),
            ));
        }
    };
    Ok(Box::new(move |b| {
        let mut windows = Windows::default();
        for k in 0..heights {
            let samples = psf.values[(chosen[b] * heights + k) * side * side..][..side * side].to_vec();
            if let Some(i) = samples.iter().position(|v| !v.is_finite()) {
                let (value, r, c) = (samples[i], i / side, i % side);
                let at =
                    format!("array `psf` has {value} at band {}, height {k}, row {r}, column {c}", chosen[b]);
                return Err(ImportError::file(&path, at));
            }
            windows.push(
                &path,
                Window { rows: side, columns: side, samples, centre: None },
                pitch,
                layout,
            )?;
        }
        Ok(windows)
    }))
}
