//! What is told of ghosts: their names, those that rings blur, those left out.

use crate::progress::{log_line, number};
use pipeline::design::System;
use pipeline::design::ghost::operator::BandGhosts;
use pipeline::design::ghost::options::GhostOptions;
use pipeline::design::ghost::path::ghost_paths;

/// Rings below which the disc of a ghost is blurred.
const SHARP_RINGS: f64 = 2.0;
/// Least share of all ghosts that such a ghost has to be worth a note.
const NOTED: f64 = 0.01;

/// Notes of the ghosts of a band that the rings blur.
pub fn small_ghosts(system: &System, band: &BandGhosts) -> Vec<String> {
    let all: f64 = band.paths.iter().map(|p| p.axis.share).sum();
    let sizes = band.operator.sizes;
    let mut notes = Vec::new();
    for path in &band.paths {
        let diameter_mm = path.axis.diameter_mm();
        let rings = diameter_mm / sizes.ring_mm;
        if rings >= SHARP_RINGS || path.axis.share <= NOTED * all {
            continue;
        }
        let [axis, half] = path.understated(sizes);
        notes.push(format!(
            "note: ghost {} at {} nm: {diameter_mm:.2} mm on the axis, {rings:.1} rings: of a lamp smaller than a ring its peak is understated {axis:.1} x there, up to {half:.1} x at half field; --ghost-rings makes rings finer",
            path_name(path.figures(system.image()).surfaces),
            number(band.wavelength_nm),
        ));
    }
    notes
}

/// Prints how many ghosts of `system` are left out, if any.
pub fn note_left_out(system: &System, options: &GhostOptions) {
    let (_, left_out) = ghost_paths(system, !options.film_reflectance.is_zero());
    if left_out > 0 {
        log_line(format!("note: {left_out} ghosts between whose reflections a mirror lies are left out"));
    }
}

/// `11-9`, the film by name: it has the number 0.
pub fn path_name(surfaces: [usize; 2]) -> String {
    let [first, second] = surfaces.map(|k| if k == 0 { "film".to_owned() } else { k.to_string() });
    format!("{first}-{second}")
}
