//! Reads Optiland's JSON.

use super::geometry::{aperture, shape};
use super::place::places;
use super::values::{incomplete, is_true, list, number, text};
use super::{OWN, film_height_scale, json};
use crate::design::agf;
use crate::design::draft::{Draft, DraftSurface, radial_field};
use crate::design::error::LensFileError;
use crate::design::options::ReadOptions;
use crate::design::text::decode;
use pipeline::design::glass::Glass;
use pipeline::design::glass_library::GlassLibrary;
use pipeline::design::model_glass::{constant_glass, model_glass};
use pipeline::design::system::{Aperture, FieldKind, RayAiming, System};
use serde_json::Value;

/// Reads a lens.
///
/// # Errors
/// [`LensFileError::Line`] for text that is not JSON; [`LensFileError::Incomplete`] for what is missing or not supported.
pub fn parse(bytes: &[u8], glasses: &GlassLibrary, options: &ReadOptions) -> Result<System, LensFileError> {
    options.only_one_configuration()?;
    let file = json::parse(&decode(bytes))?;
    let surfaces = list(&file, "/surface_group/surfaces");
    if surfaces.is_empty() {
        return Err(incomplete("has no `surface_group` with surfaces: is it a lens file of Optiland?"));
    }
    let mut draft = Draft { name: text(&file, "/name").to_owned(), ..Draft::default() };
    // Without the setting rays are aimed at the paraxial entrance pupil.
    let aiming = match text(&file, "/ray_tracer/ray_aiming_config/mode") {
        "" => text(&file, "/ray_aiming/mode"),
        mode => mode,
    };
    draft.aiming =
        Some(if matches!(aiming, "" | "paraxial") { RayAiming::Paraxial } else { RayAiming::Real });
    draft.is_telecentric = is_true(&file, "/fields/telecentric")
        || is_true(&file, "/fields/object_space_telecentric")
        || is_true(&file, "/aperture/object_space_telecentric");
    for solve in ["/pickups", "/solves/solves"] {
        if !list(&file, solve).is_empty() {
            draft.notes.push("pickups and solves are not evaluated: the saved values hold".to_owned());
        }
    }
    let apodisation = text(&file, "/apodization/type");
    if !matches!(apodisation, "" | "UniformApodization") {
        if options.strict {
            return Err(incomplete(format!(
                "has an apodised pupil ({apodisation}), which is not supported, and --strict allows none"
            )));
        }
        draft.notes.push(format!(
            "the apodisation of the pupil ({apodisation}) was ignored, its amplitude is uniform"
        ));
    }
    let mut glasses = glasses.clone();
    if let Some(agf) = file.pointer("/lenscube/glasses_agf").and_then(Value::as_str) {
        glasses.add(OWN, agf::parse(agf.as_bytes())?);
    }
    let positions: Result<Vec<f64>, _> = surfaces.iter().map(|s| number(s, "/geometry/cs/z", 0.0)).collect();
    let positions = positions?;
    let places = places(surfaces)?;
    for (i, surface) in surfaces.iter().enumerate() {
        let next = positions.get(i + 1).copied().unwrap_or(positions[i]);
        let place = |e: LensFileError| match e {
            LensFileError::Incomplete { problem } => incomplete(format!("{problem} (surface {i})")),
            other => other,
        };
        let mut read = read_surface(surface, &glasses, &mut draft.notes).map_err(place)?;
        read.thickness_mm = next - positions[i];
        if let Some(places) = places.as_ref().filter(|_| i > 0) {
            (read.place, read.thickness_mm) = (Some(places[i - 1]), 0.0);
        }
        if i > 0 {
            let drawn = format!("/lenscube/semi_diameters_mm/{}", i - 1);
            read.semi_diameter_mm = number(&file, &drawn, 0.0)?;
        }
        if is_true(surface, "/is_stop") && draft.stop.replace(i).is_some() {
            return Err(incomplete(format!("has a second stop, surface {i}")));
        }
        draft.surfaces.push(read);
    }
    fields(&file, &mut draft)?;
    wavelengths(&file, &mut draft)?;
    let value = number(&file, "/aperture/value", f64::NAN)?;
    draft.aperture = Some(match text(&file, "/aperture/type") {
        "EPD" => Aperture::EntrancePupil(value),
        "imageFNO" => Aperture::ImageFNumber(value),
        "objectNA" => Aperture::ObjectNa(value),
        "float_by_stop_size" => {
            // The value is the diameter of the stop.
            if let Some(stop) = draft.stop.and_then(|i| draft.surfaces.get_mut(i)) {
                stop.semi_diameter_mm = 0.5 * value;
            }
            Aperture::StopRadius(0.5 * value)
        }
        other => {
            return Err(incomplete(format!(
                "has an aperture of type `{other}`, expected EPD, imageFNO, objectNA or float_by_stop_size"
            )));
        }
    });
    let mut system = draft.finish()?;
    let scale = 1.0 / film_height_scale(&system)?;
    system.fields.iter_mut().for_each(|field| *field *= scale);
    Ok(system)
}

fn read_surface(
    surface: &Value,
    glasses: &GlassLibrary,
    notes: &mut Vec<String>,
) -> Result<DraftSurface, LensFileError> {
    let mut draft = DraftSurface::default();
    if is_true(surface, "/is_reflective")
        || surface.pointer("/interaction_model/is_reflective") == Some(&Value::Bool(true))
    {
        draft.is_mirror = true;
    }
    // The focal length of an ideal lens, in older and newer files.
    let is_ideal = text(surface, "/type") == "ParaxialSurface";
    let focal = if is_ideal { "/f" } else { "/interaction_model/focal_length" };
    draft.ideal_focal_mm = Some(number(surface, focal, f64::NAN)?).filter(|f| is_ideal || !f.is_nan());
    let geometry = surface.get("geometry").unwrap_or(&Value::Null);
    shape(geometry, &mut draft)?;
    aperture(surface.get("aperture").unwrap_or(&Value::Null), &mut draft, notes)?;
    if let Some(material) = surface.get("material_post").filter(|m| !m.is_null() && !draft.is_mirror) {
        draft.glass = glass(material, glasses, notes)?;
    }
    Ok(draft)
}

fn glass(
    material: &Value,
    glasses: &GlassLibrary,
    notes: &mut Vec<String>,
) -> Result<Option<Glass>, LensFileError> {
    match text(material, "/type") {
        "IdealMaterial" => {
            let n = number(material, "/index", 1.0)?;
            if !(1.0..10.0).contains(&n) {
                return Err(incomplete(format!("has a material of index {n}")));
            }
            Ok((n != 1.0).then(|| constant_glass(n)))
        }
        "AbbeMaterial" | "AbbeMaterialE" => {
            let own = text(material, "/lenscube_glass");
            if !own.is_empty() {
                return Ok(Some(glasses.find(own, &[OWN.to_owned()])?.0));
            }
            let (n, v) = (number(material, "/index", f64::NAN)?, number(material, "/abbe", f64::NAN)?);
            let glass = model_glass(&format!("n={n},V={v}"), n, v, number(material, "/dP_gF", 0.0)?)?;
            notes.push(format!("n_d = {n}, V_d = {v}: a model glass of these values"));
            Ok(Some(glass))
        }
        "Material" => {
            let name = text(material, "/name");
            if name.eq_ignore_ascii_case("air") {
                return Ok(None);
            }
            // The maker, or the folder of the data file.
            let file = text(material, "/filename").replace('\\', "/");
            let folder = file.rsplit('/').nth(1).unwrap_or_default();
            let maker = Some(text(material, "/reference")).filter(|r| !r.is_empty()).unwrap_or(folder);
            let catalogues: Vec<String> =
                Some(maker.to_uppercase()).into_iter().filter(|m| !m.is_empty()).collect();
            let (glass, note) = glasses.find(name, &catalogues)?;
            notes.extend(note);
            Ok(Some(glass))
        }
        other => Err(incomplete(format!(
            "has a material of type `{other}`, expected Material, IdealMaterial or AbbeMaterial"
        ))),
    }
}

fn fields(file: &Value, draft: &mut Draft) -> Result<(), LensFileError> {
    let fields = list(file, "/fields/fields");
    // Of version 0.6 and later, else of the versions before.
    let definition = file.pointer("/fields/field_definition").filter(|d| !d.is_null());
    let kind = match (definition, text(file, "/fields/field_type")) {
        (Some(d), _) => d.get("field_type").and_then(Value::as_str).unwrap_or("none"),
        (None, "") => fields.first().map_or("angle", |f| text(f, "/field_type")),
        (None, kind) => kind,
    };
    draft.field_kind = Some(match kind {
        "AngleField" | "angle" | "" => FieldKind::Angle,
        "ObjectHeightField" | "object_height" => FieldKind::ObjectHeight,
        "ParaxialImageHeightField" | "paraxial_image_height" => FieldKind::ParaxialImageHeight,
        "RealImageHeightField" | "real_image_height" => FieldKind::RealImageHeight,
        other => return Err(incomplete(format!("has fields of type `{other}`, which is not supported"))),
    });
    for field in fields {
        draft.fields.push(radial_field(
            draft.field_kind,
            number(field, "/x", 0.0)?,
            number(field, "/y", 0.0)?,
        ));
        draft.has_vignetting_factors |=
            number(field, "/vx", 0.0)? != 0.0 || number(field, "/vy", 0.0)? != 0.0;
    }
    Ok(())
}

fn wavelengths(file: &Value, draft: &mut Draft) -> Result<(), LensFileError> {
    for (i, wavelength) in list(file, "/wavelengths/wavelengths").iter().enumerate() {
        let um_per_unit = match text(wavelength, "/unit") {
            "um" | "" | "microns" => 1.0,
            "nm" => 1e-3,
            "mm" => 1e3,
            unit => return Err(incomplete(format!("has a wavelength in `{unit}`, expected um, nm or mm"))),
        };
        let um = number(wavelength, "/value", f64::NAN)? * um_per_unit;
        draft.wavelengths_um.push((um, number(wavelength, "/weight", 1.0)?));
        if is_true(wavelength, "/is_primary") {
            draft.primary = i;
        }
    }
    Ok(())
}
