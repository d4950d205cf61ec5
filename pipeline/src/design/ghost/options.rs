//! What the ghosts of a film are computed with.

use crate::design::prescription::error::DesignError;

/// Film and rings of a ring operator.
#[derive(Clone, Debug, PartialEq)]
pub struct GhostOptions {
    /// Real image height of the film's corner, mm.
    pub corner_mm: f64,
    /// Rings to the corner.
    pub rings: usize,
    /// Reflectance of the film.
    pub film_reflectance: Reflectance,
}

/// A reflectance over the wavelength: nm, ascending, and value; linear between entries, one holds at all wavelengths.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Reflectance(pub Vec<(f64, f64)>);

impl Reflectance {
    /// The value at `nm`, 0 without entries.
    ///
    /// # Errors
    /// [`DesignError::Option`] outside the entries.
    pub fn at(&self, nm: f64) -> Result<f64, DesignError> {
        let entries = &self.0;
        let (Some(first), Some(last)) = (entries.first(), entries.last()) else { return Ok(0.0) };
        if entries.len() == 1 {
            return Ok(first.1);
        }
        if nm < first.0 - 1e-6 || nm > last.0 + 1e-6 {
            return Err(DesignError::Option {
                option: "sensor reflectance",
                value: format!("given for {}..{} nm", first.0, last.0),
                expected: "values at all wavelengths of the film",
            });
        }
        let i = entries.partition_point(|e| e.0 <= nm).clamp(1, entries.len() - 1);
        let ((a, low), (b, high)) = (entries[i - 1], entries[i]);
        Ok(low + ((nm - a) / (b - a)).clamp(0.0, 1.0) * (high - low))
    }

    /// Whether it is 0 at all wavelengths.
    pub fn is_zero(&self) -> bool {
        self.0.iter().all(|e| e.1 == 0.0)
    }
}
