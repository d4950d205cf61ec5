//! The last step of every format: given points made dense, windows fetched band by band, the pack written.

use super::dense::{Parity, Spline, steps};
use super::window::{Layout, Outward, RowOrder, Window};
use super::{ImportError, ImportOptions, MOST};
use crate::lens::{LensPackWriter, PackAttributes};
use pipeline::bounds;
use pipeline::lens::{Lens, LensBand, PsfSample, PsfStack};
use serde_json::{Map, Value, json};
use std::path::{Path, PathBuf};

/// One wavelength as given.
#[derive(Clone, Debug, Default)]
pub(super) struct GivenBand {
    pub wavelength_nm: f64,
    /// Ideal heights and real image heights of the field points, mm.
    pub distortion: (Vec<f64>, Vec<f64>),
    /// Ideal heights (mm) and RI of the field points.
    pub illumination: (Vec<f64>, Vec<f64>),
    /// Real image height of every PSF, mm.
    pub psf_height_mm: Vec<f64>,
    /// Share of the light in every window; empty: unknown.
    pub psf_energy: Vec<f64>,
}

/// Everything as given but the windows.
pub(super) struct Given {
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
    pub bands: Vec<GivenBand>,
    pub source: Map<String, Value>,
    pub notes: Vec<String>,
}

/// Fetches the windows of a band: side, pitch in µm, samples.
pub(super) type Fetch = Box<dyn FnMut(usize) -> Result<Windows, ImportError>>;

/// The windows of one band, all of one size and pitch.
#[derive(Default)]
pub(super) struct Windows {
    size: usize,
    pitch_um: f64,
    samples: Vec<f32>,
}

impl Windows {
    /// Appends the window that `path` holds.
    pub fn push(
        &mut self,
        path: &Path,
        window: Window,
        pitch_um: f64,
        layout: Layout,
    ) -> Result<(), ImportError> {
        let ready = window.ready(layout).map_err(|e| ImportError::file(path, format!("the window {e}")))?;
        let bad = |problem: String| Err(ImportError::file(path, problem));
        if let Err(e) = bounds::PITCH_UM.check(pitch_um).and(bounds::PSF_SIDE.check_count(ready.size)) {
            return bad(format!("the window is out of bounds: {e}"));
        }
        if self.samples.is_empty() {
            (self.size, self.pitch_um) = (ready.size, pitch_um);
        }
        if ready.size != self.size {
            return bad(format!("a window of {} samples, the ones before have {}", ready.size, self.size));
        }
        if (pitch_um / self.pitch_um - 1.0).abs() > 1e-6 {
            return bad(format!("a pitch of {pitch_um} µm, the ones before have {}", self.pitch_um));
        }
        self.samples.extend(ready.samples);
        Ok(())
    }
}

/// An export that was read and checked; [`write()`] fetches its windows.
pub struct Imported {
    lens: Lens,
    source: Map<String, Value>,
    notes: Vec<String>,
    path: PathBuf,
    fetch: Fetch,
}

impl Imported {
    /// What was taken for granted, one sentence each.
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    /// The dense tables; window sizes and pitches are known only once the pack is written.
    pub fn lens(&self) -> &Lens {
        &self.lens
    }

    /// Fetches the windows of band `b`.
    ///
    /// # Errors
    /// [`ImportError`]: a file cannot be read, or does not hold what it should.
    pub fn psf(&mut self, b: usize) -> Result<PsfStack, ImportError> {
        let windows = (self.fetch)(b)?;
        let (size, samples) = (windows.size, windows.samples);
        let stack = PsfStack { size, pitch_um: windows.pitch_um, sample: self.lens.psf_sample, samples };
        let (found, expected) = (stack.samples.len(), self.lens.bands[b].psf_height_mm.len() * size * size);
        match size > 0 && found == expected {
            true => Ok(stack),
            false => {
                Err(ImportError::file(&self.path, format!("{found} samples of windows, expected {expected}")))
            }
        }
    }

    pub(super) fn new(mut given: Given, options: &ImportOptions, fetch: Fetch) -> Result<Self, ImportError> {
        let numbers = bounds::FIELD_POINTS
            .check_count(options.field_points)
            .and_then(|n| bounds::TABLE_NUMBERS.check_product(&[n, given.bands.len().max(1)]));
        if let Err(e) = numbers {
            return Err(ImportError::Option { option: "field points", problem: e.to_string() });
        }
        let fetch: Fetch = match options.without_psf {
            true => {
                given.sample = PsfSample::Integrated;
                given.notes.push(
                    "the pack holds no PSFs but an ideal point: use it for RI and distortion only".into(),
                );
                Box::new(|_| Ok(Windows { size: 1, pitch_um: 1.0, samples: vec![1.0; 2] }))
            }
            false => fetch,
        };
        let mut bands = Vec::new();
        let mut worst: f64 = 0.0;
        for band in &mut given.bands {
            if options.without_psf {
                let last = band.distortion.1.last().copied().unwrap_or(0.0);
                (band.psf_height_mm, band.psf_energy) = (vec![0.0, last], Vec::new());
            }
            let (dense, error) = made_dense(band, &given.path, options)?;
            worst = worst.max(error);
            let solid_angle_sr = given.solid_angle_sr;
            let n = given.f_number;
            let solid_angle_sr = solid_angle_sr.unwrap_or(std::f64::consts::PI / (4.0 * n * n));
            let dense = LensBand { solid_angle_sr, ..dense };
            dense.check().map_err(|source| ImportError::Table { path: given.path.clone(), source })?;
            bands.push(dense);
        }
        if bands.is_empty() || bands.len() > MOST {
            return Err(ImportError::file(
                &given.path,
                format!("has {} wavelengths, expected 1 to {MOST}", bands.len()),
            ));
        }
        if !options.without_psf && given.bands.iter().all(|b| b.psf_energy.is_empty()) {
            given
                .notes
                .push("the share of light outside the windows is unknown: psf_energy 1 was taken".into());
        }
        let mut source = given.source;
        source.insert(
            "dense_tables".into(),
            json!({"field_points": options.field_points, "linear_error_mm": worst}),
        );
        source.insert("given_points".into(), given.bands.iter().map(points).collect());
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
        };
        lens.check_head().map_err(|(name, e)| ImportError::file(&given.path, format!("`{name}`: {e}")))?;
        Ok(Self { lens, source, notes: given.notes, path: given.path, fetch })
    }
}

/// Writes the pack to `out`, a folder or a .zip; `done` hears of every band.
///
/// # Errors
/// [`ImportError`]: a window cannot be read or used, or the pack not written. Nothing is left then.
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
        source: Some(Value::Object(imported.source)),
        ..PackAttributes::default()
    };
    Ok(writer.finish(&imported.lens, &attributes)?)
}

/// The points as given, for the record.
fn points(band: &GivenBand) -> Value {
    json!({
        "wavelength_nm": band.wavelength_nm,
        "ideal_height_mm": band.distortion.0,
        "image_height_mm": band.distortion.1,
        "illumination_ideal_height_mm": band.illumination.0,
        "relative_illumination": band.illumination.1,
    })
}

/// Dense tables, and how far linear interpolation between their points is from the spline, mm.
fn made_dense(
    band: &mut GivenBand,
    path: &Path,
    options: &ImportOptions,
) -> Result<(LensBand, f64), ImportError> {
    let nm = band.wavelength_nm;
    let bad = |problem: String| ImportError::file(path, format!("at {nm} nm {problem}"));
    for (what, (ideal, values)) in [("image heights", &band.distortion), ("RI values", &band.illumination)] {
        if ideal.len() < 2 || ideal.len() != values.len() || ideal.len() > MOST * MOST {
            let (m, n) = (ideal.len(), values.len());
            return Err(bad(format!("there are {n} {what} for {m} field points, expected at least 2")));
        }
        if ideal[0] != 0.0
            || ideal.windows(2).any(|w| w[1] <= w[0])
            || values.iter().chain(ideal).any(|v| !v.is_finite())
        {
            return Err(bad(
                "the field points do not ascend from 0 in ideal height, or one is no finite number".into(),
            ));
        }
    }
    // On the axis a program may leave rounding behind.
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
    let reach = xs[xs.len() - 1].min(ri_xs[ri_xs.len() - 1]);
    let at = steps(reach, options.field_points);
    let spline = Spline::mirrored(xs, heights, Parity::Odd);
    let even = Spline::mirrored(ri_xs, ri, Parity::Even);
    let mut image: Vec<f64> = at.iter().map(|&x| spline.at(x)).collect();
    let mut illumination: Vec<f64> = at.iter().map(|&x| even.at(x)).collect();
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
        psf_energy: energy,
        solid_angle_sr: 1.0,
        transmission: 1.0,
    };
    Ok((dense, error))
}

impl ImportOptions {
    pub(super) fn layout(&self, outward: Outward) -> Layout {
        Layout { rows: self.rows, outward, even: self.even_window, symmetric: self.symmetric }
    }

    /// For formats whose windows are arrays: their first row is the top one, unless told otherwise.
    pub(super) fn told_outward(&self, path: &Path) -> Result<Outward, ImportError> {
        self.outward.ok_or(ImportError::Ask {
            path: path.into(),
            what: "on which side of a window its field point lies",
            option: "--psf-outward",
        })
    }

    pub(super) fn told_sample(&self, path: &Path) -> Result<PsfSample, ImportError> {
        match (self.sample, self.without_psf) {
            (Some(sample), _) => Ok(sample),
            (None, true) => Ok(PsfSample::Integrated),
            (None, false) => Err(ImportError::Ask {
                path: path.into(),
                what: "whether a PSF sample is a point or the mean over its square",
                option: "--psf-sample",
            }),
        }
    }

    /// F-number and, where the entrance pupil was told, the solid angle π·NA² by Abbe's sine condition.
    pub(super) fn aperture(
        &self,
        path: &Path,
        efl_mm: f64,
        f_number: Option<f64>,
    ) -> Result<(f64, Option<f64>), ImportError> {
        match (self.f_number, self.entrance_pupil_mm, f_number) {
            (Some(_), Some(_), _) => Err(ImportError::Option {
                option: "--entrance-pupil-mm",
                problem: "not together with `--f-number`".into(),
            }),
            (None, Some(pupil), _) => {
                let na = pupil / 2.0 / efl_mm;
                Ok((efl_mm / pupil, Some(std::f64::consts::PI * na * na)))
            }
            (Some(n), None, _) | (None, None, Some(n)) => Ok((n, None)),
            (None, None, None) => {
                Err(ImportError::Ask { path: path.into(), what: "the F-number", option: "--f-number" })
            }
        }
    }

    /// The indices into `count` wavelengths that were asked for.
    pub(super) fn chosen(&self, count: usize) -> Result<Vec<usize>, ImportError> {
        let Some(bands) = &self.bands else { return Ok((0..count).collect()) };
        match bands.iter().find(|&&b| b >= count) {
            Some(b) => Err(ImportError::Option {
                option: "--bands",
                problem: format!("{b} is beyond the last of {count} wavelengths"),
            }),
            None => Ok(bands.clone()),
        }
    }
}

/// A number that the options or the files must tell.
pub(super) fn told(
    path: &Path,
    told: Option<f64>,
    found: Option<f64>,
    what: &'static str,
    option: &'static str,
) -> Result<f64, ImportError> {
    let value = told.or(found).ok_or(ImportError::Ask { path: path.into(), what, option })?;
    match value.is_finite() && value > 0.0 {
        true => Ok(value),
        false => Err(ImportError::file(path, format!("{what} is {value}, expected a positive number"))),
    }
}

/// Row order is the files' own business only where the format fixes it.
pub(super) fn row_order(options: &ImportOptions) -> &'static str {
    match options.rows {
        RowOrder::Top => "top first",
        RowOrder::Bottom => "bottom first",
    }
}
