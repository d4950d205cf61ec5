//! The figures of a built lens that its criterion is made of, by field place.
//!
//! ```text
//! spot:       √(Σ w |ρ − ρ̄|²)              rays of all wavelengths by weight, each by its flux; ρ̄ the centroid of all
//! wavefront:  √(Σ w (W − a − b L − c M)²)   primary wavelength, in its waves; a, b, c by least squares: piston and tilt removed
//! MTF:        `focus_mtf`
//! ```
//! The criterion is the mean over the places: of the spot's radius in µm, of the wavefront error in waves, or of the MTF, sagittal
//! and tangential alike.

use super::fields::{Colours, Field, FilmBundle, in_parallel};
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
        let fields = in_parallel(fields, |field| self.field(colours, field))?;
        let value = |f: &FieldFigures| match self.kind {
            CriterionKind::Mtf { .. } => f.mtf.map_or(0.0, |[s, t]| 0.5 * (s + t)),
            CriterionKind::RmsSpot => f.rms_spot_um,
            CriterionKind::RmsWavefront => f.rms_wavefront,
        };
        let criterion = fields.iter().map(value).sum::<f64>() / fields.len() as f64;
        Ok(LensFigures { fields, criterion })
    }

    fn field(&self, colours: &Colours<'_>, field: &Field) -> Result<FieldFigures, SkewError> {
        let place = field.place;
        let [rings, spokes, on_rim] = PUPIL_RAYS;
        // Only an MTF needs the rims.
        let on_rim = if matches!(self.kind, CriterionKind::Mtf { .. }) { on_rim } else { 0 };
        let (mut bundles, mut rms_wavefront) = (Vec::new(), 0.0);
        for (i, (tracer, weight)) in colours.tracers.iter().enumerate() {
            let bundle = FilmBundle::trace(tracer, field, [rings, spokes, on_rim])?;
            if colours.is_primary(i) {
                rms_wavefront = wavefront_mm(&bundle) / (1e-3 * tracer.wavelength_um);
            }
            if *weight > 0.0 {
                bundles.push((tracer.wavelength_um, *weight, bundle));
            }
        }
        let mtf = match self.kind {
            // The slopes of the chief ray only matter for other positions of the film.
            CriterionKind::Mtf { frequency_per_mm } => {
                Some(FocusMtf::new(&bundles, place, [0.0; 2], frequency_per_mm, 0.0).at(0.0))
            }
            _ => None,
        };
        Ok(FieldFigures { place_mm: place, rms_spot_um: 1e3 * spot_mm(&bundles), rms_wavefront, mtf })
    }
}

/// RMS radius about the centroid of all, mm.
fn spot_mm(bundles: &[(f64, f64, FilmBundle)]) -> f64 {
    let rays =
        || bundles.iter().flat_map(|(_, weight, b)| b.rays.iter().map(move |r| (weight * r.weight, r.at_mm)));
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
