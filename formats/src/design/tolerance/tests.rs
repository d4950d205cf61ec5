//! Descriptions: the example of the documentation, units, refusals with their lines, text and back.

mod import;
mod keys;
mod refusals;
mod written;

use super::*;
use crate::design::options::ReadOptions;
use crate::design::zmx;
use pipeline::design::System;
use pipeline::design::glass_library::GlassLibrary;
use pipeline::design::tolerance::{Law, Limits, Quantity, Target, Tolerance};
use std::path::Path;

/// Object, ten surfaces and the film (11): glass behind 1, 3, 4, 7, 9; stop 6, a plane as 10.
fn design(unit: &str, operands: &str) -> String {
    let mut text = format!(
        "VERS 80915 0 0\nMODE SEQ\nNAME ten\nUNIT {unit} X W X CM MR CPMM\nENPD 5\nFTYP 0 0 1 1\nXFLN 0\nYFLN 0\n"
    );
    text += "WAVM 1 0.55 1\nPWAV 1\nSURF 0\n  TYPE STANDARD\n  CURV 0\n  DISZ INFINITY\n";
    for number in 1..=11 {
        let stop = if number == 6 { "  STOP\n" } else { "" };
        let curvature = if [6, 10, 11].contains(&number) { 0.0 } else { 0.02 };
        let glass = match number {
            1 | 7 => "  GLAS N-BK7 0 0 1.5 40\n",
            3 | 9 => "  GLAS N-SF6 0 0 1.5 40\n",
            4 => "  GLAS F2 0 0 1.5 40\n",
            _ => "",
        };
        let thickness = if number == 11 { 0 } else { 3 };
        text += &format!(
            "SURF {number}\n{stop}  TYPE STANDARD\n  CURV {curvature} 0\n  DISZ {thickness}\n{glass}  DIAM 8 0 0 0 1\n"
        );
    }
    text + operands
}

fn lens(unit: &str) -> System {
    zmx::parse(design(unit, "").as_bytes(), &GlassLibrary::new(), &ReadOptions::default()).unwrap()
}

fn parse(text: &str) -> Result<ToleranceFile, ToleranceFileError> {
    ToleranceFile::parse(Path::new("t.toml"), text)
}

fn of(target: Target, quantity: Quantity, size: f64) -> Tolerance {
    Tolerance { target, quantity, limits: Limits::symmetric(size, Law::Normal) }
}

/// The example of FIELDS.md, section 9.
const EXAMPLE: &str = r#"
[tolerances]                      # everything here is optional
law = "normal"                    # normal: limits are +-2 sigma, truncated | uniform | two-point | parabolic
fringe_nm = 546.1                 # ISO 10110 test wavelength
[[element]]                       # moves as one body; also for groups
surfaces = [7, 9]
decentre_um = 20                  # x and y, each drawn
tilt_arcmin = 1                   # about x and y through `pivot`
wedge_arcmin = 1                  # of the last surface
shift_um = 20                     # along z, between fixed neighbours
[[surface]]
surface = 5
radius_percent = 0.1              # or radius_fringes, radius_um
irregularity_fringes = 0.5        # figure = "astigmatism" | "zernike"
tilt_arcmin = 1                   # decentre_um, conic
[[gap]]
after = 3
thickness_um = 20                 # absorb = 5
[[glass]]
after = 3
index = 5e-4                      # abbe_percent = 0.8
[[film]]
tilt_arcmin = 5                   # decentre_um, shift_um (after focusing)
[compensate]
focus_um = [-500, 500]
film_tilt = false
boresight = "keep"                # | "remove"
[criterion]
kind = "mtf"                      # | "rms-spot" | "rms-wavefront"
frequency_per_mm = 50
fields = "film"
"#;
