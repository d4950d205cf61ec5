//! Places of the surfaces of Optiland's JSON: `cs` with x, y, z (mm), rx, ry, rz (rad) and the frame `reference_cs` that they are given in.

use super::values::{incomplete, number};
use crate::design::error::LensFileError;
use pipeline::design::prescription::pose::Pose;
use serde_json::Value;

/// Maximum number of frames within frames.
const MAX_DEPTH: usize = 100;

/// What tilts a surface about x or y or decentres it.
const OFF_AXIS: [&str; 4] = ["/x", "/y", "/rx", "/ry"];

/// The places of the surfaces behind the object, in the frame whose origin is on z at surface 1; none if no surface is tilted about x or y or
/// decentred.
///
/// # Errors
/// A tilted or decentred object; frames without end.
pub(super) fn places(surfaces: &[Value]) -> Result<Option<Vec<Pose>>, LensFileError> {
    let mut is_straight = true;
    for (i, surface) in surfaces.iter().enumerate() {
        let cs = frame(surface);
        is_straight &= cs.get("reference_cs").is_none_or(Value::is_null);
        for pointer in OFF_AXIS {
            is_straight &= number(cs, pointer, 0.0)? == 0.0;
            if i == 0 && !is_straight {
                return Err(incomplete("has a tilted or decentred object, which is not supported"));
            }
        }
    }
    if is_straight {
        return Ok(None);
    }
    let poses = surfaces.iter().skip(1).map(|s| pose(frame(s))).collect::<Result<Vec<_>, _>>()?;
    let first_z = poses.first().map_or(0.0, |pose| pose.origin_mm[2]);
    let to_first = Pose::at([0.0, 0.0, -first_z]);
    Ok(Some(poses.iter().map(|pose| to_first.compose(pose)).collect()))
}

fn frame(surface: &Value) -> &Value {
    surface.pointer("/geometry/cs").unwrap_or(&Value::Null)
}

/// The frame `cs` in the outermost one.
fn pose(cs: &Value) -> Result<Pose, LensFileError> {
    let (mut pose, mut frame) = (Pose::IDENTITY, Some(cs));
    for _ in 0..MAX_DEPTH {
        let Some(cs) = frame.filter(|f| !f.is_null()) else { return Ok(pose) };
        let mut values = [0.0; 6];
        for (value, pointer) in values.iter_mut().zip(["/x", "/y", "/z", "/rx", "/ry", "/rz"]) {
            *value = number(cs, pointer, 0.0)?;
        }
        let [x, y, z, rx, ry, rz] = values;
        pose = Pose::optiland([x, y, z], [rx, ry, rz]).compose(&pose);
        frame = cs.get("reference_cs");
    }
    Err(incomplete(format!("has a frame within more than {MAX_DEPTH} frames (reference_cs)")))
}
