//! The film as input of the sensor: complete, its bands in order of wavelength, its values as spectral irradiance.

use crate::args::ExposeArgs;
use crate::camera::frame::{array_index, split_group};
use crate::failure::usage;
use crate::film::plane::FilmPlane;
use crate::film::reported;
use crate::job::light_units::{self, Quantity};
use anyhow::{Result, bail};
use formats::chart::{ChartError, ChartOptions, ChartStore};
use formats::film::FilmStore;
use pipeline::flow::{ChartSource, SourceSinkError};
use pipeline::geometry::{Rect, Size};
use pipeline::sensor::HC_J_M;
use serde_json::{Value, json};
use std::f64::consts::PI;
use std::path::{Path, PathBuf};

/// A film, or one window of it.
pub struct Film {
    /// Its path or URL.
    pub path: PathBuf,
    /// Its pixels, bands ascending in wavelength.
    pub bands: Bands,
    /// Wavelengths, ascending, nm.
    pub wavelengths_nm: Vec<f64>,
    /// Where its pixels are.
    pub plane: FilmPlane,
    /// Irradiance of a film value of 1 in each band, W m⁻² nm⁻¹; of a relative film its scale is unknown.
    pub factors: Vec<f64>,
    /// Whether the values are relative.
    pub relative: bool,
    /// The film's units, as it names them.
    pub units: String,
    /// Name of the light whose white its chart has, if it is recorded.
    pub light: Option<String>,
    /// Whether it has light of scatter, glare or ghosts.
    has_veil: bool,
    /// Whether its light was followed through coatings.
    has_coatings: bool,
    /// What distinguishes its pixels from another film's.
    pub identity: Value,
    /// (rows, columns) of what is decoded at once.
    pub chunk: (usize, usize),
}

/// Bands of a store in order of wavelength.
pub struct Bands {
    store: ChartStore,
    order: Vec<usize>,
}

impl ChartSource for Bands {
    fn size(&self) -> Size {
        self.store.size()
    }

    fn read(&self, band: usize, rect: Rect, out: &mut [f32]) -> Result<(), SourceSinkError> {
        self.store.read_rect(self.order[band], rect, out).map_err(|e| match e {
            ChartError::NotFinite { path, band, row, column, value, .. } => format!(
                "film {}: {value} at band {band}, row {row}, column {column}, expected finite numbers; `lenscube verify` names \
                 damaged shards",
                path.display()
            )
            .into(),
            e => e.into(),
        })
    }

    fn prefetch(&self, band: usize, rect: Rect) {
        self.store.prefetch(self.order[band], rect);
    }
}

impl Film {
    /// Opens the film `PATH` or `PATH//array`.
    pub fn open(spec: &str, args: &ExposeArgs, cache_bytes: usize) -> Result<Self> {
        let (path, array) = split_group(spec);
        let store = reported::film(Path::new(path))?;
        let film = store.spec();
        let names: Vec<&str> = film.outputs.iter().map(|o| o.name.as_str()).collect();
        let output = array_index("film", path, &names, array)?;
        check_complete(&store, output)?;
        let name = film.outputs[output].name.clone();
        let (order, wavelengths_nm) = in_order(&film.wavelengths_nm, path)?;
        let options = ChartOptions { cache_bytes, ..ChartOptions::default() };
        let array = ChartStore::open_at(Path::new(path), &name, options)?;
        let factors = factors(&store, &wavelengths_nm, args)?;
        let [_, rows, columns] = array.chunk_shape();
        let provenance = |key: &str| store.provenance().get(key).cloned().unwrap_or_default();
        Ok(Self {
            path: path.into(),
            plane: FilmPlane::new(film, output),
            relative: factors.is_none(),
            factors: factors.unwrap_or_else(|| vec![1.0; wavelengths_nm.len()]),
            units: film.units.clone(),
            has_coatings: !provenance("source")["coatings"].is_null(),
            has_veil: film.layers.iter().any(|layer| layer.name == "veil"),
            light: provenance("light").as_str().map(str::to_owned),
            identity: json!({
                "job_digest": provenance("job_digest"),
                "engine": provenance("engine"),
                "dtype": film.sample,
                "array": name,
            }),
            chunk: (rows, columns),
            bands: Bands { store: array, order },
            wavelengths_nm,
        })
    }

    /// Notes for sensors that depend on the directions of its light, which are those of a table if `from_table`, behind plates that may be the lens's if `may_repeat_plates`.
    pub fn notes_on_directions(&self, from_table: bool, may_repeat_plates: bool) -> Vec<String> {
        let veil = "the film's veil (scatter, glare or ghosts) is taken to come from the directions of the image at its place";
        let plates = "the film has lost light in its lens; with --chief-ray-angles it is not checked that the lens has no plate of the sensor's, which would count twice";
        let notes = [(veil, self.has_veil), (plates, self.has_coatings && from_table && may_repeat_plates)];
        notes.into_iter().filter(|(_, applies)| *applies).map(|(note, _)| note.to_owned()).collect()
    }

    /// Bytes read from the store and chunks decoded so far.
    pub fn stats(&self) -> (u64, u64) {
        let stats = self.bands.store.stats();
        (stats.bytes_read, stats.chunks_decoded)
    }
}

/// Fails unless all shards of an output are there.
fn check_complete(store: &FilmStore, output: usize) -> Result<()> {
    let all: Vec<_> = store.all_shards().filter(|s| s.0 == output).collect();
    let there = store.shards_bytes(&all)?;
    let missing: Vec<_> =
        std::iter::zip(&all, there).filter(|(_, size)| size.is_none()).map(|(s, _)| *s).collect();
    if let Some(&(o, b, s)) = missing.first() {
        bail!(
            "film {}: {} of {} shards are missing ({} is the first); finish it by the same `lenscube run`",
            store.path().display(),
            missing.len(),
            all.len(),
            store.key(o, b, s)
        );
    }
    Ok(())
}

/// Band numbers in order of wavelength, and the wavelengths.
fn in_order(wavelengths_nm: &[f64], path: &str) -> Result<(Vec<usize>, Vec<f64>)> {
    let mut order: Vec<usize> = (0..wavelengths_nm.len()).collect();
    order.sort_by(|a, b| wavelengths_nm[*a].total_cmp(&wavelengths_nm[*b]));
    let sorted: Vec<f64> = order.iter().map(|b| wavelengths_nm[*b]).collect();
    match sorted.windows(2).find(|w| w[0] == w[1]) {
        None => Ok((order, sorted)),
        Some(twice) => {
            Err(usage(format!("film {path} has two bands of {} nm, expected each wavelength once", twice[0])))
        }
    }
}

/// W m⁻² nm⁻¹ of a value of each band; `None` for a relative film.
fn factors(store: &FilmStore, wavelengths_nm: &[f64], args: &ExposeArgs) -> Result<Option<Vec<f64>>> {
    let film = store.spec();
    let area_m2 = (film.pitch_um * 1e-6).powi(2);
    let Some((quantity, factor)) = light_units::parse(&film.units) else { return Ok(None) };
    if args.f_number.is_some() && !matches!(quantity, Quantity::Radiance) {
        return Err(usage(format!(
            "--f-number is for films of radiance; film {} holds what reaches it ({}): leave --f-number out",
            store.path().display(),
            film.units
        )));
    }
    let factors: Vec<f64> = match quantity {
        Quantity::Irradiance => vec![1.0; wavelengths_nm.len()],
        Quantity::Photons => wavelengths_nm.iter().map(|nm| HC_J_M / (nm * 1e-9) / area_m2).collect(),
        Quantity::Radiance => match (args.f_number, recorded(store, wavelengths_nm)) {
            (Some(n), _) => {
                let each = args.transmission.unwrap_or(1.0) * PI / (4.0 * n * n);
                vec![each; wavelengths_nm.len()]
            }
            (None, Some(factors)) => factors,
            (None, None) => {
                return Err(usage(format!(
                    "film {} holds radiance ({}) and no transmission and solid angle of its lens; give the lens's --f-number N (and \
                     --transmission), or compute the film with `lenscube run --film-units irradiance`",
                    store.path().display(),
                    film.units
                )));
            }
        },
    };
    Ok(Some(factors.iter().map(|f| f * factor).collect()))
}

/// τ·Ω of each band as the film records them.
fn recorded(store: &FilmStore, wavelengths_nm: &[f64]) -> Option<Vec<f64>> {
    let bands = store.provenance().get("bands")?.as_array()?;
    let of = |nm: &f64| {
        let band = bands.iter().find(|b| b["wavelength_nm"].as_f64() == Some(*nm))?;
        Some(band["transmission"].as_f64()? * band["solid_angle_sr"].as_f64()?)
    };
    wavelengths_nm.iter().map(of).collect()
}
