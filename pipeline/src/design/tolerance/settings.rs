//! What is adjusted after a lens is built, and what it is judged by.

/// Where the film is put sideways.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Boresight {
    /// The film's centre stays on the nominal axis.
    #[default]
    Keep,
    /// The film is moved so that t = 0 at the primary wavelength falls on its centre.
    Remove,
}

/// Adjustments of each built lens.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Compensation {
    /// Least and greatest shift of the film along the light, µm; `None` leaves it where it is.
    pub focus_um: Option<(f64, f64)>,
    /// Whether the film is tilted as well.
    pub film_tilt: bool,
    /// Where the film is put sideways.
    pub boresight: Boresight,
}

impl Compensation {
    /// Whether the film of a lens without errors may move: it is focused or tilted. Such a lens has no boresight.
    pub fn moves_film(&self) -> bool {
        self.focus_um.is_some() || self.film_tilt
    }
}

impl Default for Compensation {
    fn default() -> Self {
        Self { focus_um: Some((-1000.0, 1000.0)), film_tilt: false, boresight: Boresight::Keep }
    }
}

/// The number that a lens is judged by.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum CriterionKind {
    /// MTF at a frequency, 1/mm: the mean of sagittal and tangential; the greater the better.
    Mtf {
        /// Spatial frequency on the film, 1/mm.
        frequency_per_mm: f64,
    },
    /// RMS radius of the spot.
    RmsSpot,
    /// RMS wavefront error.
    RmsWavefront,
}

/// Places on the film, over which the criterion is the mean.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum CriterionFields {
    /// The centre, eight at 0.7 of the circle in the film's corner, eight on it.
    #[default]
    Film,
    /// REAL film coordinates, mm.
    Places(Vec<[f64; 2]>),
}

/// What a lens is judged by.
#[derive(Clone, Debug, PartialEq)]
pub struct Criterion {
    /// The number.
    pub kind: CriterionKind,
    /// Where.
    pub fields: CriterionFields,
}

impl Default for Criterion {
    fn default() -> Self {
        Self { kind: CriterionKind::Mtf { frequency_per_mm: 50.0 }, fields: CriterionFields::Film }
    }
}
