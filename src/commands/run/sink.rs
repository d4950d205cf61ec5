//! The film store as the pipeline's sink.

use formats::film::{EncodedShard, FilmStore, FilmWriter};
use pipeline::buffer::ShardPixels;
use pipeline::depth::invented::InventedLight;
use pipeline::flow::{FilmSink, SourceSinkError};
use pipeline::geometry::Rect;
use pipeline::tiling::ShardId;
use std::sync::Mutex;

/// Encodes and writes shards of a film.
pub struct FilmStoreSink<'a> {
    /// The film.
    pub film: &'a FilmWriter<'a>,
    /// Band of the film per position of the job.
    pub film_bands: &'a [usize],
    /// Invented light of its tiles, if its shares are stored.
    pub invented: Option<&'a InventedLight>,
    /// Light of the shards encoded so far, and of it invented.
    pub light: Mutex<(f64, f64)>,
}

/// A shard, and the invented shares beside it.
pub struct EncodedFilm {
    shard: EncodedShard,
    invented: Option<EncodedShard>,
}

impl FilmSink for FilmStoreSink<'_> {
    type Encoded = EncodedFilm;

    fn encode(&self, id: ShardId, _: Rect, pixels: &ShardPixels) -> Result<EncodedFilm, SourceSinkError> {
        let (band, shard) = (self.film_bands[id.position], (id.row, id.col));
        let size = pixels.size();
        let invented = self.invented.map(|light| {
            let of_shard = light.of_shard(id, pixels);
            let mut sum = self.light.lock().expect("no panic while held");
            *sum = (sum.0 + of_shard.light, sum.1 + of_shard.invented);
            self.film.store().encode_invented(id.region, band, shard, size, &of_shard.shares)
        });
        let shard = self.film.store().encode_shard_rows(id.region, band, shard, size, &|y| pixels.row(y))?;
        Ok(EncodedFilm { shard, invented })
    }

    fn commit(&self, encoded: EncodedFilm) -> Result<u64, SourceSinkError> {
        // First the shares: a shard that exists has them.
        encoded.invented.iter().try_for_each(|shares| self.film.commit_beside(shares))?;
        self.film.commit(&encoded.shard)?;
        Ok(encoded.shard.bytes().len() as u64)
    }

    fn writers(&self) -> usize {
        FilmStore::concurrent_writes(self.film.store().path())
    }
}
