//! A part of a report: figures, plots and tables of one chart in one picture.

use formats::picture::figure::Figure;
use serde_json::Value;

/// What was measured of a chart.
pub struct Section {
    /// Its name for files and programs.
    pub slug: &'static str,
    /// Its title.
    pub title: &'static str,
    /// Standard, and what was read of it.
    pub standard: &'static str,
    /// The picture.
    pub picture: String,
    /// Camera, exposure and levels, if the file names them.
    pub camera: Option<String>,
    /// Main figures: name, value in words.
    pub figures: Vec<(String, String)>,
    /// Remarks on doubtful figures and on what is not measured.
    pub remarks: Vec<String>,
    /// Plots.
    pub plots: Vec<Figure>,
    /// Tables whose first row is their head.
    pub tables: Vec<Vec<Vec<String>>>,
    /// All values, for programs.
    pub json: Value,
}

/// A number in words, `none` where there is none.
pub fn shown(value: Option<f64>, digits: usize) -> String {
    value.map_or("none".into(), |v| format!("{v:.digits$}"))
}

/// Rows of text as cells.
pub fn cells<const N: usize>(row: [&str; N]) -> Vec<String> {
    row.map(str::to_owned).to_vec()
}
