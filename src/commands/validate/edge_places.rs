//! Where the measured edges lie, and their directions.

/// Slant, degrees.
const SLANT_DEG: f64 = 5.0;

/// Position and direction of an edge.
#[derive(Clone, Debug, PartialEq)]
pub struct EdgePlace {
    /// `centre`, `mid-field` or `corner`.
    pub name: &'static str,
    /// Direction of the normal: `radial` or `tangential`.
    pub direction: &'static str,
    /// Centre (row, column) of the edge on the chart, film pixels.
    pub centre_px: (f64, f64),
    /// Azimuth of the normal on the chart, from dark to light, degrees.
    pub angle_deg: f64,
}

impl EdgePlace {
    /// Position and direction, e.g. `corner, radial`.
    pub fn title(&self) -> String {
        format!("{}, {}", self.name, self.direction)
    }
}

/// The six edges on a film of `size` px: on the paper's film mid-field and corner are at 10 mm and 19 mm.
pub fn places(size: usize) -> Vec<EdgePlace> {
    let (middle, half) = ((size as f64 - 1.0) / 2.0, size as f64 / 2.0);
    let positions = [
        ("centre", (0.0, 0.0), 0.0),
        ("mid-field", (0.0, std::f64::consts::FRAC_1_SQRT_2), 0.0),
        ("corner", (0.95, 0.95), 45.0),
    ];
    // Slants to opposite sides: a PSF rotated by twice the slant can leave the curve of one edge unchanged, never of both.
    let directions = [("radial", SLANT_DEG), ("tangential", 90.0 - SLANT_DEG)];
    let place = |(name, (y, x), azimuth_deg): (&'static str, (f64, f64), f64)| {
        directions.map(|(direction, angle_deg)| EdgePlace {
            name,
            direction,
            centre_px: ((middle + y * half).round(), (middle + x * half).round()),
            angle_deg: azimuth_deg + angle_deg,
        })
    };
    positions.into_iter().flat_map(place).collect()
}

/// Angles of the edges, ascending; edges of one angle are in one film.
pub fn angles(places: &[EdgePlace]) -> Vec<f64> {
    let mut angles: Vec<f64> = places.iter().map(|p| p.angle_deg).collect();
    angles.sort_by(f64::total_cmp);
    angles.dedup();
    angles
}
