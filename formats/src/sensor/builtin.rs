//! Sensors and tables that are in the program; where they come from: `data/sensors/SOURCES.md`.

macro_rules! files {
    ($($name:literal: $path:literal),* $(,)?) => { [$(($name, include_str!(concat!("../../", $path)))),*] };
}

/// Descriptions by name.
const SENSORS: [(&str, &str); 7] = files!(
    "cmv12000-mono": "data/sensors/cmv12000-mono.toml",
    "cmv12000-rgb": "data/sensors/cmv12000-rgb.toml",
    "mt9v024-mono": "data/sensors/mt9v024-mono.toml",
    "sony-a7r2": "data/sensors/sony-a7r2.toml",
    "ideal-mono": "data/sensors/ideal-mono.toml",
    "ideal-xyz": "data/sensors/ideal-xyz.toml",
    "example-2um": "data/sensors/example-2um.toml",
);

/// Tables by file name.
const TABLES: [(&str, &str); 7] = files!(
    "cmv12000-angular.csv": "data/sensors/cmv12000-angular.csv",
    "cmv12000-qe.csv": "data/sensors/cmv12000-qe.csv",
    "ir-cut-bir690.csv": "data/sensors/ir-cut-bir690.csv",
    "silicon-absorption.csv": "data/sensors/silicon-absorption.csv",
    "mt9v024-qe.csv": "data/sensors/mt9v024-qe.csv",
    "sony-a7r2-response.csv": "data/sensors/sony-a7r2-response.csv",
    "cie1931-cmf-illuminants.csv": "../pipeline/data/cie1931-cmf-illuminants.csv",
);

/// Names of the built-in sensors.
pub fn builtin_names() -> Vec<&'static str> {
    SENSORS.iter().map(|(name, _)| *name).collect()
}

/// The description of a built-in sensor.
pub(super) fn description(name: &str) -> Option<&'static str> {
    find(&SENSORS, name)
}

/// A built-in table by its file name.
pub(super) fn table(file: &str) -> Option<&'static str> {
    find(&TABLES, file)
}

fn find(all: &[(&'static str, &'static str)], name: &str) -> Option<&'static str> {
    all.iter().find(|(own, _)| *own == name).map(|(_, text)| *text)
}

/// The built-in sensor whose name differs from `name` in the fewest letters, if these are at most a third.
pub(super) fn nearest(name: &str) -> Option<&'static str> {
    let best = builtin_names().into_iter().map(|own| (edits(name, own), own)).min()?;
    let prefix = || builtin_names().into_iter().find(|own| name.len() >= 3 && own.starts_with(name));
    if best.0 <= best.1.len() / 3 { Some(best.1) } else { prefix() }
}

/// Insertions, removals and replacements of characters from one word to the other.
fn edits(a: &str, b: &str) -> usize {
    let b: Vec<char> = b.chars().collect();
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, from) in a.chars().take(64).enumerate() {
        let mut diagonal = row[0];
        row[0] = i + 1;
        for (j, to) in b.iter().enumerate() {
            let replaced = diagonal + usize::from(from != *to);
            diagonal = row[j + 1];
            row[j + 1] = replaced.min(diagonal + 1).min(row[j] + 1);
        }
    }
    row[b.len()]
}
