//! Charts of hidden surfaces: opened as the job's chart is, with bands at the same wavelengths.

use crate::failure::usage;
use crate::open::{self, Chart, ChartFlags};
use anyhow::{Context, Result};
use formats::chart::takes_axes;

/// Largest difference of wavelengths that are the same, nm.
const SAME_NM: f64 = 0.01;

/// Opens the chart `spec` of the surface `name` for a job's chart with bands at `wavelengths_nm`; `flags` are those of the job's chart. `--wavelengths`, if given,
/// names the bands of both.
///
/// # Errors
/// It cannot be read, or its own wavelengths are others or in another order.
pub fn open(spec: &str, name: &str, flags: &ChartFlags<'_>, wavelengths_nm: &[f64]) -> Result<Chart> {
    let is_drawn = spec.starts_with("gen:");
    let flags = ChartFlags {
        axes: flags.axes.filter(|_| takes_axes(spec)),
        scale: flags.scale.filter(|_| !is_drawn),
        ..*flags
    };
    let list = |nm: &[f64]| nm.iter().map(f64::to_string).collect::<Vec<_>>().join(",");
    // Without wavelengths of its own it has those of the job's chart.
    if flags.wavelengths.is_none()
        && !is_drawn
        && let Ok(chart) = open::chart_with(spec, &flags)
        && let Ok(own) = chart.wavelengths_nm()
    {
        let is_same = |(a, b): (&f64, &f64)| (a - b).abs() <= SAME_NM;
        if own.len() == wavelengths_nm.len() && own.iter().zip(wavelengths_nm).all(is_same) {
            return Ok(chart);
        }
        return Err(usage(format!(
            "{name}: chart `{spec}` has bands at {} nm, expected those of the job's chart in the same order, {} nm; if its wavelengths are wrong give \
             --wavelengths, which names the bands of both",
            list(&own),
            list(wavelengths_nm)
        )));
    }
    let nm = list(wavelengths_nm);
    open::chart_with(spec, &ChartFlags { wavelengths: Some(&nm), ..flags }).with_context(|| name.to_owned())
}
