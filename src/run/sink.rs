//! The film store as the pipeline's sink.

use formats::film::{EncodedShard, FilmStore};
use pipeline::buffer::ShardPixels;
use pipeline::flow::{FilmSink, SourceSinkError};
use pipeline::geometry::Rect;
use pipeline::plan::ShardId;

/// Encodes and writes shards of a film.
pub struct FilmStoreSink<'a> {
    /// The film.
    pub store: &'a FilmStore,
    /// Band of the film per position of the job.
    pub film_bands: &'a [usize],
}

impl FilmSink for FilmStoreSink<'_> {
    type Encoded = EncodedShard;

    fn encode(&self, id: ShardId, _: Rect, pixels: &ShardPixels) -> Result<EncodedShard, SourceSinkError> {
        let (band, shard) = (self.film_bands[id.position], (id.row, id.col));
        Ok(self.store.encode_shard_rows(id.region, band, shard, pixels.size(), &|y| pixels.row(y))?)
    }

    fn commit(&self, encoded: EncodedShard) -> Result<u64, SourceSinkError> {
        self.store.commit(&encoded)?;
        Ok(encoded.bytes().len() as u64)
    }

    fn writers(&self) -> usize {
        FilmStore::concurrent_writes(self.store.path())
    }
}
