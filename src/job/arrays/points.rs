//! Points and relative illumination of a lens: where a point of the chart lands on the film, and which point of the chart a place of the film shows.
//!
//! ```text
//! chart_point = film_point · h(r, λ)/r            r: REAL height of the film point, h: its ideal height, mm ([`pipeline::field`])
//! ```
//! Points are (x, y) in mm from the optical axis, y down, of the chart on the ideal image plane. The tables are those of a film that reaches as far as the points, without its
//! PSFs, so that a point lies within 10⁻⁴ px of where the remap of a film of another size puts it.

use crate::args::RunArgs;
use crate::failure::usage;
use crate::job::default_options;
use crate::job::lens::{JobLens, UntracedLens};
use crate::machine::threads;
use anyhow::{Result, anyhow};
use pipeline::band::{BandPlan, Options};
use pipeline::field::Field;
use pipeline::field::planar::PlanarField;
use pipeline::geometry::{Frame, Size};
use pipeline::lens::{LensBand, linear};
use pipeline::stage::Stage;

/// Pitch of the films whose tables are used, µm.
const PITCH_UM: f64 = 2.0;
/// Reach beyond the outermost point: relative, and in mm.
const BEYOND: (f64, f64) = (1e-3, 1e-3);
/// Films that are tried for points of the chart, whose place on the film is not known.
const TRIES: usize = 12;
/// Steps of Newton's iteration, and the error at which it ends, mm.
const NEWTON: (usize, f64) = (50, 1e-12);
/// Step of its differences, mm.
const STEP_MM: f64 = 1e-4;

/// The map of a lens at one wavelength up to a height.
pub struct PointMap {
    /// Wavelength, nm.
    pub nm: f64,
    /// Height on the film up to which it is known, mm.
    pub reach_mm: f64,
    band: LensBand,
    field: AnyField,
}

enum AnyField {
    Radial(Field),
    Planar(PlanarField),
}

impl PointMap {
    /// The map of the lens of `args` at `nm` up to `reach_mm` on the film.
    ///
    /// # Errors
    /// The lens cannot be traced so far; a pack that has no such wavelength.
    pub fn new(args: &RunArgs, nm: f64, reach_mm: f64) -> Result<Self> {
        let side = (2.0 * reach_mm / (std::f64::consts::SQRT_2 * 1e-3 * PITCH_UM)).ceil() as usize + 1;
        let size = Size::new(side, side);
        let frame = Frame::centred(size, size, PITCH_UM);
        let options = default_options();
        let options = Options { stages: options.stages.without(Stage::Svpsf), ..options };
        let lens = UntracedLens::open_focused(&args.lens, &args.surfaces, &args.tracing)?
            .with_errors(&args.built)?;
        let lens = JobLens::new(lens, &frame, &[nm], &options, threads(args.threads), None)?;
        let band = BandPlan::new(&frame, lens.lens(), nm, &options)?.lens;
        let field = match &band.planar {
            None => AnyField::Radial(Field::new(&band, 1.0, true, true, 1.0)),
            Some(planar) => AnyField::Planar(PlanarField::new(&planar.map, 1.0, true, true, 1.0)),
        };
        Ok(Self { nm, reach_mm, band, field })
    }

    /// The map with which all of the points `chart_mm` land on the film that it covers; `known` makes the map up to a height.
    ///
    /// # Errors
    /// Those of `known`; points beyond the field of the lens.
    pub fn covering(
        chart_mm: &[[f64; 2]],
        known: impl Fn(f64) -> Result<std::sync::Arc<Self>>,
    ) -> Result<std::sync::Arc<Self>> {
        let needed = reach_of(chart_mm)?;
        let mut reach_mm = needed;
        for _ in 0..TRIES {
            let map = known(reach_mm)?;
            // Where the ratio of the border is that of the points, the next film covers them.
            let border = map.ideal_of_border();
            if border >= needed {
                return Ok(map);
            }
            reach_mm = map.reach_mm * (needed / border).clamp(1.01, 1.5);
        }
        Err(usage("points of the chart lie beyond the field of the lens"))
    }

    /// The smallest ideal height on the border of the film that the map covers, mm.
    fn ideal_of_border(&self) -> f64 {
        let at = |k: usize| {
            let angle = std::f64::consts::TAU * k as f64 / 64.0;
            self.chart_of_film([self.reach_mm * angle.cos(), self.reach_mm * angle.sin()])
        };
        (0..64).map(|k| at(k)[0].hypot(at(k)[1])).fold(f64::INFINITY, f64::min)
    }

    /// The point of the chart that the film shows at `[x, y]`, mm.
    pub fn chart_of_film(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        match &self.field {
            AnyField::Radial(field) => {
                let scale = field.at(x.hypot(y)).0;
                [x * scale, y * scale]
            }
            AnyField::Planar(field) => {
                let [dy, dx, _] = field.at(y, x);
                [x + dx, y + dy]
            }
        }
    }

    /// Where on the film the point `[x, y]` of the chart lands, mm.
    ///
    /// # Errors
    /// Not found: where the map folds.
    pub fn film_of_chart(&self, point: [f64; 2]) -> Result<[f64; 2]> {
        match &self.field {
            AnyField::Radial(_) => {
                let (ideal, real) = (&self.band.ideal_height_mm, &self.band.image_height_mm);
                let h = point[0].hypot(point[1]);
                let scale = if h > 0.0 { linear(ideal, real, h) / h } else { real[1] / ideal[1] };
                Ok(point.map(|v| v * scale))
            }
            AnyField::Planar(_) => self.inverse(point),
        }
    }

    /// Newton's iteration with differences.
    fn inverse(&self, point: [f64; 2]) -> Result<[f64; 2]> {
        let mut at = point;
        for _ in 0..NEWTON.0 {
            let here = self.chart_of_film(at);
            let [ex, ey] = [point[0] - here[0], point[1] - here[1]];
            if ex.hypot(ey) < NEWTON.1 {
                break;
            }
            let along = |dx: f64, dy: f64| {
                let [ahead, behind] =
                    [1.0, -1.0].map(|sign| self.chart_of_film([at[0] + sign * dx, at[1] + sign * dy]));
                [(ahead[0] - behind[0]) / (2.0 * STEP_MM), (ahead[1] - behind[1]) / (2.0 * STEP_MM)]
            };
            let ([a, c], [b, d]) = (along(STEP_MM, 0.0), along(0.0, STEP_MM));
            let determinant = a * d - b * c;
            at = [at[0] + (d * ex - b * ey) / determinant, at[1] + (a * ey - c * ex) / determinant];
        }
        let here = self.chart_of_film(at);
        match (here[0] - point[0]).hypot(here[1] - point[1]) {
            error if error < 1e-9 => Ok(at),
            _ => Err(anyhow!("the chart point ({}, {}) mm has no place on the film", point[0], point[1])),
        }
    }

    /// Relative illumination at `[x, y]` on the film.
    pub fn relative_illumination(&self, [x, y]: [f64; 2]) -> f64 {
        match &self.field {
            AnyField::Radial(field) => field.at(x.hypot(y)).1,
            AnyField::Planar(field) => field.at(y, x)[2],
        }
    }
}

/// The reach of a film on which `points` lie, mm.
///
/// # Errors
/// Usage: a point that is not finite.
pub fn reach_of(points: &[[f64; 2]]) -> Result<f64> {
    let farthest =
        points.iter().map(|[x, y]| x.hypot(*y)).fold(0.0, |a: f64, r| if r.is_nan() { r } else { a.max(r) });
    match farthest.is_finite() {
        true => Ok(farthest * (1.0 + BEYOND.0) + BEYOND.1),
        false => Err(usage("points: expected finite numbers in mm")),
    }
}
