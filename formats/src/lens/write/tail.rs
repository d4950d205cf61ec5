//! Tails of the bands of a pack: the group `tail`.

use super::LensPackWriter;
use crate::lens::error::LensPackError;
use pipeline::lens::LensBand;
use pipeline::lens::tail::{ORDERS, TERMS};

impl LensPackWriter {
    /// Writes the tails of `bands`, of which some have one; the rows of the others are NaN.
    pub(super) fn tails(&mut self, bands: &[LensBand]) -> Result<(), LensPackError> {
        self.column("tail/inner_radius", "mm", bands, |b| b.tail.as_ref().map_or(f64::NAN, |t| t.inner_mm))?;
        let heights = |b: &LensBand| b.tail.as_ref().map_or(0, |t| t.height_mm.len());
        let width = bands.iter().map(heights).max().unwrap_or(0);
        let height = |b: &LensBand, k: usize| b.tail.as_ref().and_then(|t| t.height_mm.get(k)).copied();
        let rows = bands.iter().flat_map(|b| (0..width).map(move |k| height(b, k).unwrap_or(f64::NAN)));
        let bytes: Vec<u8> = rows.flat_map(f64::to_ne_bytes).collect();
        self.array("tail/height", "float64", &[bands.len(), width], "mm", &["wavelength", "height"], &bytes)?;
        let of = |b: &LensBand, k: usize| {
            let row = b.tail.as_ref().and_then(|t| t.coefficients.get(k)).copied();
            row.unwrap_or([[f64::NAN; TERMS]; ORDERS])
        };
        let rows = bands.iter().flat_map(|b| (0..width).map(move |k| of(b, k)));
        let bytes: Vec<u8> = rows.flatten().flatten().flat_map(f64::to_ne_bytes).collect();
        // Harmonic by harmonic.
        let shape = [bands.len(), width, ORDERS * TERMS];
        let axes = ["wavelength", "height", "harmonic_and_term"];
        self.array("tail/coefficient", "float64", &shape, "term 0: mm, term 1: mm3", &axes, &bytes)
    }
}
