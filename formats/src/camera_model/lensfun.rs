//! A lens as a database of lensfun, version 1, which lensfun 0.2 and later read.
//!
//! `cropfactor` is the diagonal of 36 × 24 mm over that of the film, `focal` the focal length of the corrected picture ([`PtLens::scale`]), so that lensfun's real focal
//! length, `focal`·(1 − a − b − c), is that of the lens in versions with and without `real-focal`. A distance of infinity is 1000 m, as in lensfun's own database.
//! `mount` is Generic, which fits all cameras.

use pipeline::camera_model::lensfun::{LateralColour, Projection, PtLens, Vignetting};
use pipeline::geometry::Size;

/// Diagonal of a film of 36 × 24 mm.
const DIAGONAL_MM: f64 = 43.266_615_305_567_87;
/// Distance of infinity in lensfun's database, m.
const INFINITY_M: f64 = 1000.0;

/// A lens on a film.
#[derive(Clone, Debug, PartialEq)]
pub struct Profile<'a> {
    /// Model name.
    pub lens: &'a str,
    /// Focal length, mm.
    pub focal_mm: f64,
    /// F-number.
    pub f_number: f64,
    /// Object distance, m; infinite.
    pub distance_m: f64,
    /// Pixels of the film.
    pub size: Size,
    /// Pixel pitch, mm.
    pub pitch_mm: f64,
    /// Distortion of green.
    pub distortion: PtLens,
    /// Lateral colour of red and blue.
    pub lateral_colour: [LateralColour; 2],
    /// Relative illumination of green.
    pub vignetting: Vignetting,
}

impl Profile<'_> {
    /// Crop factor.
    pub fn crop_factor(&self) -> f64 {
        let side = |n: usize| n as f64 * self.pitch_mm;
        DIAGONAL_MM / side(self.size.width).hypot(side(self.size.height))
    }

    /// Longer over shorter side.
    pub fn aspect_ratio(&self) -> f64 {
        let (w, h) = (self.size.width as f64, self.size.height as f64);
        w.max(h) / w.min(h)
    }
}

/// `text` in XML.
fn escaped(text: &str) -> String {
    let escape = |c: char| match c {
        '&' => "&amp;".to_owned(),
        '<' => "&lt;".to_owned(),
        '>' => "&gt;".to_owned(),
        c if c.is_control() => " ".to_owned(),
        c => c.to_string(),
    };
    text.chars().map(escape).collect()
}

/// The file.
pub fn xml(profile: &Profile<'_>) -> String {
    let Profile { lens, f_number, distortion, vignetting, .. } = profile;
    let focal = profile.focal_mm * distortion.scale;
    let distance = profile.distance_m.min(INFINITY_M);
    let kind = match distortion.projection {
        Projection::Rectilinear => "rectilinear",
        Projection::Fisheye => "fisheye",
    };
    let ([a, b, c], [k1, k2, k3]) = (distortion.abc, vignetting.k);
    let [[vr, cr, br], [vb, cb, bb]] = profile.lateral_colour.map(|colour| colour.vcb);
    format!(
        "<!DOCTYPE lensdatabase SYSTEM \"lensfun-database.dtd\">\n<lensdatabase version=\"1\">\n    <lens>\n        <maker>lenscube</maker>\n        <model>{}</model>\n        <mount>Generic</mount>\n        \
         <cropfactor>{}</cropfactor>\n        <aspect-ratio>{}</aspect-ratio>\n        <type>{kind}</type>\n        <focal value=\"{focal}\"/>\n        <aperture value=\"{f_number}\"/>\n        <calibration>\n            \
         <distortion model=\"ptlens\" focal=\"{focal}\" a=\"{a}\" b=\"{b}\" c=\"{c}\"/>\n            \
         <tca model=\"poly3\" focal=\"{focal}\" vr=\"{vr}\" cr=\"{cr}\" br=\"{br}\" vb=\"{vb}\" cb=\"{cb}\" bb=\"{bb}\"/>\n            \
         <vignetting model=\"pa\" focal=\"{focal}\" aperture=\"{f_number}\" distance=\"{distance}\" k1=\"{k1}\" k2=\"{k2}\" k3=\"{k3}\"/>\n        \
         </calibration>\n    </lens>\n</lensdatabase>\n",
        escaped(lens),
        profile.crop_factor(),
        profile.aspect_ratio(),
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use pipeline::camera_model::field_map::FieldPoint;
    use pipeline::camera_model::target::{FilmArea, Residual, Target};

    #[test]
    fn profile_of_a_lens_without_distortion() {
        let points = (1..=100).map(|i| FieldPoint::new(f64::from(i) * 1e-3, f64::from(i) * 0.05)).collect();
        let target = Target::of_points(50.0, points, &FilmArea::circle(5.0), 0.01);
        let none = Residual { max: 0.0, at_mm: 0.0, rms: 0.0 };
        let colour = LateralColour { vcb: [1.0, 0.0, 0.0], residual: none };
        let profile = Profile {
            lens: "a <b> & \"c\"\n",
            focal_mm: 50.0,
            f_number: 2.8,
            distance_m: f64::INFINITY,
            size: Size::new(2400, 3600),
            pitch_mm: 0.01,
            distortion: PtLens::fit(&target, Projection::Rectilinear, 12.0).unwrap(),
            lateral_colour: [colour; 2],
            vignetting: Vignetting { k: [-0.5, 0.0, 0.0], residual: none },
        };
        assert!((profile.crop_factor() - 1.0).abs() < 1e-12 && profile.aspect_ratio() == 1.5);
        let text = xml(&profile);
        for part in [
            "<model>a &lt;b&gt; &amp; \"c\" </model>",
            "<type>rectilinear</type>",
            "vr=\"1\" cr=\"0\" br=\"0\" vb=\"1\"",
            "aperture=\"2.8\" distance=\"1000\" k1=\"-0.5\"",
        ] {
            assert!(text.contains(part), "`{part}` is not in {text}");
        }
    }
}
