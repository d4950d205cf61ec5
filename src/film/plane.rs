//! Where the pixels of a film, or of one window of it, are.

use formats::film::FilmSpec;
use pipeline::geometry::Size;

/// Where the pixels of a film, or of one window of it, are.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FilmPlane {
    /// Size of the array in pixels.
    pub size: Size,
    /// Pixel pitch, µm.
    pub pitch_um: f64,
    /// Optical axis (y, x) from the array's middle, µm.
    pub axis_um: (f64, f64),
}

impl FilmPlane {
    /// That of an output of a film.
    pub fn new(film: &FilmSpec, output: usize) -> Self {
        let (rect, pitch_um) = (film.outputs[output].rect, film.pitch_um);
        let axis =
            |axis: f64, first: i64, n: usize| (axis - first as f64 - (n as f64 - 1.0) / 2.0) * pitch_um;
        let axis_um = (axis(film.axis_px.0, rect.y, rect.height), axis(film.axis_px.1, rect.x, rect.width));
        Self { size: rect.size(), pitch_um, axis_um }
    }
}
