//! What is restored, a film or a raw of one, and the flags of `lenscube run` that made the film, as far as they determine the map from chart to film.
//!
//! The flags are those of the film's record (`provenance.job`, and `provenance.source` with the record of a design). That they describe the film's lens is checked by its digest.

use super::planes::{Grid, Pixels, Plane};
use super::raw::RawPlanes;
use super::tails::FilmTails;
use crate::args::RestoreArgs;
use crate::camera::frame::split_group;
use crate::failure::{Coded, code, usage};
use crate::film::reported;
use crate::job::TAILS;
use crate::job::recorded_lens::RecordedLens;
use anyhow::Result;
use formats::chart::{ChartOptions, ChartStore, NanPolicy};
use formats::film::FilmStore;
use formats::raw::RawStore;
use pipeline::geometry::Rect;
use pipeline::restore::noise::NoiseEstimate;
use pipeline::stages::flags_of;
use serde_json::Value;
use std::path::{Path, PathBuf};

/// Bytes of decoded chunks.
const CACHE_BYTES: usize = 64 << 20;
/// Pixels of a film of which its noise is estimated, about, and rows that are read together.
const NOISE_PIXELS: usize = 4_000_000;
const ROWS: usize = 256;

/// What is restored, complete.
pub struct Recorded {
    film: FilmStore,
    tails: FilmTails,
    source: Source,
    grid: Grid,
    planes: Vec<Plane>,
    lens: String,
    is_traced: bool,
    flags: Vec<String>,
}

enum Source {
    Film(Box<ChartStore>),
    Raw(Box<RawPlanes>),
}

impl Recorded {
    /// Opens the film, or the raw and the record of its film, of `args`.
    ///
    /// # Errors
    /// No film or raw; a damaged one; usage: not complete, of regions, not linear, of a lens that is not recorded, a raw of another film.
    pub fn open(args: &RestoreArgs) -> Result<Self> {
        let given = args.film.display().to_string();
        let is_raw = RawStore::is_one(Path::new(split_group(&given).0)).unwrap_or(false);
        let film = match (&args.of_film, is_raw) {
            (Some(film), true) => reported::film(film)?,
            (None, false) => reported::film(&args.film)?,
            (None, true) => {
                return Err(usage(format!(
                    "{given} is a raw: give --film FILM, the film that it was made of, whose record names the lens"
                )));
            }
            (Some(_), false) => {
                return Err(usage(format!("--film is for raws; {given} is not one")));
            }
        };
        if !is_raw && args.frame != 0 {
            return Err(usage(format!("--frame is for raws; {given} is not one")));
        }
        check_invertible(&film)?;
        let recorded = RecordedLens::new(&film, args.lens.as_deref())?;
        let is_traced = recorded.is_traced();
        if is_raw && is_traced {
            recorded.open()?;
        }
        let RecordedLens { name: lens, mut flags, .. } = recorded;
        flags.extend(of_job(&film.provenance().get("job").cloned().unwrap_or_default()));
        flags.extend(args.threads.map(|n| format!("--threads={n}")));
        let (source, grid, planes) = match is_raw {
            true => {
                let (raw, grid, planes) = RawPlanes::open(args, &given, &film, CACHE_BYTES)?;
                (Source::Raw(Box::new(raw)), grid, planes)
            }
            false => {
                check_complete(&film)?;
                let options = ChartOptions {
                    cache_bytes: CACHE_BYTES,
                    nan: NanPolicy::Error,
                    ..ChartOptions::default()
                };
                let pixels = ChartStore::open(&format!("{given}//film"), options)?;
                let spec = film.spec();
                let grid = Grid { size: spec.film, pitch_um: spec.pitch_um, axis_px: spec.axis_px };
                let planes = spec.wavelengths_nm.iter().enumerate().map(|(band, nm)| Plane {
                    name: None,
                    wavelength_nm: *nm,
                    bands: vec![(band, 1.0)],
                    density: 1.0,
                    background: 0.0,
                });
                (Source::Film(Box::new(pixels)), grid, planes.collect())
            }
        };
        Ok(Self { tails: FilmTails::default(), film, source, grid, planes, lens, is_traced, flags })
    }

    /// Where its pixels are.
    pub fn grid(&self) -> Grid {
        self.grid
    }

    /// What is restored.
    pub fn planes(&self) -> &[Plane] {
        &self.planes
    }

    /// Wavelengths of the film's bands.
    pub fn film_wavelengths_nm(&self) -> &[f64] {
        &self.film.spec().wavelengths_nm
    }

    /// Distance of the film's farthest corner from the axis.
    pub fn film_reach_mm(&self) -> f64 {
        let (spec, far) =
            (self.film.spec(), |axis: f64, n: usize| (axis + 0.5).abs().max((n as f64 - 0.5 - axis).abs()));
        let (y, x) = (far(spec.axis_px.0, spec.film.height), far(spec.axis_px.1, spec.film.width));
        y.hypot(x) * spec.pitch_um * 1e-3
    }

    /// The digest that the film records of its lens, if a lens for the pitch of these pixels has the same: a design is traced anew for another pitch, and was compared by its description.
    pub fn comparable_digest(&self) -> Option<&str> {
        let is_of_pitch = (self.grid.pitch_um / self.film.spec().pitch_um - 1.0).abs() < 1e-9;
        self.lens_digest().filter(|_| is_of_pitch || !self.is_traced)
    }

    /// Path or URL of the film.
    pub fn film_path(&self) -> PathBuf {
        self.film.path().into()
    }

    /// The raw, if it is one.
    pub fn raw(&self) -> Option<&RawPlanes> {
        match &self.source {
            Source::Film(_) => None,
            Source::Raw(raw) => Some(raw),
        }
    }

    /// Name or path of its lens.
    pub fn lens(&self) -> String {
        self.lens.clone()
    }

    /// Flags of its lens and stages.
    pub fn flags(&self) -> &[String] {
        &self.flags
    }

    /// The digest of the film's job.
    pub fn job_digest(&self) -> Value {
        self.film.provenance().get("job_digest").cloned().unwrap_or_default()
    }

    /// The digest of its lens.
    pub fn lens_digest(&self) -> Option<&str> {
        self.film.provenance().get("job")?.get("lens_digest")?.as_str()
    }

    /// The unit of its chart, if that is the film's.
    pub fn chart_units(&self) -> Option<String> {
        let units = self.film.provenance().get("job")?.get("film_units")?.as_str()?;
        (units == "relative").then(|| self.film.spec().units.clone())
    }

    /// The largest value of a plane, and its noise: of a film estimated, of a raw that of its sensor at the plane's mean.
    ///
    /// # Errors
    /// As [`Recorded::read`].
    pub fn survey(&self, plane: usize) -> Result<(f64, f64)> {
        let size = self.grid.size;
        let mut estimate = NoiseEstimate::default();
        let (mut peak, mut sum) = (0.0f64, 0.0);
        for strip in size.rect().tiles(ROWS, size.width) {
            let values = self.read(plane, strip, 1.0)?.values;
            peak = values.iter().fold(peak, |m, v| m.max(f64::from(*v)));
            sum += values.iter().map(|v| f64::from(*v)).sum::<f64>();
            if self.raw().is_none() {
                let count = (NOISE_PIXELS * strip.height).div_ceil(size.height);
                estimate.add(&values, strip.width, count);
            }
        }
        let noise = match self.raw() {
            None => estimate.sigma(),
            Some(raw) => raw.sigma(plane, sum / size.pixels() as f64),
        };
        Ok((peak, noise))
    }

    /// The pixels of `rect`, without the light that the film has from the tails of PSFs; `noise`: the σ of the weights.
    ///
    /// # Errors
    /// A damaged shard; NaN.
    pub fn read(&self, plane: usize, rect: Rect, noise: f64) -> Result<Pixels> {
        let mut pixels = match &self.source {
            Source::Film(store) => {
                let mut values = vec![0.0; rect.size().pixels()];
                store.read_rect(plane, rect, &mut values)?;
                Pixels { values, weights: None }
            }
            Source::Raw(raw) => raw.read(plane, rect, noise)?,
        };
        let bands = &self.planes[plane].bands;
        self.tails.subtract(&self.film, (plane, bands), (self.grid, rect), &mut pixels.values)?;
        Ok(pixels)
    }
}

/// Fails unless the film is the linear image of one flat chart.
fn check_invertible(store: &FilmStore) -> Result<()> {
    let (spec, path) = (store.spec(), store.path().display());
    let job = store.provenance().get("job");
    let has = |key: &str| job.and_then(|job| job.get(key)).is_some_and(|value| !value.is_null());
    if has("depth") || spec.has_invented {
        return Err(usage(format!(
            "film {path} is of surfaces at several distances, which hide each other: it is not linear in its chart and is not restored; \
             `lenscube run --depth none` makes the film of a flat chart"
        )));
    }
    if let Some(layer) = spec.layers.iter().find(|layer| layer.name != TAILS) {
        return Err(usage(format!(
            "film {path} has light beside its image (layer `{}`), which is not undone: make the film without {}",
            layer.name,
            flags_of(&layer.name)
        )));
    }
    match &spec.outputs[..] {
        [output] if output.name == "film" => Ok(()),
        _ => Err(usage(format!(
            "film {path} has regions only, whose surroundings are not known: expected a complete film, made without --roi"
        ))),
    }
}

fn check_complete(store: &FilmStore) -> Result<()> {
    let all: Vec<_> = store.all_shards().collect();
    let missing = store.shards_bytes(&all)?.iter().filter(|bytes| bytes.is_none()).count();
    match missing {
        0 => Ok(()),
        _ => Err(Coded {
            code: code::WRONG,
            message: format!(
                "film {}: {missing} of {} shards are missing; the same `lenscube run` completes it",
                store.path().display(),
                all.len()
            ),
        }
        .into()),
    }
}

/// Flags of the identity of a job.
fn of_job(job: &Value) -> Vec<String> {
    let mut flags = Vec::new();
    let mut give = |flag: &str, value: &Value| match value {
        Value::Null => {}
        Value::String(text) => flags.push(format!("--{flag}={text}")),
        value => flags.push(format!("--{flag}={value}")),
    };
    give("interp", &job["interp"]);
    give("outside", &job["outside"]);
    give("film-units", &job["film_units"]);
    give("azimuths", &job["azimuths"]);
    give("psf-window", &job["psf_window"]);
    let bands = &job["band_samples"];
    if let Some(count) = bands["count"].as_u64() {
        let width = bands["width_nm"].as_f64().map(|nm| format!(",width={nm}")).unwrap_or_default();
        give("band-samples", &format!("{count}{width}").into());
    }
    let stages = job["stages"].as_object().into_iter().flatten();
    let on: Vec<&str> = stages.filter(|(_, on)| **on == true).map(|(name, _)| name.as_str()).collect();
    give("stages", &on.join(",").into());
    if job["interpolate_psf"] == true {
        flags.push("--interpolate-psf".into());
    }
    if job.get("tails").is_none() {
        flags.push("--tails=off".into());
    }
    flags
}
