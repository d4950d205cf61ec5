//! Cameras (glTF 2.0, 3.10): the vertical field of view. Planes of clipping and aspect ratio are left out: the film determines them.

use super::super::context::Context;
use super::super::error::MeshError;
use super::super::shown::shown;
use super::json::Camera;

/// Vertical field of view in radians; `None` for an orthographic camera.
///
/// # Errors
/// Another type, an angle outside 0 to π.
pub(super) fn vertical_field(
    context: &Context<'_>,
    number: usize,
    camera: &Camera,
) -> Result<Option<f64>, MeshError> {
    let place = |property: &str| format!("cameras[{number}].{property}");
    match (camera.kind.as_str(), &camera.perspective, &camera.orthographic) {
        ("perspective", Some(perspective), _) => match perspective.yfov {
            yfov if yfov > 0.0 && yfov < std::f64::consts::PI => Ok(Some(yfov)),
            yfov => {
                Err(context.invalid(place("perspective.yfov"), "an angle between 0 and π", yfov.to_string()))
            }
        },
        ("orthographic", _, Some(_)) => Ok(None),
        ("perspective" | "orthographic", ..) => {
            Err(context.invalid(place(&camera.kind), "an object", "none"))
        }
        (other, ..) => Err(context.invalid(place("type"), "perspective or orthographic", shown(other))),
    }
}
