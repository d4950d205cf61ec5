//! The signal that a raw kept, with which other exposures need no film.

use crate::camera::shading::RESPONSE_MAP;
use crate::failure::usage;
use anyhow::{Context, Result, bail};
use formats::chart::{ChartOptions, ChartStore};
use formats::raw::{RawSpec, RawStore, SIGNAL};
use formats::sensor::SensorFile;
use serde_json::Value;
use std::path::Path;

/// The signal that a raw kept.
pub struct Kept {
    pub(super) store: ChartStore,
    /// Its layout.
    pub spec: RawSpec,
    /// Its sensor.
    pub sensor: SensorFile,
    /// Identity of the signal.
    pub signal_identity: Value,
    /// What it records of the film.
    pub film: Value,
    /// Wavelengths of the film's bands, nm.
    pub wavelengths_nm: Vec<f64>,
    /// Whether the film's values are relative.
    pub relative: bool,
    /// The response over angles of incidence; null without.
    pub response_map: Value,
}

impl Kept {
    /// Opens the raw at `path`.
    pub fn open(path: &Path) -> Result<Self> {
        let raw = RawStore::open(path, true)?;
        let shown = path.display();
        if !raw.spec().signal {
            return Err(usage(format!(
                "{shown} has not kept its signal; start from its film, or make it with --keep-signal"
            )));
        }
        let shards: Vec<_> = raw.spec().all_shards().into_iter().filter(|s| s.frame.is_none()).collect();
        let missing = raw.missing(&shards)?;
        if !missing.is_empty() {
            bail!(
                "{shown}: {} of {} shards of its signal are missing; finish it by the same `lenscube sensor`",
                missing.len(),
                shards.len()
            );
        }
        let a = |key: &str| raw.attributes().get(key).cloned().unwrap_or_default();
        let options = ChartOptions { cache_bytes: 0, ..ChartOptions::default() };
        Ok(Self {
            sensor: SensorFile::from_record(path, &a("sensor"))?,
            signal_identity: a("signal_identity"),
            relative: a("film")["relative"].as_bool().context("the raw does not record its film")?,
            film: a("film"),
            response_map: a(RESPONSE_MAP),
            wavelengths_nm: serde_json::from_value(a("film_wavelengths_nm"))?,
            store: ChartStore::open_at(path, SIGNAL, options)?,
            spec: raw.spec().clone(),
        })
    }
}
