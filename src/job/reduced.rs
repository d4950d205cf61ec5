//! Reduced charts of a job, read from the user's cache or made and stored there.

use super::depth::Depth;
use super::lens::cache::{self, reduced};
use super::numeric_version::numeric_version;
use crate::open::Chart;
use crate::progress::detail_line;
use anyhow::Result;
use formats::chart::NanPolicy;
use formats::durable::sweep;
use pipeline::flow::SourceSinkError;
use pipeline::geometry::Size;
use pipeline::reduced_chart::ReducedChart;
use std::path::PathBuf;
use std::time::SystemTime;

/// Reduced charts of a job.
pub struct ReducedCharts {
    /// The cache, and what identifies the chart's values in it; `None`: all are computed.
    kept: Option<(PathBuf, String)>,
}

impl ReducedCharts {
    /// None is kept.
    pub fn none() -> Self {
        Self { kept: None }
    }

    /// Those of `chart`, or what is seen of the surfaces `depth`. They are not kept without a cache that can be written, of charts at URLs, and of
    /// those that changed just now.
    ///
    /// # Errors
    /// Files cannot be listed.
    pub fn new(chart: &Chart, depth: Option<&Depth>, nan: NanPolicy) -> Result<Self> {
        let dir = cache::directory().filter(|dir| std::fs::create_dir_all(dir).is_ok() && sweep(dir).is_ok());
        let Some(dir) = dir else { return Ok(Self::none()) };
        let now = SystemTime::now();
        let Some(mut key) = chart.samples_key(now)? else { return Ok(Self::none()) };
        if let Some(depth) = depth.filter(|depth| !depth.is_opaque()) {
            for chart in depth.charts() {
                let Some(of_surface) = chart.samples_key(now)? else { return Ok(Self::none()) };
                key = format!("{key} {of_surface}");
            }
            key = format!("{key}, surfaces {}", depth.identity()?.0);
        }
        Ok(Self { kept: Some((dir, format!("{key}, NaN: {nan:?}, arithmetic {}", numeric_version(false)))) })
    }

    /// Band `band` of a chart of `chart` px in cells of `side` chart pixels: from the cache, or of `read`.
    ///
    /// # Errors
    /// Those of `read`.
    pub fn get(
        &self,
        chart: Size,
        band: usize,
        side: usize,
        read: impl FnOnce() -> Result<ReducedChart, SourceSinkError>,
    ) -> Result<ReducedChart, SourceSinkError> {
        let Some((dir, key)) = &self.kept else { return read() };
        let text = format!("lenscube reduced chart 2, {key}, band {band}, cells of {side} px");
        let recipe = blake3::hash(text.as_bytes()).to_hex().to_string();
        if let Some(found) = reduced::find(dir, &recipe, chart, side) {
            detail_line(format!("reduced chart of band {band}: from the cache"));
            return Ok(found);
        }
        let made = read()?;
        reduced::insert(dir, &recipe, &made);
        Ok(made)
    }
}
