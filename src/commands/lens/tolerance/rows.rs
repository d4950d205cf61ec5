//! `lenses.csv`: a row a lens with its drawn values and its figures.
//!
//! Numbers have up to twelve significant digits, drawn values all of theirs. Cells of failed lenses are empty but for sample,
//! status, reason and drawn values. Field k is place k of `summary.json`, from 1.

use super::request::Request;
use crate::commands::lens::tables::csv_line;
use crate::progress::number;
use formats::design::tolerance::columns;
use pipeline::design::tolerance::{AssessedLens, Batch, CriterionKind, FieldFigures};

/// A lens.
pub struct Row {
    /// Its number.
    pub sample: u64,
    /// Drawn values, one a parameter.
    pub values: Vec<f64>,
    /// Its figures, or why it has none.
    pub outcome: Result<Figures, String>,
}

/// Figures of a lens.
pub struct Figures {
    /// Adjustments.
    pub film_shift_mm: f64,
    pub film_tilt_rad: [f64; 2],
    pub at_limit: bool,
    /// What it is judged by.
    pub criterion: f64,
    /// By place.
    pub fields: Vec<FieldFigures>,
    /// Of the image.
    pub boresight_mm: [f64; 2],
    pub shift_mm: f64,
    pub illumination_change: f64,
}

impl Row {
    /// The lens of `values`.
    pub fn new(sample: u64, values: Vec<f64>, batch: &Batch<'_>) -> Self {
        let outcome = batch.assess(&values).map(Figures::from).map_err(|failure| failure.to_string());
        Self { sample, values, outcome }
    }

    /// A figure of a lens that has not failed.
    pub fn figure(&self, of: impl Fn(&Figures) -> f64) -> Option<f64> {
        self.outcome.as_ref().ok().map(of)
    }
}

impl From<AssessedLens> for Figures {
    fn from(lens: AssessedLens) -> Self {
        Self {
            film_shift_mm: lens.compensated.film_shift_mm,
            film_tilt_rad: lens.compensated.film_tilt_rad,
            at_limit: lens.compensated.at_limit,
            criterion: lens.figures.criterion,
            fields: lens.figures.fields,
            boresight_mm: lens.boresight_mm,
            shift_mm: lens.shift_mm,
            illumination_change: lens.illumination_change,
        }
    }
}

/// The text of `rows` with figures at `places` places.
pub fn csv(request: &Request<'_>, rows: &[Row], places: usize) -> String {
    let mut head: Vec<String> = ["sample", "status", "reason"].map(str::to_owned).to_vec();
    head.extend(columns(request.tolerances));
    head.extend(figure_columns(request, places));
    let mut text = csv_line(&head);
    for row in rows {
        let (status, reason) = match &row.outcome {
            Ok(figures) if figures.at_limit => ("ok", "film shift at its limit"),
            Ok(_) => ("ok", ""),
            Err(reason) => ("failed", reason.as_str()),
        };
        let mut cells = vec![row.sample.to_string(), status.to_owned(), reason.to_owned()];
        cells.extend(row.values.iter().map(f64::to_string));
        match &row.outcome {
            Ok(figures) => cells.extend(figures.cells().iter().map(|v| number(*v).to_string())),
            Err(_) => cells.resize(head.len(), String::new()),
        }
        text += &csv_line(&cells);
    }
    text
}

fn figure_columns(request: &Request<'_>, places: usize) -> Vec<String> {
    let mut names =
        ["film_shift_mm", "film_tilt_x_rad", "film_tilt_y_rad", "criterion"].map(str::to_owned).to_vec();
    for k in 1..=places {
        if matches!(request.criterion().kind, CriterionKind::Mtf { .. }) {
            names.extend([format!("mtf_sagittal_{k}"), format!("mtf_tangential_{k}")]);
        }
        names.extend([format!("rms_wavefront_{k}_waves"), format!("rms_spot_{k}_um")]);
    }
    let last =
        ["boresight_x_mm", "boresight_y_mm", "shift_beyond_boresight_mm", "relative_illumination_change"];
    names.extend(last.map(str::to_owned));
    names
}

impl Figures {
    /// In the order of the columns.
    fn cells(&self) -> Vec<f64> {
        let [tilt_x, tilt_y] = self.film_tilt_rad;
        let mut cells = vec![self.film_shift_mm, tilt_x, tilt_y, self.criterion];
        for field in &self.fields {
            cells.extend(field.mtf.iter().flatten());
            cells.extend([field.rms_wavefront, field.rms_spot_um]);
        }
        cells.extend(self.boresight_mm);
        cells.extend([self.shift_mm, self.illumination_change]);
        cells
    }
}
