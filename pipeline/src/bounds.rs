//! Bounds of numbers read from outside: attributes of charts and films, lens packs, imports, command line, plan files. Those of sensor
//! descriptions are checked by `formats::sensor`.
//!
//! Readers check a number before computing with it or allocating memory for it. The bounds are wider than any camera, microscope or
//! telescope, and narrow enough that products of a few of them do not overflow f64 (or, for counts, u64) and no quotient is NaN. A
//! number beyond them indicates a damaged file or a wrong unit.

use crate::geometry::Size;
use std::fmt;
use thiserror::Error;

/// Minimum and maximum of a quantity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bound {
    /// Name of the quantity.
    pub name: &'static str,
    /// Unit, as printed in errors; empty for a ratio.
    pub unit: &'static str,
    /// Minimum.
    pub min: f64,
    /// Maximum.
    pub max: f64,
}

/// A number outside its bound.
#[derive(Clone, Debug, Error, PartialEq)]
#[error("{} is {found}, expected {bound}", bound.name)]
pub struct OutOfBounds {
    /// The bound.
    pub bound: Bound,
    /// The number, with its unit.
    pub found: String,
}

/// Wavelength in nm: soft X-rays (the shortest light that a lens or mirror of this kind images) to 1 mm (sub-millimetre waves).
pub const WAVELENGTH_NM: Bound = bound("the wavelength", "nm", 1.0, 1e6);
/// Pixel pitch of a film or chart and sample pitch of a PSF, µm: 1 nm (far below any wavelength above) to 1 m.
pub const PITCH_UM: Bound = bound("the pitch", "µm", 1e-3, 1e6);
/// Ideal and REAL image heights in mm: up to 100 m, beyond the focal surface of any telescope.
pub const HEIGHT_MM: Bound = bound("the image height", "mm", 0.0, 1e5);
/// Focal lengths in mm: 1 µm (a microlens) to 1000 km (nearly afocal systems).
pub const FOCAL_LENGTH_MM: Bound = bound("the focal length", "mm", 1e-3, 1e9);
/// F-number: 0.2 is beyond an immersed aperture of NA = 2, 1e5 is a pinhole.
pub const F_NUMBER: Bound = bound("the F-number", "", 0.2, 1e5);
/// Object distance in mm, of either sign: designs write 1e10 to 1e20 for infinity.
pub const OBJECT_DISTANCE_MM: Bound = bound("the object distance", "mm", -1e21, 1e21);
/// Object distance in mm as given by a flag: in front of the lens.
pub const GIVEN_DISTANCE_MM: Bound = bound("the object distance", "mm", 1e-3, 1e21);
/// Diameter of the entrance pupil, mm.
pub const PUPIL_MM: Bound = bound("the entrance pupil", "mm", 1e-3, 1e6);
/// Image height to which a lens is traced, mm.
pub const REACH_MM: Bound = bound("the image height", "mm", 1e-6, 1e5);
/// Spatial frequency on the film, line pairs per mm.
pub const FREQUENCY_LP_MM: Bound = bound("the spatial frequency", "lp/mm", 1e-6, 1e6);
/// A position on the film from the axis, mm.
pub const FILM_POINT_MM: Bound = bound("the position on the film", "mm", -1e5, 1e5);
/// Azimuth of a field point, degrees.
pub const AZIMUTH_DEG: Bound = bound("the azimuth", "deg", -360.0, 360.0);
/// Tilt of a surface of a design, degrees.
pub const TILT_DEG: Bound = bound("the tilt", "deg", -360.0, 360.0);
/// Radius of an encircled energy, µm.
pub const RADIUS_UM: Bound = bound("the radius", "µm", 0.0, 1e6);
/// Ideal height over object height, of either sign.
pub const MAGNIFICATION: Bound = bound("the magnification", "", -1e6, 1e6);
/// Shift of the image plane from its focus, mm.
pub const DEFOCUS_MM: Bound = bound("the defocus", "mm", -1e5, 1e5);
/// Width of a band, nm.
pub const BAND_WIDTH_NM: Bound = bound("the width of a band", "nm", 1e-3, 1e5);
/// RMS roughness of the surfaces of a lens, nm: polished ones have 0.3 to 5.
pub const ROUGHNESS_NM: Bound = bound("the roughness of surfaces", "nm", 0.0, 1000.0);
/// Shoulder of scattered light on the film, µm.
pub const SCATTER_SHOULDER_UM: Bound = bound("r0 of scatter", "µm", 1.0, 1e6);
/// Slope of scattered light with distance: polished surfaces have 1 to 3; above 1, so that the light within a distance is finite.
pub const SCATTER_SLOPE: Bound = bound("the slope of scatter", "", 1.000_001, 4.0);
/// Reach of scattered light on the film, mm.
pub const SCATTER_REACH_MM: Bound = bound("the reach of scatter", "mm", 1e-6, 1e5);
/// Relative illumination, 1 on the axis: pupils that grow with the field reach 2 or 3.
pub const RELATIVE_ILLUMINATION: Bound = bound("the relative illumination", "", 0.0, 100.0);
/// Projected solid angle of the pupil in sr, π·NA²: at most that of F-number 0.2, at least that of a pinhole.
pub const SOLID_ANGLE_SR: Bound = bound("the solid angle", "sr", 1e-12, 20.0);
/// Transmission of the lens.
pub const TRANSMISSION: Bound = bound("the transmission", "", 1e-12, 1.0);
/// Share of the light that a PSF window holds; rounding may bring it above 1 by 1e-6.
pub const PSF_ENERGY: Bound = bound("the share of light in the PSF window", "", 1e-12, 1.0 + 1e-6);
/// Side of a PSF window in samples: 639 film pixels can be convolved, sampled at a twelfth of them.
pub const PSF_SIDE: Bound = bound("the side of the PSF window", "samples", 1.0, 8191.0);
/// Azimuths J_k of a height off the axis: steps of 0.05°.
pub const AZIMUTHS: Bound = bound("the number of azimuths", "", 1.0, 7200.0);
/// Azimuths A_k of a height at which a lens without rotational symmetry has PSFs.
pub const AZIMUTH_SAMPLES: Bound = bound("the number of azimuths with PSFs", "", 1.0, 2880.0);
/// Columns and rows of PSFs on the film.
pub const PSF_COLUMNS: Bound = bound("the number of columns or rows of PSFs", "", 1.0, 4096.0);
/// PSFs of a band of a lens without rotational symmetry.
pub const PSF_ROWS: Bound = bound("the number of PSFs", "", 1.0, 65_536.0);
/// Field points of a lens's tables, typically 1000.
pub const FIELD_POINTS: Bound = bound("the number of field points", "", 2.0, 1e6);
/// Heights of a lens's PSFs, typically 20 to 100.
pub const PSF_HEIGHTS: Bound = bound("the number of PSF heights", "", 2.0, 4096.0);
/// Nodes of a map without rotational symmetry, in each direction: a cubic has 4.
pub const MAP_NODES: Bound = bound("the number of nodes of the map", "", 4.0, 1025.0);
/// A coordinate on the ideal plane from the axis, mm.
pub const IDEAL_POINT_MM: Bound = bound("the ideal point", "mm", -1e5, 1e5);
/// Numbers in one table of a lens, all bands: 100 bands of 40,000 field points.
pub const TABLE_NUMBERS: Bound = bound("the size of a lens table", "numbers", 1.0, 4_194_304.0);
/// Numbers of the pupil functions of a band: those of the built-in lenses have up to 870,000.
pub const PUPIL_NUMBERS: Bound = bound("the size of the pupil functions", "numbers", 1.0, 67_108_864.0);
/// Rings of the film in the operators of ghosts.
pub const GHOST_RINGS: Bound = bound("the number of rings", "", 16.0, 256.0);
/// Numbers of the operator of a band: that of the most rings.
pub const GHOST_NUMBERS: Bound = bound("the size of an operator of ghosts", "numbers", 1.0, 31_539_200.0);
/// Depth nodes of a band.
pub const DEPTH_NODES: Bound = bound("the number of depth nodes", "", 1.0, 4096.0);
/// Vergence 1/z of an object in 1/m: infinity to 0.1 mm.
pub const VERGENCE: Bound = bound("the vergence", "1/m", 0.0, 1e4);
/// Distance between the points where chief rays cross the axis, mm.
pub const PUPIL_SHIFT_MM: Bound = bound("the shift of the entrance pupil", "mm", -1e5, 1e5);
/// Blur radius on the film per dioptre from focus, µm·m: a microlens to a telescope.
pub const BLUR_PER_DIOPTRE_UM: Bound = bound("the blur per dioptre", "µm", 1e-6, 1e12);
/// Largest error of a kernel between depth nodes, L1 at film pixels: two kernels differ by at most 2.
pub const DEPTH_TOLERANCE: Bound = bound("the error between depth nodes", "", 1e-4, 2.0);
/// Object distance in focus, m from the entrance pupil.
pub const FOCUS_M: Bound = bound("the focus distance", "m", 1e-4, f64::INFINITY);
/// Bands of a chart or film.
pub const BANDS: Bound = bound("the number of bands", "", 1.0, 10_000.0);
/// Side of a film in pixels: 500 times that of a large sensor; its square still counts exactly in f64.
pub const FILM_SIDE_PX: Bound = bound("the side of the film", "px", 1.0, 1e6);
/// Side of a chart in pixels: coordinates on it are an i32 and a fraction.
pub const CHART_SIDE_PX: Bound = bound("the side of the chart", "px", 1.0, 1_073_741_823.0);
/// Samples of a chart or film, all bands: 4 PB of f32.
pub const SAMPLES: Bound = bound("the number of samples", "", 1.0, (1u64 << 50) as f64);
/// Film pixels per chart pixel.
pub const SCALE: Bound = bound("the scale", "film pixels per chart pixel", 1e-3, 1e3);
/// Optical axis in film pixels from the film's first pixel.
pub const AXIS_PX: Bound = bound("the optical axis", "px", -1e7, 1e7);
/// Position on a film, chart or raw in pixels.
pub const POSITION_PX: Bound = bound("the position", "px", -1e7, 1e7);
/// Centre of the chart in mm from the axis.
pub const CENTER_MM: Bound = bound("the centre of the chart", "mm", -1e7, 1e7);
/// Pitch of the chart's pixels in object space, mm: 1 nm to 1000 km (a planet seen by a probe).
pub const OBJECT_PITCH_MM: Bound = bound("the chart's pitch in object space", "mm", 1e-6, 1e9);
/// Sides of shards and inner chunks in pixels: a shard of f32 has at most 1 GiB.
pub const SHARD_SIDE_PX: Bound = bound("the side of the shard or chunk", "px", 1.0, 16_384.0);
/// Inner chunks of a shard: each takes 16 bytes of the shard's index.
pub const CHUNKS_PER_SHARD: Bound = bound("the number of chunks in a shard", "", 1.0, 1_048_576.0);
/// Shards of a film, all bands and outputs: each is a file, and `status` keeps the list of them in memory.
pub const SHARDS: Bound = bound("the number of shards", "", 1.0, 4_194_304.0);
/// Arrays of a film.
pub const OUTPUTS: Bound = bound("the number of outputs", "", 1.0, 4096.0);

const fn bound(name: &'static str, unit: &'static str, min: f64, max: f64) -> Bound {
    Bound { name, unit, min, max }
}

impl Bound {
    /// Whether `value` is within the bound; false for NaN.
    pub fn contains(&self, value: f64) -> bool {
        value >= self.min && value <= self.max
    }

    /// `value` if it is within the bound.
    ///
    /// # Errors
    /// [`OutOfBounds`] with quantity, value, bounds and unit.
    pub fn check(&self, value: f64) -> Result<f64, OutOfBounds> {
        match self.contains(value) {
            true => Ok(value),
            false => Err(OutOfBounds { bound: *self, found: self.with_unit(number(value)) }),
        }
    }

    /// Checks all `values`.
    ///
    /// # Errors
    /// Index and error of the first outside the bound.
    pub fn check_all(&self, values: &[f64]) -> Result<(), (usize, OutOfBounds)> {
        values.iter().enumerate().try_for_each(|(i, &v)| self.check(v).map(drop).map_err(|e| (i, e)))
    }

    /// `count` if it is within the bound.
    ///
    /// # Errors
    /// As [`Bound::check`].
    pub fn check_count(&self, count: usize) -> Result<usize, OutOfBounds> {
        match count as u64 as f64 {
            value if self.contains(value) => Ok(count),
            _ => Err(OutOfBounds { bound: *self, found: self.with_unit(count.to_string()) }),
        }
    }

    /// The product of `factors` if it is within the bound, without overflow.
    ///
    /// # Errors
    /// As [`Bound::check`].
    pub fn check_product(&self, factors: &[usize]) -> Result<u64, OutOfBounds> {
        let product = factors.iter().try_fold(1u64, |n, &f| n.checked_mul(f as u64));
        match product.filter(|n| self.contains(*n as f64)) {
            Some(n) => Ok(n),
            None => {
                let factors: Vec<String> = factors.iter().map(usize::to_string).collect();
                Err(OutOfBounds { bound: *self, found: self.with_unit(factors.join(" x ")) })
            }
        }
    }

    fn with_unit(&self, text: String) -> String {
        if self.unit.is_empty() { text } else { format!("{text} {}", self.unit) }
    }
}

impl fmt::Display for Bound {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let text = format!("{} to {}", number(self.min), number(self.max));
        f.write_str(&self.with_unit(text))
    }
}

/// The shorter of decimal and exponential notation.
fn number(v: f64) -> String {
    let (plain, exponent) = (v.to_string(), format!("{v:e}"));
    if exponent.len() < plain.len() { exponent } else { plain }
}

/// Checks the sides of a film.
///
/// # Errors
/// [`OutOfBounds`].
pub fn film_size(size: Size) -> Result<Size, OutOfBounds> {
    FILM_SIDE_PX.check_count(size.height)?;
    FILM_SIDE_PX.check_count(size.width)?;
    Ok(size)
}

/// Checks bands, sides and samples of a chart.
///
/// # Errors
/// [`OutOfBounds`].
pub fn chart_size(bands: usize, size: Size) -> Result<(), OutOfBounds> {
    BANDS.check_count(bands)?;
    CHART_SIDE_PX.check_count(size.height)?;
    CHART_SIDE_PX.check_count(size.width)?;
    SAMPLES.check_product(&[bands, size.height, size.width]).map(drop)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn out_of_bounds_error_contains_value_unit_and_bounds() {
        let e = PITCH_UM.check(1e-300).unwrap_err().to_string();
        assert_eq!(e, "the pitch is 1e-300 µm, expected 1e-3 to 1e6 µm");
        for v in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, -1.0, 0.0, 1e12] {
            assert!(PITCH_UM.check(v).is_err(), "{v}");
        }
        assert_eq!(PITCH_UM.check(2.0), Ok(2.0));
        assert_eq!(HEIGHT_MM.check_all(&[0.0, 3.0, f64::NAN]).unwrap_err().0, 2);
    }

    #[test]
    fn products_do_not_overflow() {
        assert_eq!(SAMPLES.check_product(&[3, 5, 7]), Ok(105));
        for sides in [[usize::MAX; 3], [1 << 40, 1 << 40, 1], [1, 1 << 25, (1 << 25) + 1]] {
            assert!(SAMPLES.check_product(&sides).is_err(), "{sides:?}");
        }
        assert!(film_size(Size::new(1 << 40, 1 << 40)).unwrap_err().to_string().contains("px"));
        assert!(chart_size(0, Size::new(5, 5)).is_err() && chart_size(1, Size::new(5, 5)).is_ok());
        assert!(chart_size(1, Size::new(1 << 30, 1)).is_err());
    }

    #[test]
    fn products_of_extreme_values_are_finite() {
        let (n, sr) = (F_NUMBER, SOLID_ANGLE_SR);
        for f in [n.min, n.max] {
            assert!(sr.contains(std::f64::consts::PI / (4.0 * f * f)), "solid angle at F-number {f}");
        }
        let ratio = HEIGHT_MM.max / (PITCH_UM.min * 1e-3) / SCALE.min;
        let light = RELATIVE_ILLUMINATION.max * SOLID_ANGLE_SR.max * WAVELENGTH_NM.max * PITCH_UM.max.powi(2);
        assert!(ratio.is_finite() && light.is_finite() && (light as f32).is_finite());
    }
}
