//! Bands of a MAT-file: planes of a stored array, or of a linear model of coefficients. Within a plane columns follow each other, so that a plane is read whole.

use std::io::Read;
use std::path::PathBuf;

use pipeline::geometry::Size;

use super::mat_error;
use crate::chart::decoded_chart::{BandDecoder, Sink};
use crate::chart::error::ChartError;
use crate::chart::header::open_regular;
use crate::mat::{MatArray, MatError, Stream};
use crate::parallel::Progress;

/// Where the samples of a chart come from.
#[derive(Debug)]
pub(super) enum Samples {
    /// Its own array.
    Stored(MatArray),
    /// Σ_k coefficients·basis + mean, at least 0.
    Model {
        coefficients: MatArray,
        /// Number of coefficients a pixel.
        count: usize,
        /// (band, k), bands fastest.
        basis: Vec<f64>,
        /// A number a band.
        mean: Vec<f64>,
    },
}

impl Samples {
    /// Bytes of what is in memory at a time, of planes of `pixels`, without the band that is given on.
    pub(super) fn largest_bytes(&self, pixels: usize) -> usize {
        match self {
            Self::Stored(array) => pixels.saturating_mul(array.number.bytes()),
            Self::Model { count, .. } => pixels.saturating_mul(size_of::<f64>()).saturating_mul(*count),
        }
    }
}

/// The decoder of a file.
#[derive(Debug)]
pub(super) struct Bands {
    pub(super) path: PathBuf,
    pub(super) size: Size,
    pub(super) is_big_endian: bool,
    pub(super) samples: Samples,
}

impl Bands {
    /// The next plane of `array`, rows fastest as it is stored.
    fn plane(&self, stream: &mut Stream<'_>, array: &MatArray) -> Result<Vec<f64>, MatError> {
        let pixels = self.size.pixels();
        let mut bytes = vec![0; pixels * array.number.bytes()];
        stream.read_exact(&mut bytes)?;
        Ok((0..pixels).map(|k| array.number.read(&bytes, k, self.is_big_endian)).collect())
    }

    /// The values of a plane, row after row, in native order of bytes.
    fn rows(&self, value: impl Fn(usize) -> f64) -> Vec<u8> {
        let Size { height, width } = self.size;
        let place = |k: usize| (k % width) * height + k / width;
        (0..height * width).flat_map(|k| value(place(k)).to_ne_bytes()).collect()
    }
}

impl BandDecoder for Bands {
    fn decode(
        &self,
        bands: &[usize],
        _threads: usize,
        progress: Progress<'_>,
        sink: Sink<'_>,
    ) -> Result<(), ChartError> {
        let failed = |e: MatError| mat_error(&self.path, e);
        let file = open_regular(&self.path)?;
        match &self.samples {
            Samples::Stored(array) => {
                let mut stream = array.samples(&file).map_err(failed)?;
                let plane_bytes = (self.size.pixels() * array.number.bytes()) as u64;
                let mut next = 0;
                for (done, &band) in bands.iter().enumerate() {
                    stream.skip((band - next) as u64 * plane_bytes).map_err(|e| failed(e.into()))?;
                    next = band + 1;
                    let plane = self.plane(&mut stream, array).map_err(failed)?;
                    sink(&self.path, band, 0, 0, &self.rows(|k| plane[k]))?;
                    progress(done as u64 + 1, bands.len() as u64);
                }
            }
            Samples::Model { coefficients, count, basis, mean } => {
                let mut stream = coefficients.samples(&file).map_err(failed)?;
                let planes = (0..*count).map(|_| self.plane(&mut stream, coefficients));
                let planes = planes.collect::<Result<Vec<_>, _>>().map_err(failed)?;
                for (done, &band) in bands.iter().enumerate() {
                    let of_band = |k: usize| basis[k * mean.len() + band];
                    let value = |at: usize| {
                        let sum: f64 =
                            planes.iter().enumerate().map(|(k, plane)| plane[at] * of_band(k)).sum();
                        // Not `max`, which would make 0 of NaN.
                        let value = sum + mean[band];
                        if value < 0.0 { 0.0 } else { value }
                    };
                    sink(&self.path, band, 0, 0, &self.rows(value))?;
                    progress(done as u64 + 1, bands.len() as u64);
                }
            }
        }
        Ok(())
    }

    /// A plane as it is stored and as numbers, or all coefficients; and the band.
    fn thread_bytes(&self) -> usize {
        let pixels = self.size.pixels();
        self.samples.largest_bytes(pixels) + 2 * size_of::<f64>() * pixels
    }
}
