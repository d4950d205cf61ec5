//! Which arrays hold the surfaces of a job: those of `--depth` and `--hidden`, else those of the chart itself.
//!
//! A chart's group may hold `depth`, `coverage`, `hidden/1/chart`, `hidden/1/depth`, `hidden/1/coverage`, `hidden/2/chart`, …; `gen:depth-scene` has
//! such arrays, too, and a scene has them for each of its surfaces. `--depth none` ignores them.

use super::arrays::is_missing;
use crate::args::DepthArgs;
use crate::failure::usage;
use crate::open::{self, Chart, ChartFlags};
use anyhow::Result;
use formats::chart::{exr, lacks_array};
use pipeline::chart::ScenePart;
use std::path::Path;

/// Arrays of one surface.
#[derive(Clone)]
pub struct SurfacePaths {
    /// Its name in messages.
    pub name: String,
    /// Its chart; none for the surface that the job's chart shows.
    pub chart: Option<String>,
    /// Its distances: an array, or one number.
    pub depth: String,
    /// Where its coverage is, if it has one.
    pub coverage: Option<String>,
}

impl SurfacePaths {
    /// The surfaces of a job with the flags `given` and the chart `chart`, given as `spec`: the one that it shows first; empty for a flat chart.
    ///
    /// # Errors
    /// Flags of distances without distances; the chart's store cannot be read.
    pub fn of_job(given: &DepthArgs, spec: &str, chart: &Chart) -> Result<Vec<Self>> {
        let mut found = match given.depth.as_deref() {
            Some("none") => Vec::new(),
            Some(depth) => vec![Self::first(depth)],
            None => Self::of_chart(spec, chart)?,
        };
        let Some(first) = found.first() else {
            return match unused(given) {
                None => Ok(found),
                Some(flag) => Err(usage(format!(
                    "{flag} requires the distance of every chart pixel: --depth with an array or one distance"
                ))),
            };
        };
        if !given.hidden.is_empty() {
            let hidden = given.given_hidden()?.iter().map(|group| Self::hidden(group));
            found = std::iter::once(first.clone()).chain(hidden).collect();
        }
        Ok(found)
    }

    /// The surface that the chart shows, with the distances `depth`.
    pub fn first(depth: &str) -> Self {
        let coverage = group_of(depth).map(|group| member(group, "coverage"));
        Self { name: format!("--depth {depth}"), chart: None, depth: depth.into(), coverage }
    }

    fn hidden(group: &str) -> Self {
        if exr::is_supported_path(Path::new(group)) {
            let (name, chart) = (format!("--hidden {group}"), Some(group.to_owned()));
            return Self { name, chart, depth: group.into(), coverage: None };
        }
        let member = |name: &str| member(group, name);
        Self {
            name: format!("--hidden {group}"),
            chart: Some(member("chart")),
            depth: member("depth"),
            coverage: Some(member("coverage")),
        }
    }

    /// Those beside the chart `chart`, given as `spec`.
    ///
    /// # Errors
    /// Its store cannot be read.
    pub fn of_chart(spec: &str, chart: &Chart) -> Result<Vec<Self>> {
        match chart {
            Chart::Generated(generator) => {
                let part = |part| Some(format!("gen:{}", generator.spec().scene_part(part)?));
                let (true, Some(depth)) = (generator.spec().has_depth(), part(ScenePart::Depth)) else {
                    return Ok(Vec::new());
                };
                let front =
                    Self { name: spec.to_owned(), chart: None, depth, coverage: part(ScenePart::Coverage) };
                let behind = part(ScenePart::Hidden).zip(part(ScenePart::HiddenDepth));
                let behind = behind.map(|(hidden, depth)| Self {
                    name: format!("{spec}, hidden surface"),
                    chart: Some(hidden),
                    depth,
                    coverage: None,
                });
                Ok(std::iter::once(front).chain(behind).collect())
            }
            Chart::Store(store) => {
                let array = store.array_path();
                // Of `GROUP/chart` and `GROUP/film`; an array at the root of its store has no group.
                let group = array.parent().filter(|_| array != store.path()).and_then(|p| p.to_str());
                let Some(group) = group else { return Ok(Vec::new()) };
                let group = match group.strip_prefix(&*store.path().to_string_lossy()) {
                    Some(inside) if !inside.is_empty() => {
                        format!("{}//{}", store.path().display(), inside.trim_start_matches('/'))
                    }
                    _ => group.to_owned(),
                };
                Self::of_group(&group)
            }
            Chart::Array(_) => Ok(Vec::new()),
            Chart::Scene(scene) => Ok(Self::of_scene(&scene.path().display().to_string(), scene.sheets())),
            Chart::Raster(_) | Chart::Decoded(_) => match chart.hdf5_array() {
                None => Ok(Vec::new()),
                Some((file, array)) => Self::of_group(&match array.path.rsplit_once('/') {
                    None => file.display().to_string(),
                    Some((group, _)) => format!("{}//{group}", file.display()),
                }),
            },
        }
    }

    /// Those of the scene at `path`.
    fn of_scene(path: &str, sheets: usize) -> Vec<Self> {
        let depth = member(path, "depth");
        let first = Self { name: depth.clone(), ..Self::first(&depth) };
        let hidden = |number: usize| {
            let group = member(path, &format!("hidden/{number}"));
            Self { name: group.clone(), chart: Some(group.clone()), ..Self::hidden(&group) }
        };
        std::iter::once(first).chain((1..sheets).map(hidden)).collect()
    }

    /// Those of a group of a Zarr store or an HDF5 file.
    fn of_group(group: &str) -> Result<Vec<Self>> {
        let depth = member(group, "depth");
        if !is_plane(&depth)? {
            return Ok(Vec::new());
        }
        let mut found = vec![Self { name: depth.clone(), ..Self::first(&depth) }];
        for number in 1.. {
            let hidden = member(group, &format!("hidden/{number}"));
            if !is_plane(&member(&hidden, "depth"))? {
                break;
            }
            found.push(Self { name: hidden.clone(), ..Self::hidden(&hidden) });
        }
        Ok(found)
    }
}

/// A flag that has no effect without distances.
fn unused(given: &DepthArgs) -> Option<&'static str> {
    [
        ("--hidden", !given.hidden.is_empty()),
        ("--depth-unit", given.depth_unit.is_some()),
        ("--depth-kind", given.depth_kind.is_some()),
        ("--depth-miss", given.depth_miss.is_some()),
        ("--depth-edges", given.depth_edges.is_some()),
        ("--coverage-light", given.coverage_light.is_some()),
        ("--depth-tolerance", given.depth_tolerance.is_some()),
    ]
    .into_iter()
    .find_map(|(flag, is_given)| is_given.then_some(flag))
}

/// Whether there is an array of rows and columns `spec` in a Zarr store or an HDF5 file.
fn is_plane(spec: &str) -> Result<bool> {
    if lacks_array(spec)? {
        return Ok(false);
    }
    match open::chart_with(spec, &ChartFlags::default()) {
        Ok(chart) => Ok(chart.bands() == 1),
        Err(e) if is_missing(&e) => Ok(false),
        Err(e) => Err(e),
    }
}

/// The group of the array `PATH//depth`; none for an array that is a store of its own.
pub fn group_of(spec: &str) -> Option<&str> {
    let (scheme, path) = spec.split_once("://").map_or((0, spec), |(scheme, path)| (scheme.len() + 3, path));
    let at = scheme + path.rfind("//").map(|_| path.rfind('/'))??;
    Some(spec[..at].trim_end_matches('/'))
}

/// The array `name` of a group `PATH` or `PATH//GROUP`.
pub fn member(group: &str, name: &str) -> String {
    let has_array = group.split_once("://").map_or(group, |(_, path)| path).contains("//");
    format!("{group}{}{name}", if has_array { "/" } else { "//" })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arrays_of_a_group_are_found_beside_each_other() {
        for (spec, group, coverage) in [
            ("a/c.zarr//depth", Some("a/c.zarr"), "a/c.zarr//coverage"),
            ("c.zarr//hidden/1/depth", Some("c.zarr//hidden/1"), "c.zarr//hidden/1/coverage"),
            ("s3://b/c.zarr//depth", Some("s3://b/c.zarr"), "s3://b/c.zarr//coverage"),
        ] {
            assert_eq!(group_of(spec), group);
            assert_eq!(member(group.unwrap(), "coverage"), coverage);
        }
        assert_eq!([group_of("a/depth.npy"), group_of("s3://b/depth.zarr")], [None, None]);
    }
}
