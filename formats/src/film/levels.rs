//! The levels of a film's pyramid.
//!
//! ```text
//! level n (i, j) = mean of the finite ones of level n−1 (2i, 2j), (2i, 2j+1), (2i+1, 2j), (2i+1, 2j+1);  NaN if there is none
//! ```

use pipeline::geometry::{Rect, Size};
use pipeline::tiling::FilmRegion;
use serde_json::Value;

use super::store::FilmStore;
use super::{FilmSpec, ome};
use crate::chart::{ChartOptions, NanPolicy};
use crate::group::{GroupError, JobGroup, Output, ShardFile};
use crate::pyramid::{Halving, LevelReader, Pyramid, PyramidSource, halve, level_sizes};
use crate::shard::ShardEncoder;

impl FilmStore {
    /// The film's pyramid.
    pub fn pyramid(&self) -> Pyramid<'_> {
        Pyramid(self)
    }

    /// The encoded shard with pixels `rect`, in a shard of `shape`, of the level above `below`.
    fn halve_shard(&self, below: &LevelReader<'_>, rect: Rect, shape: Size) -> Result<Vec<u8>, GroupError> {
        let mut means = vec![0f32; rect.size().pixels()];
        let mut rows_below = Vec::new();
        for (k, out) in means.chunks_mut(self.spec.chunk * rect.width).enumerate() {
            let (first, rows) = (rect.y as usize + k * self.spec.chunk, out.len() / rect.width);
            let source = Rect::new(2 * first as i64, 2 * rect.x, 2 * rows, 2 * rect.width)
                .intersect(below.size().rect());
            below.read(source, &mut rows_below)?;
            halve(&rows_below, source.size(), out);
        }
        let encoded = self.encoder.encode(&means, (rect.height, rect.width), self.encoder.chunks_of(shape));
        encoded.map_err(|e| GroupError::Level {
            place: below.place(),
            reason: format!("{e} of {rect} of the next level"),
        })
    }
}

impl PyramidSource for FilmStore {
    fn group(&self) -> &JobGroup {
        &self.group
    }

    fn arrays(&self) -> Vec<(&str, Size)> {
        self.spec.outputs.iter().map(Output::array).collect()
    }

    fn bands(&self) -> usize {
        self.spec.wavelengths_nm.len()
    }

    fn source_files(&self) -> Vec<ShardFile<'_>> {
        self.shard_files()
    }

    fn own_attributes(&self) -> Value {
        self.spec.attributes(&self.provenance)
    }

    fn encoder(&self) -> &ShardEncoder {
        &self.encoder
    }

    fn level_grid(&self, size: Size) -> FilmRegion {
        self.spec.grid_of(size.rect())
    }

    fn level_array(&self, output: usize, size: Size) -> Value {
        self.spec.array(&self.spec.outputs[output], size)
    }

    fn reader_options(&self) -> ChartOptions {
        ChartOptions {
            // Rows are read in multiples of inner chunks: no chunk is requested twice.
            cache_bytes: 0,
            nan: NanPolicy::Keep,
            wavelengths_nm: Some(self.spec.wavelengths_nm.clone()),
            ..ChartOptions::default()
        }
    }

    /// Its shard, rows of the level before, and the encoded shard.
    fn worker_bytes(&self) -> usize {
        let (FilmSpec { shard, chunk, .. }, sample) = (&self.spec, size_of::<f32>());
        2 * shard * shard * sample + 4 * chunk * shard * sample + 4 * chunk * chunk * sample
    }

    fn halving(&self) -> Result<Halving<'_>, GroupError> {
        Ok(Box::new(|below, rect, shape| self.halve_shard(below, rect, shape)))
    }

    fn ome_attribute(&self) -> Result<Value, GroupError> {
        let last = level_sizes(self.spec.outputs[0].rect.size()).len() - 1;
        let mut whites = Vec::new();
        self.pyramid().for_each_band((0, last), |pixels| whites.push(ome::white_level(pixels)))?;
        Ok(ome::ome_attribute(self, &whites))
    }
}
