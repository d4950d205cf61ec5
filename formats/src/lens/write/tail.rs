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

    /// Writes the middle parts of the tails of `bands`, of which some have one; whether any has.
    pub(super) fn middles(&mut self, bands: &[LensBand]) -> Result<bool, LensPackError> {
        let middle = |b: &LensBand| b.tail.as_ref().and_then(|t| t.middle.clone());
        if bands.iter().all(|b| middle(b).is_none()) {
            return Ok(false);
        }
        self.column("tail/middle_pitch", "mm", bands, |b| middle(b).map_or(f64::NAN, |m| m.pitch_mm))?;
        for (band, of_band) in bands.iter().enumerate() {
            let Some(middle) = middle(of_band) else { continue };
            let bytes: Vec<u8> = middle.samples.iter().flat_map(|v| v.to_ne_bytes()).collect();
            let heights = middle.samples.len() / (middle.size * middle.size);
            let shape = [heights, middle.size, middle.size];
            let name = format!("tail/middle/{band}");
            self.array(&name, "float32", &shape, "share of the light", &["height", "row", "column"], &bytes)?;
        }
        Ok(true)
    }
}
