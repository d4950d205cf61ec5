//! Lens packs from measured PSF fields, and from those of other programs, described by a TOML file.
//!
//! ```toml
//! name = "unit 17"
//! wavelengths_nm = [450, 550, 650]            # ascending
//! distortion_focal_length_mm = 35.0           # not with `brown`
//! # effective_focal_length_mm, f_number, primary_wavelength_nm; object_distance_mm with magnification
//! [psf]
//! files = "psf-{band}.npy"                    # band from 0; or a list, one a band; or one file of all bands
//! x_mm = [-12, -6, 0, 6, 12]                  # or the name of an array file
//! y_mm = [-8, -4, 0, 4, 8]
//! pitch_um = 1.0
//! sample = "point"                            # or "integrated"
//! y_up = false                                # true: y_mm and the rows of windows ascend upwards
//! centre = "keep"                             # or "centroid", "peak"
//! [map]
//! ideal_x = "ix.npy"                          # mm; or displacement_x_px (film − ideal) with pitch_um,
//! ideal_y = "iy.npy"                          # or brown = { f_px, c_px, k, p } with size_px and pitch_um
//! x_mm = [-14, -7, 0, 7, 14]
//! y_mm = [-10, -5, 0, 5, 10]
//! [shading]
//! relative_illumination = "flat.npy"          # at the nodes of the map, or at x_mm and y_mm of its own
//! normalise = "centre"                        # or "largest"
//! ```
//! | array | shape |
//! |---|---|
//! | PSFs of a band | (Ny, Nx, n, n), or (Ny·Nx, n, n) with x fastest; of all bands with one axis B before |
//! | map, shading | (My, Mx) for all bands, or (B, My, Mx) |
//!
//! Files lie in the folder of the description or below: `NAME.npy` (f4, f8), `NAME.npz:ARRAY`, `NAME.fits:IMAGE` (images
//! counted from 0).
//!
//! *Frame*: film coordinates X right, Y DOWN, mm from the film's centre, REAL places. Row and column j, i of an array are
//! `y_mm[j]`, `x_mm[i]`, which may descend. With `y_up` y is −Y, and row 0 of a window is its lowest one; in `[map]`
//! `ideal_y` and `displacement_y_px` change their sign.
//! *Reference point*: the middle sample of each window is the film point that the map gives. `centre` moves windows only, so
//! with "centroid" the map must be of centroids, with "peak" of peaks.
//! *Defaults*: the primary wavelength is that of the middle band, the effective focal length the distortion focal length.
//! Each with a note: F-number 1; without `[map]` no distortion, over the places of the PSFs and one step beyond; without
//! `[shading]` R = 1.
//!
//! | module | content |
//! |---|---|
//! | `description`, `map_table` | the meaning of the TOML text |
//! | `arrays`, `fits` | array files |
//! | `axis` | columns and rows: uniform, in the film frame |
//! | `windows`, `centre` | PSF windows |
//! | `map`, `brown`, `shading` | tables over the film |

mod arrays;
mod axis;
mod brown;
mod centre;
mod description;
mod fits;
mod map;
mod map_table;
mod shading;
mod windows;

use super::{ImportError, text};
use crate::lens::{LensPackWriter, PackAttributes, ReferencePoint};
use arrays::Loader;
use description::{Centre, Description};
use map_table::MapTable;
use pipeline::lens::planar::PlanarBand;
use pipeline::lens::{Lens, LensBand, PsfStack};
use serde_json::json;
use std::f64::consts::PI;
use std::path::{Path, PathBuf};
use windows::Windows;

/// F-number of a description without one.
const ASSUMED_F_NUMBER: f64 = 1.0;

/// A field that was read and checked; [`write()`] reads its windows.
pub struct ImportedField {
    path: PathBuf,
    lens: Lens,
    windows: Windows,
    loader: Loader,
    map_source: &'static str,
    has_shading: bool,
    notes: Vec<String>,
}

/// Whether `path` is a description by its name.
pub fn is_description(path: &Path) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case("toml"))
}

/// Reads the description `path` with its maps, and the sizes of its windows.
///
/// # Errors
/// [`ImportError`]: the line of the description, or the array file with place, found and expected values.
pub fn open(path: &Path) -> Result<ImportedField, ImportError> {
    let description = Description::parse(path, &text::read(path)?)?;
    let mut loader = Loader::default();
    let windows = Windows::new(path, &description, &mut loader)?;
    let maps = map::maps(path, &description, &windows, &mut loader)?;
    let mut notes = notes(&description);
    notes.extend(maps.notes);
    let f_number = description.f_number.unwrap_or(ASSUMED_F_NUMBER);
    let focal = description.distortion_focal_length_mm;
    let nm = &description.wavelengths_nm;
    let places = windows.places();
    let band = |(b, map): (usize, _)| LensBand {
        wavelength_nm: nm[b],
        ideal_height_mm: Vec::new(),
        image_height_mm: Vec::new(),
        relative_illumination: Vec::new(),
        psf_height_mm: Vec::new(),
        azimuth_count: Vec::new(),
        psf_size: windows.side(b),
        psf_pitch_um: description.psf.pitch_um,
        kernel_pitch_um: None,
        psf_energy: vec![1.0; places.count()],
        solid_angle_sr: PI / (4.0 * f_number * f_number),
        transmission: 1.0,
        tail: None,
        cones: None,
        planar: Some(PlanarBand { map, psfs: places.clone() }),
    };
    let lens = Lens {
        name: description.name.clone(),
        distortion_focal_length_mm: focal,
        effective_focal_length_mm: description.effective_focal_length_mm.unwrap_or(focal),
        f_number,
        primary_wavelength_nm: description.primary_wavelength_nm.unwrap_or(nm[nm.len() / 2]),
        object_distance_mm: description.object_distance_mm,
        magnification: description.magnification,
        psf_sample: description.psf.sample,
        bands: maps.maps.into_iter().enumerate().map(band).collect(),
        depth: None,
    };
    lens.check_head().map_err(|(name, e)| ImportError::file(path, format!("`{name}`: {e}")))?;
    for band in &lens.bands {
        band.check().map_err(|source| ImportError::Table { path: path.into(), source })?;
    }
    Ok(ImportedField {
        path: path.into(),
        lens,
        windows,
        loader,
        map_source: description.map.name(),
        has_shading: description.shading.is_some(),
        notes,
    })
}

/// Notes on what the description leaves out.
fn notes(description: &Description) -> Vec<String> {
    let mut notes = Vec::new();
    if matches!(description.map, MapTable::Identity) {
        notes.push("no [map]: the image is taken as free of distortion".to_owned());
    }
    if description.shading.is_none() {
        notes.push("no [shading]: a relative illumination of 1 is assumed".to_owned());
    }
    if description.f_number.is_none() {
        notes.push(format!(
            "no f_number: {ASSUMED_F_NUMBER} is assumed, on which films in physical units depend"
        ));
    }
    notes.push("the share of light outside the windows is unknown: psf_energy 1 is assumed".to_owned());
    match description.psf.centre {
        Centre::Keep => {}
        Centre::Centroid => {
            notes.push("PSFs are centred on their centroids: the map must be of centroids".to_owned())
        }
        Centre::Peak => notes
            .push("PSFs are centred on their largest samples: the map must be of these points".to_owned()),
    }
    notes
}

impl ImportedField {
    /// The tables of the lens.
    pub fn lens(&self) -> &Lens {
        &self.lens
    }

    /// Assumptions and observations, one sentence each.
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    /// Gives the lens another name.
    pub fn rename(&mut self, name: &str) {
        name.clone_into(&mut self.lens.name);
    }

    /// Reads the windows of band `b`, rows (j, i) of the film's grid, and counts their negative samples.
    ///
    /// # Errors
    /// [`ImportError`]: a window that is not finite, or whose sum is not positive.
    pub fn psf(&mut self, b: usize) -> Result<(PsfStack, usize), ImportError> {
        self.windows.read(b, &mut self.loader)
    }
}

/// Writes the pack to `out`, a folder or a .zip; `done` is called after every band.
///
/// # Errors
/// [`ImportError`]: a window is invalid, or the pack cannot be written. No partial pack is left.
pub fn write(
    out: &Path,
    mut field: ImportedField,
    mut done: impl FnMut(usize, &PsfStack),
) -> Result<(), ImportError> {
    let mut writer = LensPackWriter::create_planar(out)?;
    let mut negative = Vec::new();
    for b in 0..field.lens.bands.len() {
        let (stack, count) = field.psf(b)?;
        negative.push(count);
        writer.psf(b, &stack)?;
        done(b, &stack);
    }
    let centre = field.windows.centre();
    let source = json!({
        "format": "measured field",
        "description": field.path.file_name().map(|name| name.to_string_lossy()),
        "psf_centre": centre.name(),
        "psf_y_up": field.windows.y_up(),
        "negative_samples": negative,
        "map": field.map_source,
        "shading": field.has_shading,
    });
    let attributes = PackAttributes {
        frame: Some(
            "film frame: X right, Y down, mm, REAL places unless named ideal; windows not turned, row down"
                .into(),
        ),
        source: Some(source),
        reference_point: Some(match centre {
            Centre::Centroid => ReferencePoint::Centroid,
            Centre::Keep | Centre::Peak => ReferencePoint::AsGiven,
        }),
        ..PackAttributes::default()
    };
    Ok(writer.finish(&field.lens, &attributes)?)
}
