//! Built-in lenses: prescriptions of patents and textbooks, as tables in `data/lenses` with their sources, and the sample lens.
//!
//! A table's `source` names the patent or book; `glasses` says how the glasses were matched.

use super::glass_library::GlassLibrary;
use super::reading::ReadOptions;
use super::system::System;
use super::{table, zmx};

/// A built-in lens.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ShelfLens {
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
        ShelfLens {
            name: $name,
            kind: $kind,
            text: include_str!(concat!("../../data/lenses/", $name, ".csv")),
        }
    };
}

/// The built-in lenses.
pub const LENSES: &[ShelfLens] = &[
    ShelfLens { name: SAMPLE, kind: "double Gauss", text: include_str!("../../data/double-gauss-28.zmx") },
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

impl ShelfLens {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::design::bundle::Bundle;
    use crate::design::describe::field_tan;
    use crate::design::paraxial::Paraxial;
    use crate::design::ray::Tracer;

    /// Nominal focal length in mm and F-number, of the source or of the product that was made of it.
    #[test]
    fn focal_length_and_f_number_are_those_of_the_source() {
        for (name, mm, f_number) in [
            ("fast-fifty", 50.0, 1.8),
            ("macro-100", 100.0, 2.9),
            ("macro-70", 69.2, 2.9),
            ("mirror-500", 499.48, 6.7),
            ("mirrorless-50", 49.57, 1.85),
            ("triplet", 50.0, 4.0),
            ("uv-105", 105.0, 4.5),
            (SAMPLE, 100.0, 3.0),
        ] {
            let system = ShelfLens::named(name).unwrap().system();
            let p = Paraxial::new(&system, system.primary_um()).unwrap();
            let f = p.effective_focal_length_mm;
            // Lenses are engraved with rounded figures: a 50 mm lens has up to 52 mm.
            assert!((f / mm - 1.0).abs() < 0.03, "{name}: {f} mm");
            assert!((p.image_f_number() / f_number - 1.0).abs() < 0.03, "{name}: f/{}", p.image_f_number());
        }
    }

    #[test]
    fn light_of_the_outermost_field_point_of_every_lens_reaches_the_film() {
        for lens in LENSES {
            let system = lens.system();
            let tracer = Tracer::new(&system, system.primary_um()).unwrap();
            let tans = system.fields.iter().map(|f| field_tan(&system, &tracer.primary, *f).abs());
            let bundle = Bundle::trace(&tracer, tans.fold(0.0, f64::max), 12, 16);
            let bundle = bundle.unwrap_or_else(|e| panic!("{}: {e}", lens.name));
            assert!(bundle.rays.len() >= 12 * 16 && bundle.chief.x.v > 1.0, "{}", lens.name);
        }
    }

    #[test]
    fn every_lens_is_near_focus_and_names_its_source() {
        assert!(LENSES.len() >= 9 && LENSES[1..].windows(2).all(|w| w[0].name < w[1].name));
        for lens in LENSES {
            let system = lens.system();
            let p = Paraxial::new(&system, system.primary_um()).unwrap();
            let shift = p.focus_shift_mm() / p.effective_focal_length_mm;
            assert!(shift.abs() < 0.01, "{}: focus {shift} focal lengths from the film", lens.name);
            assert!(lens.source().len() > 20 && system.fields.last() > Some(&0.0), "{}", lens.name);
        }
    }
}
