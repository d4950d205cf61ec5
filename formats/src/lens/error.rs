//! What can be wrong with a lens pack: which pack, which array, what was found, what was expected, the way out.

use pipeline::lens::LensError;
use std::path::PathBuf;
use thiserror::Error;

/// A lens pack that cannot be read or written.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum LensPackError {
    /// Nothing is there.
    #[error(
        "there is no lens pack at {path}; give a directory `*.lens.zarr`, a .zip of one, or a built-in lens's name"
    )]
    NotFound {
        /// The pack.
        path: PathBuf,
    },
    /// No built-in lens has this name.
    #[error("there is no built-in lens pack `{name}`; there is: {known}")]
    NotBuiltin {
        /// Name asked for.
        name: String,
        /// Names there are.
        known: String,
    },
    /// The operating system refused.
    #[error("{path}: cannot {action}: {source}")]
    Io {
        /// The file or directory.
        path: PathBuf,
        /// What was being done.
        action: &'static str,
        /// What it said.
        source: std::io::Error,
    },
    /// Not a Zarr v3 group.
    #[error(
        "{path} is not a lens pack: {problem}; expected a Zarr v3 group (a `zarr.json` with node_type `group`)"
    )]
    NotAPack {
        /// The pack.
        path: PathBuf,
        /// What was found.
        problem: String,
    },
    /// The .zip itself is damaged or truncated.
    #[error("{path}: the zip archive cannot be read: {problem}; copy it again, it may be cut short")]
    Zip {
        /// The pack.
        path: PathBuf,
        /// What the archive said.
        problem: String,
    },
    /// Another schema.
    #[error("{path}: attribute `schema` is {found}, expected \"{expected}\"; this program reads no other")]
    Schema {
        /// The pack.
        path: PathBuf,
        /// As found.
        found: String,
        /// As needed.
        expected: &'static str,
    },
    /// An attribute is missing or unfit.
    #[error("{path}: attribute `{name}` {problem}")]
    Attribute {
        /// The pack.
        path: PathBuf,
        /// Name of the attribute.
        name: &'static str,
        /// What is wrong.
        problem: String,
    },
    /// A required array is not there.
    #[error("{path}: array `{array}` is missing")]
    MissingArray {
        /// The pack.
        path: PathBuf,
        /// The array.
        array: String,
    },
    /// The array's metadata cannot be used.
    #[error("{path}: array `{array}`: {problem}")]
    Metadata {
        /// The pack.
        path: PathBuf,
        /// The array.
        array: String,
        /// What is wrong.
        problem: String,
    },
    /// Another shape than the contract's.
    #[error("{path}: array `{array}` has shape {found:?}, expected {expected}")]
    Shape {
        /// The pack.
        path: PathBuf,
        /// The array.
        array: String,
        /// As found.
        found: Vec<u64>,
        /// As needed, in words.
        expected: String,
    },
    /// Another data type than the contract's.
    #[error("{path}: array `{array}` has data type {found}, expected {expected}")]
    DataType {
        /// The pack.
        path: PathBuf,
        /// The array.
        array: String,
        /// As found.
        found: String,
        /// As needed.
        expected: &'static str,
    },
    /// The metadata claims more than the pack could hold, or than any lens needs.
    #[error(
        "{path}: array `{array}` claims {claim}, more than {limit}; its metadata is damaged, or this is no lens pack"
    )]
    TooLarge {
        /// The pack.
        path: PathBuf,
        /// The array.
        array: String,
        /// The size claimed.
        claim: String,
        /// The bound that it breaks.
        limit: String,
    },
    /// A chunk file is not there.
    #[error(
        "{path}: array `{array}`: chunk {chunk} is missing, so the pack is incomplete; copy it again (a writer that drops chunks equal to the fill value needs write_empty_chunks)"
    )]
    MissingChunk {
        /// The pack.
        path: PathBuf,
        /// The array.
        array: String,
        /// Key of the chunk.
        chunk: String,
    },
    /// A chunk file is damaged or cut short.
    #[error("{path}: array `{array}`: chunk {chunk} is damaged: {problem}; copy the pack again")]
    Chunk {
        /// The pack.
        path: PathBuf,
        /// The array.
        array: String,
        /// Key of the chunk.
        chunk: String,
        /// What the codec said.
        problem: String,
    },
    /// A value that no lens has.
    #[error("{path}: array `{array}`: band {band}, index {index} is {value}, expected {expected}")]
    Value {
        /// The pack.
        path: PathBuf,
        /// The array.
        array: String,
        /// Band index.
        band: usize,
        /// Index within the band.
        index: usize,
        /// As found.
        value: f64,
        /// As needed.
        expected: &'static str,
    },
    /// The tables break the lens's contract.
    #[error("{path}: {source}")]
    Table {
        /// The pack.
        path: PathBuf,
        /// Which table, and how.
        source: LensError,
    },
    /// A PSF window does not sum to 1.
    #[error(
        "{path}: array `psf/{band}`: the window at height {index} ({height_mm:.3} mm) sums to {sum}, expected 1 within 1e-3; divide each window by its sum and put the light it held into psf_energy"
    )]
    PsfSum {
        /// The pack.
        path: PathBuf,
        /// Band index.
        band: usize,
        /// Height index.
        index: usize,
        /// REAL image height of the window, mm.
        height_mm: f64,
        /// Sum of its samples.
        sum: f64,
    },
    /// A band index beyond the lens's bands.
    #[error("{path}: band {band} was asked for, the pack has {bands}")]
    Band {
        /// The pack.
        path: PathBuf,
        /// Index asked for.
        band: usize,
        /// Number of bands.
        bands: usize,
    },
    /// It is not what it was when it was opened.
    #[error(
        "{path}: the lens pack changed while it was used ({what}), so a film may be of both; let it rest, then start anew with --overwrite"
    )]
    Changed {
        /// The pack.
        path: PathBuf,
        /// What differs.
        what: String,
    },
    /// Something is already there.
    #[error("{path} already exists; a lens pack is never overwritten: remove it or choose another name")]
    Exists {
        /// The pack.
        path: PathBuf,
    },
    /// What is to be written contradicts itself.
    #[error("{path}: cannot write the lens pack: {problem}")]
    Write {
        /// The pack.
        path: PathBuf,
        /// What is wrong.
        problem: String,
    },
}
