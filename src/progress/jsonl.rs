//! Progress for programs: one JSON object per line on stdout. `elapsed_s` counts from the start of the command.
//!
//! ```text
//! trace     bands, bands_total: bands of the lens that have been traced or found in the cache, before `start`; not for a lens pack
//! start     film, device, threads, pid, host, shards, shards_done, tiles, pixels, startup_s
//! progress  band, tiles, tiles_total, pixels, pixels_total, shards, shards_total, bytes_written, mpx_per_s, eta_s; at most one per second
//! shard     key, band, bytes: written; in a film of less than 64 MB present after its batch, before `done` at the latest
//! done      code 0, shards, tiles, pixels, bytes_read, bytes_written, peak_resident_bytes, wall_s     the last line of a complete run
//! error     code, retry, message                                                                     the last line of any other
//! ```
//! With a plan each line also has `plan`, the first digits of its digest, and `units`, the list of units that are computed.

use crate::failure::{self, code};
use crate::progress::terminal;
use formats::object;
use serde_json::{Map, Value, json};
use std::sync::{Mutex, OnceLock};
use std::time::{Duration, Instant};

/// Minimum time between two `progress` events.
const INTERVAL: Duration = Duration::from_secs(1);

/// That of this process.
static ACTIVE: OnceLock<Jsonl> = OnceLock::new();

/// Writes the events of one command.
pub struct Jsonl {
    start: Instant,
    common: OnceLock<Map<String, Value>>,
    state: Mutex<State>,
}

/// What has been completed so far.
#[derive(Default)]
struct State {
    /// Start of the computation.
    running: Option<Instant>,
    last_event: Option<Instant>,
    totals: Totals,
    tiles: u64,
    pixels: u64,
    shards: u64,
    bytes: u64,
}

/// Numbers to be computed.
#[derive(Clone, Copy, Default)]
struct Totals {
    shards: u64,
    tiles: u64,
    pixels: u64,
}

impl Jsonl {
    /// For the command of this process, which starts now.
    pub fn start() -> &'static Self {
        ACTIVE.get_or_init(|| Self {
            start: Instant::now(),
            common: OnceLock::new(),
            state: Mutex::default(),
        })
    }

    /// Adds the plan and its units to all following events.
    pub fn set_plan(&self, plan: &str, units: &str) {
        let _ = self.common.set(object! { "plan": plan, "units": units });
    }

    /// Writes one event. Errors are ignored: the reader may have closed the pipe, and the run continues.
    pub fn write(&self, event: &str, fields: Value) {
        let elapsed_s = (self.start.elapsed().as_secs_f64() * 1e3).round() / 1e3;
        let mut line =
            Map::from_iter([("event".to_owned(), json!(event)), ("elapsed_s".into(), json!(elapsed_s))]);
        line.extend(self.common.get().cloned().unwrap_or_default());
        if let Value::Object(fields) = fields {
            line.extend(fields);
        }
        let _ = terminal::result_line(&Value::Object(line).to_string());
    }

    /// The computation begins: numbers of shards, tiles and film pixels to compute.
    pub fn set_totals(&self, shards: u64, tiles: u64, pixels: u64) {
        let mut s = self.state.lock().expect("no panic while held");
        (s.running, s.totals) = (Some(Instant::now()), Totals { shards, tiles, pixels });
    }

    /// A tile of `band` of the film was added.
    pub fn tile(&self, band: usize, pixels: usize) {
        let mut s = self.state.lock().expect("no panic while held");
        s.tiles += 1;
        s.pixels += pixels as u64;
        if s.last_event.is_some_and(|last| last.elapsed() < INTERVAL) {
            return;
        }
        s.last_event = Some(Instant::now());
        let seconds = s.running.map_or(0.0, |since| since.elapsed().as_secs_f64());
        let rate = s.pixels as f64 / seconds;
        let finite = |v: f64| if v.is_finite() { json!((v * 1e3).round() / 1e3) } else { Value::Null };
        let fields = json!({
            "band": band,
            "tiles": s.tiles,
            "tiles_total": s.totals.tiles,
            "pixels": s.pixels,
            "pixels_total": s.totals.pixels,
            "shards": s.shards,
            "shards_total": s.totals.shards,
            "bytes_written": s.bytes,
            "mpx_per_s": finite(rate * 1e-6),
            "eta_s": finite(s.totals.pixels.saturating_sub(s.pixels) as f64 / rate),
        });
        // Written under the lock, so that counts never decrease from event to event.
        self.write("progress", fields);
    }

    /// A shard was committed.
    pub fn shard(&self, key: &str, band: usize, bytes: u64) {
        let mut s = self.state.lock().expect("no panic while held");
        s.shards += 1;
        s.bytes += bytes;
        self.write("shard", json!({ "key": key, "band": band, "bytes": bytes }));
    }

    /// The last event of a command that was not completed; `resume`: how it is resumed.
    pub fn end(&self, result: &anyhow::Result<u8>, resume: &str) {
        let (code, message) = match result {
            Ok(0) => return,
            Ok(code) => (*code, format!("interrupted; {resume}")),
            Err(error) => (failure::exit_code(error), failure::line(error)),
        };
        let retry = [code::RETRY, code::INTERRUPTED].contains(&code);
        self.write("error", json!({ "code": code, "retry": retry, "message": message }));
    }
}

/// Writes the `trace` event, if this process writes events.
pub fn traced(bands: usize, bands_total: usize) {
    if let Some(jsonl) = ACTIVE.get() {
        jsonl.write("trace", json!({ "bands": bands, "bands_total": bands_total }));
    }
}
