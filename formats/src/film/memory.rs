//! Memory of encoding the shards of a film, bytes.

use super::spec::FilmSpec;

impl FilmSpec {
    /// Encoded shards of `pixels` pixels in all: codecs hardly enlarge them.
    pub fn encoded_bytes(&self, pixels: usize) -> usize {
        pixels * self.sample.bytes()
    }

    /// An inner chunk while it is encoded: its samples, the same after the shuffle, and the compressed bytes.
    pub fn encode_scratch_bytes(&self) -> usize {
        3 * self.chunk * self.chunk * self.sample.bytes()
    }
}
