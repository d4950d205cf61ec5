//! Whether a list of tolerances can be drawn for a lens.

use std::collections::HashMap;

use super::entry::{Rank, Target, Tolerance};
use super::problem::{Problem, ToleranceError};
use super::quantity::{Direction, Quantity, RadiusUnit};
use crate::design::system::{Medium, Surface, System};

/// Zernike terms that are figure errors, up to the 20th order.
const TERMS: std::ops::RangeInclusive<u32> = 4..=231;

/// Clear radius of a surface, mm, over which fringes count; 0 if the design does not give it.
pub(super) fn semi_diameter_mm(surface: &Surface) -> f64 {
    if surface.semi_diameter_mm > 0.0 { surface.semi_diameter_mm } else { surface.aperture_mm.unwrap_or(0.0) }
}

/// Checks each tolerance by itself and against those before it.
pub(super) fn check(list: &[Tolerance], system: &System) -> Result<(), ToleranceError> {
    let mut drawn: HashMap<(Rank, String), usize> = HashMap::new();
    let mut elements: Vec<(usize, [usize; 2])> = Vec::new();
    for (index, tolerance) in list.iter().enumerate() {
        let error =
            |other: Option<usize>, problem| ToleranceError { index, other, id: tolerance.id(), problem };
        one(tolerance, system).map_err(|problem| error(None, problem))?;
        if let Target::Element { first, last, .. } = tolerance.target {
            if let Some((other, _)) = elements.iter().find(|(_, range)| cross(*range, [first, last])) {
                let crossed = list[*other].target.name();
                return Err(error(Some(*other), Problem::Crossing { other: crossed }));
            }
            elements.push((index, [first, last]));
        }
        for parameter in parameters(tolerance) {
            if let Some(other) = drawn.insert(parameter, index).filter(|other| *other != index) {
                return Err(error(Some(other), Problem::Twice { other: list[other].id() }));
            }
        }
    }
    Ok(())
}

/// Whether two ranges share surfaces and neither contains the other.
fn cross([a, b]: [usize; 2], [c, d]: [usize; 2]) -> bool {
    (a < c && c <= b && b < d) || (c < a && a <= d && d < b)
}

fn one(tolerance: &Tolerance, system: &System) -> Result<(), Problem> {
    let Tolerance { target, quantity, limits } = tolerance;
    // Neither holds for a limit that is not a number.
    if !(limits.low <= limits.high && limits.low.is_finite() && limits.high.is_finite()) {
        return Err(Problem::Limits { low: limits.low, high: limits.high });
    }
    let film = system.surfaces.len();
    // Everything but the film; an element's pivot may be there.
    let within = |surface: usize| match (1..film).contains(&surface) {
        true => Ok(&system.surfaces[surface - 1]),
        false if surface == film => Err(Problem::Film { surface }),
        false => Err(Problem::Surface { surface, expected: format!("1 to {}", film - 1) }),
    };
    match *target {
        Target::Element { first, last, pivot } => {
            within(first)?;
            within(last)?;
            if pivot.surface != film {
                within(pivot.surface)?;
            }
            if first > last {
                return Err(Problem::Order { first, last });
            }
            if !pivot.offset_mm.is_finite() {
                return Err(Problem::Offset { offset_mm: pivot.offset_mm });
            }
            match quantity {
                Quantity::Decentre(_) | Quantity::Tilt(_) | Quantity::Wedge(_) | Quantity::Shift => Ok(()),
                _ => Err(Problem::Kind),
            }
        }
        Target::Surface(number) => {
            let surface = within(number)?;
            match quantity {
                Quantity::Decentre(_) | Quantity::Tilt(_) | Quantity::Conic => Ok(()),
                Quantity::Radius(RadiusUnit::Percent | RadiusUnit::Um) => {
                    (surface.shape.curvature != 0.0).then_some(()).ok_or(Problem::Flat { surface: number })
                }
                Quantity::Zernike(term) if !TERMS.contains(term) => Err(Problem::Term { term: *term }),
                Quantity::Radius(RadiusUnit::Fringes) | Quantity::Irregularity(_) | Quantity::Zernike(_) => {
                    let is_known = semi_diameter_mm(surface) > 0.0;
                    is_known.then_some(()).ok_or(Problem::NoSemiDiameter { surface: number })
                }
                _ => Err(Problem::Kind),
            }
        }
        Target::Gap { after, absorb } => {
            within(after)?;
            if let Some(surface) = absorb.filter(|s| !(after + 1..film).contains(s)) {
                let expected = format!("the surface in front of a later gap, {} to {}", after + 1, film - 1);
                return Err(Problem::Surface { surface, expected });
            }
            matches!(quantity, Quantity::Thickness).then_some(()).ok_or(Problem::Kind)
        }
        Target::Glass(after) => {
            let surface = within(after)?;
            if surface.is_mirror || !matches!(surface.medium, Medium::Glass(_)) {
                return Err(Problem::NoGlass { surface: after });
            }
            matches!(quantity, Quantity::Index | Quantity::Abbe).then_some(()).ok_or(Problem::Kind)
        }
        Target::Film => match quantity {
            Quantity::Decentre(_) | Quantity::Tilt(_) | Quantity::Shift => Ok(()),
            _ => Err(Problem::Kind),
        },
    }
}

/// The parameters that a tolerance draws: the body that moves or changes, and what of it.
fn parameters(tolerance: &Tolerance) -> Vec<(Rank, String)> {
    let Tolerance { target, quantity, .. } = *tolerance;
    let (body, what) = match (target, quantity) {
        // The rear surface of an element about its vertex.
        (Target::Element { last, .. }, Quantity::Wedge(d)) => (Target::Surface(last), Quantity::Tilt(d)),
        // An element of one surface about its vertex is that surface.
        (Target::Element { first, last, pivot }, _)
            if first == last && pivot.surface == first && pivot.offset_mm == 0.0 =>
        {
            (Target::Surface(first), quantity)
        }
        _ => (target, quantity),
    };
    let along = |direction: &Direction| match what {
        Quantity::Decentre(_) => Quantity::Decentre(*direction),
        _ => Quantity::Tilt(*direction),
    };
    match what.axes() {
        [] => vec![(body.rank(), what.name())],
        axes => axes.iter().map(|d| (body.rank(), along(d).name())).collect(),
    }
}
