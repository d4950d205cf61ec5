//! The film store as the pipeline's sink.

use formats::film::{EncodedShard, FilmStore};
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

    fn encode(&self, id: ShardId, rect: Rect, pixels: &[f32]) -> Result<EncodedShard, SourceSinkError> {
        // The chart's values are finite, so only a product beyond the range of f32 is not.
        if let Some(i) = pixels.iter().position(|v| !v.is_finite()) {
            let (row, column) = (rect.y + (i / rect.width) as i64, rect.x + (i % rect.width) as i64);
            return Err(format!(
                "row {row}, column {column} of the film is {}: chart values times illumination and film units exceed the range of \
                 float32; scale the chart down",
                pixels[i]
            )
            .into());
        }
        Ok(self.store.encode_shard(id.region, self.film_bands[id.band], (id.row, id.col), pixels)?)
    }

    fn commit(&self, encoded: EncodedShard) -> Result<u64, SourceSinkError> {
        self.store.commit(&encoded)?;
        Ok(encoded.bytes().len() as u64)
    }

    fn writers(&self) -> usize {
        FilmStore::concurrent_writes(self.store.path())
    }
}
