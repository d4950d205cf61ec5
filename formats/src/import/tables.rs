//! A folder of CSV tables and NPY windows, for export from any other program.
//!
//! Files:
//! ```text
//! lens.csv      key,value
//!               name,My lens                      distortion_focal_length_mm,99.332063
//!               effective_focal_length_mm,99.50   f_number,2.985
//!               primary_wavelength_nm,587.5618    object_distance_mm,infinity     magnification,0
//!               psf_sample,point|integrated       psf_outward,right|left|up|down
//!               even_window,pad|crop|shift        psf_rows,top|bottom             (these two only if needed)
//! heights.csv   wavelength_nm,ideal_height_mm,image_height_mm,relative_illumination[,cra_deg]
//! psf.csv       wavelength_nm,image_height_mm,psf_pitch_um,psf_energy,file,index
//! *.npy         f4 or f8, C order: (windows, rows, columns), or (rows, columns) with index 0
//! ```
//! Rows of a wavelength ascend in height from 0; wavelengths ascend. `psf_energy` is the share of ALL the light that the window
//! holds. `psf_outward` is the side of a window, drawn with its top row on top, that points away from the optical axis.
//! `cra_deg`, optional: angle of the chief ray in air in front of the film, positive away from the axis, 0 on it, for sensors
//! whose response depends on it; the exit pupil is taken to be round, of the F-number N (1 + |m|).
//! `#` starts a comment. A worked example lies in `formats/data/tables-example`.

use super::csv::Csv;
use super::npy;
use super::window::{EvenWindow, Outward, RowOrder, Window};
use super::write::{Imported, ReadWindows, SparseBand, SparseLens, Windows};
use super::{ImportError, ImportOptions, MAX_SIDE, text};
use pipeline::bounds::{self, Bound};
use pipeline::lens::PsfSample;
use serde_json::json;
use std::path::{Path, PathBuf};

/// The file by which the format is recognised.
pub(super) const LENS_FILE: &str = "lens.csv";
/// The column of chief-ray angles, and the largest one, degrees.
const CRA: &str = "cra_deg";
const MAX_CRA_DEG: f64 = 85.0;

/// Reads a folder.
///
/// # Errors
/// [`ImportError`].
pub fn open(folder: &Path, options: &ImportOptions) -> Result<Imported, ImportError> {
    let lens = Keys(Csv::read(&folder.join(LENS_FILE))?);
    let path = lens.0.path.clone();
    for (k, (line, row)) in lens.0.rows.iter().enumerate() {
        if lens.0.rows[..k].iter().any(|(_, earlier)| earlier[0] == row[0]) {
            let problem = format!("`{}` is given twice", row[0].chars().take(40).collect::<String>());
            return Err(ImportError::line(&path, *line, problem));
        }
    }
    let mut options = options.clone();
    options.sample =
        options.sample.or(
            lens.choice("psf_sample", &[("point", PsfSample::Point), ("integrated", PsfSample::Integrated)])?
        );
    let sides =
        [("right", Outward::Right), ("left", Outward::Left), ("up", Outward::Up), ("down", Outward::Down)];
    options.outward = options.outward.or(lens.choice("psf_outward", &sides)?);
    let even = [("pad", EvenWindow::Pad), ("crop", EvenWindow::Crop), ("shift", EvenWindow::Shift)];
    options.even_window = options.even_window.or(lens.choice("even_window", &even)?);
    if let Some(rows) = lens.choice("psf_rows", &[("top", RowOrder::Top), ("bottom", RowOrder::Bottom)])? {
        options.rows = rows;
    }
    let sample = options.required_sample(&path)?;
    let efl = options.focal_length(&path, lens.number("effective_focal_length_mm")?)?;
    let focal = options.distortion_focal(&path, lens.number("distortion_focal_length_mm")?)?;
    let primary = options.primary_nm(&path, lens.number("primary_wavelength_nm")?)?;
    let (f_number, solid_angle_sr) = options.aperture(&path, efl, lens.number("f_number")?)?;
    let object = match lens.get("object_distance_mm") {
        Some((_, text)) if ["infinity", "inf"].contains(&text.to_ascii_lowercase().as_str()) => None,
        Some(_) => lens.bounded("object_distance_mm", bounds::GIVEN_DISTANCE_MM)?,
        None => {
            return Err(ImportError::file(&path, "has no key `object_distance_mm` (a number, or infinity)"));
        }
    };
    let magnification = match object {
        None => 0.0,
        Some(_) => {
            lens.bounded("magnification", bounds::MAGNIFICATION)?.filter(|m| *m != 0.0).ok_or_else(|| {
                ImportError::file(
                    &path,
                    "has no key `magnification`, or one of 0: it is required for a finite object distance",
                )
            })?
        }
    };
    let mut bands = read_heights(&folder.join("heights.csv"))?;
    let files = match options.without_psf {
        true => Vec::new(),
        false => read_psf_table(folder, &mut bands)?,
    };
    let selected = options.selected_bands(bands.len())?;
    let bands: Vec<SparseBand> = selected.iter().map(|&b| bands[b].clone()).collect();
    let files: Vec<_> = selected.iter().filter_map(|&b| files.get(b).cloned()).collect();
    let program = lens.get("program").map(|(_, text)| text);
    let sparse_lens = SparseLens {
        path: folder.into(),
        name: lens.get("name").map_or("lens".into(), |(_, w)| w.to_string()),
        distortion_focal_length_mm: focal,
        effective_focal_length_mm: efl,
        f_number,
        solid_angle_sr,
        primary_wavelength_nm: primary,
        object_distance_mm: object,
        magnification,
        sample,
        bands,
        source: json!({ "format": "CSV tables and NPY windows", "program": program }),
        notes: Vec::new(),
    };
    if !options.without_psf {
        options.required_outward(&path)?;
    }
    let read_windows = window_reader(files, options.clone());
    Imported::new(sparse_lens, &options, read_windows)
}

/// A CSV with one key and value per row.
struct Keys(Csv);

impl Keys {
    fn get(&self, key: &str) -> Option<(usize, &str)> {
        self.0
            .rows
            .iter()
            .find(|(_, row)| row.first().is_some_and(|k| k == key))
            .map(|(line, row)| (*line, row.get(1).map_or("", String::as_str)))
    }

    fn number(&self, key: &str) -> Result<Option<f64>, ImportError> {
        let Some((line, text)) = self.get(key) else { return Ok(None) };
        let bad = || ImportError::line(&self.0.path, line, format!("{key} is `{text}`, not a finite number"));
        text::number(text).map(Some).ok_or_else(bad)
    }

    fn bounded(&self, key: &str, bound: Bound) -> Result<Option<f64>, ImportError> {
        let (Some((line, _)), Some(value)) = (self.get(key), self.number(key)?) else { return Ok(None) };
        bound.check(value).map(Some).map_err(|e| ImportError::line(&self.0.path, line, e.to_string()))
    }

    fn choice<T: Copy>(&self, key: &str, known: &[(&str, T)]) -> Result<Option<T>, ImportError> {
        let Some((line, text)) = self.get(key) else { return Ok(None) };
        match known.iter().find(|(name, _)| *name == text) {
            Some((_, value)) => Ok(Some(*value)),
            None => {
                let names: Vec<&str> = known.iter().map(|(name, _)| *name).collect();
                let problem = format!("{key} is `{text}`, expected {}", names.join(" or "));
                Err(ImportError::line(&self.0.path, line, problem))
            }
        }
    }
}

/// Whether row `r` starts a new wavelength. Wavelengths must ascend, and the heights of each from 0.
fn starts_band(
    csv: &Csv,
    r: usize,
    bands: &[f64],
    nm: f64,
    last: Option<f64>,
    height_mm: f64,
) -> Result<bool, ImportError> {
    let line = csv.rows[r].0;
    let bad = |problem: String| Err(ImportError::line(&csv.path, line, problem));
    match bands.last() {
        Some(&now) if now == nm => match last {
            Some(last) if height_mm > last => Ok(false),
            last => bad(format!("height {height_mm} mm does not ascend from {} mm", last.unwrap_or(0.0))),
        },
        Some(&now) if nm < now => bad(format!("wavelength {nm} nm does not ascend from {now} nm")),
        _ if height_mm != 0.0 => bad(format!("the first height at {nm} nm is {height_mm} mm, expected 0")),
        _ => Ok(true),
    }
}

fn read_heights(path: &Path) -> Result<Vec<SparseBand>, ImportError> {
    let csv = Csv::read(path)?;
    let [nm, ideal, image, ri] =
        ["wavelength_nm", "ideal_height_mm", "image_height_mm", "relative_illumination"]
            .map(|c| csv.column(c));
    let (nm, ideal, image, ri) = (nm?, ideal?, image?, ri?);
    let cra = csv.optional_column(CRA);
    let (mut bands, mut waves): (Vec<SparseBand>, Vec<f64>) = (Vec::new(), Vec::new());
    for r in 0..csv.rows.len() {
        let [nm, ideal, image, ri] = [nm, ideal, image, ri].map(|c| csv.number(r, c));
        let (nm, ideal, image, ri) = (nm?, ideal?, image?, ri?);
        let last =
            |column: fn(&SparseBand) -> &Vec<f64>| bands.last().and_then(|b| column(b).last().copied());
        let start = starts_band(&csv, r, &waves, nm, last(|b| &b.distortion.0), ideal)?;
        starts_band(&csv, r, &waves, nm, last(|b| &b.distortion.1), image)?;
        if start {
            waves.push(nm);
            bands.push(SparseBand { wavelength_nm: nm, ..SparseBand::default() });
        }
        if let Some(band) = bands.last_mut() {
            band.distortion.0.push(ideal);
            band.distortion.1.push(image);
            band.illumination.0.push(ideal);
            band.illumination.1.push(ri);
            if let Some(cra) = cra {
                band.cra_deg.push(chief_ray_angle(&csv, r, cra)?);
            }
        }
    }
    Ok(bands)
}

/// The chief-ray angle in row `r`, degrees.
fn chief_ray_angle(csv: &Csv, r: usize, column: usize) -> Result<f64, ImportError> {
    let degrees = csv.number(r, column)?;
    match degrees.abs() <= MAX_CRA_DEG {
        true => Ok(degrees),
        false => {
            let problem = format!("{CRA} is {degrees}, expected -{MAX_CRA_DEG} to {MAX_CRA_DEG}");
            Err(ImportError::line(&csv.path, csv.rows[r].0, problem))
        }
    }
}

/// One window: file, index in its array, sample pitch.
#[derive(Clone)]
struct WindowEntry {
    path: PathBuf,
    index: usize,
    pitch_um: f64,
}

/// The windows of every band; heights and energies are added to `bands`.
fn read_psf_table(folder: &Path, bands: &mut [SparseBand]) -> Result<Vec<Vec<WindowEntry>>, ImportError> {
    let csv = Csv::read(&folder.join("psf.csv"))?;
    let columns =
        ["wavelength_nm", "image_height_mm", "psf_pitch_um", "psf_energy", "index"].map(|c| csv.column(c));
    let [nm, height, pitch, energy, index] = columns;
    let (nm, height, pitch, energy, index, file) =
        (nm?, height?, pitch?, energy?, index?, csv.column("file")?);
    let mut files: Vec<Vec<WindowEntry>> = vec![Vec::new(); bands.len()];
    let mut waves = Vec::new();
    for r in 0..csv.rows.len() {
        let (line, row) = &csv.rows[r];
        let bad = |problem: String| ImportError::line(&csv.path, *line, problem);
        let (wave, height) = (csv.number(r, nm)?, csv.number(r, height)?);
        let Some(b) = bands.iter().position(|b| b.wavelength_nm == wave) else {
            return Err(bad(format!("{wave} nm is not a wavelength of heights.csv")));
        };
        if starts_band(&csv, r, &waves, wave, bands[b].psf_height_mm.last().copied(), height)? {
            waves.push(wave);
        }
        let name = row[file].as_str();
        if name.is_empty() || name.contains(['/', '\\', '\0']) || name.starts_with('.') {
            return Err(bad("file must be a plain file name in this folder".into()));
        }
        let at = csv.number(r, index)?;
        if at.fract() != 0.0 || !(0.0..=MAX_SIDE as f64).contains(&at) {
            return Err(bad(format!("index is {at}, expected a whole number from 0")));
        }
        bands[b].psf_height_mm.push(height);
        bands[b].psf_energy.push(csv.number(r, energy)?);
        files[b].push(WindowEntry {
            path: folder.join(name),
            index: at as usize,
            pitch_um: csv.number(r, pitch)?,
        });
    }
    match bands.iter().find(|b| b.psf_height_mm.len() < 2) {
        Some(b) => Err(ImportError::file(
            &csv.path,
            format!("has {} windows at {} nm, expected at least 2", b.psf_height_mm.len(), b.wavelength_nm),
        )),
        None => Ok(files),
    }
}

fn window_reader(files: Vec<Vec<WindowEntry>>, options: ImportOptions) -> ReadWindows {
    Box::new(move |b| {
        let mut windows = Windows::default();
        let mut open: Option<(&Path, npy::Npy)> = None;
        for entry in &files[b] {
            let path = entry.path.as_path();
            let layout = options.layout(options.required_outward(path)?);
            if open.as_ref().is_none_or(|(name, _)| *name != path) {
                let array = npy::parse(&text::read_bytes(path)?).map_err(|e| ImportError::file(path, e))?;
                open = Some((path, array));
            }
            let Some((_, array)) = &open else { continue };
            let window = window(array, entry.index).map_err(|e| ImportError::file(path, e))?;
            windows.push(path, window, entry.pitch_um, layout)?;
        }
        Ok(windows)
    })
}

/// Window `index` of an array.
fn window(array: &npy::Npy, index: usize) -> Result<Window, String> {
    let (count, rows, columns) = match array.shape[..] {
        [rows, columns] => (1, rows, columns),
        [count, rows, columns] => (count, rows, columns),
        _ => return Err(format!("has shape {:?}, expected (windows, rows, columns)", array.shape)),
    };
    if index >= count {
        return Err(format!("has {count} windows, psf.csv refers to index {index}"));
    }
    array.window(index, (rows, columns))
}
