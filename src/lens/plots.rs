//! Plots.

use super::look::Subject;
use anyhow::Result;
use std::path::Path;

/// Writes them.
pub fn write(_dir: &Path, _subject: &Subject, _nm: &[f64], _at: &[f64], _lp_mm: &[f64]) -> Result<()> {
    Ok(())
}
