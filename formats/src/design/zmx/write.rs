//! Writes a lens as a sequential .zmx file.

use crate::design::error::LensFileError;
use crate::design::writing::{
    GlassForm, Written, catalogues_of, check_symmetry, glass_form, number, one_line, surfaces_along_z,
};
use pipeline::design::shape::Shape;
use pipeline::design::system::{Aperture, FieldKind, Medium, RayAiming, Surface, System};

/// The file of `system`, lengths in mm; `own` is the catalogue that glasses which are not built in are written to.
///
/// # Errors
/// [`LensFileError::Incomplete`] if the format cannot hold the lens.
pub fn write(system: &System, own: &str) -> Result<Written, LensFileError> {
    check_symmetry(system)?;
    let (catalogues, catalogue) = catalogues_of(system, own)?;
    let mut text = format!(
        "VERS 140124 258 36214\nMODE SEQ\nNAME {}\nUNIT MM X W X CM MR CPMM\n",
        one_line(&system.name)
    );
    text += &match system.aperture {
        Aperture::EntrancePupil(d) => format!("ENPD {}\n", number(d)),
        Aperture::ImageFNumber(f) => format!("FNUM {} 0\n", number(f)),
        Aperture::WorkingFNumber(f) => format!("FNUM {} 1\n", number(f)),
        Aperture::ObjectNa(na) => format!("OBNA {} 0\n", number(na)),
        Aperture::StopRadius(_) => "FLOA\n".to_owned(),
    };
    text += "ENVD 2.0E+1 1 0\nGFAC 0 0\n";
    if !catalogues.is_empty() {
        text += &format!("GCAT {}\n", catalogues.join(" "));
    }
    text += &format!("RAIM 0 {} 1 1 0 0 0 0 0\n", if system.aiming == RayAiming::Real { 2 } else { 0 });
    let kind = match system.field_kind {
        FieldKind::Angle => 0,
        FieldKind::ObjectHeight => 1,
        FieldKind::ParaxialImageHeight => 2,
        FieldKind::RealImageHeight => 3,
    };
    text += &format!(
        "FTYP {kind} {} {} {} 0 0 0\n",
        u8::from(system.is_telecentric),
        system.fields.len(),
        system.wavelengths_um.len()
    );
    let list = |values: &mut dyn Iterator<Item = f64>| values.map(number).collect::<Vec<_>>().join(" ");
    text += &format!("XFLN {}\n", list(&mut system.fields.iter().map(|_| 0.0)));
    text += &format!("YFLN {}\n", list(&mut system.fields.iter().copied()));
    for (i, (um, weight)) in system.wavelengths_um.iter().enumerate() {
        text += &format!("WAVM {} {} {}\n", i + 1, number(*um), number(*weight));
    }
    text += &format!("PWAV {}\n", system.primary + 1);
    let distance = system.object_distance_mm.map_or_else(|| "INFINITY".to_owned(), number);
    text += &format!("SURF 0\n  TYPE STANDARD\n  CURV 0\n  DISZ {distance}\n");
    for (i, surface) in surfaces_along_z(system).iter().enumerate() {
        text += &format!("SURF {}\n", i + 1);
        if i == system.stop {
            text += "  STOP\n";
        }
        let radius = match system.aperture {
            Aperture::StopRadius(r) if i == system.stop => r,
            _ => surface.semi_diameter_mm,
        };
        text += &surface_lines(i + 1, surface, radius, &catalogues)?;
    }
    Ok(Written { text, catalogue, notes: Vec::new() })
}

fn surface_lines(
    number_of_surface: usize,
    surface: &Surface,
    radius_mm: f64,
    catalogues: &[String],
) -> Result<String, LensFileError> {
    let shape = &surface.shape;
    let (kind, terms) = shape_lines(shape).ok_or_else(|| LensFileError::Incomplete {
        problem: format!(
            "has more than 120 terms in the asphere of surface {number_of_surface}, the maximum of .zmx"
        ),
    })?;
    let (kind, terms) = match surface.ideal_focal_mm {
        Some(f) => ("PARAXIAL", format!("  PARM 1 {}\n", number(f))),
        None => (kind, terms),
    };
    let mut text = format!("  TYPE {kind}\n  CURV {} 0 0 0 0 \"\"\n", number(shape.curvature));
    if shape.conic != 0.0 {
        text += &format!("  CONI {}\n", number(shape.conic));
    }
    text += &terms;
    text += &format!("  DISZ {}\n", number(surface.thickness_mm));
    if surface.is_mirror {
        text += "  GLAS MIRROR 0 0 1.5 40 0 0 0 0 0 0\n";
    } else if let Medium::Glass(glass) = &surface.medium {
        text += &match glass_form(glass, catalogues) {
            GlassForm::Named(name) => format!("  GLAS {name} 0 0 1.5 40 0 0 0 0 0 0\n"),
            GlassForm::Constant(n) => format!("  GLAS ___BLANK 1 0 {} 0 0 0 0 0 0 0\n", number(n)),
            GlassForm::Model(n, v, delta) => {
                format!("  GLAS ___BLANK 1 0 {} {} {} 0 0 0 0 0\n", number(n), number(v), number(delta))
            }
        };
    }
    if let Some(name) = &surface.coating_name {
        text += &format!("  COAT {name} 0.0 0.0\n");
    }
    text += &format!("  DIAM {} 0 0 0 1 \"\"\n", number(radius_mm));
    let inner = number(surface.obscuration_mm.unwrap_or(0.0));
    if let Some(aperture) = surface.aperture_mm {
        text += &format!("  CLAP {inner} {} 0\n", number(aperture));
    } else if surface.obscuration_mm.is_some() {
        text += &format!("  OBSC 0 {inner} 0\n");
    }
    Ok(text)
}

/// Surface type, and the lines of its coefficients: of the types of eight terms where they suffice, else of an extended asphere of norm
/// radius 1.
fn shape_lines(shape: &Shape) -> Option<(&'static str, String)> {
    const TERMS: usize = 8;
    const EXTENDED: usize = 120;
    let used = |c: &[f64]| c.iter().rposition(|a| *a != 0.0).map_or(0, |i| i + 1);
    let (even, odd) = (used(&shape.aspheric), used(&shape.odd));
    let at = |c: &[f64], i: usize| c.get(i).copied().unwrap_or(0.0);
    // Coefficient of r^power, from 1.
    let coefficient = |power: usize| match power % 2 {
        0 => at(&shape.aspheric, power / 2 - 1),
        _ => at(&shape.odd, power / 2),
    };
    let highest = (2 * even).max((2 * odd).saturating_sub(1));
    let parameters = |terms: &mut dyn Iterator<Item = f64>| {
        terms.enumerate().map(|(i, a)| format!("  PARM {} {}\n", i + 1, number(a))).collect::<String>()
    };
    let extended = |terms: Vec<f64>| {
        let data = [terms.len() as f64, 1.0].into_iter().chain(terms).enumerate();
        data.map(|(i, v)| format!("  XDAT {} {} 0 0 1 0 0 0 \"\"\n", i + 1, number(v))).collect::<String>()
    };
    Some(match (even, odd, highest) {
        (0, 0, _) => ("STANDARD", String::new()),
        (n, 0, _) if n <= TERMS => ("EVENASPH", parameters(&mut shape.aspheric.iter().copied().take(TERMS))),
        (_, _, h) if h <= TERMS => ("ODDASPHE", parameters(&mut (1..=h).map(coefficient))),
        (n, 0, _) if n <= EXTENDED => ("XASPHERE", extended(shape.aspheric[..n].to_vec())),
        (_, _, h) if h <= EXTENDED => ("XODDASPH", extended((1..=h).map(coefficient).collect())),
        _ => return None,
    })
}
