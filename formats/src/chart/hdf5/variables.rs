//! The arrays of a file, and the one that is the chart.

use std::path::Path;

use hdf5_pure::{Dataset, Error, File, Group};

use super::super::error::ChartError;
use super::dimensions;
use super::guard::guarded;
use super::sample_type;

/// Levels of groups that are searched.
const MAX_DEPTH: usize = 4;
/// Maximum number of arrays that are looked at.
const MAX_ARRAYS: usize = 1000;
/// Arrays listed in a message.
const MAX_LISTED: usize = 20;

/// An array of a file.
pub(super) struct Variable {
    /// Path of its group; empty for the root.
    pub(super) group: String,
    pub(super) name: String,
    pub(super) dataset: Dataset,
}

impl Variable {
    /// Path in the file.
    pub(super) fn full_name(&self) -> String {
        join(&self.group, &self.name)
    }
}

fn join(group: &str, name: &str) -> String {
    if group.is_empty() { name.to_owned() } else { format!("{group}/{name}") }
}

/// The group at `path`; empty for the root.
fn group(file: &File, path: &str) -> Result<Group, Error> {
    if path.is_empty() { Ok(file.root()) } else { file.group(path) }
}

/// The group at `path` and those above it, up to the root.
pub(super) fn groups(file: &File, path: &str) -> Result<Vec<Group>, Error> {
    let mut groups = vec![group(file, path)?];
    let mut inner = path;
    while !inner.is_empty() {
        inner = inner.rsplit_once('/').map_or("", |(outer, _)| outer);
        groups.push(group(file, inner)?);
    }
    Ok(groups)
}

/// The array `requested`; if that is empty, the only array of three axes, of several the only one with as many bands as there are wavelengths (then
/// with a note), else the only one of two.
pub(super) fn select(
    path: &Path,
    file: &File,
    requested: &str,
    given_wavelengths: Option<usize>,
) -> Result<(Variable, Option<String>), ChartError> {
    let none = |requested: String, found: &[Variable]| {
        let mut list: Vec<String> = found.iter().take(MAX_LISTED).map(describe).collect();
        if found.len() > MAX_LISTED {
            list.push("…".into());
        }
        let found = if list.is_empty() { "none".into() } else { list.join(", ") };
        ChartError::NoArray { path: path.into(), requested, found }
    };
    let all = || {
        guarded(path, || {
            let mut all = Vec::new();
            collect(&file.root(), "", 0, &mut all)?;
            Ok(all)
        })
    };
    if !requested.is_empty() {
        let (group, name) = requested.rsplit_once('/').unwrap_or(("", requested));
        return match guarded(path, || file.dataset(requested)) {
            Ok(dataset) => Ok((Variable { group: group.into(), name: name.into(), dataset }, None)),
            Err(error @ (ChartError::Damaged { .. } | ChartError::Io(_))) => Err(error),
            Err(_) => Err(none(format!("{requested:?}"), &all()?)),
        };
    }
    let mut all = all()?;
    let rank =
        |v: &Variable| v.dataset.shape().map_or(0, |s| if s.iter().all(|n| *n > 1) { s.len() } else { 0 });
    for (axes, words) in [(3, "three"), (2, "two")] {
        let places: Vec<usize> = (0..all.len()).filter(|&k| rank(&all[k]) == axes).collect();
        match places[..] {
            [] => {}
            [only] => return Ok((all.swap_remove(only), None)),
            _ if axes == 3 => {
                let fitting = guarded(path, || with_wavelengths(file, &all, &places, given_wavelengths))?;
                let [(only, count)] = fitting[..] else {
                    return Err(none(format!("selected, and several have {words} axes"), &all));
                };
                let chosen = all.swap_remove(only);
                let note = format!(
                    "array {} is read: of {} with three axes it alone has a side of the {count} wavelengths",
                    chosen.full_name(),
                    places.len()
                );
                return Ok((chosen, Some(note)));
            }
            _ => return Err(none(format!("selected, and several have {words} axes"), &all)),
        }
    }
    // An array of one band, row or column.
    let places: Vec<usize> =
        (0..all.len()).filter(|&k| all[k].dataset.shape().is_ok_and(|s| s.len() == 3)).collect();
    match places[..] {
        [] => Err(none("of three or two axes".into(), &all)),
        [only] => Ok((all.swap_remove(only), None)),
        _ => Err(none("selected, and several have three axes".into(), &all)),
    }
}

/// Those of the arrays at `places` that have a side as long as their list of wavelengths, or the one given, with that length.
fn with_wavelengths(
    file: &File,
    all: &[Variable],
    places: &[usize],
    given: Option<usize>,
) -> Result<Vec<(usize, usize)>, Error> {
    let mut fitting = Vec::new();
    for &k in places {
        let counts = match given {
            Some(given) => vec![given],
            None => dimensions::wavelength_counts(&groups(file, &all[k].group)?)?,
        };
        let sides = all[k].dataset.shape()?;
        let fits = |count: &&usize| **count > 1 && sides.contains(&(**count as u64));
        fitting.extend(counts.iter().find(fits).map(|count| (k, *count)));
    }
    Ok(fitting)
}

/// Name, shape and sample type, for messages.
fn describe(variable: &Variable) -> String {
    let shape = variable.dataset.shape().unwrap_or_default();
    let sample = match variable.dataset.datatype().map(|t| sample_type::of(&t)) {
        Ok(Ok((sample, _))) => sample.name().to_owned(),
        Ok(Err(other)) => other,
        Err(_) => "an invalid type".into(),
    };
    format!("{} {shape:?} of {sample}", variable.full_name())
}

fn collect(group: &Group, path: &str, depth: usize, all: &mut Vec<Variable>) -> Result<(), Error> {
    for (name, dataset) in group.iter_datasets()? {
        if all.len() == MAX_ARRAYS {
            return Ok(());
        }
        all.push(Variable { group: path.into(), name, dataset });
    }
    if depth == MAX_DEPTH {
        return Ok(());
    }
    // MATLAB's own groups are #refs# and #subsystem#.
    for name in group.groups()?.iter().filter(|n| !n.starts_with('#')) {
        collect(&group.group(name)?, &join(path, name), depth + 1, all)?;
    }
    Ok(())
}
