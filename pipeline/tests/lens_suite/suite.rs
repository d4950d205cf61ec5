//! The lenses of `data/lens_suite.txt` and their figures.
#![allow(missing_docs, dead_code, reason = "shared by tests that each use a part")]

use lenscube_pipeline::design::System;
use lenscube_pipeline::design::glass::{Dispersion, Glass};
use lenscube_pipeline::design::system::{Aperture, FieldKind, Medium, RayAiming, Surface};

/// Wavelengths of the figures, µm.
pub const UM: [f64; 3] = [0.4861, 0.5876, 0.6563];

/// A lens with its figures.
pub struct Entry {
    pub system: System,
    pub paraxial: Vec<f64>,
    /// tan, three heights, relative illumination.
    pub fields: Vec<Vec<f64>>,
    /// Direction of the light along z of the file.
    pub direction: f64,
    pub psf: Psf,
}

/// PSF at the tangent `tan`: rows y = 0, 1, … of 2·half + 1 samples along x, peak 1.
#[derive(Default)]
pub struct Psf {
    pub tan: f64,
    pub pitch_um: f64,
    pub rows: Vec<Vec<f64>>,
}

/// The lenses.
pub fn suite() -> Vec<Entry> {
    let mut lenses = Vec::new();
    for line in include_str!("../data/lens_suite.txt").lines().filter(|l| !l.starts_with('#')) {
        let (key, rest) = line.split_once(' ').unwrap();
        if key == "lens" {
            let system = System {
                name: rest.to_owned(),
                object_distance_mm: None,
                is_telecentric: false,
                surfaces: Vec::new(),
                stop: 0,
                aperture: Aperture::EntrancePupil(1.0),
                field_kind: FieldKind::Angle,
                fields: vec![0.0],
                wavelengths_um: UM.map(|um| (um, 1.0)).to_vec(),
                primary: 1,
                aiming: RayAiming::Real,
                notes: Vec::new(),
                asymmetry: None,
            };
            let (paraxial, fields, psf) = (Vec::new(), Vec::new(), Psf::default());
            lenses.push(Entry { system, paraxial, fields, direction: 1.0, psf });
            continue;
        }
        let numbers: Vec<f64> = rest.split(' ').map(|v| v.parse().unwrap()).collect();
        let entry = lenses.last_mut().unwrap();
        match key {
            "object" => entry.system.object_distance_mm = Some(numbers[0]).filter(|d| d.is_finite()),
            "stop" => entry.system.stop = numbers[0] as usize,
            "diameter" => entry.system.aperture = Aperture::EntrancePupil(numbers[0]),
            "surface" => {
                let before = entry.system.surfaces.last().map_or(Medium::Air, |s| s.medium.clone());
                let surface = surface(&numbers, before, &mut entry.direction);
                entry.system.surfaces.push(surface);
            }
            "obscuration" => entry.system.surfaces[numbers[0] as usize].obscuration_mm = Some(numbers[1]),
            "psf" => entry.psf = Psf { tan: numbers[0], pitch_um: numbers[1], rows: Vec::new() },
            "row" => entry.psf.rows.push(numbers),
            "paraxial" => entry.paraxial = numbers,
            "field" => entry.fields.push(numbers),
            _ => panic!("{line}"),
        }
    }
    for entry in &mut lenses {
        entry.system.surfaces.push(Surface::new(0.0, 0.0, Medium::Air));
    }
    lenses
}

/// Curvature, thickness, A (0 for a mirror), B, conic, coefficients of r⁴, r⁶, …, z along the first light.
fn surface(v: &[f64], before: Medium, direction: &mut f64) -> Surface {
    let medium = match (v[2], v[3]) {
        (0.0, _) => before,
        (1.0, 0.0) => Medium::Air,
        (a, b) => Medium::Glass(Glass::new(
            format!("n2={a}+{b}/um2"),
            Dispersion::new(1, &[a, 0.0, b, 0.0, 0.0, 0.0]).unwrap(),
            (0.1, 9.0),
        )),
    };
    let mut surface = Surface::new(*direction * v[0], 0.0, medium);
    surface.is_mirror = v[2] == 0.0;
    if surface.is_mirror {
        *direction = -*direction;
    }
    surface.thickness_mm = *direction * v[1];
    surface.shape.conic = v[4];
    if v.len() > 5 {
        surface.shape.aspheric = std::iter::once(0.0).chain(v[5..].iter().copied()).collect();
    }
    surface
}
