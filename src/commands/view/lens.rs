//! Figures and PSF of the film's lens at a pixel.

use crate::args::DesignArgs;
use crate::design;
use crate::job::lens::samples::LensData;
use crate::job::lens::without_tracing_flags;
use anyhow::{Context, Result, anyhow};
use formats::chart::cache::Cache;
use formats::lens::builtin_names;
use formats::picture::image::Image;
use pipeline::colour::srgb_encode;
use pipeline::design::System;
use pipeline::design::illumination::irradiance_sr;
use pipeline::design::ray::Tracer;
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

/// Relative difference of irradiances that rounding explains: a shift of the film by 1e-6 of its distance from the exit pupil gives 2e-6.
const SAME_IRRADIANCE: f64 = 1e-6;

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
        let band = provenance.get("bands").map(|bands| bands[0].clone()).unwrap_or_default();
        let (film_lens, digest) = (job["lens_name"].as_str(), job["lens_digest"].as_str());
        let is_film_lens = |data: &LensData| -> Result<bool> {
            Ok(match data {
                LensData::Pack(pack) => Some(pack.digest().context("reading the lens")?) == digest,
                LensData::Design(system, _) => {
                    Some(data.name()) == film_lens && is_as_recorded(system, &band)?
                }
            })
        };
        let field_points = Cache::new(CACHE_BYTES);
        if let Some(name) = name {
            let data =
                LensData::open(name, &DesignArgs::default()).map_err(|e| without_tracing_flags(name, e))?;
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
            if data.name() == film_lens {
                return Err(anyhow!(
                    "the film was made with {film_lens} of another focus, gap or parameter than the built-in design; name a lens pack of it \
                     (`lenscube lens trace`) with --lens"
                ));
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

/// Whether a design has the irradiance on the axis (sr) that the film records of its lens in `band`, which another focus, gap or glass changes; `true`
/// where none is recorded.
fn is_as_recorded(system: &System, band: &Value) -> Result<bool> {
    let recorded = band["wavelength_nm"].as_f64().zip(band["solid_angle_sr"].as_f64());
    let Some((nm, recorded_sr)) = recorded else { return Ok(true) };
    let own_sr = irradiance_sr(&Tracer::new(system, nm / 1e3)?, 0.0)?;
    Ok((own_sr / recorded_sr - 1.0).abs() <= SAME_IRRADIANCE)
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

#[cfg(test)]
mod tests {
    use super::*;
    use formats::object;

    #[test]
    fn a_design_of_another_focus_is_not_the_film_lens() {
        let of = |focus_m| {
            let (system, _) = design::focused("phone", &DesignArgs::default(), focus_m).unwrap();
            let light_sr = irradiance_sr(&Tracer::new(&system, 0.55).unwrap(), 0.0).unwrap();
            let band = json!({ "wavelength_nm": 550.0, "solid_angle_sr": light_sr });
            let provenance = object! { "job": json!({ "lens_name": system.name }), "bands": [band] };
            provenance
        };
        assert_eq!(Lens::open(None, &of(None)).unwrap().note, None);
        let other = Lens::open(None, &of(Some(0.1))).map(|lens| lens.name().to_owned());
        assert!(other.unwrap_err().to_string().contains("another focus"));
        assert!(Lens::open(Some("phone"), &of(Some(100.0))).unwrap().note.is_some());
    }
}
