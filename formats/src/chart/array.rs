//! A chart in the memory of the caller: a job is planned from its size and wavelengths, and its pixels are given when a film is computed, so that
//! one job serves many arrays.

use std::path::Path;

use pipeline::flow::{ChartSource, SourceSinkError};
use pipeline::geometry::{Rect, Size};

use super::error::ChartError;
use super::options::NanPolicy;
use super::values::Values;

/// What messages call it.
const NAME: &str = "array";

/// Size and wavelengths of the arrays of a job.
#[derive(Clone, Debug)]
pub struct ArrayChart {
    size: Size,
    wavelengths_nm: Vec<f64>,
    nan: NanPolicy,
    values: Values,
}

impl ArrayChart {
    /// Arrays of a band of `size` at each of `wavelengths_nm`; `nan` is what becomes of pixels that are NaN or infinite.
    pub fn new(size: Size, wavelengths_nm: Vec<f64>, nan: NanPolicy) -> Self {
        Self { size, wavelengths_nm, nan, values: Values::default() }
    }

    /// Wavelengths of the bands, nm.
    pub fn wavelengths_nm(&self) -> &[f64] {
        &self.wavelengths_nm
    }

    /// Makes values beyond `max` in magnitude an error.
    pub fn limit_values(&mut self, max: f32) {
        self.values.max_magnitude = max;
    }

    /// The chart with `pixels`, (array, wavelength, y, x) of as many arrays as there are: band b of array i is read as band i·bands + b. Single bands may be
    /// given in their place, which are read by their index.
    ///
    /// # Panics
    /// `pixels` is not a whole number of bands.
    pub fn with_pixels<'a>(&'a self, pixels: &'a [f32]) -> ArrayPixels<'a> {
        assert_eq!(pixels.len() % self.size.pixels(), 0, "whole bands");
        ArrayPixels { chart: self, pixels }
    }
}

impl ChartSource for ArrayChart {
    fn size(&self) -> Size {
        self.size
    }

    fn read(&self, _band: usize, _rect: Rect, _out: &mut [f32]) -> Result<(), SourceSinkError> {
        Err("the pixels of an array are given when its film is computed".into())
    }
}

/// Arrays with their pixels.
#[derive(Clone, Copy, Debug)]
pub struct ArrayPixels<'a> {
    chart: &'a ArrayChart,
    pixels: &'a [f32],
}

impl ChartSource for ArrayPixels<'_> {
    fn size(&self) -> Size {
        self.chart.size
    }

    fn read(&self, band: usize, rect: Rect, out: &mut [f32]) -> Result<(), SourceSinkError> {
        let ArrayChart { size, wavelengths_nm, nan, values } = self.chart;
        let of_band = &self.pixels[band * size.pixels()..][..size.pixels()];
        for (y, line) in (rect.y as usize..).zip(out.chunks_exact_mut(rect.width.max(1))) {
            let row = &of_band[y * size.width + rect.x as usize..][..rect.width];
            line.copy_from_slice(row);
            if let Some((column, sample)) = values.check(band, line, |k| f64::from(row[k]), *nan).error {
                let place = (band % wavelengths_nm.len(), y, rect.x as usize + column);
                let error: ChartError =
                    sample.into_error(Path::new(NAME).into(), place, values.max_magnitude);
                return Err(error.into());
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rectangles_of_any_array_are_read_and_checked() {
        let mut pixels: Vec<f32> = (0..2 * 2 * 12).map(|i| i as f32).collect();
        let chart = ArrayChart::new(Size::new(3, 4), vec![500.0, 600.0], NanPolicy::Error);
        let mut out = [0.0; 4];
        let rect = Rect::new(1, 2, 2, 2);
        chart.with_pixels(&pixels).read(3, rect, &mut out).unwrap();
        assert_eq!(out, [42.0, 43.0, 46.0, 47.0]);
        assert!(chart.read(0, rect, &mut out).is_err(), "without pixels there is nothing to read");
        pixels[42] = f32::NAN;
        let error = chart.with_pixels(&pixels).read(3, rect, &mut out).unwrap_err().to_string();
        assert!(error.contains("chart array: NaN at band 1, row 1, column 2"), "{error}");
        let zero = ArrayChart { nan: NanPolicy::Zero, ..chart };
        zero.with_pixels(&pixels).read(3, rect, &mut out).unwrap();
        assert_eq!(out, [0.0, 43.0, 46.0, 47.0]);
    }
}
