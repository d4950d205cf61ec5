//! Start-up time of a worker, measured while the plan is made.

use super::file::Plan;
use crate::args::RunArgs;
use crate::job::Job;
use crate::job::stages::stages;
use crate::progress::log_line;
use anyhow::Result;
use std::collections::BTreeSet;
use std::time::Instant;

/// Share of a unit's time above which start-up is worth a note.
const MAX_USUAL_SHARE: f64 = 0.1;

/// Measures the time until the first tile for the cheapest unit, and prints it.
///
/// # Errors
/// The job of the unit cannot be opened.
pub fn measure(plan: &Plan, run: &RunArgs) -> Result<()> {
    let Some(unit) = plan.units.iter().min_by(|a, b| a.cost.core_s.total_cmp(&b.cost.core_s)) else {
        return Ok(());
    };
    let start = Instant::now();
    let bands = plan.bands(&BTreeSet::from([unit.unit]));
    let job = Job::for_planned_bands(run, plan.planned_bands(&bands))?;
    let opening_s = start.elapsed().as_secs_f64();
    stages(&job, 0)?;
    let startup_s = start.elapsed().as_secs_f64();
    let share = startup_s / (startup_s + unit.cost.core_s / job.threads as f64);
    log_line(format!(
        "start-up of a worker, measured here for unit {}: opening {opening_s:.3} s, kernels {:.3} s; i.e. {:.1} % of its time on \
         {} threads",
        unit.unit,
        startup_s - opening_s,
        100.0 * share,
        job.threads
    ));
    if share > MAX_USUAL_SHARE {
        log_line("note: for a job this small a single `lenscube run` is faster");
    }
    Ok(())
}
