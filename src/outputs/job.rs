//! Inputs and the film of a job.

use super::guard::Guard;
use crate::args::{DepthArgs, RunArgs, TracingArgs};

impl Guard {
    /// Inputs and the film of a job.
    pub fn of_job(args: &RunArgs) -> Self {
        Self::default()
            .reads_chart("chart", &args.chart)
            .reads_surfaces(&args.surfaces)
            .reads_lens(&args.lens)
            .reads_glasses(&args.tracing)
            .writes("FILM", &args.film)
    }

    /// Adds glass catalogues.
    pub fn reads_glasses(self, args: &TracingArgs) -> Self {
        let guard = args.glass_catalog.iter().fold(self, |guard, path| guard.reads("glass catalogue", path));
        args.coatings.file().into_iter().fold(guard, |guard, path| guard.reads("coatings", path))
    }

    /// Adds distances and hidden surfaces.
    pub fn reads_surfaces(self, args: &DepthArgs) -> Self {
        let is_path = |depth: &&String| *depth != "none" && depth.parse::<f64>().is_err();
        let depth = args.depth.iter().filter(is_path);
        let guard = depth.fold(self, |guard, depth| guard.reads_chart("depth array", depth));
        let hidden = args.given_hidden().unwrap_or_default();
        hidden.iter().fold(guard, |guard, group| guard.reads_chart("hidden surface", group))
    }
}
