//! What a restoration works on: pixels at their places, of bands or colour planes.

use pipeline::geometry::Size;

/// Pixels, where they are.
#[derive(Clone, Copy, Debug)]
pub struct Grid {
    /// Rows and columns.
    pub size: Size,
    /// Their pitch.
    pub pitch_um: f64,
    /// The optical axis: row, column.
    pub axis_px: (f64, f64),
}

/// A picture of one band, or of one colour plane: what is restored by itself.
#[derive(Clone, Debug)]
pub struct Plane {
    /// Name of a colour plane.
    pub name: Option<String>,
    /// Of its band; of a colour plane, the mean over its electrons of a film that has the same value in every band.
    pub wavelength_nm: f64,
    /// Bands of the film, and the share of each: 1 in all.
    pub bands: Vec<(usize, f64)>,
    /// Share of the pixels that measure it.
    pub density: f64,
    /// Variance of the noise that does not depend on the light over the value of an electron; 0 of a film.
    pub background: f64,
}

/// A part of a plane.
#[derive(Clone, Debug)]
pub struct Pixels {
    /// Film values, also between the pixels that measure the plane.
    pub values: Vec<f32>,
    /// σ² over the variance of each pixel, 0 where none is measured; none: 1.
    pub weights: Option<Vec<f32>>,
}
