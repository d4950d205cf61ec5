//! The lens of a job as built: drawn from the manufacturing errors of its design.
//!
//! It depends on the design, the tolerances, the seed and its index alone. What is adjusted after it is built (focus, tilt and place of the film)
//! depends on the film as well, whose places it is judged at. A lens without errors whose film stays in place IS its design, with rotational symmetry.
//! If its film moves, its ideal plane remains that of the design, whose distortion focal length belongs to the film in its place: it is traced like
//! any other lens as built.

use crate::args::BuiltArgs;
use crate::failure::usage;
use anyhow::{Context, Result};
use formats::design::tolerance::{ToleranceFile, record};
use pipeline::design::System;
use pipeline::design::skew::system::BuiltLens;
use pipeline::design::tolerance::{Compensated, CriterionFields, Tolerances, compensate};
use serde_json::Value;
use std::path::{Path, PathBuf};

/// Largest description of errors, bytes.
const MAX_BYTES: u64 = 16 << 20;

/// A description of manufacturing errors, as it was read.
pub struct ReadTolerances {
    /// Its file.
    pub path: PathBuf,
    /// Its errors, adjustments and criterion.
    pub file: ToleranceFile,
    /// BLAKE3 of its bytes.
    pub digest: String,
}

impl ReadTolerances {
    /// Reads `path`.
    ///
    /// # Errors
    /// It cannot be read; an entry that is not valid, with its line.
    pub fn open(path: &Path) -> Result<Self> {
        let reading = || format!("reading tolerances {}", path.display());
        let size = std::fs::metadata(path).with_context(reading)?.len();
        if size > MAX_BYTES {
            return Err(usage(format!(
                "{}: {size} bytes, expected a description of errors of at most {MAX_BYTES}",
                path.display()
            )));
        }
        let bytes = std::fs::read(path).with_context(reading)?;
        let text = std::str::from_utf8(&bytes)
            .map_err(|e| usage(format!("{}: expected text in UTF-8: {e}", path.display())))?;
        let file = ToleranceFile::parse(path, text).map_err(|e| usage(e.to_string()))?;
        let digest = blake3::hash(&bytes).to_hex().to_string();
        Ok(Self { path: path.into(), file, digest })
    }

    /// The errors of `system`.
    ///
    /// # Errors
    /// Usage: errors that the lens does not have, with their line; no errors.
    pub fn of(&self, system: &System) -> Result<Tolerances> {
        let tolerances = self.file.tolerances(system).map_err(|e| usage(e.to_string()))?;
        if tolerances.parameters().is_empty() {
            return Err(usage(format!(
                "{}: no errors; give an [[element]], [[surface]], [[gap]], [[glass]] or [[film]]",
                self.path.display()
            )));
        }
        Ok(tolerances)
    }
}

/// A drawn lens.
pub struct DrawnLens {
    /// The description that it is drawn from.
    pub read: ReadTolerances,
    /// Seed and index.
    pub draw: (u64, u64),
    /// The lens, before anything is adjusted.
    pub lens: BuiltLens,
    /// Its errors, for people and for the record of films and packs.
    pub record: Value,
}

impl DrawnLens {
    /// Its flags.
    pub const FLAGS: [&'static str; 3] = ["--tolerances", "--seed", "--lens-sample"];

    /// The flags with the values that identify the lens: of the tolerances their digest.
    pub fn flags(&self) -> [(String, Value); 3] {
        let values = [self.read.digest.clone(), self.draw.0.to_string(), self.draw.1.to_string()];
        let mut values = values.into_iter();
        Self::FLAGS.map(|flag| (flag.to_owned(), values.next().into()))
    }

    /// The lens of `args`, drawn from the errors of `system`; none without tolerances.
    ///
    /// # Errors
    /// Usage: the description of errors; several samples; parts of the design that lenses with errors do not have.
    pub fn new(args: &BuiltArgs, system: &System) -> Result<Option<Self>> {
        let Some(path) = &args.tolerances else { return Ok(None) };
        let Some(sample) = args.lens_sample.only() else {
            return Err(usage(format!(
                "--lens-sample {}: expected one lens here; `lenscube run` makes films of several",
                args.lens_sample
            )));
        };
        let read = ReadTolerances::open(path)?;
        let tolerances = read.of(system)?;
        let values = tolerances.draw(args.seed, sample);
        let lens =
            BuiltLens::new(system, &tolerances.deviations(&values)).map_err(|e| usage(e.to_string()))?;
        let record = record(&tolerances, &values, args.seed, sample, &read.digest);
        Ok(Some(Self { read, draw: (args.seed, sample), lens, record }))
    }

    /// Whether it is its design: it has no errors, and its film stays in place.
    pub fn is_nominal(&self) -> bool {
        self.lens.is_nominal() && !self.read.file.compensation.moves_film()
    }

    /// The lens with what is adjusted after it is built, judged over a film whose corner lies `corner_mm` from the axis.
    ///
    /// # Errors
    /// A lens that loses its light.
    pub fn compensated(&self, corner_mm: f64) -> Result<Compensated> {
        let ToleranceFile { compensation, criterion, .. } = &self.read.file;
        let adjusted = compensate(&self.lens, compensation, criterion, corner_mm);
        // Some of its places lie beside a film that is no square.
        let judged = match criterion.fields {
            CriterionFields::Film => {
                format!(", judged up to the circle of the film's corner, {corner_mm:.4} mm from its centre")
            }
            CriterionFields::Places(_) => String::new(),
        };
        adjusted.with_context(|| format!("lens {} of seed {}{judged}", self.draw.1, self.draw.0))
    }

    /// Checks that the description still has the bytes that were read.
    ///
    /// # Errors
    /// It changed, or can no longer be read.
    pub fn check_unchanged(&self) -> Result<()> {
        let now = std::fs::read(&self.read.path).map(|bytes| blake3::hash(&bytes).to_hex().to_string());
        match now {
            Ok(now) if now == self.read.digest => Ok(()),
            _ => anyhow::bail!(
                "{}: the tolerances changed during the run; leave the file unchanged and start again with --overwrite",
                self.read.path.display()
            ),
        }
    }
}
