//! The levels of a raw's pyramid.
//!
//! Every level is a mosaic of the same pattern of half the resolution, made of means over pixels of one filter ([`super::mosaic`]), in
//! digital numbers, frame by frame: a viewer shows it as it shows the raw, and it is developed as the raw is. The signal has no levels.

use pipeline::geometry::{Rect, Size};
use pipeline::tiling::FilmRegion;
use serde_json::Value;

use super::{Period, RawStore, codec_error, halve_mosaic, mosaic_below, ome};
use crate::chart::ChartOptions;
use crate::group::{GroupError, JobGroup, Output, ShardFile};
use crate::pyramid::{Halving, LevelReader, Pyramid, PyramidSource};
use crate::shard::ShardEncoder;

impl RawStore {
    /// The raw's pyramid.
    pub fn pyramid(&self) -> Pyramid<'_> {
        Pyramid(self)
    }

    /// Rows and columns of the period of its mosaic.
    ///
    /// # Errors
    /// [`GroupError::Damaged`] if it does not record its pattern.
    pub fn period(&self) -> Result<Period, GroupError> {
        let pattern = self.attributes.get("cfa").and_then(|cfa| cfa["pattern"].as_array());
        let rows = pattern.map_or(0, Vec::len);
        let columns = pattern.and_then(|p| p.first()?.as_array()).map_or(0, Vec::len);
        match (1..=8).contains(&rows) && (1..=8).contains(&columns) {
            true => Ok((rows, columns)),
            false => Err(self.group.damaged("zarr.json", "attributes with the pattern of the mosaic")),
        }
    }

    /// The encoded shard with pixels `rect`, in a shard of `shape`, of the level above `below`.
    fn halve_shard(
        &self,
        below: &LevelReader<'_>,
        period: Period,
        rect: Rect,
        shape: Size,
    ) -> Result<Vec<u8>, GroupError> {
        let mut counts = vec![0u16; rect.size().pixels()];
        let (mut pixels, mut means) = (Vec::new(), Vec::new());
        for (k, line) in counts.chunks_mut(self.spec.chunk * rect.width).enumerate() {
            let first = rect.y + (k * self.spec.chunk) as i64;
            let part = Rect::new(first, rect.x, line.len() / rect.width, rect.width);
            let source = mosaic_below(part, below.size(), period);
            below.read(source, &mut pixels)?;
            means.resize(line.len(), 0.0);
            halve_mosaic(&pixels, source, period, part, &mut means);
            // Rounded means of 16-bit numbers.
            std::iter::zip(line, &means).for_each(|(count, mean)| *count = *mean as u16);
        }
        let encoded =
            self.counts.encode_counts(&counts, (rect.height, rect.width), self.counts.chunks_of(shape));
        encoded.map_err(codec_error)
    }
}

impl PyramidSource for RawStore {
    fn group(&self) -> &JobGroup {
        &self.group
    }

    fn arrays(&self) -> Vec<(&str, Size)> {
        self.spec.outputs.iter().map(Output::array).collect()
    }

    fn bands(&self) -> usize {
        self.spec.exposure_s.len()
    }

    fn source_files(&self) -> Vec<ShardFile<'_>> {
        let frames = self.spec.all_shards().into_iter().filter(|shard| shard.frame.is_some());
        frames.map(|shard| self.shard_file(shard)).collect()
    }

    fn own_attributes(&self) -> Value {
        Value::Object(self.spec.attributes(&self.attributes))
    }

    fn encoder(&self) -> &ShardEncoder {
        &self.counts
    }

    fn level_grid(&self, size: Size) -> FilmRegion {
        self.spec.grid_of(size.rect())
    }

    fn level_array(&self, output: usize, size: Size) -> Value {
        self.spec.counts_array(&self.spec.outputs[output], size)
    }

    fn reader_options(&self) -> ChartOptions {
        ChartOptions {
            cache_bytes: 0,
            // Frames take the place of bands, which have wavelengths.
            wavelengths_nm: Some((1..=self.spec.exposure_s.len()).map(|f| f as f64).collect()),
            ..ChartOptions::default()
        }
    }

    /// Digital numbers of its shard, rows of the level before and of this one, and the encoded shard.
    fn worker_bytes(&self) -> usize {
        let (shard, chunk) = (self.spec.shard, self.spec.chunk);
        2 * 2 * shard * shard + 4 * (2 * (chunk + 8)) * (2 * shard + 16) + 4 * chunk * shard
    }

    fn halving(&self) -> Result<Halving<'_>, GroupError> {
        let period = self.period()?;
        Ok(Box::new(move |below, rect, shape| self.halve_shard(below, period, rect, shape)))
    }

    fn ome_attribute(&self) -> Result<Value, GroupError> {
        Ok(ome::ome_attribute(self))
    }
}
