//! Inputs and the film of a job.

use super::guard::Guard;
use crate::args::{BuiltArgs, CoatingsArg, DepthArgs, GhostArgs, RunArgs, TracingArgs};
use crate::design::coating_tables;
use formats::sensor::{builtin_names, sensor_tables};
use std::path::{Path, PathBuf};

impl Guard {
    /// Inputs and the film of a job.
    pub fn of_job(args: &RunArgs) -> Self {
        Self::default().reads_chart("chart", &args.chart).reads_optics(args).writes("FILM", &args.film)
    }

    /// Adds all inputs of a job but its chart.
    pub fn reads_optics(self, args: &RunArgs) -> Self {
        self.reads_surfaces(&args.surfaces)
            .reads_lens(&args.lens)
            .reads_glasses(&args.tracing)
            .reads_tolerances(&args.built)
            .reads_ghosts(&args.veil.ghosts)
    }

    /// Adds the description of a sensor with the tables that it or `set` (`FIELD=VALUE`) names; nothing of a built-in sensor.
    pub fn reads_sensor(self, name: &str, set: &[String]) -> Self {
        if builtin_names().contains(&name) {
            return self;
        }
        let guard = self.reads("sensor description", Path::new(name));
        let tables = sensor_tables(Path::new(name), set);
        tables.iter().fold(guard, |guard, path| guard.reads("table of the sensor", path))
    }

    /// Adds a description of manufacturing errors.
    pub fn reads_tolerances(self, args: &BuiltArgs) -> Self {
        args.tolerances.iter().fold(self, |guard, path| guard.reads("tolerances", path))
    }

    /// Adds a table of the film's reflectance.
    pub fn reads_ghosts(self, args: &GhostArgs) -> Self {
        args.reflectance_file()
            .into_iter()
            .fold(self, |guard, path| guard.reads_text("reflectance of the film", path))
    }

    /// Adds glass catalogues and coatings.
    pub fn reads_glasses(self, args: &TracingArgs) -> Self {
        self.reads_catalogues(&args.glass_catalog, &args.coatings)
    }

    /// Adds glass catalogues, a file of coatings, and the tables that this names.
    pub fn reads_catalogues(self, glasses: &[PathBuf], coatings: &CoatingsArg) -> Self {
        let guard = glasses.iter().fold(self, |guard, path| guard.reads_text("glass catalogue", path));
        let Some(file) = coatings.file() else { return guard };
        let tables = coating_tables(file).into_iter();
        tables.fold(guard.reads_text("coatings", file), |g, table| {
            g.reads_text("table of the coatings", &table)
        })
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
