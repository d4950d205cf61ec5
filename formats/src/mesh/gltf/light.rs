//! Lights (KHR_lights_punctual): linear colour, intensity in lx (directional) or cd (point, spot), range in m, angles from the axis of a cone.

use std::f64::consts::{FRAC_PI_2, FRAC_PI_4};

use super::super::context::Context;
use super::super::error::MeshError;
use super::super::shown::shown;
use super::json::Light;
use pipeline::scene::description::LightKind;

/// Colour, intensity and kind of a light.
///
/// # Errors
/// Another type; negative or not finite numbers; angles other than 0 ≤ inner < outer ≤ π/2.
pub(super) fn photometry(
    context: &Context<'_>,
    number: usize,
    light: &Light,
) -> Result<([f32; 3], f64, LightKind), MeshError> {
    let invalid = |property: &str, expected: &str, found: String| {
        let place = format!("extensions.KHR_lights_punctual.lights[{number}].{property}");
        context.invalid(place, expected, found)
    };
    let colour = light.color.unwrap_or([1.0; 3]).map(|c| c as f32);
    if !colour.iter().all(|&c| c >= 0.0 && c.is_finite()) {
        return Err(invalid("color", "three numbers from 0 on", format!("{colour:?}")));
    }
    let intensity = light.intensity.unwrap_or(1.0);
    if intensity < 0.0 {
        return Err(invalid("intensity", "a number from 0 on", intensity.to_string()));
    }
    if let Some(range) = light.range.filter(|&range| range <= 0.0) {
        return Err(invalid("range", "a number above 0", range.to_string()));
    }
    let kind = match (light.kind.as_str(), &light.spot) {
        ("directional", _) => LightKind::Directional,
        ("point", _) => LightKind::Point(light.range),
        ("spot", Some(spot)) => {
            let inner = spot.inner_cone_angle.unwrap_or_default();
            let outer = spot.outer_cone_angle.unwrap_or(FRAC_PI_4);
            // Exporters write π/2 in f32, which is 4.4e-8 larger.
            if !(inner >= 0.0 && inner < outer && outer <= FRAC_PI_2 + 1e-7) {
                return Err(invalid(
                    "spot",
                    "angles 0 ≤ inner < outer ≤ π/2",
                    format!("{inner} and {outer}"),
                ));
            }
            LightKind::Spot(inner, outer, light.range)
        }
        ("spot", None) => return Err(invalid("spot", "an object", "none".into())),
        (other, _) => return Err(invalid("type", "directional, point or spot", shown(other))),
    };
    Ok((colour, intensity, kind))
}
