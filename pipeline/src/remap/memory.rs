//! Memory of the remap stage, bytes.

use super::{BandMap, PART_COLS, PART_ROWS, Remap};
use crate::field::planar::{film_row_bytes, planar_table_bytes};
use crate::geometry::Size;
use crate::lens::LensBand;
use crate::tiling::Tiling;

/// Coordinates, fractions and gain of a film pixel; where the chart is averaged, its coordinates in f64.
const BYTES_PER_PIXEL: usize = 44;
/// Tables of a band per field point: buckets of the height table, knots of the anchors.
const BYTES_PER_FIELD_POINT: usize = 160;

impl Remap {
    /// Scratch of one worker for tiles of `tiling`, read from a chart of `chart` px: the coordinates of a part of the tile, and
    /// [`Remap::chart_area_bytes`].
    pub fn scratch_bytes(&self, tiling: &Tiling, chart: Size) -> usize {
        let pixels = PART_ROWS.min(tiling.tile()) * PART_COLS.min(tiling.tile());
        let row = match &self.band_map {
            BandMap::Radial { .. } => 0,
            BandMap::Planar(field) => film_row_bytes(field.cells().1),
        };
        self.chart_area_bytes(tiling, chart).saturating_add(BYTES_PER_PIXEL * pixels + row)
    }

    /// Chart pixels under a part of a tile, and the part of them inside the chart as it is read.
    pub fn chart_area_bytes(&self, tiling: &Tiling, chart: Size) -> usize {
        let all = self.max_chart_px(tiling);
        let inside = all.min(chart.pixels() as u64);
        usize::try_from(all.saturating_add(inside).saturating_mul(4)).unwrap_or(usize::MAX)
    }
}

/// Tables of `band` for lookup in film pixels.
pub fn table_bytes(band: &LensBand) -> usize {
    match &band.planar {
        None => BYTES_PER_FIELD_POINT * band.ideal_height_mm.len(),
        Some(planar) => planar_table_bytes((planar.map.y_mm.len(), planar.map.x_mm.len())),
    }
}
