//! The figures of a built lens that its criterion is made of, by field place.
//!
//! ```text
//! spot:       √(Σ w |ρ − ρ̄|²)              rays of all wavelengths by weight, each by its flux; ρ̄ the centroid of all
//! wavefront:  √(Σ w (W − a − b L − c M)²)   primary wavelength, in its waves; a, b, c by least squares: piston and tilt removed
//! MTF:        `focus_mtf`
//! ```
//! The criterion is the mean over the places: of the spot's radius in µm, of the wavefront error in waves, or of the MTF, sagittal
//! and tangential alike.

use super::fields::{ColourBundle, Colours, Field, FieldBundles, FilmBundle, in_parallel};
use super::focus_mtf::{FocusMtf, PUPIL_RAYS};
use super::settings::{Criterion, CriterionKind};
use crate::design::skew::error::SkewError;
use crate::design::skew::system::BuiltLens;

/// Figures of a field.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FieldFigures {
    /// Its place on the film, mm.
    pub place_mm: [f64; 2],
    /// RMS radius of the polychromatic spot about its centroid, µm.
    pub rms_spot_um: f64,
    /// RMS wavefront error at the primary wavelength, waves.
    pub rms_wavefront: f64,
    /// MTF at the criterion's frequency, sagittal and tangential; none if it has no frequency.
    pub mtf: Option<[f64; 2]>,
}

/// Figures of a lens.
#[derive(Clone, Debug, PartialEq)]
pub struct LensFigures {
    /// By place, in the order of the criterion.
    pub fields: Vec<FieldFigures>,
    /// The criterion.
    pub criterion: f64,
}

impl Criterion {
    /// The figures of `lens`, as it is, on a film whose corner is `corner_mm` from its centre.
    ///
    /// # Errors
    /// A field without chief ray or light.
    pub fn figures(&self, lens: &BuiltLens, corner_mm: f64) -> Result<LensFigures, SkewError> {
        let colours = Colours::new(lens)?;
        let fields = colours.fields(&self.fields.places(corner_mm))?;
        self.figures_of(&colours, &fields)
    }

    /// The figures of these fields.
    pub(super) fn figures_of(
        &self,
        colours: &Colours<'_>,
        fields: &[Field],
    ) -> Result<LensFigures, SkewError> {
        let [rings, spokes, on_rim] = PUPIL_RAYS;
        // Only an MTF needs the rims.
        let on_rim = if matches!(self.kind, CriterionKind::Mtf { .. }) { on_rim } else { 0 };
        let traced = in_parallel(fields, |field| {
            let rays = FieldBundles::trace(colours, field, [rings, spokes, on_rim])?;
            let mtf = match self.kind {
                CriterionKind::Mtf { frequency_per_mm } => {
                    Some(FocusMtf::new(&rays, frequency_per_mm, 0.0).at(0.0))
                }
                _ => None,
            };
            Ok(of_rays(&rays, mtf))
        });
        Ok(self.of_fields(traced?))
    }

    /// The figures of these fields from their rays and their MTF.
    pub(super) fn figures_of_rays(&self, fields: &[(FieldBundles, [f64; 2])]) -> LensFigures {
        self.of_fields(fields.iter().map(|(rays, mtf)| of_rays(rays, Some(*mtf))).collect())
    }

    fn of_fields(&self, fields: Vec<FieldFigures>) -> LensFigures {
        let value = |f: &FieldFigures| match self.kind {
            CriterionKind::Mtf { .. } => f.mtf.map_or(0.0, |[s, t]| 0.5 * (s + t)),
            CriterionKind::RmsSpot => f.rms_spot_um,
            CriterionKind::RmsWavefront => f.rms_wavefront,
        };
        let criterion = fields.iter().map(value).sum::<f64>() / fields.len() as f64;
        LensFigures { fields, criterion }
    }
}

/// Figures of a field with an MTF.
fn of_rays(field: &FieldBundles, mtf: Option<[f64; 2]>) -> FieldFigures {
    let primary = field.colours.iter().find(|c| c.is_primary);
    FieldFigures {
        place_mm: field.place,
        rms_spot_um: 1e3 * spot_mm(&field.colours),
        rms_wavefront: primary.map_or(0.0, |c| wavefront_mm(&c.bundle) / (1e-3 * c.wavelength_um)),
        mtf,
    }
}

/// RMS radius about the centroid of all, mm.
fn spot_mm(colours: &[ColourBundle]) -> f64 {
    let rays =
        || colours.iter().flat_map(|c| c.bundle.rays.iter().map(move |r| (c.weight * r.weight, r.at_mm)));
    let mut mean = [0.0; 2];
    for (w, [x, y]) in rays() {
        mean = [mean[0] + w * x, mean[1] + w * y];
    }
    let square: f64 = rays().map(|(w, [x, y])| w * ((x - mean[0]).powi(2) + (y - mean[1]).powi(2))).sum();
    square.max(0.0).sqrt()
}

/// RMS of W without piston and tilt, mm.
fn wavefront_mm(bundle: &FilmBundle) -> f64 {
    // Moments about the means remove the piston.
    let mut mean = [0.0; 3];
    let values = |r: &super::fields::FilmRay| [r.cosines[0], r.cosines[1], r.wavefront_mm];
    for r in &bundle.rays {
        for (m, v) in mean.iter_mut().zip(values(r)) {
            *m += r.weight * v;
        }
    }
    let mut moments = [[0.0; 3]; 3];
    for r in &bundle.rays {
        let v = values(r);
        for i in 0..3 {
            for j in 0..3 {
                moments[i][j] += r.weight * (v[i] - mean[i]) * (v[j] - mean[j]);
            }
        }
    }
    let [[ll, lm, lw], [_, mm, mw], [_, _, ww]] = moments;
    let det = ll * mm - lm * lm;
    let (b, c) = ((lw * mm - mw * lm) / det, (mw * ll - lw * lm) / det);
    // Of the residuals themselves: the difference of moments would lose digits.
    let square: f64 = bundle
        .rays
        .iter()
        .map(|r| {
            let [l, m, w] = values(r);
            r.weight * (w - mean[2] - b * (l - mean[0]) - c * (m - mean[1])).powi(2)
        })
        .sum();
    debug_assert!(square <= ww * (1.0 + 1e-9) + f64::MIN_POSITIVE);
    square.max(0.0).sqrt()
}
