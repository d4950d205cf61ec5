//! Display of a run's progress: bars or log lines for people, JSON lines for programs.

use crate::job::Job;
use crate::progress::Bars;
use crate::progress::jsonl::Jsonl;
use formats::film::FilmStore;
use pipeline::executor::Progress;
use pipeline::tiling::ShardId;

/// Display of progress.
pub enum Display<'a> {
    /// Bars or log lines on stderr.
    Bars(Bars),
    /// JSON lines on stdout.
    Lines {
        /// The writer.
        jsonl: &'a Jsonl,
        /// Translates positions to bands of the film.
        job: &'a Job,
        /// Translates shards to keys.
        store: &'a FilmStore,
    },
}

impl Display<'_> {
    /// Removes the bars from the terminal.
    pub fn finish(&self) {
        if let Self::Bars(bars) = self {
            bars.finish();
        }
    }
}

impl Progress for Display<'_> {
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
                let band = job.film_bands[id.position];
                jsonl.shard(&store.key(id.region, band, (id.row, id.col)), band, bytes);
            }
        }
    }
}
