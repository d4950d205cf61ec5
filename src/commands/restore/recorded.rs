//! The film to restore, and the flags of `lenscube run` that made it, as far as they determine the map from chart to film.
//!
//! The flags are those of the film's record (`provenance.job`, and `provenance.source` with the record of a design). That they describe the film's lens is checked by its digest.

use crate::args::RestoreArgs;
use crate::failure::{Coded, code, usage};
use crate::film::reported;
use crate::job::TAILS;
use crate::job::recorded_lens::RecordedLens;
use anyhow::{Context, Result};
use formats::chart::{ChartOptions, ChartStore, NanPolicy};
use formats::film::{FilmSpec, FilmStore};
use pipeline::buffer::ShardPixels;
use pipeline::geometry::Rect;
use pipeline::layer::{Layer, Taps};
use serde_json::Value;
use std::path::PathBuf;

/// Bytes of decoded chunks of the film.
const CACHE_BYTES: usize = 64 << 20;

/// A complete film.
pub struct Recorded {
    store: FilmStore,
    pixels: ChartStore,
    lens: String,
    flags: Vec<String>,
}

impl Recorded {
    /// Opens the film of `args`.
    ///
    /// # Errors
    /// No film; a damaged one; usage: not complete, of regions, not linear, of a lens that is not recorded.
    pub fn open(args: &RestoreArgs) -> Result<Self> {
        let store = reported::film(&args.film)?;
        check_invertible(&store)?;
        check_complete(&store)?;
        let options =
            ChartOptions { cache_bytes: CACHE_BYTES, nan: NanPolicy::Error, ..ChartOptions::default() };
        let pixels = ChartStore::open(&format!("{}//film", args.film.display()), options)?;
        let RecordedLens { name: lens, mut flags, .. } = RecordedLens::new(&store, args.lens.as_deref())?;
        flags.extend(of_job(&store.provenance().get("job").cloned().unwrap_or_default()));
        flags.extend(args.threads.map(|n| format!("--threads={n}")));
        Ok(Self { store, pixels, lens, flags })
    }

    /// Its layout.
    pub fn spec(&self) -> &FilmSpec {
        self.store.spec()
    }

    /// Its path or URL.
    pub fn path(&self) -> PathBuf {
        self.store.path().into()
    }

    /// Name or path of its lens.
    pub fn lens(&self) -> String {
        self.lens.clone()
    }

    /// Flags of its lens and stages.
    pub fn flags(&self) -> &[String] {
        &self.flags
    }

    /// The digest of its job.
    pub fn job_digest(&self) -> Value {
        self.store.provenance().get("job_digest").cloned().unwrap_or_default()
    }

    /// The digest of its lens.
    pub fn lens_digest(&self) -> Option<&str> {
        self.store.provenance().get("job")?.get("lens_digest")?.as_str()
    }

    /// The unit of its chart, if that is the film's.
    pub fn chart_units(&self) -> Option<String> {
        let units = self.store.provenance().get("job")?.get("film_units")?.as_str()?;
        (units == "relative").then(|| self.spec().units.clone())
    }

    /// The pixels of `rect`, without the light that the film has from the tails of PSFs.
    ///
    /// # Errors
    /// A damaged shard; NaN.
    pub fn read(&self, band: usize, rect: Rect) -> Result<Vec<f32>> {
        let mut film = vec![0.0; rect.size().pixels()];
        self.pixels.read_rect(band, rect, &mut film)?;
        for (index, _) in self.spec().layers.iter().enumerate() {
            let coefficients = self.store.read_layer(index, band)?;
            let coefficients = coefficients.context("the film lacks its layer of tails")?;
            let grid = self.spec().layer_grid(index, band);
            let mut light = ShardPixels::new(rect.size());
            light.reach(rect.height, Vec::new);
            Layer::new(grid, Taps::Lagrange, coefficients).add(rect, &mut light);
            for (y, row) in film.chunks_exact_mut(rect.width).enumerate() {
                row.iter_mut().zip(light.row(y)).for_each(|(v, tail)| *v -= tail);
            }
        }
        Ok(film)
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
            "film {path} has scatter, veiling glare or ghosts (layer `{}`), which are not undone: make the film without --scatter, \
             --veiling-glare and --ghosts",
            layer.name
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
