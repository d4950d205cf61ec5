//! Built-in lenses: prescriptions of patents and textbooks, as tables in `data/lenses` with their sources, and the sample lens.
//!
//! A table's `source` names the patent or book; `glasses` says how the glasses were matched.

use super::options::ReadOptions;
use super::{table, zmx};
use pipeline::design::glass_library::GlassLibrary;
use pipeline::design::system::System;

/// A built-in lens.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BuiltinLens {
    /// Name on the command line.
    pub name: &'static str,
    /// Kind of lens.
    pub kind: &'static str,
    text: &'static str,
}

/// The sample that all examples use.
pub const SAMPLE: &str = "double-gauss-28";

macro_rules! lens {
    ($name:literal, $kind:literal) => {
        BuiltinLens {
            name: $name,
            kind: $kind,
            text: include_str!(concat!("../../data/lenses/", $name, ".csv")),
        }
    };
}

/// The built-in lenses.
pub const LENSES: &[BuiltinLens] = &[
    BuiltinLens {
        name: SAMPLE,
        kind: "double Gauss",
        text: include_str!("../../data/lenses/double-gauss-28.zmx"),
    },
    lens!("cine-petzval", "cine projection"),
    lens!("fast-fifty", "fast fifty"),
    lens!("fisheye-170", "fisheye"),
    lens!("macro-100", "macro"),
    lens!("macro-70", "macro"),
    lens!("mirror-500", "mirror lens"),
    lens!("mirrorless-50", "fast fifty, asphere"),
    lens!("phone", "phone"),
    lens!("telephoto", "telephoto"),
    lens!("tessar", "Tessar"),
    lens!("triplet", "triplet"),
    lens!("uv-105", "machine vision, UV"),
    lens!("wide-100", "wide angle"),
];

impl BuiltinLens {
    /// The lens of that name.
    pub fn named(name: &str) -> Option<&'static Self> {
        LENSES.iter().find(|lens| lens.name == name)
    }

    /// Its prescription.
    ///
    /// # Panics
    /// If a built-in table is not valid, which a test rules out.
    pub fn system(&self) -> System {
        let options = ReadOptions { strict: true, configuration: None };
        let parse = if self.name == SAMPLE { zmx::parse } else { table::parse };
        parse(self.text.as_bytes(), &GlassLibrary::new(), &options).expect("the built-in designs are valid")
    }

    /// The patent or book that it is taken from.
    pub fn source(&self) -> String {
        let line = self.text.lines().find_map(|line| line.strip_prefix("source,"));
        line.map_or("sample of a lens design program, Double Gauss 28 degree field", |l| l.trim_matches('"'))
            .to_owned()
    }
}
