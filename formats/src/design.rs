//! Lens files: prescriptions as lens design programs, patents and books write them, read as a [`System`] and written.
//!
//! | module | content |
//! |---|---|
//! | [`zmx`], [`codev`], [`oslo`], [`table`], [`optiland`] | a format each: `parse`, and where it is written `write` |
//! | [`zar`] | archives with a lens file and its glass catalogues |
//! | [`agf`] | glass catalogues |
//! | [`coatings`] | coatings by name, files of coatings |
//! | [`builtin`] | the lenses in the program |
//! | `draft`, `straight_axis` | a prescription as a reader collects it, and what all formats have in common when it becomes a [`System`] |
//! | `asymmetric`, `freeform` | the same of a design without rotational symmetry: places, apertures, shapes |
//! | [`text`], [`options`], [`writing`] | encodings and numbers; what readers are given; what writers have in common |
//! | `format`, `lens_file` | what a row of [`FORMATS`] says; a file, its format chosen by ending and content |
//! | [`error`] | errors of lens files |
//!
//! # Adding a lens format
//!
//! A module `design/FORMAT.rs`, with a folder beside it if it is large, whose function `parse` collects a `draft::Draft` and finishes it, its line below, and a row at the end of [`FORMATS`].
//! Endings in help and messages, reading, and `lens convert` if the row has a writer, follow from the row.
//! Tests: a target in `formats/tests/fuzz/designs.rs`, `formats/tests/design/survival.rs` and its chain in `chain.rs` for a writer, the snapshots of help. Files are text of at most 8 MB (`lens_file`); a binary format needs a `Content` there. What is read of the format, for users: `src/manual/guide/lenses.md`.

pub mod agf;
mod asymmetric;
pub mod builtin;
pub mod coatings;
pub mod codev;
mod draft;
pub mod error;
mod format;
mod freeform;
mod lens_file;
pub mod optiland;
pub mod options;
pub mod oslo;
mod straight_axis;
pub mod table;
pub mod text;
pub mod tolerance;
pub mod writing;
pub mod zar;
pub mod zmx;

pub use draft::INFINITE_MM;
pub use error::LensFileError;
pub use format::{
    Content, LensFormat, Read, TextFormat, Unpack, Write, endings_read, endings_written, names_read,
    names_written,
};
pub use lens_file::{LensFile, is_lens_file, writer};
pub use options::ReadOptions;

use format::{NO_CATALOGUES, NO_COATING_FILE};
#[cfg(doc)]
use pipeline::design::System;

/// The formats of lens files, in the order in which help and messages list them.
pub const FORMATS: &[LensFormat] = &[
    LensFormat {
        name: ".zmx",
        endings: &["zmx"],
        is_it: None,
        content: Content::Text(TextFormat {
            read: zmx::parse,
            catalogues: zmx::catalogues,
            coating_file: zmx::coating_file,
        }),
        write: Some(zmx::write),
    },
    LensFormat {
        name: "CODE V .seq",
        endings: &["seq", "len"],
        is_it: None,
        content: Content::Text(TextFormat {
            read: codev::parse,
            catalogues: NO_CATALOGUES,
            coating_file: NO_COATING_FILE,
        }),
        write: None,
    },
    LensFormat {
        name: "binary .len of CODE V",
        endings: &["len"],
        is_it: Some(codev::is_binary),
        content: Content::Refused(
            "a binary .len file of CODE V is not read; save the lens as a sequence file (.seq) with WRL",
        ),
        write: None,
    },
    LensFormat {
        name: "OSLO .len",
        endings: &["len"],
        is_it: Some(oslo::is_oslo),
        content: Content::Text(TextFormat {
            read: oslo::parse,
            catalogues: NO_CATALOGUES,
            coating_file: NO_COATING_FILE,
        }),
        write: None,
    },
    LensFormat {
        name: "lens table .csv",
        endings: &["csv"],
        is_it: None,
        content: Content::Text(TextFormat {
            read: table::parse,
            catalogues: table::catalogues,
            coating_file: NO_COATING_FILE,
        }),
        write: Some(table::write),
    },
    LensFormat {
        name: ".zar archive",
        endings: &["zar"],
        is_it: None,
        content: Content::Archive(zar::lens),
        write: None,
    },
    LensFormat {
        name: "Optiland .json",
        endings: &["json"],
        is_it: None,
        content: Content::Text(TextFormat {
            read: optiland::parse,
            catalogues: NO_CATALOGUES,
            coating_file: NO_COATING_FILE,
        }),
        write: Some(|system, _| optiland::write(system)),
    },
    LensFormat {
        name: ".zos",
        endings: &["zos"],
        is_it: None,
        content: Content::Refused(
            "files .zos are not read; save the lens as .zmx (in OpticStudio: File, Save As)",
        ),
        write: None,
    },
];
