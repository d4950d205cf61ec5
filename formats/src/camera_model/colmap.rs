//! `cameras.txt` of a COLMAP reconstruction: a camera a line, `CAMERA_ID MODEL WIDTH HEIGHT PARAMS[]`.
//! Source: COLMAP, doc/format.rst; parameters and their order: src/colmap/sensor/models.h.

use super::{plain, spaced};
use pipeline::camera_model::Intrinsics;
use pipeline::camera_model::fisheye::Fisheye;
use pipeline::camera_model::opencv::OpenCv;

/// A camera model of COLMAP.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Model {
    /// f, cx, cy, k1, k2.
    Radial(OpenCv),
    /// fx, fy, cx, cy, k1, k2, p1, p2.
    OpenCv(OpenCv),
    /// And k3 to k6.
    FullOpenCv(OpenCv),
    /// fx, fy, cx, cy, k1 to k4.
    OpenCvFisheye(Fisheye),
}

impl Model {
    /// Its name.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Radial(_) => "RADIAL",
            Self::OpenCv(_) => "OPENCV",
            Self::FullOpenCv(_) => "FULL_OPENCV",
            Self::OpenCvFisheye(_) => "OPENCV_FISHEYE",
        }
    }

    /// Its parameters, in COLMAP's order.
    pub fn parameters(&self, intrinsics: &Intrinsics) -> Vec<f64> {
        let f = intrinsics.focal_px;
        let [cx, cy] = intrinsics.principal_point(0.5);
        let with_two_focal_lengths = |k: &[f64]| [&[f, f, cx, cy], k].concat();
        match self {
            Self::Radial(OpenCv { numerator: [k1, k2, _], .. }) => vec![f, cx, cy, *k1, *k2],
            Self::OpenCv(OpenCv { numerator: [k1, k2, _], .. }) => {
                with_two_focal_lengths(&[*k1, *k2, 0.0, 0.0])
            }
            Self::FullOpenCv(OpenCv { numerator: [k1, k2, k3], denominator: [k4, k5, k6] }) => {
                with_two_focal_lengths(&[*k1, *k2, 0.0, 0.0, *k3, *k4, *k5, *k6])
            }
            Self::OpenCvFisheye(Fisheye { k }) => with_two_focal_lengths(k),
        }
    }
}

/// The file.
pub fn cameras(lens: &str, wavelength_nm: f64, intrinsics: &Intrinsics, model: &Model) -> String {
    let size = intrinsics.size;
    format!(
        "# Camera list with one line of data per camera:\n#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n# {} at {wavelength_nm} nm\n1 {} {} {} {}\n",
        plain(lens),
        model.name(),
        size.width,
        size.height,
        spaced(model.parameters(intrinsics))
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use pipeline::geometry::Size;

    #[test]
    fn line_has_the_parameters_in_order() {
        let intrinsics = Intrinsics { size: Size::new(300, 400), focal_px: 500.5 };
        let k = OpenCv { numerator: [1.0, 2.0, 3.0], denominator: [4.0, 5.0, 6.0] };
        let line = |model: Model| {
            let text = cameras("lens", 550.0, &intrinsics, &model);
            text.lines().last().unwrap().to_owned()
        };
        assert_eq!(line(Model::Radial(k)), "1 RADIAL 400 300 500.5 200 150 1 2");
        assert_eq!(line(Model::OpenCv(k)), "1 OPENCV 400 300 500.5 500.5 200 150 1 2 0 0");
        assert_eq!(line(Model::FullOpenCv(k)), "1 FULL_OPENCV 400 300 500.5 500.5 200 150 1 2 0 0 3 4 5 6");
        let fisheye = Model::OpenCvFisheye(Fisheye { k: [1.0, 2.0, 3.0, 4.0] });
        assert_eq!(line(fisheye), "1 OPENCV_FISHEYE 400 300 500.5 500.5 200 150 1 2 3 4");
    }
}
