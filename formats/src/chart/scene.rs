//! A scene ([`crate::scene`]) as a chart, or one of its hidden surfaces: weights of spectra, which are summed as bands are read.
//!
//! ```text
//! L(λ, y, x) = Σ_b weights(b, y, x)·S_b(λ)      W m⁻² sr⁻¹ nm⁻¹, in 32-bit floats, in the order of the bases; those with S_b = 0 are not read
//! ```
//! The bands are those that are asked for, by default every 10 nm from 400 to 700: a scene has none of its own.

use std::io::Read;
use std::path::Path;

use pipeline::flow::{ChartSource, SourceSinkError};
use pipeline::geometry::{Rect, Size};
use pipeline::projection::Projection;
use pipeline::scene::weights::{Spectra, spectra};
use serde_json::{Value, json};

use super::error::ChartError;
use super::open::split_array;
use super::options::{ChartOptions, NanPolicy};
use super::store::ChartStore;
use crate::durable::is_url;
use crate::group::{GroupError, GroupKind};
use crate::scene::{SceneLight, SceneStore};

/// Metadata of a group are smaller.
const MAX_METADATA_BYTES: u64 = 64 << 20;
/// Unit of its values.
pub(super) const UNITS: &str = "W m-2 sr-1 nm-1";
/// Error of colours, of white, that is told.
const EXACT: f64 = pipeline::reflectance::EXACT;

/// A scene, or a hidden surface of it, as a chart.
#[derive(Debug)]
pub struct SceneChart {
    weights: ChartStore,
    light: SceneLight,
    wavelengths_nm: Vec<f64>,
    /// S_b(λ), (basis, band).
    radiance: Vec<Vec<f32>>,
    film_size: Option<Size>,
    pitch_um: f64,
    focal_mm: f64,
    projection: Projection,
    sheets: usize,
    /// Digest of all that determined its numbers.
    job_digest: String,
    /// Error of the colours, of white, and the primary that has it.
    colour_error: (f64, &'static str),
}

/// The scene and the number of its surface (0: the first) that `spec` names: `SCENE` or `SCENE//hidden/1`.
fn split(spec: &str) -> Option<(&Path, usize)> {
    // Not `split_array`, for which an existing directory names no array.
    match spec.rsplit_once("//hidden/") {
        Some((path, number)) => Some((Path::new(path), number.parse().ok().filter(|n| *n > 0)?)),
        None if split_array(spec).1.is_empty() => Some((Path::new(spec), 0)),
        None => None,
    }
}

/// Whether `spec` names a scene, or a hidden surface of one. What cannot be read is none here; opening it reports why.
pub(super) fn is_scene(spec: &str) -> bool {
    let Some((path, _)) = split(spec) else { return false };
    if is_url(path) {
        return SceneStore::is_one(path).unwrap_or(false);
    }
    let schema = || {
        let name = path.join("zarr.json");
        // Opening a pipe would wait for its writer.
        let file = std::fs::metadata(&name).ok()?.is_file().then(|| std::fs::File::open(&name))?.ok()?;
        let mut text = Vec::new();
        file.take(MAX_METADATA_BYTES).read_to_end(&mut text).ok()?;
        let group: Value = serde_json::from_slice(&text).ok()?;
        Some(group.get("attributes")?.get("schema")? == GroupKind::Scene.schema())
    };
    schema().unwrap_or(false)
}

/// The error of a store: of the disk or network, or of what the scene is.
fn of_group(error: GroupError) -> ChartError {
    match error {
        GroupError::Storage(e) => e.into(),
        e => ChartError::Usage(e.to_string()),
    }
}

impl SceneChart {
    /// Opens the scene, or the hidden surface, that `spec` names.
    ///
    /// # Errors
    /// [`ChartError::Usage`] with a scale, for bands that cannot represent the colours or lie beyond a spectrum; else that the scene cannot be
    /// opened.
    pub(super) fn open(
        spec: &str,
        wavelengths_nm: Option<&[f64]>,
        scale: Option<f64>,
        cache_bytes: usize,
    ) -> Result<Self, ChartError> {
        let refused = |reason: &dyn std::fmt::Display| ChartError::Usage(format!("scene `{spec}`: {reason}"));
        let (path, sheet) = split(spec).ok_or_else(|| refused(&"expected SCENE or SCENE//hidden/1"))?;
        let store = SceneStore::open(path, true).map_err(of_group)?;
        let missing = store.missing(&store.spec().all_shards().collect::<Vec<_>>());
        let missing = missing.map_err(of_group)?;
        if let Some(first) = missing.first() {
            return Err(refused(&format!(
                "{} of its files are missing, e.g. {}: it is not complete; finish it by the command that began it",
                missing.len(),
                first.key()
            )));
        }
        let sheets = store.spec().sheets;
        if sheet >= sheets {
            return Err(refused(&format!("it has {} hidden surfaces", sheets - 1)));
        }
        if scale.is_some() {
            return Err(refused(
                &"--chart-scale applies to charts with bands; --illuminance changes a scene's light",
            ));
        }
        let default_nm: Vec<f64> = (40..=70).map(|k| 10.0 * f64::from(k)).collect();
        let nm = wavelengths_nm.unwrap_or(&default_nm);
        let attributes = store.attributes();
        let invalid = || refused(&"its attributes are not those of a scene; make it again with --overwrite");
        let light = SceneLight::from_attributes(attributes).ok_or_else(invalid)?;
        let job_digest = attributes.get("provenance").and_then(|p| p["job_digest"].as_str());
        let job_digest = job_digest.ok_or_else(invalid)?.to_owned();
        let focal_mm = attributes.get("focal_mm").and_then(Value::as_f64).ok_or_else(invalid)?;
        // Few bands cannot represent all colours: they have the nearest then, with a note.
        let Spectra { radiance, colour_error } =
            spectra(&light.bases, nm, &light.illuminant, light.illuminance_lx, f64::INFINITY)
                .map_err(|e| refused(&format!("--wavelengths: {e}")))?;
        let array = if sheet == 0 { "weights".to_owned() } else { format!("hidden/{sheet}/weights") };
        let numbers = (1..=light.bases.len()).map(|b| b as f64).collect();
        let options = ChartOptions {
            cache_bytes,
            nan: NanPolicy::Error,
            wavelengths_nm: Some(numbers),
            ..ChartOptions::default()
        };
        let weights = ChartStore::open_at(path, &array, options)?;
        if weights.bands() != radiance.len() {
            return Err(invalid());
        }
        let radiance = radiance.into_iter().map(|s| s.into_iter().map(|v| v as f32).collect()).collect();
        let film_size = weights.film_size();
        let (pitch_um, projection) = (store.spec().pitch_um, store.spec().projection);
        Ok(Self {
            weights,
            light,
            wavelengths_nm: nm.to_vec(),
            radiance,
            film_size,
            pitch_um,
            focal_mm,
            projection,
            sheets,
            job_digest,
            colour_error,
        })
    }

    /// The array of weights.
    pub(super) fn weights(&self) -> &ChartStore {
        &self.weights
    }

    /// The array of weights.
    pub(super) fn weights_mut(&mut self) -> &mut ChartStore {
        &mut self.weights
    }

    /// Number of spectra.
    pub(super) fn bases(&self) -> usize {
        self.radiance.len()
    }

    /// Numbers of its spectra, all of which a band may need.
    pub(super) fn all_bases(&self) -> Vec<usize> {
        (0..self.bases()).collect()
    }

    /// Wavelengths of the bands in nm.
    pub(super) fn wavelengths_nm(&self) -> &[f64] {
        &self.wavelengths_nm
    }

    /// Path or URL of the scene.
    pub fn path(&self) -> &Path {
        self.weights.path()
    }

    /// Surfaces of a pixel: one seen first, the others hidden.
    pub fn sheets(&self) -> usize {
        self.sheets
    }

    /// Distortion focal length of the lens that it was made for, mm.
    pub fn focal_mm(&self) -> f64 {
        self.focal_mm
    }

    /// The plane of its chart.
    pub fn projection(&self) -> Projection {
        self.projection
    }

    /// Pixel pitch in µm.
    pub fn pitch_um(&self) -> f64 {
        self.pitch_um
    }

    /// Size of the film that it was made for.
    pub fn film_size(&self) -> Option<Size> {
        self.film_size
    }

    /// Name of its illuminant.
    pub(super) fn illuminant(&self) -> &str {
        self.light.illuminant.name()
    }

    /// Limits the magnitude of values to `max`.
    pub(super) fn limit_values(&mut self, max: f32) {
        let sum = |band: usize| self.radiance.iter().map(|of_basis| of_basis[band]).sum::<f32>();
        let largest = (0..self.wavelengths_nm.len()).map(sum).fold(f32::MIN_POSITIVE, f32::max);
        self.weights.limit_values((max / largest).min(f32::MAX));
    }

    /// Notes on how its values are read.
    pub(super) fn notes(&self) -> Vec<String> {
        let (error, corner) = self.colour_error;
        let note = format!(
            "the scene's colours are in error by up to {:.1} % of white ({corner}): bands every 20 nm from 400 to 700 nm represent all of sRGB",
            100.0 * error
        );
        Some(note).filter(|_| error > EXACT).into_iter().collect()
    }

    /// Identity for the job's digest, and the modification times of its files.
    pub(super) fn identity(&self) -> Result<(Value, Value), ChartError> {
        let identity = self.weights.identity()?;
        let light = self.light.attributes();
        let content = json!({
            "scene": identity.content,
            "job_digest": self.job_digest,
            "light": light,
            "wavelengths_nm": self.wavelengths_nm,
        });
        Ok((content, json!(identity.mtimes)))
    }
}

impl ChartSource for SceneChart {
    fn size(&self) -> Size {
        self.weights.size()
    }

    fn read(&self, band: usize, rect: Rect, out: &mut [f32]) -> Result<(), SourceSinkError> {
        out.fill(0.0);
        let mut weights = vec![0.0; out.len()];
        for (basis, radiance) in self.radiance.iter().enumerate().filter(|(_, s)| s[band] != 0.0) {
            self.weights.read(basis, rect, &mut weights)?;
            out.iter_mut().zip(&weights).for_each(|(to, w)| *to += radiance[band] * w);
        }
        Ok(())
    }

    fn prefetch(&self, band: usize, rect: Rect) {
        let needed = (0..self.radiance.len()).filter(|basis| self.radiance[*basis][band] != 0.0);
        needed.for_each(|basis| self.weights.prefetch(basis, rect));
    }
}
