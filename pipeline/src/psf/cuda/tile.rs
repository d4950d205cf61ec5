//! A tile of a batch.

use crate::geometry::Rect;

/// One tile of a batch, with the places of its input and output.
#[derive(Clone, Copy, Debug)]
pub struct PsfTile {
    /// On the film.
    pub rect: Rect,
    /// Index of its first value in the remapped tiles; its rows follow one another.
    pub remapped_offset: usize,
    /// Index of the first value of its contribution, whose size is that of [`BandPsf::reaches`](crate::psf::BandPsf::reaches).
    pub contribution_offset: usize,
    /// Values from one row of the contribution to the next.
    pub contribution_stride: usize,
}
