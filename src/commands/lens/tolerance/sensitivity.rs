//! Each error alone at its limits: what it does to the lens after its adjustment.
//!
//! Changes are from the lens without errors, adjusted alike. Errors are sorted by the larger change of the criterion, whatever its
//! sign. The root of the sum of the mean squares of the changes is the estimate of the deviation that all cause together; it is
//! good where changes are proportional to errors, and MTF falls with the square of small ones.

use super::rows::Row;
use crate::commands::lens::tables::csv_line;
use crate::progress::number;
use pipeline::design::tolerance::statistics::root_sum_square;
use pipeline::design::tolerance::{Extreme, Tolerances};
use serde_json::{Value, json};

/// Changes of a lens with one error at a limit.
#[derive(Clone, Copy)]
pub struct Change {
    pub criterion: f64,
    pub film_shift_mm: f64,
    pub boresight_mm: [f64; 2],
    pub shift_mm: f64,
    pub illumination: f64,
}

/// An error at its lower and upper limit; none where the lens fails.
pub struct Effect {
    /// Index of the parameter.
    pub parameter: usize,
    pub changes: [Option<Change>; 2],
}

/// All errors, the strongest first.
pub struct Sensitivity {
    pub effects: Vec<Effect>,
    /// Estimate of all together.
    pub root_sum_square: f64,
}

impl Effect {
    /// The larger change of the criterion.
    pub fn largest(&self) -> f64 {
        // A lens that fails has the largest of all.
        self.changes.iter().map(|c| c.map_or(f64::INFINITY, |c| c.criterion.abs())).fold(0.0, f64::max)
    }
}

impl Sensitivity {
    /// Of the lenses of `extremes`, both of each.
    pub fn new(nominal: &Row, extremes: &[Extreme], lenses: Vec<[Row; 2]>) -> Self {
        let change = |row: &Row| {
            let (of, from) = (row.outcome.as_ref().ok()?, nominal.outcome.as_ref().ok()?);
            Some(Change {
                criterion: of.criterion - from.criterion,
                film_shift_mm: of.film_shift_mm - from.film_shift_mm,
                boresight_mm: of.boresight_mm,
                shift_mm: of.shift_mm,
                illumination: of.illumination_change,
            })
        };
        let effect = |(extreme, rows): (&Extreme, &[Row; 2])| Effect {
            parameter: extreme.parameter,
            changes: [change(&rows[0]), change(&rows[1])],
        };
        let mut effects: Vec<Effect> = extremes.iter().zip(&lenses).map(effect).collect();
        effects.sort_by(|a, b| b.largest().total_cmp(&a.largest()));
        let changes: Vec<[f64; 2]> =
            effects.iter().map(|e| e.changes.map(|c| c.map_or(0.0, |c| c.criterion))).collect();
        Self { root_sum_square: root_sum_square(&changes), effects }
    }

    /// `sensitivity.csv`: two rows an error.
    pub fn csv(&self, tolerances: &Tolerances) -> String {
        let head = [
            "error",
            "unit",
            "limit",
            "criterion_change",
            "film_shift_change_mm",
            "boresight_x_mm",
            "boresight_y_mm",
            "shift_beyond_boresight_mm",
            "relative_illumination_change",
        ];
        let mut text = csv_line(&head.map(str::to_owned));
        for effect in &self.effects {
            let parameter = &tolerances.parameters()[effect.parameter];
            for (limit, change) in
                [parameter.limits.low, parameter.limits.high].into_iter().zip(&effect.changes)
            {
                let mut cells =
                    vec![parameter.id.clone(), parameter.unit.name().to_owned(), limit.to_string()];
                match change {
                    Some(c) => cells.extend(
                        [
                            c.criterion,
                            c.film_shift_mm,
                            c.boresight_mm[0],
                            c.boresight_mm[1],
                            c.shift_mm,
                            c.illumination,
                        ]
                        .map(|v| number(v).to_string()),
                    ),
                    None => cells.resize(head.len(), String::new()),
                }
                text += &csv_line(&cells);
            }
        }
        text
    }

    /// Its part of the summary.
    pub fn json(&self, tolerances: &Tolerances) -> Value {
        let effect = |e: &Effect| {
            let parameter = &tolerances.parameters()[e.parameter];
            json!({
                "error": parameter.id,
                "unit": parameter.unit.name(),
                "limits": [parameter.limits.low, parameter.limits.high],
                "criterion_change": e.changes.map(|c| c.map(|c| number(c.criterion))),
                "film_shift_change_mm": e.changes.map(|c| c.map(|c| number(c.film_shift_mm))),
            })
        };
        json!({
            "root_sum_square": number(self.root_sum_square),
            "errors": self.effects.iter().map(effect).collect::<Vec<_>>(),
        })
    }
}
