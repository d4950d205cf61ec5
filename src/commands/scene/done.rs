//! What a command made of a scene.

use pipeline::scene::sheets::Counts;

/// What was made.
#[derive(Default)]
pub struct Done {
    /// Shards made.
    pub shards: usize,
    /// Shards still missing.
    pub left: usize,
    /// Bytes of them.
    pub bytes: u64,
    /// What was counted in the tiles.
    pub counts: Counts,
}
