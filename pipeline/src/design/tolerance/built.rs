//! Drawn values as deviations of the lens that is traced, in mm and rad.
//!
//! ```text
//! radius in percent p or µm:   R → R + ΔR, ΔR = R p/100
//! fringes N:                   Δc = N λ/S², λ the test wavelength, S the clear radius of the design
//! Zernike term j, w waves:     sag = w λ Z_j(x/S, y/S), RMS over the circle 1, Noll's order
//! Abbe number, percent p:      V → V (1 + p/100)
//! radial value v at azimuth α: (v cos α, v sin α)
//! ```
//! Source of the order: Noll, "Zernike polynomials and atmospheric turbulence", JOSA 66 (1976) 207; OpticStudio calls these terms
//! standard.

use super::entry::Target;
use super::quantity::{Direction, Figure, Quantity, RadiusUnit};
use super::set::{Nominal, Tolerances};
use crate::design::skew::deviation::{
    self, Deviation, ShapeChange, curvature_of_fringes, curvature_of_radius, irregularity,
    mixed_irregularity, zernike,
};
use crate::real;

/// mm in a µm.
const MM: f64 = 1e-3;
/// rad in an arcmin.
const RAD: f64 = std::f64::consts::PI / (180.0 * 60.0);

/// What the values of one target add up to.
#[derive(Default)]
struct Sum {
    decentre_mm: [f64; 2],
    tilt_rad: [f64; 2],
    wedge_rad: [f64; 2],
    shift_mm: f64,
    thickness_mm: f64,
    index: f64,
    abbe: f64,
    shape: ShapeChange,
}

impl Tolerances {
    /// The deviations of the lens with these values (one a parameter), the outermost element first.
    pub fn deviations(&self, values: &[f64]) -> Vec<Deviation> {
        let mut deviations = Vec::new();
        let mut sum = Sum::default();
        for (i, tolerance) in self.list.iter().enumerate() {
            let start = self.starts[i];
            let angle = tolerance.quantity.largest_angle().map_or(0.0, |_| values[start + 1]);
            let nominal = match tolerance.target {
                Target::Surface(surface) => self.nominal[surface - 1],
                _ => Nominal::default(),
            };
            sum.add(tolerance.quantity, values[start], angle, nominal, self.fringe_mm);
            // All quantities of a target follow each other.
            if self.list.get(i + 1).is_none_or(|next| next.target != tolerance.target) {
                deviations.push(std::mem::take(&mut sum).deviation(tolerance.target));
            }
        }
        deviations
    }
}

impl Sum {
    fn add(&mut self, quantity: Quantity, value: f64, angle_rad: f64, nominal: Nominal, fringe_mm: f64) {
        let along = |direction: Direction, size: f64| match direction {
            Direction::X => [size, 0.0],
            Direction::Y => [0.0, size],
            Direction::Radial => [size * real::cos(angle_rad), size * real::sin(angle_rad)],
        };
        let plus = |to: &mut [f64; 2], [x, y]: [f64; 2]| *to = [to[0] + x, to[1] + y];
        let Nominal { curvature, semi_diameter_mm } = nominal;
        let figure = &mut self.shape.figure;
        match quantity {
            Quantity::Decentre(d) => plus(&mut self.decentre_mm, along(d, value * MM)),
            Quantity::Tilt(d) => plus(&mut self.tilt_rad, along(d, value * RAD)),
            Quantity::Wedge(d) => plus(&mut self.wedge_rad, along(d, value * RAD)),
            Quantity::Shift => self.shift_mm = value * MM,
            Quantity::Radius(unit) => {
                let radius_mm = 1.0 / curvature;
                self.shape.curvature = match unit {
                    RadiusUnit::Percent => curvature_of_radius(radius_mm, radius_mm * value / 100.0),
                    RadiusUnit::Um => curvature_of_radius(radius_mm, value * MM),
                    RadiusUnit::Fringes => curvature_of_fringes(value, fringe_mm, semi_diameter_mm),
                };
            }
            Quantity::Irregularity(Figure::Astigmatism) => {
                figure.extend(irregularity(value, fringe_mm, semi_diameter_mm, angle_rad));
            }
            Quantity::Irregularity(Figure::Mixed) => {
                figure.extend(mixed_irregularity(value, fringe_mm, semi_diameter_mm, angle_rad));
            }
            Quantity::Zernike(term) => {
                let (n, m) = noll(term);
                figure.extend(zernike(n, m, value * fringe_mm, semi_diameter_mm, true));
            }
            Quantity::Conic => self.shape.conic = value,
            Quantity::Thickness => self.thickness_mm = value * MM,
            Quantity::Index => self.index = value,
            Quantity::Abbe => self.abbe = value / 100.0,
        }
    }

    /// The deviation of `target`, whose surfaces the tracer counts from 0.
    fn deviation(self, target: Target) -> Deviation {
        let Self { decentre_mm, tilt_rad, wedge_rad, shift_mm, thickness_mm, index, abbe, shape } = self;
        match target {
            Target::Element { first, last, pivot } => Deviation::Element {
                surfaces: [first - 1, last - 1],
                decentre_mm,
                tilt_rad: [tilt_rad[0], tilt_rad[1], 0.0],
                wedge_rad,
                shift_mm,
                pivot: Some(deviation::Pivot { surface: pivot.surface - 1, offset_mm: pivot.offset_mm }),
            },
            Target::Surface(surface) => {
                Deviation::Surface { surface: surface - 1, decentre_mm, tilt_rad, shape }
            }
            Target::Gap { after, absorb } => {
                Deviation::Gap { after: after - 1, thickness_mm, absorb: absorb.map(|s| s - 1) }
            }
            Target::Glass(after) => Deviation::Glass { after: after - 1, index, abbe },
            Target::Film => Deviation::Film { decentre_mm, tilt_rad, shift_mm },
        }
    }
}

/// Radial and azimuthal order of Noll's term `j`; a negative azimuthal order is a sine.
pub(super) fn noll(j: u32) -> (u32, i32) {
    let mut n = 0;
    while (n + 1) * (n + 2) / 2 < j {
        n += 1;
    }
    let place = j - n * (n + 1) / 2 - 1;
    let m = if n % 2 == 0 { 2 * place.div_ceil(2) } else { 1 + 2 * (place / 2) } as i32;
    (n, if j.is_multiple_of(2) { m } else { -m })
}
