//! Weights of the bands of a pass in the planes of a column block.

use super::super::Sensor;
use super::super::field_weights::{FieldWeights, interpolated};
use super::super::row_sums::tile;
use super::{ColumnBlock, Pass};
use std::ops::Range;
use std::sync::Arc;

/// Weights of the bands of a film for each filter, and what they have in addition where they differ over the sensor.
#[derive(Clone, Debug, PartialEq)]
pub struct BandWeights(pub(super) Vec<Vec<f64>>, pub(super) Option<Arc<FieldWeights>>);

impl BandWeights {
    /// Electrons per second of a mean spectral irradiance (W m⁻² nm⁻¹), times `factors`, the irradiance of a film value of 1 in each band.
    pub fn electrons(sensor: &Sensor, bands_nm: &[f64], factors: &[f64]) -> Self {
        let of = |channel| sensor.electron_weights(channel, (bands_nm, factors));
        Self((0..sensor.channels.len()).map(of).collect(), None)
    }

    /// With those of the directions of the light, made with the same factors.
    #[must_use]
    pub fn with_field(self, field: Option<Arc<FieldWeights>>) -> Self {
        Self(self.0, field)
    }

    /// The same weights behind every filter.
    pub fn uniform(sensor: &Sensor, weights: &[f64]) -> Self {
        Self(vec![weights.to_vec(); sensor.channels.len()], None)
    }
}

impl Pass<'_> {
    /// Nodes of the field of `plane` around `columns` of the window.
    pub(super) fn nodes(&self, plane: &BandWeights, columns: &Range<usize>) -> Vec<(usize, [f64; 4])> {
        let first = self.window.x as usize;
        let of = |field: &Arc<FieldWeights>| field.column_taps(columns.clone().map(|x| first + x));
        plane.1.as_ref().map_or_else(Vec::new, of)
    }

    /// Weights of bands in a row of the mosaic, of a plane's `weights`, and the columns of their tiles.
    pub(super) fn row_weights<'w>(
        &self,
        weights: &'w [f64],
        phase: usize,
        bands: usize,
    ) -> (&'w [f64], usize) {
        let of_row = weights.len() / self.sensor.pattern.rows;
        (&weights[phase * of_row..][..of_row], of_row / bands)
    }

    /// Weights of bands for the columns of a column block by plane: row by row of the mosaic, band by band, a tile, or all columns where they differ over the sensor.
    pub(super) fn weigh_columns(
        &self,
        bands: &Range<usize>,
        column_block: &ColumnBlock,
        weights: &mut Vec<Vec<f64>>,
    ) {
        let pattern = &self.sensor.pattern;
        let first = self.window.x as usize + column_block.columns.start;
        weights.resize_with(self.planes.len(), Vec::new);
        for (plane, weights) in self.planes.iter().zip(weights) {
            let columns = match plane.1 {
                None => tile(pattern.columns),
                Some(_) => column_block.columns.len(),
            };
            weights.clear();
            for row in 0..pattern.rows {
                for band in bands.clone() {
                    let of = |x: usize| plane.0[pattern.channel(row, first + x)][band];
                    weights.extend((0..columns).map(of));
                }
            }
        }
    }

    /// Factors of the corrections: row by row of the mosaic, correction by correction, band by band.
    pub(super) fn factors(&self, bands: Range<usize>, column_block: &ColumnBlock, factors: &mut Vec<f32>) {
        let pattern = &self.sensor.pattern;
        let first = self.window.x as usize + column_block.columns.start;
        factors.clear();
        for row in 0..pattern.rows {
            for correction in self.corrections {
                for band in bands.clone() {
                    let of = |x: usize| correction[pattern.channel(row, first + x)][band] as f32;
                    factors.extend((0..tile(pattern.columns)).map(of));
                }
            }
        }
    }

    /// Weights of row `row` of the window, where they differ over the sensor.
    pub(super) fn weigh_row(
        &self,
        bands: &Range<usize>,
        row: usize,
        column_block: &ColumnBlock,
        weights: &mut [Vec<f64>],
        lines: &mut Vec<Vec<f64>>,
    ) {
        let (pattern, n) = (&self.sensor.pattern, column_block.columns.len());
        let row = self.window.y as usize + row;
        let phase = row % pattern.rows;
        let channels = &pattern.channels[phase * pattern.columns..][..pattern.columns];
        let first = self.window.x as usize + column_block.columns.start;
        for ((plane, nodes), weights) in self.planes.iter().zip(&column_block.nodes).zip(weights) {
            let Some(field) = &plane.1 else { continue };
            lines.resize_with(pattern.columns, Vec::new);
            let own = &mut weights[phase * bands.len() * n..][..bands.len() * n];
            for (band, to) in bands.clone().zip(own.chunks_mut(n)) {
                for (line, channel) in lines.iter_mut().zip(channels) {
                    field.line((*channel, band), row, line);
                }
                // Column by column of the mosaic.
                for (column, line) in lines.iter().enumerate() {
                    let begin = (column + pattern.columns - first % pattern.columns) % pattern.columns;
                    let uniform = plane.0[channels[column]][band];
                    let own = to.iter_mut().zip(nodes).skip(begin).step_by(pattern.columns);
                    own.for_each(|(to, taps)| *to = uniform + interpolated(line, taps));
                }
            }
        }
    }
}
