//! Errors of prescriptions and of tracing them.

use thiserror::Error;

/// A design that cannot be traced.
#[derive(Clone, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum DesignError {
    /// A part of the prescription is missing or impossible.
    #[error("the design {problem}")]
    Incomplete {
        /// What is missing or impossible.
        problem: String,
    },
    /// A design without rotational symmetry where symmetry is needed.
    #[error(
        "the design has tilted, decentred or freeform surfaces, and this needs a lens with rotational symmetry; `lenscube run`, `plan` and \
         `lens trace` take such a design"
    )]
    Asymmetric,
    /// A glass that is in no catalogue.
    #[error("no glass `{name}` in the catalogues{}; give its catalogue (`--glass-catalog FILE.agf`)", nearest_words(.nearest))]
    UnknownGlass {
        /// The name in the design.
        name: String,
        /// The most similar names in the catalogues.
        nearest: Vec<String>,
    },
    /// A wavelength outside the range of a glass's formula.
    #[error(
        "{um} µm lies outside {first_um}..{last_um} µm, the range of glass {glass}; choose other wavelengths or give a catalogue with its \
         data there (`--glass-catalog FILE.agf`)",
        um = tidy(.wavelength_um)
    )]
    Wavelength {
        /// The glass.
        glass: String,
        /// Requested wavelength, µm.
        wavelength_um: f64,
        /// Start of the range, µm.
        first_um: f64,
        /// End of the range, µm.
        last_um: f64,
    },
    /// A wavelength outside the tables of a coating.
    #[error(
        "{um} µm lies outside {}, the wavelengths of {name} in the coatings; choose other wavelengths or give its data there",
        range_um.map_or("no entries at all".to_owned(), |(a, b)| format!("{a}..{b} µm")), um = tidy(.wavelength_um)
    )]
    Coating {
        /// The coating or material.
        name: String,
        /// Requested wavelength, µm.
        wavelength_um: f64,
        /// Wavelengths of its table, µm; none if it is empty.
        range_um: Option<(f64, f64)>,
    },
    /// No light reaches the film.
    #[error(
        "the coatings or glasses of the design pass no light at {um} µm; choose other wavelengths or coatings",
        um = tidy(.wavelength_um)
    )]
    Dark {
        /// Wavelength, µm.
        wavelength_um: f64,
    },
    /// The paraxial system has no finite focal length, pupil or image.
    #[error("the design has no usable {what} at {um} µm: {problem}", um = tidy(.wavelength_um))]
    Paraxial {
        /// Which figure.
        what: &'static str,
        /// Wavelength, µm.
        wavelength_um: f64,
        /// Why.
        problem: String,
    },
    /// A ray that the tables need does not reach the image.
    #[error(
        "the ray at pupil ({px:.4}, {py:.4}) of the field point at {:.4} degrees, {um} µm, {problem}; {advice}",
        crate::real::atan(*.field_tan).to_degrees(), um = tidy(.wavelength_um))]
    Ray {
        /// Pupil coordinates.
        px: f64,
        /// Pupil coordinates.
        py: f64,
        /// Tangent of the field angle.
        field_tan: f64,
        /// Wavelength, µm.
        wavelength_um: f64,
        /// What happened, and at which surface.
        problem: String,
        /// The way out.
        advice: &'static str,
    },
    /// The rays of a field point cannot be aimed within the budget of rays.
    #[error(
        "{rays} rays are not enough to find the rays of the field point at {:.4} degrees, {um} µm, that pass the stop: {place}; check \
         aspheric coefficients, radii and clear radii there, or aim rays at the paraxial pupil (`--aiming paraxial`)",
        crate::real::atan(*.field_tan).to_degrees(), um = tidy(.wavelength_um))]
    Search {
        /// Tangent of the field angle.
        field_tan: f64,
        /// Wavelength, µm.
        wavelength_um: f64,
        /// The budget.
        rays: u32,
        /// Where rays end.
        place: String,
    },
    /// The lens does not reach the requested image height.
    #[error(
        "the maximum real image height of the lens is {reached_mm:.4} mm of real image height at {um} µm, {requested_mm:.4} mm requested: {problem}", um = tidy(.wavelength_um))]
    Height {
        /// Requested height, mm.
        requested_mm: f64,
        /// Maximum height, mm.
        reached_mm: f64,
        /// Wavelength, µm.
        wavelength_um: f64,
        /// Why.
        problem: String,
    },
    /// Rays that do not resolve the pupil of a PSF.
    #[error(
        "the PSF at {height_mm:.4} mm and {um} µm has {share:.4} of its light in its window: near the end of the lens's field its rays do not resolve the pupil; use a smaller field", um = tidy(.wavelength_um))]
    Unresolved {
        /// Real image height, mm.
        height_mm: f64,
        /// Wavelength, µm.
        wavelength_um: f64,
        /// Sum of its samples over the light of its pupil.
        share: f64,
    },
    /// The PSFs need a window larger than the maximum.
    #[error(
        "a window of {max_px} film pixels, the maximum, holds {:.1} % of the light of the PSF at {height_mm:.3} mm and {um} µm, at least {:.1} % requested: the lens is out of focus or the film's pixels are too fine; move the film (`--image-plane rms`), trace for coarser pixels (`--film-pitch-um`), allow less light (`--energy`) or a wider window (`--max-window-px`)",
        100.0 * .held, 100.0 * .requested, um = tidy(.wavelength_um))]
    Window {
        /// Maximum window, film pixels.
        max_px: usize,
        /// Real image height, mm.
        height_mm: f64,
        /// Wavelength, µm.
        wavelength_um: f64,
        /// Share of the light inside the window.
        held: f64,
        /// Minimum share.
        requested: f64,
    },
    /// An option that is out of range.
    #[error("{option} is {value}, expected {expected}")]
    Option {
        /// The option.
        option: &'static str,
        /// Its value.
        value: String,
        /// Allowed values.
        expected: &'static str,
    },
    /// The sink of the traced bands failed.
    #[error("storing the band at {wavelength_nm} nm: {problem}")]
    Sink {
        /// The band.
        wavelength_nm: f64,
        /// Error of the sink.
        problem: String,
    },
}

/// Without the digits of rounding: 0.5875618 for 0.5875617999999999.
pub(in crate::design) fn tidy(um: &f64) -> f64 {
    (um * 1e9).round() / 1e9
}

fn nearest_words(nearest: &[String]) -> String {
    if nearest.is_empty() { String::new() } else { format!(" (nearest: {})", nearest.join(", ")) }
}
