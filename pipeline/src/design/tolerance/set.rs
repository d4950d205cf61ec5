//! All errors of a lens in their order, and the lenses drawn from them.
//!
//! Order: elements, the outermost group first, then surfaces, gaps, glasses and the film, whatever the order of the description:
//! the same errors are the same parameters. An identifier is kind, surfaces and parameter (`element 7-9/decentre_x`). Errors that
//! differ only in their pivot, or in the gap that absorbs them, have one identifier: the second in this order gets `#2`.

use std::collections::HashMap;

use super::check::{check, semi_diameter_mm};
use super::draw::uniform;
use super::entry::Tolerance;
use super::law::{Law, Limits};
use super::problem::ToleranceError;
use super::quantity::Unit;
use crate::design::system::{Surface, System};

/// A number that is drawn for each lens.
#[derive(Clone, Debug, PartialEq)]
pub struct Parameter {
    /// Identifier, the key of its draws.
    pub id: String,
    /// Unit of its values.
    pub unit: Unit,
    /// Its limits and their law; of a direction, the circle.
    pub limits: Limits,
    /// Whether it is the direction of the parameter before it, which is no error by itself.
    pub is_direction: bool,
}

/// A lens with one error at its limits.
#[derive(Clone, Debug, PartialEq)]
pub struct Extreme {
    /// Index of the parameter.
    pub parameter: usize,
    /// Values of all parameters with this one at its lower and at its upper limit, all others 0 (directions: along x).
    pub values: [Vec<f64>; 2],
}

/// What the conversion of a value needs of a surface.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Nominal {
    /// Vertex curvature of the conic, 1/mm.
    pub(super) curvature: f64,
    /// Clear radius, mm.
    pub(super) semi_diameter_mm: f64,
}

/// The errors of a lens.
#[derive(Clone, Debug, PartialEq)]
pub struct Tolerances {
    /// In their order.
    pub(super) list: Vec<Tolerance>,
    parameters: Vec<Parameter>,
    /// Index of the parameter of each tolerance.
    pub(super) starts: Vec<usize>,
    /// Test wavelength, mm.
    pub(super) fringe_mm: f64,
    /// Surface k at index k − 1.
    pub(super) nominal: Vec<Nominal>,
}

impl Tolerances {
    /// The errors `list`, in any order, of the nominal lens `system`; fringes are counted at `fringe_nm`.
    ///
    /// # Errors
    /// [`ToleranceError`] with the index of the tolerance in `list`.
    pub fn new(list: &[Tolerance], fringe_nm: f64, system: &System) -> Result<Self, ToleranceError> {
        check(list, system)?;
        let mut list = list.to_vec();
        list.sort_by_key(|t| (t.target.rank(), t.quantity));
        let (mut parameters, mut starts) = (Vec::new(), Vec::with_capacity(list.len()));
        let mut seen: HashMap<String, usize> = HashMap::new();
        for tolerance in &list {
            let count = seen.entry(tolerance.id()).or_insert(0);
            *count += 1;
            let suffix = if *count == 1 { String::new() } else { format!("#{count}") };
            starts.push(parameters.len());
            parameters.push(Parameter {
                id: tolerance.id() + &suffix,
                unit: tolerance.quantity.unit(),
                limits: tolerance.limits,
                is_direction: false,
            });
            if let Some(high) = tolerance.quantity.largest_angle() {
                parameters.push(Parameter {
                    id: format!("{}_angle{suffix}", tolerance.id()),
                    unit: Unit::Rad,
                    limits: Limits { low: 0.0, high, law: Law::Uniform },
                    is_direction: true,
                });
            }
        }
        let nominal =
            |s: &Surface| Nominal { curvature: s.shape.curvature, semi_diameter_mm: semi_diameter_mm(s) };
        let nominal = system.surfaces.iter().map(nominal).collect();
        Ok(Self { list, parameters, starts, fringe_mm: fringe_nm * 1e-6, nominal })
    }

    /// The numbers that are drawn for each lens.
    pub fn parameters(&self) -> &[Parameter] {
        &self.parameters
    }

    /// The values of a lens, one a parameter.
    pub fn draw(&self, seed: u64, sample: u64) -> Vec<f64> {
        self.parameters.iter().map(|p| p.limits.value(uniform(seed, sample, &p.id))).collect()
    }

    /// Each error alone at its limits.
    pub fn extremes(&self) -> Vec<Extreme> {
        let one = |&parameter: &usize| {
            let limits = self.parameters[parameter].limits;
            let at = |value: f64| {
                let mut values = vec![0.0; self.parameters.len()];
                values[parameter] = value;
                values
            };
            Extreme { parameter, values: [at(limits.low), at(limits.high)] }
        };
        self.starts.iter().map(one).collect()
    }
}
