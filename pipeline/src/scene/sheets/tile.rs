//! Sheets of a tile as arrays.

use super::edges::Border;

/// One sheet of a tile of h × w px, row by row.
#[derive(Clone, Debug, PartialEq)]
pub struct Sheet {
    /// (basis, y, x): weights of the light of the surface alone; 0 where coverage is 0.
    pub weights: Vec<f32>,
    /// (y, x): z in m, infinity at vergence 0; 0 where coverage is 0.
    pub depth: Vec<f32>,
    /// (y, x): share of the pixel that the sheets before do not cover, 0 to 1.
    pub coverage: Vec<f32>,
    /// Pixels with coverage.
    pub pixels: usize,
}

impl Sheet {
    /// Without surfaces, of `pixels` px.
    pub(super) fn empty(pixels: usize, bases: usize) -> Self {
        Self {
            weights: vec![0.0; bases * pixels],
            depth: vec![0.0; pixels],
            coverage: vec![0.0; pixels],
            pixels: 0,
        }
    }

    /// Whether no pixel has coverage.
    pub fn is_empty(&self) -> bool {
        self.pixels == 0
    }
}

/// Sheet 0 of a tile.
#[derive(Clone, Debug, PartialEq)]
pub struct Front {
    /// The sheet.
    pub sheet: Sheet,
    /// Whether hidden sheets can be seen near the tile, as far as its own pixels say.
    pub has_edge: bool,
    /// For the comparison with neighbours.
    pub border: Border,
    /// Figures.
    pub counts: Counts,
}

/// What is counted while tiles are made; the sums do not depend on the order of tiles.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Counts {
    /// Samples.
    pub samples: u64,
    /// Samples whose first surface is nearer than the limit.
    pub near_samples: u64,
    /// The nearest surface: vergence in 1/m and triangle; of equal ones the lowest triangle.
    pub nearest: Option<(f64, u32)>,
    /// Pixels with more visible surfaces than sheets; the last sheet has their light.
    pub merged_pixels: u64,
    /// Samples in hidden sheets.
    pub hidden_samples: u64,
    /// Those that see the back of a triangle that is not of a solid.
    pub hidden_back_samples: u64,
    /// Hits beyond the largest number per sample.
    pub dropped_hits: u64,
}

impl Counts {
    /// Adds those of another tile.
    pub fn add(&mut self, other: &Self) {
        self.samples += other.samples;
        self.near_samples += other.near_samples;
        self.merged_pixels += other.merged_pixels;
        self.hidden_samples += other.hidden_samples;
        self.hidden_back_samples += other.hidden_back_samples;
        self.dropped_hits += other.dropped_hits;
        if let Some((vergence, triangle)) = other.nearest {
            self.find_nearest(vergence, triangle);
        }
    }

    #[inline]
    pub(super) fn find_nearest(&mut self, vergence: f64, triangle: u32) {
        if self.nearest.is_none_or(|(v, t)| vergence > v || (vergence == v && triangle < t)) {
            self.nearest = Some((vergence, triangle));
        }
    }
}
