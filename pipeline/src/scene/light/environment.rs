//! Light from all directions by a map of azimuth and elevation.
//!
//! ```text
//! column = (azimuth/360° + ½)·W − ½      −180° (south) at the left edge, north in the middle, east to the right
//! row    = (½ − elevation/180°)·H − ½    90° at the upper edge                                                [`Horizon`]
//! E_up   = Σ_pixels above the horizon Y·sin(elevation)·dΩ,   dΩ = (2π/W)·∫ cos(elevation) over the row        Y: luminance of linear sRGB
//! ```
//! Values are multiplied so that an open horizontal surface has the illuminance that is asked for: they are then luminances in cd/m² of the red, green and
//! blue parts of white. As a background the map is read bilinearly; surfaces are lit by means of it over about [`COARSE_DEG`] degrees, the distance of the
//! directions in which a sky is sampled: the sun of a map gives soft shadows.

use crate::real;
use crate::scene::horizon::Horizon;
use std::f64::consts::PI;

/// Side of the cells of the map by which surfaces are lit, degrees.
pub const COARSE_DEG: f64 = 7.5;
/// Luminance of linear red, green and blue of sRGB.
const LUMINANCE: [f64; 3] = [0.2126, 0.7152, 0.0722];

/// A map that cannot light a scene.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum EnvironmentError {
    /// Not twice as wide as high.
    #[error(
        "the map has {width} x {height} pixels; expected 360 x 180 degrees: twice as many columns as rows"
    )]
    Shape {
        /// Columns.
        width: usize,
        /// Rows.
        height: usize,
    },
    /// A value that is no light.
    #[error("the map is {found} at column {column}, row {row}; expected numbers of 0 or more")]
    Value {
        /// Its column.
        column: usize,
        /// Its row.
        row: usize,
        /// As given.
        found: f32,
    },
    /// No light from above.
    #[error("the map is dark above the horizon: no factor gives it an illuminance")]
    Dark,
}

/// Values by row and column.
#[derive(Clone, Debug)]
struct Map {
    height: usize,
    width: usize,
    values: Vec<[f32; 3]>,
}

impl Map {
    /// The value at an azimuth and an elevation, bilinear, around the horizon; beyond the middles of the first and last row they go on.
    fn at(&self, azimuth_rad: f64, elevation_rad: f64) -> [f64; 3] {
        let column = (azimuth_rad / (2.0 * PI) + 0.5) * self.width as f64 - 0.5;
        let row =
            ((0.5 - elevation_rad / PI) * self.height as f64 - 0.5).clamp(0.0, self.height as f64 - 1.0);
        let (left, top) = (column.floor(), row.floor());
        let (u, v) = (column - left, row - top);
        let wrapped = |k: i64| (left as i64 + k).rem_euclid(self.width as i64) as usize;
        let below = (top as usize + 1).min(self.height - 1);
        let of = |row: usize, column: usize| self.values[row * self.width + column].map(f64::from);
        let corners = [
            (of(top as usize, wrapped(0)), (1.0 - u) * (1.0 - v)),
            (of(top as usize, wrapped(1)), u * (1.0 - v)),
            (of(below, wrapped(0)), (1.0 - u) * v),
            (of(below, wrapped(1)), u * v),
        ];
        std::array::from_fn(|c| corners.iter().map(|(value, share)| value[c] * share).sum())
    }

    /// Solid angle of a pixel of a row, sr.
    fn solid_angle(&self, row: usize) -> f64 {
        let edge = |row: usize| real::sin((0.5 - row as f64 / self.height as f64) * PI);
        2.0 * PI / self.width as f64 * (edge(row) - edge(row + 1))
    }

    /// Means over cells of about [`COARSE_DEG`], by solid angle.
    fn coarse(&self) -> Self {
        let height = ((180.0 / COARSE_DEG) as usize).min(self.height);
        let width = (2 * height).min(self.width);
        let mut sums = vec![([0.0f64; 3], 0.0); height * width];
        for row in 0..self.height {
            let area = self.solid_angle(row);
            for column in 0..self.width {
                let value = self.values[row * self.width + column];
                for (i, down) in cells_of(row, self.height, height) {
                    for (j, across) in cells_of(column, self.width, width) {
                        let (sum, total) = &mut sums[i * width + j];
                        let share = area * down * across;
                        sum.iter_mut().zip(value).for_each(|(sum, v)| *sum += share * f64::from(v));
                        *total += share;
                    }
                }
            }
        }
        let values = sums.into_iter().map(|(sum, area)| sum.map(|v| (v / area) as f32)).collect();
        Self { height, width, values }
    }

    /// Illuminance of an open horizontal surface, for luminances in cd/m².
    fn illuminance_lx(&self) -> f64 {
        let of_row = |row: usize| {
            // ∫ sin(elevation) cos(elevation) over the part of the row above the horizon.
            let squared = |row: usize| {
                let elevation = ((0.5 - row as f64 / self.height as f64) * PI).max(0.0);
                real::sin(elevation) * real::sin(elevation)
            };
            let weight = PI / self.width as f64 * (squared(row) - squared(row + 1));
            let line = &self.values[row * self.width..][..self.width];
            let luminance =
                |v: &[f32; 3]| v.iter().zip(LUMINANCE).map(|(v, y)| f64::from(*v) * y).sum::<f64>();
            weight * line.iter().map(luminance).sum::<f64>()
        };
        (0..self.height).map(of_row).sum()
    }
}

/// The cells, of `cells` that divide `count` pixels, in which pixel `k` lies, and its share in each.
fn cells_of(k: usize, count: usize, cells: usize) -> [(usize, f64); 2] {
    // In parts of which a cell has `count` and a pixel `cells`.
    let (first, end) = (k * cells, (k + 1) * cells);
    let (cell, last) = (first / count, (end - 1) / count);
    let beyond = if last > cell { (end - last * count) as f64 / cells as f64 } else { 0.0 };
    [(cell, 1.0 - beyond), (last, beyond)]
}

/// A map of the light around a scene.
#[derive(Clone, Debug)]
pub struct Environment {
    map: Map,
    coarse: Map,
    /// cd/m² of a value of 1.
    scale: f64,
    horizon: Horizon,
    turned_rad: f64,
}

impl Environment {
    /// The map of `width` columns with `values` in linear sRGB, row by row, turned clockwise by `turned_deg`, so that an open horizontal surface has `illuminance_lx`.
    ///
    /// # Errors
    /// [`EnvironmentError`].
    pub fn new(
        (height, width): (usize, usize),
        values: Vec<[f32; 3]>,
        illuminance_lx: f64,
        (horizon, turned_deg): (Horizon, f64),
    ) -> Result<Self, EnvironmentError> {
        if height == 0 || width != 2 * height || values.len() != height * width {
            return Err(EnvironmentError::Shape { width, height });
        }
        let is_light = |v: &f32| *v >= 0.0 && v.is_finite();
        if let Some(k) = values.iter().position(|v| !v.iter().all(is_light)) {
            let found = values[k].into_iter().find(|v| !is_light(v)).unwrap_or(f32::NAN);
            return Err(EnvironmentError::Value { column: k % width, row: k / width, found });
        }
        let map = Map { height, width, values };
        let of_map = map.illuminance_lx();
        if of_map <= 0.0 {
            return Err(EnvironmentError::Dark);
        }
        let (coarse, scale) = (map.coarse(), illuminance_lx / of_map);
        Ok(Self { map, coarse, scale, horizon, turned_rad: turned_deg.to_radians() })
    }

    /// Luminance in cd/m² of the red, green and blue part of the light from a direction of the camera frame, of any length.
    pub fn luminance(&self, direction: [f64; 3]) -> [f64; 3] {
        self.of(&self.map, direction)
    }

    /// The same, a mean over about [`COARSE_DEG`].
    pub fn mean_luminance(&self, direction: [f64; 3]) -> [f64; 3] {
        self.of(&self.coarse, direction)
    }

    fn of(&self, map: &Map, direction: [f64; 3]) -> [f64; 3] {
        let (azimuth, elevation) = self.horizon.angles_rad(direction);
        map.at(azimuth - self.turned_rad, elevation).map(|v| self.scale * v)
    }

    /// Rows and columns of the map, and its values.
    pub fn map(&self) -> ((usize, usize), &[[f32; 3]]) {
        ((self.map.height, self.map.width), &self.map.values)
    }

    /// Bytes in memory.
    pub fn bytes(&self) -> usize {
        (self.map.values.len() + self.coarse.values.len()) * size_of::<[f32; 3]>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::horizon::UpAxis;
    use crate::scene::test_mesh::POSE;

    fn horizon() -> Horizon {
        Horizon::new(&POSE, UpAxis::Y)
    }

    fn environment(size: (usize, usize), of: impl Fn(usize, usize) -> [f32; 3], turned: f64) -> Environment {
        let values = (0..size.0 * size.1).map(|k| of(k / size.1, k % size.1)).collect();
        Environment::new(size, values, 1000.0, (horizon(), turned)).unwrap()
    }

    #[test]
    fn an_even_map_has_the_luminance_of_its_illuminance() {
        let map = environment((36, 72), |_, _| [0.3; 3], 0.0);
        for direction in [[0.0, 0.0, 1.0], [0.3, -2.0, 0.1], [-1.0, 0.5, -3.0]] {
            for found in [map.luminance(direction), map.mean_luminance(direction)] {
                assert!(found.iter().all(|v| (v * PI / 1000.0 - 1.0).abs() < 1e-6), "{found:?}");
            }
        }
    }

    #[test]
    fn a_lamp_of_the_map_is_seen_in_its_direction_and_lights_from_there() {
        // 45° east of north, 30° up: column 5/8 of 360, row 1/3 of 180, a pixel of 1 degree.
        let lamp =
            |row: usize, column: usize| if (row, column) == (60, 225) { [5.0, 1.0, 0.0] } else { [0.0; 3] };
        for (turned, azimuth) in [(0.0, 45.5), (70.0, 115.5)] {
            let map = environment((180, 360), lamp, turned);
            let to = horizon().direction(azimuth, 29.5);
            let found = map.luminance(to);
            let elevation = 29.5_f64.to_radians();
            let solid = (PI / 180.0).powi(2) * elevation.cos();
            let luminance: f64 = found.iter().zip(LUMINANCE).map(|(v, y)| v * y).sum();
            assert!((luminance * solid * elevation.sin() / 1000.0 - 1.0).abs() < 1e-4, "{luminance}");
            assert!((found[0] / found[1] - 5.0).abs() < 1e-9 && found[2] == 0.0);
            assert_eq!(map.luminance(horizon().direction(azimuth + 3.0, 29.5)), [0.0; 3]);
            // The mean keeps its light: over all directions the same.
            let total = |of: &dyn Fn([f64; 3]) -> [f64; 3]| -> f64 {
                let rows = (0..360).map(|i| 90.0 - (f64::from(i) + 0.5) / 2.0);
                rows.map(|elevation| {
                    let columns = (0..720).map(|j| of(horizon().direction(f64::from(j) / 2.0, elevation))[0]);
                    columns.sum::<f64>() * elevation.to_radians().cos()
                })
                .sum()
            };
            let ratio = total(&|d| map.mean_luminance(d)) / total(&|d| map.luminance(d));
            assert!((ratio - 1.0).abs() < 0.02, "{ratio}");
        }
    }

    #[test]
    fn maps_of_another_shape_without_light_or_with_numbers_that_are_none_are_refused() {
        let new = |size, values: Vec<[f32; 3]>| {
            Environment::new(size, values, 1000.0, (horizon(), 0.0)).err().unwrap().to_string()
        };
        assert!(new((2, 3), vec![[1.0; 3]; 6]).contains("has 3 x 2 pixels"));
        assert!(new((2, 4), vec![[0.0; 3]; 8]).contains("dark above the horizon"));
        let mut values = vec![[1.0; 3]; 8];
        values[5][1] = -2.0;
        assert!(new((2, 4), values).contains("is -2 at column 1, row 1"));
    }
}
