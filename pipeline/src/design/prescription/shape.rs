//! The shape of a surface, rotationally symmetric about z.
//!
//! ```text
//! sag(r) = c r² / (1 + √(1 − (1 + κ) c² r²)) + Σ α_i r^(2i) + Σ β_i r^(2i−1)
//!                                                               c curvature [1/mm], κ conic constant, α_i [mm^(1−2i)], β_i [mm^(2−2i)]
//! ```

/// The shape of a surface.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Shape {
    /// Curvature, 1/mm.
    pub curvature: f64,
    /// Conic constant.
    pub conic: f64,
    /// Even asphere: coefficient of r², r⁴, r⁶, …
    pub aspheric: Vec<f64>,
    /// Odd asphere: coefficient of r, r³, r⁵, …
    pub odd: Vec<f64>,
}

impl Shape {
    /// Whether it is a plane.
    pub fn is_flat(&self) -> bool {
        self.curvature == 0.0 && !self.is_aspheric()
    }

    /// The same surface seen from behind: z counts the other way.
    pub fn reversed(&self) -> Self {
        let negate = |c: &[f64]| c.iter().map(|a| -a).collect();
        // Not −0, which would be written.
        let curvature = if self.curvature == 0.0 { 0.0 } else { -self.curvature };
        Self { curvature, conic: self.conic, aspheric: negate(&self.aspheric), odd: negate(&self.odd) }
    }

    /// Whether it has terms beside those of a conic.
    pub fn is_aspheric(&self) -> bool {
        self.aspheric.iter().chain(&self.odd).any(|a| *a != 0.0)
    }

    /// Curvature at the vertex, the r² term included, 1/mm.
    pub fn paraxial_curvature(&self) -> f64 {
        self.curvature + 2.0 * self.aspheric.first().copied().unwrap_or(0.0)
    }
}
