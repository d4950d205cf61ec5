//! Colorimetry: XYZ and sRGB of a stack of bands, illuminants, and the reflectance spectra of the ColorChecker.
//!
//!   X = K_m ∫ L(λ)·x̄(λ) dλ   (Y with ȳ, Z with z̄),   K_m = 683 lm/W,   λ in nm
//! for spectral radiance L [W m⁻² sr⁻¹ nm⁻¹]; Y is then luminance in cd m⁻². Between bands L is taken as linear, so a
//! band's weight is ∫ x̄·hat_b dλ with hat_b the triangle between its neighbours; before the first and after the last
//! band L is constant for half a spacing. A single band represents 10 nm.
//! Colour-matching functions, illuminants and ColorChecker reflectances are tables of 5 nm, linear between nodes.
//! XYZ is converted to linear sRGB (IEC 61966-2-1, D65 white) after Bradford adaptation (ICC.1:2010, annex E) from the image's white.
//! Not modelled: observers other than the CIE 1931 2° one, fluorescence. Sources: `data/SOURCES.md`.

mod cie;
mod difference;
mod srgb;

pub use cie::{
    CHECKER_PATCHES, FIRST_NM, Illuminant, LAST_NM, LUMINOUS_EFFICACY, checker_names, checker_reflectance,
    observer, reflected_xyz, xyz_weights,
};
pub use difference::{delta_e_2000, lab};
pub use srgb::{
    adaptation, inverse, linear_srgb_to_xyz, srgb_decode, srgb_encode, srgb_weights, xyz_to_linear_srgb,
};
