//! Times of a recorded run, in the quantities of the paper's Table 2.

use anyhow::{Context, Result};
use formats::film::FilmStore;
use pipeline::clock::Phase;
use serde_json::{Map, Value, json};
use std::path::Path;

/// Key and phases of a row of the paper's table.
type Row = (&'static str, &'static [Phase]);

/// Relative illumination and distortion.
pub const REMAP: Row = ("ri_distortion_core_s", &[Phase::Remap]);
/// The PSF.
pub const SVPSF: Row = ("svpsf_core_s", &[Phase::Svpsf, Phase::Add, Phase::Prepare]);
/// Input and output.
pub const IO: Row = ("io_core_s", &[Phase::Read, Phase::Encode, Phase::Write]);

/// Times of the newest run that made `film` completely; `null` without one.
pub fn newest_complete_run(film: Option<&Path>) -> Result<Value> {
    let Some(path) = film else { return Ok(Value::Null) };
    let store = FilmStore::open(path, false).with_context(|| format!("--timing {}", path.display()))?;
    let spec = store.spec();
    let film_pixels: u64 = spec.outputs.iter().map(|o| o.rect.size().pixels() as u64).sum::<u64>()
        * spec.wavelengths_nm.len() as u64;
    // A run that resumed a film has the times of a part only.
    let complete = |r: &Map<String, Value>| {
        r.get("outcome").and_then(Value::as_str) == Some("complete")
            && r.get("pixels").and_then(Value::as_u64).is_some_and(|p| p >= film_pixels)
    };
    let Some(run) = store.group().runs()?.into_iter().rfind(complete) else { return Ok(Value::Null) };
    let windows = store.provenance().get("bands").and_then(Value::as_array).cloned().unwrap_or_default();
    let windows: Vec<u64> = windows.iter().filter_map(|b| b["psf_window_px"].as_u64()).collect();
    let core = |phases: &[Phase]| phases.iter().filter_map(|p| run["core_s"][p.name()].as_f64()).sum::<f64>();
    let text = |key: &str| run.get(key).and_then(Value::as_str).unwrap_or("?").to_owned();
    let wall_s = run["wall_s"].as_f64().unwrap_or(f64::NAN);
    Ok(json!({
        "film_px": [spec.film.height, spec.film.width],
        "bands": spec.wavelengths_nm.len(),
        "psf_window_px": { "least": windows.iter().min(), "most": windows.iter().max() },
        REMAP.0: core(REMAP.1),
        SVPSF.0: core(SVPSF.1),
        IO.0: core(IO.1),
        "wall_s": wall_s,
        "mpx_per_s": film_pixels as f64 * 1e-6 / wall_s,
        "peak_resident_bytes": run.get("peak_resident_bytes"),
        "threads": run.get("threads"),
        "device": format!("{}, {}", text("device"), text("engine")),
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_phase_is_in_one_row() {
        for phase in Phase::ALL {
            let rows = [REMAP, SVPSF, IO].into_iter().filter(|(_, phases)| phases.contains(&phase));
            assert_eq!(rows.count(), 1, "{}", phase.name());
        }
    }
}
