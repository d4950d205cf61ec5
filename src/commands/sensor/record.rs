//! The record that a run leaves in the raw, and its last line.

use super::resolve::{RawJob, Source};
use super::write::{Done, seconds};
use crate::film::group;
use crate::machine::peak_resident;
use crate::progress::mib;
use crate::progress::plural;
use anyhow::Result;
use formats::object;
use formats::raw::RawStore;
use rustix::time::{ClockId, clock_gettime};
use serde_json::json;
use std::time::Instant;

/// Keeps what the run did, however it ended.
pub fn write(job: &RawJob, store: &RawStore, outcome: &Result<Done>, start: Start) {
    let done = outcome.as_ref().ok();
    let of = |f: fn(&Done) -> u64| done.map(f);
    let (bytes_read, chunks) = match &job.source {
        Source::Film(film, _) => Some(film.stats()).unzip(),
        Source::Kept(_) => (None, None),
    };
    let further = object! {
        "core_s": done.map(|d| json!({
            "film_and_signal": rest_s(d, start), "noise": d.noise_s, "encode_and_write": d.write_s
        })),
        "shards": of(|d| d.shards as u64),
        "bytes_written": of(|d| d.bytes),
        "bytes_read": bytes_read,
        "chunks_decoded": chunks,
        "signal_pixels": of(|d| d.pixels),
        "negative_pixels": of(|d| d.negative),
        "digital_numbers": of(|d| d.numbers),
        "clipped_at_white": of(|d| d.white),
        "clipped_at_0": of(|d| d.black),
    };
    let left = outcome.as_ref().map(|done| done.left);
    group::write_record(
        store.group(),
        left,
        (job.memory.threads, job.memory.limit as u64),
        start.wall,
        further,
    );
}

/// Core seconds of reading the film and making the signal: all since `start` but those of the shards.
fn rest_s(done: &Done, start: Start) -> f64 {
    (process_core_s() - start.core_s - done.noise_s - done.write_s).max(0.0)
}

/// When a raw was begun: by the clock, and by the CPU time of the process, which may have made the film before.
#[derive(Clone, Copy)]
pub struct Start {
    wall: Instant,
    core_s: f64,
}

impl Start {
    /// Now.
    pub fn now() -> Self {
        Self { wall: Instant::now(), core_s: process_core_s() }
    }
}

/// CPU time of this process, s.
fn process_core_s() -> f64 {
    seconds(clock_gettime(ClockId::ProcessCPUTime))
}

/// Core seconds, for `-v`.
pub fn details(job: &RawJob, done: &Done, start: Start) -> String {
    format!(
        "core seconds: film and signal {:.1}, noise {:.1}, encoding and writing {:.1}, on {}",
        rest_s(done, start),
        done.noise_s,
        done.write_s,
        plural(job.memory.threads, "thread")
    )
}

/// What was done, in a line.
pub fn summary(done: &Done, start: Start) -> String {
    let wall = start.wall.elapsed().as_secs_f64();
    format!(
        "{}, {:.1} Mpx exposed in {wall:.1} s; {:.2} % at white, {} at 0; {} written, peak memory {}",
        plural(done.shards, "shard"),
        done.numbers as f64 / 1e6,
        100.0 * done.white as f64 / done.numbers.max(1) as f64,
        done.black,
        mib(done.bytes as usize),
        peak_resident().map_or("unknown".into(), |b| mib(b as usize)),
    )
}
