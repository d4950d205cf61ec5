//! Figures and PSF of the film's lens at a pixel.

use crate::args::DesignArgs;
use crate::design;
use crate::lens::samples::LensData;
use anyhow::{Context, Result, anyhow};
use formats::chart::cache::Cache;
use formats::lens::builtin_names;
use formats::picture::image::Image;
use pipeline::colour::srgb_encode;
use pipeline::figures::PsfWindow;
use pipeline::geometry::Size;
use serde_json::{Map, Value, json};
use std::sync::Arc;

/// Resolution of the image heights, steps per mm.
const STEPS_PER_MM: f64 = 100.0;
/// Range of a logarithmic PSF image, decades.
const DECADES: f64 = 4.0;
/// Size of the cache of field points.
const CACHE_BYTES: usize = 16 << 20;

/// Lens of the film.
pub struct Lens {
    data: LensData,
    /// Note for the user.
    pub note: Option<String>,
    /// Field points by the bits of the wavelength and the steps of height.
    field_points: Cache<FieldPoint, (u64, u64)>,
}

/// Lens at one field point and wavelength.
pub struct FieldPoint {
    figures: Value,
    /// PSF, the field point on +x.
    psf: PsfWindow,
}

impl Lens {
    /// Opens the lens `name`, or without a name the built-in lens that the film's provenance names.
    pub fn open(name: Option<&str>, provenance: &Map<String, Value>) -> Result<Self> {
        let job = provenance.get("job").cloned().unwrap_or_default();
        let (film_lens, digest) = (job["lens_name"].as_str(), job["lens_digest"].as_str());
        let is_film_lens = |data: &LensData| -> Result<bool> {
            Ok(match data {
                LensData::Pack(pack) => Some(pack.digest().context("reading the lens")?) == digest,
                LensData::Design(..) => Some(data.name()) == film_lens,
            })
        };
        let field_points = Cache::new(CACHE_BYTES);
        if let Some(name) = name {
            let data = LensData::open(name, &DesignArgs::default())?;
            let film_lens = film_lens.unwrap_or("an unknown lens");
            let note = format!("not the lens that the film was made with, {film_lens}");
            let note = (!is_film_lens(&data)?).then_some(note);
            return Ok(Self { data, note, field_points });
        }
        let film_lens = film_lens.context("the film does not record its lens; name it with --lens")?;
        for builtin in builtin_names().chain(design::builtin_names()) {
            let data = LensData::open(builtin, &DesignArgs::default())?;
            if is_film_lens(&data)? {
                return Ok(Self { data, note: None, field_points });
            }
        }
        Err(anyhow!("the film was made with {film_lens}, which is not built in; name its file with --lens"))
    }

    pub fn name(&self) -> &str {
        self.data.name()
    }

    /// Figures and PSF at the REAL image height `height_mm`, rounded to 0.01 mm, and `nm`.
    pub fn field_point(&self, nm: f64, height_mm: f64) -> Result<Arc<FieldPoint>> {
        let step = (height_mm * STEPS_PER_MM).round();
        self.field_points.get((nm.to_bits(), step as u64), || {
            let samples = self.data.sample(&[nm], &[step / STEPS_PER_MM])?;
            let figures = samples.figures(0, 0).json();
            let field = samples.fields.into_iter().flatten().next().context("no field point")?;
            let bytes = field.psf.samples.len() * size_of::<f32>();
            Ok((FieldPoint { figures, psf: field.psf }, bytes))
        })
    }
}

impl FieldPoint {
    /// Figures, and size and centroid of the PSF.
    pub fn json(&self) -> Value {
        let psf = &self.psf;
        json!({
            "figures": self.figures,
            "psf": {"size": psf.size, "pitch_um": psf.pitch_um, "centroid_um": psf.centroid_um()},
        })
    }

    /// Image of the PSF with its peak white: linear in light, or its logarithm over [`DECADES`].
    pub fn psf_image(&self, logarithmic: bool) -> Image {
        let psf = &self.psf;
        let peak = f64::from(psf.samples.iter().fold(f32::MIN_POSITIVE, |a, b| a.max(*b)));
        let mut image = Image::new(Size::new(psf.size, psf.size), [0; 3]);
        for (y, row) in psf.samples.chunks_exact(psf.size).enumerate() {
            for (pixel, &v) in image.row_mut(y).iter_mut().zip(row) {
                let v = f64::from(v) / peak;
                let shown = match logarithmic {
                    true if v > 0.0 => (1.0 + v.log10() / DECADES).max(0.0),
                    true => 0.0,
                    false => srgb_encode(v),
                };
                *pixel = [(255.0 * shown).round() as u8; 3];
            }
        }
        image
    }
}
