//! Environment: radiance from all directions, as a map of latitude and longitude.
//!
//! Pixel (row i, column j) of H × W has azimuth 360°·(j + ½)/W and elevation 90° − 180°·(i + ½)/H in the sense of [`super::horizon::Horizon`]: north is at the
//! left edge, east at a quarter, south in the middle, up in the first row. With y up the middle is +Z and a quarter +X, as in maps of
//! OpenEXR.
//! The background is the map, bilinear. Light on surfaces is sampled in few directions: it comes from the means over 1/64 of the width and 1/32 of the
//! height, weighted by solid angle, so that a small source in the map is neither missed nor counted twice; it lights as one of that size.

use super::horizon::Horizon;
use super::weights::LightSpectrum;
use crate::real;
use std::f64::consts::PI;

/// Maximum columns and rows of the means that light surfaces.
const MEANS: (usize, usize) = (64, 32);

/// A map that is none.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum EnvironmentError {
    /// Sizes that do not fit.
    #[error(
        "the environment has {found} values; expected {height} rows of {width} pixels of {channels} channels, at least one of each"
    )]
    Size {
        /// Rows.
        height: usize,
        /// Columns.
        width: usize,
        /// Channels.
        channels: usize,
        /// Values.
        found: usize,
    },
    /// A value that is no radiance.
    #[error(
        "the environment is {found} at row {row}, column {column}, channel {channel}; radiances are finite and 0 or more"
    )]
    Value {
        /// Row.
        row: usize,
        /// Column.
        column: usize,
        /// Channel.
        channel: usize,
        /// The value.
        found: f32,
    },
    /// Wavelengths that do not increase.
    #[error("the bands of the environment at {0} and {1} nm are not in order of wavelength")]
    Order(f64, f64),
}

/// Channels of a map.
#[derive(Clone, Debug, PartialEq)]
enum Channels {
    /// Linear red, green and blue, cd/m² of white.
    Colours,
    /// Radiance at these wavelengths in nm, W m⁻² sr⁻¹ nm⁻¹.
    Bands(Vec<f64>),
}

/// The map and the directions of its axes.
#[derive(Clone, Debug)]
pub struct Environment {
    channels: Channels,
    picture: Picture,
    means: Picture,
    horizon: Horizon,
}

/// (row, column, channel).
#[derive(Clone, Debug)]
struct Picture {
    width: usize,
    height: usize,
    channels: usize,
    values: Vec<f32>,
}

impl Environment {
    /// Of linear red, green and blue, (row, column, 3), that times `luminance` are cd/m² of white.
    ///
    /// # Errors
    /// [`EnvironmentError`] for sizes that do not fit, or values that are negative or not finite.
    pub fn of_colours(
        (height, width): (usize, usize),
        mut values: Vec<f32>,
        luminance: f32,
        horizon: Horizon,
    ) -> Result<Self, EnvironmentError> {
        values.iter_mut().for_each(|v| *v *= luminance);
        Self::new(Channels::Colours, Picture { width, height, channels: 3, values }, horizon)
    }

    /// Of radiances at increasing `wavelengths_nm`, (row, column, band), W m⁻² sr⁻¹ nm⁻¹.
    ///
    /// # Errors
    /// [`EnvironmentError`] likewise, or for another order of wavelengths.
    pub fn of_bands(
        (height, width): (usize, usize),
        wavelengths_nm: Vec<f64>,
        values: Vec<f32>,
        horizon: Horizon,
    ) -> Result<Self, EnvironmentError> {
        if let Some(w) = wavelengths_nm.windows(2).find(|w| w[0].is_nan() || w[1].is_nan() || w[0] >= w[1]) {
            return Err(EnvironmentError::Order(w[0], w[1]));
        }
        let channels = wavelengths_nm.len();
        Self::new(Channels::Bands(wavelengths_nm), Picture { width, height, channels, values }, horizon)
    }

    fn new(channels: Channels, picture: Picture, horizon: Horizon) -> Result<Self, EnvironmentError> {
        let Picture { width, height, channels: count, ref values } = picture;
        let expected = height.checked_mul(width).and_then(|n| n.checked_mul(count));
        if values.is_empty() || expected != Some(values.len()) {
            return Err(EnvironmentError::Size { height, width, channels: count, found: values.len() });
        }
        if let Some(i) = values.iter().position(|v| !(*v >= 0.0 && v.is_finite())) {
            let (row, column, channel) = (i / count / width, i / count % width, i % count);
            return Err(EnvironmentError::Value { row, column, channel, found: values[i] });
        }
        let means = picture.means();
        Ok(Self { channels, picture, means, horizon })
    }

    /// Number of channels.
    pub fn channels(&self) -> usize {
        self.picture.channels
    }

    /// Whether the channels are bands.
    pub fn is_spectral(&self) -> bool {
        self.channels != Channels::Colours
    }

    /// Spectra of the light of each channel.
    pub fn light_spectra(&self) -> Vec<LightSpectrum> {
        match &self.channels {
            Channels::Colours => {
                [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(LightSpectrum::Colour).into()
            }
            Channels::Bands(nm) => {
                (0..nm.len()).map(|band| LightSpectrum::Band { wavelengths_nm: nm.clone(), band }).collect()
            }
        }
    }

    /// Adds the value of each channel in a direction of the camera frame, as a background, to `sums`.
    pub fn add_background(&self, direction: [f64; 3], sums: &mut [f64]) {
        self.picture.add(self.horizon.angles_rad(direction), sums);
    }

    /// The same of the means that light surfaces.
    pub(super) fn add_light(&self, direction: [f64; 3], sums: &mut [f64]) {
        self.means.add(self.horizon.angles_rad(direction), sums);
    }
}

impl Picture {
    fn add(&self, (azimuth_rad, elevation_rad): (f64, f64), sums: &mut [f64]) {
        let x = azimuth_rad / (2.0 * PI) * self.width as f64 - 0.5;
        let y = (0.5 - elevation_rad / PI) * self.height as f64 - 0.5;
        let (x0, y0) = (x.floor(), y.floor());
        let (tx, ty) = (x - x0, y - y0);
        let column = |i: i64| i.rem_euclid(self.width as i64) as usize;
        let row = |i: i64| i.clamp(0, self.height as i64 - 1) as usize;
        let (x0, y0) = (x0 as i64, y0 as i64);
        for (r, wy) in [(row(y0), 1.0 - ty), (row(y0 + 1), ty)] {
            for (c, wx) in [(column(x0), 1.0 - tx), (column(x0 + 1), tx)] {
                let at = &self.values[(r * self.width + c) * self.channels..][..self.channels];
                sums.iter_mut().zip(at).for_each(|(sum, v)| *sum += wy * wx * f64::from(*v));
            }
        }
    }

    /// Means over at most [`MEANS`] cells of equal angles, weighted by solid angle.
    fn means(&self) -> Self {
        let (width, height) = (self.width.min(MEANS.0), self.height.min(MEANS.1));
        let mut values = Vec::with_capacity(width * height * self.channels);
        for row in 0..height {
            let rows = overlaps(row, height, self.height);
            // Of a row of pixels: difference of the sines of its edges, up to a factor that is that of all rows.
            let solid_angle = |r: usize| real::cos(PI * ((r as f64 + 0.5) / self.height as f64 - 0.5));
            for column in 0..width {
                let columns = overlaps(column, width, self.width);
                let mut sums = vec![0.0; self.channels];
                let mut total = 0.0;
                for (r, share) in rows.clone() {
                    for (c, share) in columns.clone().map(|(c, s)| (c, s * share * solid_angle(r))) {
                        total += share;
                        let at = &self.values[(r * self.width + c) * self.channels..][..self.channels];
                        sums.iter_mut().zip(at).for_each(|(sum, v)| *sum += share * f64::from(*v));
                    }
                }
                values.extend(sums.iter().map(|v| (v / total) as f32));
            }
        }
        Self { width, height, channels: self.channels, values }
    }
}

/// The pixels of a side of `n` that cell `i` of `m` covers, and how much of each.
fn overlaps(i: usize, m: usize, n: usize) -> impl Iterator<Item = (usize, f64)> + Clone {
    // In units of 1/m of a pixel the cell is from i·n to (i + 1)·n, pixel p from p·m to (p + 1)·m.
    let (from, to) = (i * n, (i + 1) * n);
    (from / m..to.div_ceil(m)).map(move |p| {
        let covered = to.min((p + 1) * m) - from.max(p * m);
        (p, covered as f64 / m as f64)
    })
}

#[cfg(test)]
mod tests;
