//! A calibration in the YAML of OpenCV's `cv::FileStorage`, with the names of OpenCV's sample `calibration.cpp`.

use super::plain;
use pipeline::camera_model::Intrinsics;

/// What a calibration says beside its coefficients.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Calibration<'a> {
    /// Name of the lens.
    pub lens: &'a str,
    /// Wavelength, nm.
    pub wavelength_nm: f64,
    /// Film and focal length.
    pub intrinsics: Intrinsics,
    /// Maximum and RMS of the residual, px.
    pub residual_px: [f64; 2],
}

/// The file: `distortion` in OpenCV's order, k1, k2, p1, p2, k3 and k4 to k6, or k1 to k4 of a fisheye.
pub fn yaml(calibration: &Calibration<'_>, distortion: &[f64], is_fisheye: bool) -> String {
    let Calibration { lens, wavelength_nm, intrinsics, residual_px: [max, rms] } = calibration;
    let (size, f, [cx, cy]) = (intrinsics.size, intrinsics.focal_px, intrinsics.principal_point(0.0));
    let matrix = |rows: usize, cols: usize, values: &[f64]| {
        let data: Vec<String> = values.iter().map(|v| format!("{v:?}")).collect();
        format!(
            "!!opencv-matrix\n   rows: {rows}\n   cols: {cols}\n   dt: d\n   data: [ {} ]\n",
            data.join(", ")
        )
    };
    format!(
        "%YAML:1.0\n---\nlens: \"{}\"\nwavelength_nm: {wavelength_nm:?}\nimage_width: {}\nimage_height: {}\nfisheye_model: {}\n\
         camera_matrix: {}distortion_coefficients: {}avg_reprojection_error: {rms:?}\nmax_reprojection_error: {max:?}\n",
        plain(lens),
        size.width,
        size.height,
        u8::from(is_fisheye),
        matrix(3, 3, &[f, 0.0, cx, 0.0, f, cy, 0.0, 0.0, 1.0]),
        matrix(1, distortion.len(), distortion),
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use pipeline::geometry::Size;

    #[test]
    fn yaml_has_the_matrix_and_the_coefficients() {
        let intrinsics = Intrinsics { size: Size::new(300, 401), focal_px: 512.25 };
        let calibration =
            Calibration { lens: "a \"b\"\nc", wavelength_nm: 550.0, intrinsics, residual_px: [0.5, 0.25] };
        let text = yaml(&calibration, &[-0.125, 0.5, 0.0, 0.0, 2.0], false);
        let expected = "%YAML:1.0\n---\nlens: \"a  b  c\"\nwavelength_nm: 550.0\nimage_width: 401\nimage_height: 300\nfisheye_model: 0\n\
            camera_matrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   data: [ 512.25, 0.0, 200.0, 0.0, 512.25, 149.5, 0.0, 0.0, 1.0 ]\n\
            distortion_coefficients: !!opencv-matrix\n   rows: 1\n   cols: 5\n   dt: d\n   data: [ -0.125, 0.5, 0.0, 0.0, 2.0 ]\n\
            avg_reprojection_error: 0.25\nmax_reprojection_error: 0.5\n";
        assert_eq!(text, expected);
    }
}
