//! Errors of lens packs: pack, array, found and expected value, way out.

use super::attributes::PLANAR_SCHEMA;
use pipeline::design::pupil_stack::PupilError;
use pipeline::lens::LensError;
use std::path::PathBuf;
use thiserror::Error;

/// Error of reading or writing a lens pack.
#[derive(Debug, Error)]
#[non_exhaustive]
#[allow(missing_docs, reason = "the messages describe the fields")]
pub enum LensPackError {
    /// The path does not exist.
    #[error(
        "there is no lens pack at {path}; give a directory `*.lens.zarr`, a .zip of one, or a built-in lens's name"
    )]
    NotFound { path: PathBuf },
    /// No built-in lens has this name.
    #[error("there is no built-in lens pack `{name}`; built-in: {known}")]
    NotBuiltin { name: String, known: String },
    /// Error of the operating system.
    #[error("{path}: cannot {action}: {source}")]
    Io {
        path: PathBuf,
        /// Operation, as a verb.
        action: &'static str,
        source: std::io::Error,
    },
    /// Not a Zarr v3 group.
    #[error(
        "{path} is not a lens pack: {problem}; expected a Zarr v3 group (a `zarr.json` with node_type `group`)"
    )]
    NotAPack { path: PathBuf, problem: String },
    /// The .zip is damaged or truncated.
    #[error("{path}: the zip archive cannot be read: {problem}; copy it again, it may be truncated")]
    Zip { path: PathBuf, problem: String },
    /// The schema is not supported.
    #[error("{path}: attribute `schema` is {found}, expected {expected}; no other is supported")]
    Schema { path: PathBuf, found: String, expected: String },
    /// An attribute is missing or invalid.
    #[error("{path}: attribute `{name}` {problem}")]
    Attribute { path: PathBuf, name: &'static str, problem: String },
    /// A required array is missing.
    #[error("{path}: array `{array}` is missing")]
    MissingArray { path: PathBuf, array: String },
    /// The array's metadata is invalid.
    #[error("{path}: array `{array}`: {problem}")]
    Metadata { path: PathBuf, array: String, problem: String },
    /// The array has an unexpected shape.
    #[error("{path}: array `{array}` has shape {found:?}, expected {expected}")]
    Shape { path: PathBuf, array: String, found: Vec<u64>, expected: String },
    /// The array has an unexpected data type.
    #[error("{path}: array `{array}` has data type {found}, expected {expected}")]
    DataType { path: PathBuf, array: String, found: String, expected: &'static str },
    /// The metadata states a size beyond the stored bytes, or beyond any lens.
    #[error(
        "{path}: array `{array}` states {stated}, more than {limit}; its metadata is damaged, or this is not a lens pack"
    )]
    TooLarge { path: PathBuf, array: String, stated: String, limit: String },
    /// The ghosts of a band are not those of a lens.
    #[error("{path}: array `{array}`: {problem}")]
    Ghosts { path: PathBuf, array: String, problem: String },
    /// A chunk is missing.
    #[error(
        "{path}: array `{array}`: chunk {chunk} is missing, so the pack is incomplete; copy it again (a writer that omits chunks equal to the fill value needs write_empty_chunks)"
    )]
    MissingChunk { path: PathBuf, array: String, chunk: String },
    /// A chunk is damaged or truncated.
    #[error("{path}: array `{array}`: chunk {chunk} is damaged: {problem}; copy the pack again")]
    Chunk { path: PathBuf, array: String, chunk: String, problem: String },
    /// A value is invalid.
    #[error("{path}: array `{array}`: band {band}, index {index} is {value}, expected {expected}")]
    Value {
        path: PathBuf,
        array: String,
        band: usize,
        /// Index within the band.
        index: usize,
        value: f64,
        expected: &'static str,
    },
    /// A table of a band is invalid.
    #[error("{path}: {source}")]
    Table { path: PathBuf, source: LensError },
    /// A PSF window does not sum to 1.
    #[error(
        "{path}: array `{array}`: the window at {place} sums to {sum}, expected 1 within 1e-3; divide each window by its sum and store the share of the total energy in psf_energy"
    )]
    PsfSum {
        path: PathBuf,
        array: String,
        /// Index of the window.
        index: usize,
        /// Height, or film place, of the window.
        place: String,
        sum: f64,
    },
    /// The pupil functions of a band are invalid.
    #[error("{path}: array `{array}`: {source}")]
    Pupil { path: PathBuf, array: String, source: PupilError },
    /// There is no such band.
    #[error("{path}: band {band} was requested, the pack has {bands}")]
    Band { path: PathBuf, band: usize, bands: usize },
    /// The pack changed after it was opened.
    #[error(
        "{path}: the lens pack changed while it was used ({what}), so the film may mix both versions; keep it unchanged, then start again with --overwrite"
    )]
    Changed { path: PathBuf, what: String },
    /// The lens has no image heights.
    #[error(
        "lens pack {path} has no rotational symmetry (schema {}): {what} needs image heights; use `lenscube run` or `lenscube lens show`",
        PLANAR_SCHEMA
    )]
    NotSymmetric {
        path: PathBuf,
        /// What needs image heights.
        what: String,
    },
    /// The path exists.
    #[error("{path} already exists; a lens pack is never overwritten: remove it or choose another name")]
    Exists { path: PathBuf },
    /// The values to write are inconsistent.
    #[error("{path}: cannot write the lens pack: {problem}")]
    Write { path: PathBuf, problem: String },
}
