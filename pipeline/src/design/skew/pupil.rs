//! The pupil function of a place of the film of a built lens, over the full circle of the pupil.
//!
//! ```text
//! W = path − path₀ − L (X − X₀) − M (Y − Y₀),   A = √(Φ J / N),   J = |d(L, M)/d(p, q)|      (0: the chief ray)
//! ```
//! all in the film frame (X right, Y down, of the film as built), so the PSF's rows go down as the film's do. The open pupil is that of
//! [`super::opening`], its segments have θ in (−π, π] about centres anywhere in the pupil; values and their accuracy are those of
//! [`crate::design::psf::PupilFunction`].

use super::error::SkewError;
use super::opening::{OpenSegment, Opening};
use super::trace::SkewTracer;
use crate::design::pupil::function::{PupilFunction, Rims, Sampler, Values, ray_values};
use crate::design::pupil::{Pupil, Segment};
use crate::real;

/// The pupil function of the field whose chief ray lands at `film_mm`, beginning with the grids of `nearby` where its pupil has the
/// same rims.
///
/// # Errors
/// No chief ray lands there; all rays are blocked; one within the apertures does not reach the film.
pub fn pupil_function(
    tracer: &SkewTracer<'_>,
    film_mm: [f64; 2],
    nearby: Option<&PupilFunction>,
) -> Result<PupilFunction, SkewError> {
    pupil_function_at(tracer, film_mm, tracer.field_of(film_mm)?, nearby)
}

/// [`pupil_function`] of the field of slopes `t`, whose chief ray lands at `film_mm`.
///
/// # Errors
/// As there.
pub fn pupil_function_at(
    tracer: &SkewTracer<'_>,
    film_mm: [f64; 2],
    t: [f64; 2],
    nearby: Option<&PupilFunction>,
) -> Result<PupilFunction, SkewError> {
    let field = Field { film_mm, t, opening: Opening::new(tracer, t)? };
    field.pupil_function(tracer, 0.0, nearby)
}

/// The pupil function of the film place at a height, mm, and an azimuth, rad, from +X towards +Y, in the frame that is turned by the azimuth.
/// Where no aperture clips, its pupil coordinates are turned as well: it then changes little with the azimuth.
///
/// # Errors
/// As [`pupil_function`].
pub fn turned_pupil_function(
    tracer: &SkewTracer<'_>,
    (height_mm, azimuth_rad): (f64, f64),
    nearby: Option<&PupilFunction>,
) -> Result<PupilFunction, SkewError> {
    let (sin, cos) = real::sin_cos(azimuth_rad);
    let film_mm = [height_mm * cos, height_mm * sin];
    let t = tracer.field_of(film_mm)?;
    let field = Field { film_mm, t, opening: Opening::new(tracer, t)? };
    match field.opening.is_open() {
        true => field.pupil_function(tracer, azimuth_rad, nearby),
        false => Ok(field.pupil_function(tracer, 0.0, nearby)?.turned(-azimuth_rad)),
    }
}

/// A field with its open pupil.
struct Field {
    film_mm: [f64; 2],
    t: [f64; 2],
    opening: Opening,
}

impl Field {
    /// Its pupil function; frame and pupil coordinates are turned by `azimuth_rad`, which is 0 for a clipped pupil.
    fn pupil_function(
        &self,
        tracer: &SkewTracer<'_>,
        azimuth_rad: f64,
        nearby: Option<&PupilFunction>,
    ) -> Result<PupilFunction, SkewError> {
        let (t, (sin, cos)) = (self.t, real::sin_cos(azimuth_rad));
        let pupil = Pupil { segments: self.opening.segments.iter().map(closed).collect() };
        let chief = tracer.ray(t, 0.0, 0.0)?;
        // Pupil coordinates have y up, the film Y down.
        let values: &Values<'_> = &|p, q| {
            let r = tracer.ray(t, p * cos + q * sin, q * cos - p * sin)?;
            let [w, l, m, amplitude, flux] = ray_values(&r, &chief, (r.x.v - chief.x.v, r.y.v - chief.y.v));
            Ok([w, l * cos + m * sin, m * cos - l * sin, amplitude, flux])
        };
        let rims: &Rims<'_> = &|segment, angles| opened(segment).radii(tracer, t, angles);
        let patches =
            Sampler { wavelength_um: tracer.wavelength_um, rims, values }.patches(&pupil, nearby)?;
        let height_mm = real::hypot(self.film_mm[0], self.film_mm[1]);
        Ok(PupilFunction::new(tracer.wavelength_um, (pupil, true), patches, height_mm).lit()?)
    }
}

/// The segment of a pupil function.
fn closed(s: &OpenSegment) -> Segment {
    let &OpenSegment { from, to, limit, centre: [centre, across], sign } = s;
    Segment { from, to, limit, centre, across, sign }
}

fn opened(s: &Segment) -> OpenSegment {
    let &Segment { from, to, limit, centre, across, sign } = s;
    OpenSegment { from, to, limit, centre: [centre, across], sign }
}
