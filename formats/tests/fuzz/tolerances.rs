//! Descriptions of manufacturing errors, and the TOL lines of .zmx files.

use super::fuzz_support::{Random, damage_text, fuzz};
use lenscube_formats::design::tolerance::{ToleranceFile, import};
use pipeline::design::System;
use pipeline::design::skew::system::BuiltLens;
use std::path::Path;

const DESCRIPTION: &str = "[tolerances]\nlaw = \"normal\"\nfringe_nm = 546.1\n[[element]]\nsurfaces = [7, 9]\ndecentre_um = 20\ntilt_arcmin = [-1, 2]\n\
wedge_arcmin = 1\nshift_um = 20\npivot = 8\npivot_offset_mm = 1.5\n[[element]]\nsurfaces = [7, 11]\nradial = true\ndecentre_um = { limits = [0, 30], law = \"uniform\" }\n\
[[surface]]\nsurface = 5\nradius_fringes = 3\nirregularity_fringes = 0.5\nfigure = \"mixed\"\nconic = 0.01\n[[surface]]\nsurface = 4\nfigure = \"zernike\"\n\
zernike = { terms = [4, 11], rms_waves = 0.05 }\n[[gap]]\nafter = 3\nthickness_um = 20\nabsorb = 5\n[[glass]]\nafter = 1\nindex = 5e-4\nabbe_percent = 0.8\n\
[[film]]\ntilt_arcmin = 5\nshift_um = 3\n[compensate]\nfocus_um = [-500, 500]\nboresight = \"remove\"\n[criterion]\nkind = \"rms-spot\"\nfields = [[0, 0], [3, -4]]\n";

#[test]
fn damaged_descriptions_of_errors_do_not_panic() {
    let system = System::double_gauss_28();
    let parse = |text: &str| ToleranceFile::parse(Path::new("errors.toml"), text);
    assert!(parse(DESCRIPTION).is_ok_and(|file| file.tolerances(&system).is_ok()));
    let make = |r: &mut Random| {
        let mut bytes = DESCRIPTION.as_bytes().to_vec();
        damage_text(&mut bytes, r);
        bytes
    };
    fuzz("tolerances .toml", 400, make, |bytes| {
        let Ok(file) = parse(&String::from_utf8_lossy(bytes)) else { return false };
        let Ok(tolerances) = file.tolerances(&system) else { return false };
        BuiltLens::new(&system, &tolerances.deviations(&tolerances.draw(1, 0))).is_ok()
    });
}

#[test]
fn damaged_tol_lines_do_not_panic() {
    const LINES: &[u8] = b"UNIT MM X W X CM MR CPMM\nTOL TWAV   0   0   0.6328   0   0 0 0\nTOL COMP  11   0  -5  5 0 0 0\nTOL TEDX   1   2 -0.02 0.02 0 0 0\n\
TOL TETX   1   2 -0.05 0.05 0 0 0\nTOL TRAD   3   0 -0.2 0.2 0 0 0\nTOL TIRR   3   0 -0.2 0.2 0 0 0\nTOL TTHI   2   3 -0.1 0.1 0 0 0\nTOL TIND   1   0 -0.001 0.001 0 0 0\n\
TOL TABB   1   0 -0.5 0.5 0 0 0\nTOL TIRX   4   0 -0.02 0.02 0 0 0\nTOL TEXI   4   11 -0.2 0.2 0 0 0\nTOL TOFF   0   0 0 0 0 0 0\n";
    let system = System::double_gauss_28();
    let make = |r: &mut Random| {
        let mut bytes = LINES.to_vec();
        damage_text(&mut bytes, r);
        bytes
    };
    fuzz("TOL lines of .zmx", 400, make, |bytes| !import(bytes, &system).list.is_empty());
}
