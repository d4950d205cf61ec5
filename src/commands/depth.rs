//! `lenscube depth`: what the distances of a chart's pixels mean for a run: range, blur, depth nodes, slabs, cost, suspicious pixels.

mod figure;
mod overview;
mod report;

use crate::args::DepthReportArgs;
use crate::failure::code;
use crate::job::preview::{Opened, Preview};
use crate::outputs::check_absent;
use crate::progress::{log_line, print};
use anyhow::Result;
use overview::Overview;
use std::cell::RefCell;

/// Runs the command; the exit code.
pub fn command(args: &DepthReportArgs) -> Result<u8> {
    if let Some(path) = &args.plot {
        check_absent(path, args.overwrite)?;
    }
    let opened = Opened::new(args)?;
    let overview = RefCell::new(Overview::new(opened.frame.chart, figure::SIDE));
    let (focus, blur_px) = (opened.focus, opened.blur_px());
    let mut on_row = |y: usize, row: &[f64]| {
        overview.borrow_mut().add(y, row, |v| (v - focus).abs() * blur_px);
    };
    let preview = Preview::new(args, opened, &mut on_row)?;
    let overview = overview.into_inner();
    match args.json {
        true => print(serde_json::to_string_pretty(&report::json(&preview, &overview))?),
        false => print(report::text(&preview, &overview)),
    }
    if let Some(path) = &args.plot {
        figure::figure(&preview, &overview, args.style).write(path)?;
        log_line(format!("{}: depth, blur radius, slabs of each tile", path.display()));
    }
    Ok(if preview.problems.is_empty() { 0 } else { code::WRONG })
}
