//! Linear sRGB rows from a stack of bands: (R, G, B) = Σ_b w_b·L_b, read once, averaged over area.

use std::collections::VecDeque;

use pipeline::colour::{self, Illuminant};

use super::area::{Grid, stream};
use super::{ChartSource, PictureError, Progress};

/// Receives a row of the picture in linear sRGB, and its number.
type EmitRow<'a> = dyn FnMut(usize, &[[f32; 3]]) -> Result<(), PictureError> + Send + 'a;

/// The bands that contribute to colour, and their weights in linear sRGB.
pub(super) struct VisibleBands {
    bands: Vec<usize>,
    weights: Vec<[f32; 3]>,
}

impl VisibleBands {
    /// Weights of the CIE 1931 2° observer, normalised to the light that shows as white.
    pub(super) fn new(bands_nm: &[f64], light: Illuminant) -> Result<Self, PictureError> {
        let weights = colour::srgb_weights(bands_nm, |nm| light.relative_power(nm) / 100.0);
        if weights.iter().flatten().all(|&w| w == 0.0) {
            return Err(PictureError::Invisible { bands_nm: bands_nm.to_vec(), white: light.name() });
        }
        // A band that contributes less than 1e-12 of white is invisible, and is neither read nor checked for missing samples.
        let bands: Vec<usize> =
            (0..weights.len()).filter(|&b| weights[b].iter().any(|w| w.abs() > 1e-12)).collect();
        let weights = bands.iter().map(|&b| weights[b].map(|w| w as f32)).collect();
        Ok(Self { bands, weights })
    }

    /// Reads the source once and emits the picture's rows, top to bottom. Returns the number of missing samples.
    pub(super) fn stream_rows(
        &self,
        source: &dyn ChartSource,
        grid: &Grid,
        threads: usize,
        progress: Progress<'_>,
        emit: &mut EmitRow<'_>,
    ) -> Result<u64, PictureError> {
        let last = self.bands.len() - 1;
        // Rows to which some bands have not been added yet: those of one strip of the source.
        let mut incomplete: VecDeque<Vec<[f32; 3]>> = VecDeque::new();
        let mut first = 0;
        stream(source, &self.bands, grid, threads, progress, &mut |position, y, means| {
            while incomplete.len() <= y - first {
                incomplete.push_back(vec![[0.0; 3]; grid.out.width]);
            }
            let w = self.weights[position];
            // NaN stays NaN in the sum: a pixel missing in one band is missing.
            let row = incomplete[y - first].iter_mut().zip(means);
            row.for_each(|(p, &v)| (0..3).for_each(|c| p[c] += w[c] * v));
            if position == last
                && let Some(row) = incomplete.pop_front()
            {
                first += 1;
                emit(y, &row)?;
            }
            Ok(())
        })
    }
}
