//! Progress for programs: one JSON object a line on stdout. `elapsed_s` counts from the start of the command.
//!
//! ```text
//! start     film, device, threads, pid, host, shards, shards_done, tiles, pixels, startup_s
//! progress  band, tiles, tiles_total, pixels, pixels_total, shards, shards_total, bytes_written, mpx_per_s, eta_s; at most one a second
//! shard     key, band, bytes
//! done      code 0, shards, tiles, pixels, bytes_read, bytes_written, peak_resident_bytes, wall_s     the last line of a run that did its work
//! error     code, retry, message                                                                     the last line of any other
//! ```
//! With a plan each line also has `plan`, the first digits of its digest, and `units`, the list that is being done.

use crate::failure::{self, code};
use serde_json::{Map, Value, json};
use std::io::Write;
use std::sync::{Mutex, OnceLock};
use std::time::{Duration, Instant};

/// Time between two lines of progress.
const EVERY: Duration = Duration::from_secs(1);

/// The lines of one command.
pub struct Jsonl {
    start: Instant,
    every_line: OnceLock<Map<String, Value>>,
    state: Mutex<State>,
}

/// What has been done so far.
#[derive(Default)]
struct State {
    /// Since when tiles are made.
    running: Option<Instant>,
    told: Option<Instant>,
    totals: (u64, u64, u64),
    tiles: u64,
    pixels: u64,
    shards: u64,
    bytes: u64,
}

impl Jsonl {
    /// For a command that starts now.
    pub fn new() -> Self {
        Self { start: Instant::now(), every_line: OnceLock::new(), state: Mutex::default() }
    }

    /// Says the plan and its units with every line from now on.
    pub fn of_plan(&self, plan: &str, units: &str) {
        let Value::Object(map) = json!({ "plan": plan, "units": units }) else {
            unreachable!("written so above")
        };
        let _ = self.every_line.set(map);
    }

    /// Writes one line. A reader that has gone is no fault: the film is what counts.
    pub fn line(&self, event: &str, fields: Value) {
        let elapsed_s = (self.start.elapsed().as_secs_f64() * 1e3).round() / 1e3;
        let mut line =
            Map::from_iter([("event".to_owned(), json!(event)), ("elapsed_s".into(), json!(elapsed_s))]);
        line.extend(self.every_line.get().cloned().unwrap_or_default());
        if let Value::Object(fields) = fields {
            line.extend(fields);
        }
        let mut out = std::io::stdout().lock();
        let _ = writeln!(out, "{}", Value::Object(line)).and_then(|()| out.flush());
    }

    /// Tiles are about to be made: shards, tiles and pixels of them all.
    pub fn begin(&self, totals: (u64, u64, u64)) {
        let mut s = self.state.lock().expect("no panic while held");
        (s.running, s.totals) = (Some(Instant::now()), totals);
    }

    /// A tile of `band` of the film was added.
    pub fn tile(&self, band: usize, pixels: usize) {
        let mut s = self.state.lock().expect("no panic while held");
        s.tiles += 1;
        s.pixels += pixels as u64;
        if s.told.is_some_and(|told| told.elapsed() < EVERY) {
            return;
        }
        s.told = Some(Instant::now());
        let seconds = s.running.map_or(0.0, |since| since.elapsed().as_secs_f64());
        let rate = s.pixels as f64 / seconds;
        let (shards, tiles, all) = s.totals;
        let finite = |v: f64| if v.is_finite() { json!((v * 1e3).round() / 1e3) } else { Value::Null };
        let fields = json!({
            "band": band,
            "tiles": s.tiles,
            "tiles_total": tiles,
            "pixels": s.pixels,
            "pixels_total": all,
            "shards": s.shards,
            "shards_total": shards,
            "bytes_written": s.bytes,
            "mpx_per_s": finite(rate * 1e-6),
            "eta_s": finite(all.saturating_sub(s.pixels) as f64 / rate),
        });
        // Under the lock, so that counts only grow from line to line.
        self.line("progress", fields);
    }

    /// A shard was committed.
    pub fn shard(&self, key: &str, band: usize, bytes: u64) {
        let mut s = self.state.lock().expect("no panic while held");
        s.shards += 1;
        s.bytes += bytes;
        self.line("shard", json!({ "key": key, "band": band, "bytes": bytes }));
    }

    /// The last line of a command that has not told that it is done.
    pub fn end(&self, result: &anyhow::Result<u8>) {
        let (code, message) = match result {
            Ok(0) => return,
            Ok(code) => (*code, "interrupted; the same command resumes".to_owned()),
            Err(error) => (failure::exit_code(error), failure::line(error)),
        };
        let retry = [code::RETRY, code::INTERRUPTED].contains(&code);
        self.line("error", json!({ "code": code, "retry": retry, "message": message }));
    }
}
