//! The lens of a film, from what the film records of it.

use super::arrays::ArrayFlags;
use super::lens::UntracedLens;
use super::lens::request::difference;
use crate::failure::usage;
use anyhow::{Context, Result};
use formats::film::FilmStore;
use serde_json::Value;

/// Flags of a design that are read back from its record.
const OF_DESIGN: [&str; 7] = [
    "--focus-m",
    "--image-plane",
    "--aiming",
    "--configuration",
    "--coatings",
    "--energy",
    "--max-window-px",
];

/// The lens that a film records, or another path of it.
pub struct RecordedLens {
    /// Name or path.
    pub name: String,
    /// The flags of `lenscube run` that describe it.
    pub flags: Vec<String>,
    /// What the film records of a design.
    request: Value,
}

impl RecordedLens {
    /// That of `film`, which is at `lens` now if that is given.
    ///
    /// # Errors
    /// Usage: the film does not record its lens, or not completely.
    pub fn new(film: &FilmStore, lens: Option<&str>) -> Result<Self> {
        let source = film.provenance().get("source").cloned().unwrap_or_default();
        let name = lens.map(str::to_owned).or_else(|| source["lens"].as_str().map(str::to_owned));
        let name = name.ok_or_else(|| {
            usage(format!("film {} does not record its lens: give --lens", film.path().display()))
        })?;
        let mut flags = vec![format!("--lens={name}")];
        let request = source["lens_request"].clone();
        flags.extend(of_design(&request["flags"])?);
        Ok(Self { name, flags, request })
    }

    /// Whether it is a design, which a run traces.
    pub fn is_traced(&self) -> bool {
        !self.request.is_null()
    }

    /// Opens it.
    ///
    /// # Errors
    /// It cannot be opened; usage: a design that is not the film's.
    pub fn open(&self) -> Result<UntracedLens> {
        let args = ArrayFlags::parse(&self.flags)?.job;
        let lens =
            UntracedLens::open_focused(&args.lens, &args.surfaces, &args.tracing).with_context(|| {
                format!("opening the lens of the film, {}; --lens names another path", self.name)
            })?;
        let differs = lens.request(&args).and_then(|request| difference(&self.request, &request));
        match differs {
            Some(what) if !self.request.is_null() => Err(usage(format!(
                "lens {} is not the one that made the film: {what}; open it as it was, or give the lens by --lens",
                self.name
            ))),
            _ => Ok(lens),
        }
    }
}

/// Flags of the record of a design.
fn of_design(record: &Value) -> Result<Vec<String>> {
    let mut flags = Vec::new();
    for (flag, value) in record.as_object().into_iter().flatten() {
        let value = value.as_str().unwrap_or_default();
        let is_default = ["nothing", "[]"].contains(&value);
        match OF_DESIGN.contains(&flag.as_str()) {
            _ if is_default => {}
            true => flags.push(format!("{flag}={value}")),
            false => {
                return Err(usage(format!(
                    "the film was made with {flag}, which its record does not describe completely: make the lens a pack by `lenscube lens trace` with this \
                     flag, and the film with that pack"
                )));
            }
        }
    }
    Ok(flags)
}
