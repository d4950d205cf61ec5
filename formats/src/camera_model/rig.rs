//! An f-theta camera as a sensor of a rig of NVIDIA DriveWorks, JSON: `polynomial` is the forward one, `bw-poly`, which older readers take, the inverse.
//!
//! Numbers are texts, as in rigs. DriveWorks counts the principal point from the origin of the area that is read out: the outer corner of the first pixel.
//! The sensor is at the origin of the rig.

use super::spaced;
use pipeline::camera_model::Intrinsics;
use pipeline::camera_model::ftheta::FTheta;
use serde_json::json;

/// The file.
pub fn json(lens: &str, intrinsics: &Intrinsics, model: &FTheta) -> String {
    let [cx, cy] = intrinsics.principal_point(0.5);
    let rig = json!({ "rig": { "sensors": [{
        "name": format!("camera:{lens}"),
        "nominalSensor2Rig_FLU": { "t": [0.0, 0.0, 0.0], "roll-pitch-yaw": [0.0, 0.0, 0.0] },
        "properties": {
            "Model": "ftheta",
            "width": intrinsics.size.width.to_string(),
            "height": intrinsics.size.height.to_string(),
            "cx": cx.to_string(),
            "cy": cy.to_string(),
            "polynomial": spaced(model.forward),
            "polynomial-type": "angle-to-pixeldistance",
            "bw-poly": spaced(model.inverse),
            "linear-c": "1",
            "linear-d": "0",
            "linear-e": "0",
        },
    }] } });
    format!("{rig:#}\n")
}

#[cfg(test)]
mod tests {
    use super::*;
    use pipeline::geometry::Size;

    #[test]
    fn rig_has_both_polynomials() {
        let intrinsics = Intrinsics { size: Size::new(300, 400), focal_px: 500.5 };
        let model =
            FTheta { forward: [0.0, 500.5, 0.0, -2.0, 0.0, 1.0], inverse: [0.0, 2e-3, 0.0, 1e-9, 0.0, 0.0] };
        let rig: serde_json::Value = serde_json::from_str(&json("lens", &intrinsics, &model)).unwrap();
        let properties = &rig["rig"]["sensors"][0]["properties"];
        assert_eq!(properties["polynomial"], "0 500.5 0 -2 0 1");
        assert_eq!(properties["bw-poly"], "0 0.002 0 0.000000001 0 0");
        assert_eq!((&properties["cx"], &properties["width"]), (&json!("200"), &json!("400")));
    }
}
