//! Errors of sensor descriptions.

use std::path::PathBuf;

use crate::durable::DurableError;

/// A sensor description or one of its tables cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SensorError {
    /// No such sensor.
    #[error(
        "sensor `{name}`: neither a built-in sensor nor a file (.toml); built in are {}{}", .builtin.join(", "),
        .nearest.map_or(String::new(), |n| format!("; did you mean `{n}`?"))
    )]
    Unknown {
        /// What was asked for.
        name: String,
        /// Names of the built-in sensors.
        builtin: Vec<&'static str>,
        /// The one that is spelt nearly so.
        nearest: Option<&'static str>,
    },
    /// Not TOML, or a field that is unknown, missing or of another type; the message has line and column.
    #[error("sensor {}: {message}", .path.display())]
    Syntax {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        message: String,
    },
    /// A `--set` that cannot be.
    #[error("--set {set}: {message}")]
    Set {
        /// As typed.
        set: String,
        /// What is wrong.
        message: String,
    },
    /// A field out of range.
    #[error("sensor {}: {field}: expected {expected}, found {found}", .path.display())]
    Field {
        /// The file.
        path: PathBuf,
        /// The field.
        field: String,
        /// What it must be.
        expected: String,
        /// What it is.
        found: String,
    },
    /// A table that cannot be used.
    #[error("table {}: {problem}", .path.display())]
    Table {
        /// The file.
        path: PathBuf,
        /// Line or column, what was expected and found.
        problem: String,
    },
    /// The files.
    #[error("reading a sensor: {0}")]
    Storage(#[from] DurableError),
}
