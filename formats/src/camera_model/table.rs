//! Field points as CSV: `field_angle_deg,ideal_height_mm,image_height_mm,relative_illumination`, a row each from the axis outwards, at one wavelength.

/// A row.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Row {
    /// Angle at the centre of the entrance pupil.
    pub field_angle_deg: f64,
    /// Distortion focal length times its tangent.
    pub ideal_height_mm: f64,
    /// REAL height of the chief ray.
    pub image_height_mm: f64,
    /// 1 on the axis.
    pub relative_illumination: f64,
}

/// The file.
pub fn csv(rows: &[Row]) -> String {
    let line = |r: &Row| {
        let Row { field_angle_deg, ideal_height_mm, image_height_mm, relative_illumination } = r;
        format!("{field_angle_deg},{ideal_height_mm},{image_height_mm},{relative_illumination}\n")
    };
    let head = "field_angle_deg,ideal_height_mm,image_height_mm,relative_illumination\n".to_owned();
    std::iter::once(head).chain(rows.iter().map(line)).collect()
}
