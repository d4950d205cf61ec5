//! Designs without rotational symmetry in lens files: places, shapes and apertures with their numbers.

mod codev;
mod optiland;
mod zmx;

use lenscube_pipeline::design::System;
use lenscube_pipeline::design::prescription::asymmetry::FreeSurface;

/// The true surface `number`, the object is 0.
fn surface(system: &System, number: usize) -> &FreeSurface {
    &system.asymmetry.as_ref().expect("the design has no rotational symmetry").surfaces[number - 1]
}

/// The sag of surface `number` at (x, y) in mm, z as in the file.
fn sag(system: &System, number: usize, x: f64, y: f64) -> f64 {
    let s = surface(system, number);
    let (sag, _) = s.shape.sag(x, y).unwrap();
    if s.is_reversed { -sag } else { sag }
}

fn is_near(a: &[f64], b: &[f64], tolerance: f64) -> bool {
    a.len() == b.len() && a.iter().zip(b).all(|(a, b)| (a - b).abs() <= tolerance)
}

/// Origin and z axis of surface `number`.
fn origin_and_z(system: &System, number: usize) -> ([f64; 3], [f64; 3]) {
    let pose = &surface(system, number).pose;
    (pose.origin_mm, [0, 1, 2].map(|i| pose.rotation[i][2]))
}

fn note_of_asymmetry(system: &System) -> &str {
    let notes: Vec<_> =
        system.notes.iter().filter(|n| n.contains("no rotational symmetry; it is traced")).collect();
    assert_eq!(notes.len(), 1, "{:?}", system.notes);
    notes[0]
}
