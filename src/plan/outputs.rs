//! Paths of the outputs of `lenscube plan` (film, plan, lens pack): none may lie inside another or inside an input.

use crate::args::PlanArgs;
use crate::failure::usage;
use crate::run::film::resolve_links;
use anyhow::Result;
use formats::durable::is_url;
use std::path::{Path, PathBuf};

/// Fails if an output is, or lies inside, another output or the chart.
pub fn check_apart(args: &PlanArgs) -> Result<()> {
    let film = (format!("the film {}", args.job.film.display()), resolved(&args.job.film));
    let chart = Path::new(args.job.chart.split("//").next().unwrap_or_default());
    let chart = (format!("the chart {}", args.job.chart), resolved(chart).filter(|path| path.exists()));
    // In a directory the plan's file name follows from its digest.
    let plan = match args.output.is_dir() {
        true => args.output.join("plan"),
        false => args.output.clone(),
    };
    let plan = (format!("the plan {}", args.output.display()), resolved(&plan));
    let pack = args.lens_pack.as_deref();
    let pack =
        (format!("the lens pack {}", pack.unwrap_or(Path::new("")).display()), pack.and_then(resolved));
    for (inner, outer) in [
        (&plan, &film),
        (&plan, &chart),
        (&plan, &pack),
        (&pack, &film),
        (&pack, &chart),
        (&pack, &plan),
        (&film, &pack),
        (&film, &plan),
    ] {
        if let (Some(a), Some(b)) = (&inner.1, &outer.1)
            && a.starts_with(b)
        {
            let (inner, outer) = (&inner.0, &outer.0);
            return Err(usage(format!("{inner} is or lies inside {outer}; choose another path for it")));
        }
    }
    Ok(())
}

/// The path with links resolved; `None` for a URL.
fn resolved(path: &Path) -> Option<PathBuf> {
    if is_url(path) || path.as_os_str().is_empty() {
        return None;
    }
    Some(resolve_links(&std::path::absolute(path).ok()?))
}
