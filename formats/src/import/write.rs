//! Common last step of all formats: tables made dense, windows read band by band, the pack written.

use super::dense::{Parity, Spline, equidistant};
use super::error::ImportError;
use super::options::{ImportOptions, MAX_COUNT};
use super::window::{Layout, RowOrder, Window};
use crate::lens::{LensPackWriter, PackAttributes};
use pipeline::bounds;
use pipeline::lens::cone::ConeTable;
use pipeline::lens::cone_field::ConeField;
use pipeline::lens::{Lens, LensBand, PsfSample, PsfStack};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// Tables of one wavelength at the field points of the source.
#[derive(Clone, Debug, Default)]
pub(super) struct SparseBand {
    pub wavelength_nm: f64,
    /// Ideal heights and real image heights of the field points, mm.
    pub distortion: (Vec<f64>, Vec<f64>),
    /// Ideal heights (mm) and RI of the field points.
    pub illumination: (Vec<f64>, Vec<f64>),
    /// Real image height of every PSF, mm.
    pub psf_height_mm: Vec<f64>,
    /// Share of all the light in every window; empty: unknown.
    pub psf_energy: Vec<f64>,
    /// Chief-ray angle in air at every field point, degrees; empty: unknown.
    pub cra_deg: Vec<f64>,
}

/// A lens as read from its source, without the PSF windows.
pub(super) struct SparseLens {
    pub path: PathBuf,
    pub name: String,
    pub distortion_focal_length_mm: f64,
    pub effective_focal_length_mm: f64,
    pub f_number: f64,
    pub solid_angle_sr: Option<f64>,
    pub primary_wavelength_nm: f64,
    pub object_distance_mm: Option<f64>,
    pub magnification: f64,
    pub sample: PsfSample,
    pub bands: Vec<SparseBand>,
    /// The pack's attribute `source`, a JSON object.
    pub source: Value,
    pub notes: Vec<String>,
}

/// Reads the windows of a band.
pub(super) type ReadWindows = Box<dyn FnMut(usize) -> Result<Windows, ImportError>>;

/// The windows of one band, all of equal size and pitch.
#[derive(Default)]
pub(super) struct Windows {
    size: usize,
    pitch_um: f64,
    samples: Vec<f32>,
}

impl Windows {
    /// Appends a window of `path`.
    pub fn push(
        &mut self,
        path: &Path,
        window: Window,
        pitch_um: f64,
        layout: Layout,
    ) -> Result<(), ImportError> {
        let window =
            window.normalised(layout).map_err(|e| ImportError::file(path, format!("the window {e}")))?;
        let bad = |problem: String| Err(ImportError::file(path, problem));
        if let Err(e) = bounds::PITCH_UM.check(pitch_um).and(bounds::PSF_SIDE.check_count(window.size)) {
            return bad(format!("the window is out of bounds: {e}"));
        }
        if self.samples.is_empty() {
            (self.size, self.pitch_um) = (window.size, pitch_um);
        }
        if window.size != self.size {
            return bad(format!("a window of {} samples, the ones before have {}", window.size, self.size));
        }
        if (pitch_um / self.pitch_um - 1.0).abs() > 1e-6 {
            return bad(format!("a pitch of {pitch_um} µm, the ones before have {}", self.pitch_um));
        }
        self.samples.extend(window.samples);
        Ok(())
    }
}

/// An export that was read and checked; [`write()`] reads its windows.
pub struct Imported {
    lens: Lens,
    source: Value,
    notes: Vec<String>,
    path: PathBuf,
    read_windows: ReadWindows,
}

impl Imported {
    /// Assumptions and observations, one sentence each.
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    /// The dense tables; window sizes and pitches are set when the pack is written.
    pub fn lens(&self) -> &Lens {
        &self.lens
    }

    /// Reads the windows of band `b`.
    ///
    /// # Errors
    /// [`ImportError`]: a file cannot be read, or its content is invalid.
    pub fn psf(&mut self, b: usize) -> Result<PsfStack, ImportError> {
        let windows = (self.read_windows)(b)?;
        let (size, samples) = (windows.size, windows.samples);
        let stack = PsfStack { size, pitch_um: windows.pitch_um, sample: self.lens.psf_sample, samples };
        let (found, expected) = (stack.samples.len(), self.lens.bands[b].psf_height_mm.len() * size * size);
        if size == 0 || found != expected {
            let problem = format!("{found} samples of windows, expected {expected}");
            return Err(ImportError::file(&self.path, problem));
        }
        Ok(stack)
    }

    pub(super) fn new(
        mut given: SparseLens,
        options: &ImportOptions,
        read_windows: ReadWindows,
    ) -> Result<Self, ImportError> {
        let numbers = bounds::FIELD_POINTS
            .check_count(options.field_points)
            .and_then(|n| bounds::TABLE_NUMBERS.check_product(&[n, given.bands.len().max(1)]));
        if let Err(e) = numbers {
            return Err(ImportError::Option { option: "field points", problem: e.to_string() });
        }
        let read_windows: ReadWindows = match options.without_psf {
            true => {
                given.sample = PsfSample::Integrated;
                let note = "the pack has an ideal point instead of PSFs: use it for RI and distortion only";
                given.notes.push(note.into());
                Box::new(|_| Ok(Windows { size: 1, pitch_um: 1.0, samples: vec![1.0; 2] }))
            }
            false => read_windows,
        };
        let n = given.f_number;
        let solid_angle_sr = given.solid_angle_sr.unwrap_or(std::f64::consts::PI / (4.0 * n * n));
        let mut bands = Vec::new();
        let mut worst: f64 = 0.0;
        for band in &mut given.bands {
            if options.without_psf {
                let last = band.distortion.1.last().copied().unwrap_or(0.0);
                (band.psf_height_mm, band.psf_energy) = (vec![0.0, last], Vec::new());
            }
            let (dense, error) = dense_tables(band, solid_angle_sr, &given.path, options)?;
            worst = worst.max(error);
            dense.check().map_err(|source| ImportError::Table { path: given.path.clone(), source })?;
            bands.push(dense);
        }
        for (dense, band) in bands.iter_mut().zip(&given.bands) {
            dense.cones = cones(band, &given)?;
        }
        if bands.is_empty() || bands.len() > MAX_COUNT {
            let problem = format!("has {} wavelengths, expected 1 to {MAX_COUNT}", bands.len());
            return Err(ImportError::file(&given.path, problem));
        }
        if !options.without_psf && given.bands.iter().all(|b| b.psf_energy.is_empty()) {
            let note = "the share of light outside the windows is unknown: psf_energy 1 is assumed";
            given.notes.push(note.into());
        }
        let mut source = given.source;
        source["psf_rows"] = match options.rows {
            RowOrder::Top => json!("top first"),
            RowOrder::Bottom => json!("bottom first"),
        };
        source["dense_tables"] = json!({"field_points": options.field_points, "linear_error_mm": worst});
        source["given_points"] = given.bands.iter().map(given_points).collect();
        let lens = Lens {
            name: options.name.clone().unwrap_or(given.name),
            distortion_focal_length_mm: given.distortion_focal_length_mm,
            effective_focal_length_mm: given.effective_focal_length_mm,
            f_number: given.f_number,
            primary_wavelength_nm: given.primary_wavelength_nm,
            object_distance_mm: given.object_distance_mm,
            magnification: given.magnification,
            psf_sample: given.sample,
            bands,
            depth: None,
        };
        lens.check_head().map_err(|(name, e)| ImportError::file(&given.path, format!("`{name}`: {e}")))?;
        Ok(Self { lens, source, notes: given.notes, path: given.path, read_windows })
    }
}

/// Writes the pack to `out`, a folder or a .zip; `done` is called after every band.
///
/// # Errors
/// [`ImportError`]: a window is unreadable or invalid, or the pack cannot be written. No partial pack is left.
pub fn write(
    out: &Path,
    mut imported: Imported,
    mut done: impl FnMut(usize, &PsfStack),
) -> Result<(), ImportError> {
    let mut writer = LensPackWriter::create(out)?;
    for b in 0..imported.lens.bands.len() {
        let stack = imported.psf(b)?;
        let band = &mut imported.lens.bands[b];
        (band.psf_size, band.psf_pitch_um) = (stack.size, stack.pitch_um);
        writer.psf(b, &stack)?;
        done(b, &stack);
    }
    let attributes = PackAttributes {
        frame: Some("field point on +x, row down; heights real unless named ideal; mm".into()),
        source: Some(imported.source),
        ..PackAttributes::default()
    };
    Ok(writer.finish(&imported.lens, &attributes)?)
}

/// The points of the source, for the pack's attribute `source`.
fn given_points(band: &SparseBand) -> Value {
    let mut points = json!({
        "wavelength_nm": band.wavelength_nm,
        "ideal_height_mm": band.distortion.0,
        "image_height_mm": band.distortion.1,
        "illumination_ideal_height_mm": band.illumination.0,
        "relative_illumination": band.illumination.1,
    });
    if !band.cra_deg.is_empty() {
        points["cra_deg"] = json!(band.cra_deg);
    }
    points
}

/// The cones of the chief-ray angles of a band, if it has them: behind a round exit pupil of the F-number of the light at the film, N (1 + |m|) for pupils of the same size.
fn cones(band: &SparseBand, lens: &SparseLens) -> Result<Option<ConeField>, ImportError> {
    let heights = &band.distortion.1;
    if band.cra_deg.is_empty() {
        return Ok(None);
    }
    let bad = |problem: String| {
        Err(ImportError::file(
            &lens.path,
            format!("at {} nm chief-ray angles: {problem}", band.wavelength_nm),
        ))
    };
    let last_mm = heights[heights.len() - 1];
    if let Err(e) = bounds::HEIGHT_MM.check(last_mm) {
        return bad(e.to_string());
    }
    if band.cra_deg[0] != 0.0 {
        return bad(format!("{} degrees on the axis, expected 0", band.cra_deg[0]));
    }
    let f_number = lens.f_number * (1.0 + lens.magnification.abs());
    let angle = Spline::mirrored(heights, &band.cra_deg, Parity::Odd);
    let table = ConeTable::of_chief_rays(last_mm, |height_mm| (angle.at(height_mm), f_number));
    match ConeTable::from_directions(table.step_mm(), &table.directions().collect::<Vec<_>>()) {
        Ok(table) => Ok(Some(ConeField::Symmetric(table))),
        Err(problem) => bad(problem),
    }
}

/// Dense tables, and the maximum difference of linear interpolation between their points from the spline, mm.
fn dense_tables(
    band: &mut SparseBand,
    solid_angle_sr: f64,
    path: &Path,
    options: &ImportOptions,
) -> Result<(LensBand, f64), ImportError> {
    let nm = band.wavelength_nm;
    let bad = |problem: String| ImportError::file(path, format!("at {nm} nm {problem}"));
    for (what, (ideal, values)) in [("image heights", &band.distortion), ("RI values", &band.illumination)] {
        if ideal.len() < 2 || ideal.len() != values.len() || ideal.len() > MAX_COUNT * MAX_COUNT {
            let (m, n) = (ideal.len(), values.len());
            return Err(bad(format!("there are {n} {what} for {m} field points, expected at least 2")));
        }
        if ideal[0] != 0.0
            || ideal.windows(2).any(|w| w[1] <= w[0])
            || values.iter().chain(ideal).any(|v| !v.is_finite())
        {
            return Err(bad(
                "the field points do not ascend from 0 in ideal height, or one is not finite".into()
            ));
        }
    }
    // Programs may write rounding errors for 0 on the axis.
    for height in [&mut band.distortion.1[0], band.psf_height_mm.first_mut().unwrap_or(&mut 0.0)] {
        if height.abs() < 1e-9 {
            *height = 0.0;
        }
    }
    let (xs, heights) = &band.distortion;
    let (ri_xs, ri) = &band.illumination;
    if (ri[0] - 1.0).abs() > 1e-3 {
        return Err(bad(format!("RI on the axis is {}, expected 1: it is relative to the axis", ri[0])));
    }
    let max_height = xs[xs.len() - 1].min(ri_xs[ri_xs.len() - 1]);
    let at = equidistant(max_height, options.field_points);
    let spline = Spline::mirrored(xs, heights, Parity::Odd);
    let even = Spline::mirrored(ri_xs, ri, Parity::Even);
    let mut image: Vec<f64> = at.iter().map(|&x| spline.at(x)).collect();
    // Where the listed values end at 0, the spline is 0 but for rounding, or below; negative listed values are refused with the lens.
    let least = if ri.iter().all(|v| *v >= 0.0) { 0.0 } else { f64::NEG_INFINITY };
    let mut illumination: Vec<f64> = at.iter().map(|&x| even.at(x).max(least)).collect();
    (image[0], illumination[0]) = (heights[0], ri[0]);
    let error = at
        .windows(2)
        .zip(image.windows(2))
        .map(|(x, y)| (spline.at((x[0] + x[1]) / 2.0) - (y[0] + y[1]) / 2.0).abs());
    let error = error.fold(0.0, f64::max);
    let k = band.psf_height_mm.len();
    let energy = if band.psf_energy.is_empty() { vec![1.0; k] } else { band.psf_energy.clone() };
    let dense = LensBand {
        wavelength_nm: nm,
        ideal_height_mm: at,
        image_height_mm: image,
        relative_illumination: illumination,
        psf_height_mm: band.psf_height_mm.clone(),
        azimuth_count: (0..k).map(|i| if i == 0 { 1 } else { options.azimuths }).collect(),
        psf_size: 1,
        psf_pitch_um: 1.0,
        kernel_pitch_um: None,
        psf_energy: energy,
        solid_angle_sr,
        transmission: 1.0,
        tail: None,
        cones: None,
        planar: None,
    };
    Ok((dense, error))
}
