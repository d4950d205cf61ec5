//! What comparisons of two lenses share: their wavelengths, and the numbers of the lenses as a whole.

use crate::failure::usage;
use anyhow::Result;
use pipeline::lens::Lens;

/// Largest difference of wavelengths that count as equal, nm.
pub const WAVELENGTH_TOLERANCE_NM: f64 = 1e-6;

/// Wavelengths of the packs among two lenses, of both if both are packs: a design (none) can be traced at any wavelength. None for two designs.
pub fn common(packs: [Option<Vec<f64>>; 2]) -> Option<Result<Vec<f64>>> {
    let (a_nm, b_nm) = match packs {
        [Some(a), Some(b)] => (a, b),
        [a, b] => return a.or(b).map(Ok),
    };
    let equal = |x: &f64, y: &f64| (x - y).abs() < WAVELENGTH_TOLERANCE_NM;
    let common: Vec<f64> = a_nm.iter().copied().filter(|x| b_nm.iter().any(|y| equal(x, y))).collect();
    if common.is_empty() {
        let list = pipeline::wavelengths::format;
        return Some(Err(usage(format!(
            "the packs have no common wavelength: {} nm and {} nm",
            list(&a_nm),
            list(&b_nm)
        ))));
    }
    Some(Ok(common))
}

/// Scalars of the lenses: name, value of A, value of B.
pub fn scalars(a: &Lens, b: &Lens) -> [(&'static str, f64, f64); 4] {
    [
        ("effective_focal_length_mm", a.effective_focal_length_mm, b.effective_focal_length_mm),
        ("distortion_focal_length_mm", a.distortion_focal_length_mm, b.distortion_focal_length_mm),
        ("f_number", a.f_number, b.f_number),
        ("magnification", a.magnification, b.magnification),
    ]
}
