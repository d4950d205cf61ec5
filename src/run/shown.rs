//! What a run shows while it goes: bars and words for people, or lines for programs.

use crate::job::Job;
use crate::progress::Bars;
use crate::progress::jsonl::Jsonl;
use formats::film::FilmStore;
use pipeline::executor::Progress;
use pipeline::plan::ShardId;

/// Progress on its way to whoever looks.
pub enum Shown<'a> {
    /// To people.
    Bars(Bars),
    /// To programs.
    Lines {
        /// The lines.
        jsonl: &'a Jsonl,
        /// What positions mean.
        job: &'a Job,
        /// What shards are called.
        store: &'a FilmStore,
    },
}

impl Shown<'_> {
    /// Leaves the terminal as it was.
    pub fn finish(&self) {
        if let Self::Bars(bars) = self {
            bars.finish();
        }
    }
}

impl Progress for Shown<'_> {
    fn band(&self, position: usize, pixels: u64) {
        if let Self::Bars(bars) = self {
            bars.band(position, pixels);
        }
    }

    fn tile(&self, position: usize, pixels: usize) {
        match self {
            Self::Bars(bars) => bars.tile(position, pixels),
            Self::Lines { jsonl, job, .. } => jsonl.tile(job.film_bands[position], pixels),
        }
    }

    fn shard(&self, id: ShardId, bytes: u64) {
        match self {
            Self::Bars(bars) => bars.shard(id, bytes),
            Self::Lines { jsonl, job, store } => {
                let band = job.film_bands[id.band];
                jsonl.shard(&store.key(id.window, band, (id.row, id.col)), band, bytes);
            }
        }
    }
}
