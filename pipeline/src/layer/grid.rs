//! The bins of a layer.

use crate::geometry::Size;

/// Largest side of a bin of a layer, film pixels.
pub const MAX_BIN_PX: usize = 64;

/// Bins of b × b film pixels, aligned with film pixel (0, 0), from `margin` bins before the film to as many behind it. The bins at the far
/// edges of the film are whole: what lies beyond the film in them are its surroundings.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BinGrid {
    /// Film size, px.
    pub film: Size,
    /// Side of a bin, film pixels.
    pub bin_px: usize,
    /// Bins around those of the film, on every side.
    pub margin: usize,
}

impl BinGrid {
    /// Bins of `bin_px` on a film of `film` px with `margin` bins around.
    ///
    /// # Panics
    /// `bin_px` is no power of two from 2 on.
    pub fn new(film: Size, bin_px: usize, margin: usize) -> Self {
        assert!(bin_px.is_power_of_two() && bin_px > 1, "bins of {bin_px} px");
        Self { film, bin_px, margin }
    }

    /// Whether bins of a layer may have this side.
    pub fn is_bin(bin_px: usize) -> bool {
        bin_px.is_power_of_two() && (2..=MAX_BIN_PX).contains(&bin_px)
    }

    /// Bins that hold film pixels.
    pub fn bins(&self) -> Size {
        Size::new(self.film.height.div_ceil(self.bin_px), self.film.width.div_ceil(self.bin_px))
    }

    /// All bins, margin included.
    pub fn size(&self) -> Size {
        let bins = self.bins();
        Size::new(bins.height + 2 * self.margin, bins.width + 2 * self.margin)
    }

    /// Index along an axis of the bin that is the `bin`-th from that of film pixel 0.
    ///
    /// # Panics
    /// The bin lies before the margin.
    pub(super) fn index(&self, bin: i64) -> usize {
        usize::try_from(bin + self.margin as i64).expect("a bin of the grid")
    }

    /// First film pixel of the first bin, of rows and of columns.
    pub fn first_pixel(&self) -> i64 {
        -((self.margin * self.bin_px) as i64)
    }
}
