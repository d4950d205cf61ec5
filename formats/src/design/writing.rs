//! What the writers of designs have in common: numbers, and glasses that are read as the same glass again.
//!
//! A glass of the built-in table is written by its name, with its maker among the design's catalogues; where that name would be found in another catalogue
//! first, as `NAME_MAKER`. A model glass is written by its n_d, V_d and ΔP_gF, any other glass into a catalogue (AGF) beside the design.

use super::agf;
use super::error::LensFileError;
use pipeline::design::glass::{Glass, GlassCatalog};
use pipeline::design::glass_library::{GlassLibrary, maker_of_glass};
use pipeline::design::model_glass::model_values;
use pipeline::design::prescription::asymmetry::FreeSurface;
use pipeline::design::system::{Medium, Surface, System};

/// A design in a file format.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Written {
    /// The file.
    pub text: String,
    /// A glass catalogue (AGF) that belongs beside it.
    pub catalogue: Option<String>,
    /// What the format cannot hold.
    pub notes: Vec<String>,
}

/// How a glass is written.
pub(super) enum GlassForm {
    Named(String),
    Constant(f64),
    /// n_d, V_d, ΔP_gF.
    Model(f64, f64, f64),
}

/// Checks that a format that holds lenses of rotational symmetry can hold this one.
///
/// # Errors
/// [`LensFileError::Incomplete`] names a surface without it.
pub(super) fn check_symmetry(system: &System) -> Result<(), LensFileError> {
    let Some(asymmetry) = &system.asymmetry else { return Ok(()) };
    let is_free = |s: &FreeSurface| {
        let is_on_axis = s.pose.origin_mm[..2] == [0.0; 2] && s.pose.rotation[2] == [0.0, 0.0, 1.0];
        let outlines = [s.aperture, s.obscuration].into_iter().flatten();
        !s.is_frame
            && (!is_on_axis || !s.shape.is_symmetric() || !outlines.into_iter().all(|o| o.is_centred_disc()))
    };
    let number = asymmetry.surfaces.iter().position(is_free).map_or(0, |i| i + 1);
    let problem = format!(
        "has no rotational symmetry (surface {number}), and is not written in this format: keep its own file"
    );
    Err(LensFileError::Incomplete { problem })
}

/// The shortest decimal that is read as the same number.
pub(super) fn number(v: f64) -> String {
    let magnitude = v.abs();
    if v != 0.0 && !(1e-4..1e15).contains(&magnitude) { format!("{v:E}") } else { format!("{v}") }
}

/// The surfaces as files have them, with z along the first light: thicknesses behind an odd number of mirrors are negative.
pub(super) fn surfaces_along_z(system: &System) -> Vec<Surface> {
    let mut direction = 1.0;
    let along_z = |s: &Surface| {
        let shape = if direction > 0.0 { s.shape.clone() } else { s.shape.reversed() };
        direction = if s.is_mirror { -direction } else { direction };
        let thickness_mm = if s.thickness_mm == 0.0 { 0.0 } else { direction * s.thickness_mm };
        Surface { shape, thickness_mm, ..s.clone() }
    };
    system.surfaces.iter().map(along_z).collect()
}

/// The radius that is read as curvature `c` again, or the nearest; `inf` for a plane.
pub(super) fn radius(c: f64) -> String {
    if c == 0.0 {
        return "inf".to_owned();
    }
    let r = 1.0 / c;
    let digits = (r * 1e9).round() / 1e9;
    let candidates = [digits, r, r.next_up(), r.next_down()];
    number(candidates.into_iter().find(|r| 1.0 / r == c).unwrap_or(r))
}

/// Text without line ends and control characters.
pub(super) fn one_line(text: &str) -> String {
    text.chars().map(|c| if c.is_control() { ' ' } else { c }).collect::<String>().trim().to_owned()
}

fn is_constant(glass: &Glass) -> Option<f64> {
    let n = glass.dispersion.index(0.55);
    (glass.dispersion == pipeline::design::glass::Dispersion::constant(n)).then_some(n)
}

/// The glasses of a design.
fn glasses(system: &System) -> impl Iterator<Item = &Glass> {
    system.surfaces.iter().filter_map(|s| match &s.medium {
        Medium::Glass(glass) => Some(glass),
        Medium::Air => None,
    })
}

/// Catalogues for a design: makers of its built-in glasses, and `own` with the text of that catalogue if other glasses need it.
pub(super) fn catalogues_of(
    system: &System,
    own: &str,
) -> Result<(Vec<String>, Option<String>), LensFileError> {
    let (mut names, mut own_glasses) = (Vec::<String>::new(), GlassCatalog::default());
    for glass in glasses(system) {
        if is_constant(glass).is_some() || model_values(glass).is_some() {
            continue;
        }
        match maker_of_glass(glass) {
            Some(maker) if !names.iter().any(|n| n == maker) => names.push(maker.to_owned()),
            Some(_) => (),
            None => {
                if own_glasses.get(&glass.name).is_some_and(|known| known != glass) {
                    let problem = format!("has two glasses named {}", glass.name);
                    return Err(LensFileError::Incomplete { problem });
                }
                own_glasses.add(glass.clone());
            }
        }
    }
    if own_glasses.glasses().is_empty() {
        return Ok((names, None));
    }
    names.insert(0, own.to_owned());
    Ok((names, Some(agf::write(&own_glasses)?)))
}

/// How a glass is written in a design with these catalogues.
pub(super) fn glass_form(glass: &Glass, catalogues: &[String]) -> GlassForm {
    if let Some(n) = is_constant(glass) {
        return GlassForm::Constant(n);
    }
    if let Some((n, v, delta)) = model_values(glass) {
        return GlassForm::Model(n, v, delta);
    }
    let is_found =
        |name: &str| GlassLibrary::new().find(name, catalogues).is_ok_and(|(found, _)| found == *glass);
    match maker_of_glass(glass) {
        Some(maker) if !is_found(&glass.name) => GlassForm::Named(format!("{}_{maker}", glass.name)),
        _ => GlassForm::Named(agf::written_name(glass)),
    }
}
