//! Weights of the bands of a pass in the planes of a column block.

use super::super::Sensor;
use super::super::field_sums::{Columns, RowNodes};
use super::super::field_weights::FieldWeights;
use super::super::row_sums::{factor_tile, tile};
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
    /// `columns` of the window among the nodes of the field of `plane`.
    pub(super) fn nodes(&self, plane: &BandWeights, columns: &Range<usize>) -> Option<Columns> {
        let first = self.window.x as usize;
        plane.1.as_ref().map(|field| field.columns(first + columns.start..first + columns.end))
    }

    /// Weights of bands in a row of the mosaic, of a plane's `weights`: a tile for each band.
    pub(super) fn row_weights<'w>(&self, weights: &'w [f64], phase: usize, bands: usize) -> &'w [f64] {
        let of_row = bands * tile(self.sensor.pattern.columns);
        &weights[phase * of_row..][..of_row]
    }

    /// Weights of bands for the columns of a column block by plane: row by row of the mosaic, band by band, a tile; none where they differ over the sensor.
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
            weights.clear();
            if plane.1.is_some() {
                continue;
            }
            for row in 0..pattern.rows {
                for band in bands.clone() {
                    let of = |x: usize| plane.0[pattern.channel(row, first + x)][band];
                    weights.extend((0..tile(pattern.columns)).map(of));
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
                    factors.extend((0..factor_tile(pattern.columns)).map(of));
                }
            }
        }
    }

    /// Weights of row `row` of the window by plane, where they differ over the sensor.
    pub(super) fn weigh_row(
        &self,
        bands: &Range<usize>,
        row: usize,
        column_block: &ColumnBlock,
        fields: &mut Vec<RowNodes>,
    ) {
        let pattern = &self.sensor.pattern;
        let row = self.window.y as usize + row;
        let first = self.window.x as usize + column_block.columns.start;
        let channels: Vec<usize> = (0..pattern.columns).map(|x| pattern.channel(row, first + x)).collect();
        fields.resize_with(self.planes.len(), RowNodes::default);
        for ((plane, columns), own) in self.planes.iter().zip(&column_block.nodes).zip(fields) {
            if let (Some(field), Some(columns)) = (&plane.1, columns) {
                own.set((field, &plane.0), bands.clone(), (row, columns), &channels);
            }
        }
    }
}
