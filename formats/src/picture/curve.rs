//! Curves of a lens's tables: relative illumination and distortion over REAL image height, for a few wavelengths.
//!
//!   distortion = (real − ideal) / ideal · 100 %,   ideal = f·tan w, w the field angle,
//! with f the DISTORTION focal length of the primary wavelength for all wavelengths, so lateral colour shows as curves
//! that differ already on axis. At height 0 the quotient is its limit: distortion D is even in height, so the first two
//! field points off axis give D₀ = D₁ − (D₂ − D₁)·r₁²/(r₂² − r₁²).
//! At most six wavelengths are drawn, evenly spaced, among them the first, the last and the one nearest the primary, whose
//! curve is wider. The title holds f and its wavelength.

use super::PictureError;
use super::figure::Figure;
use super::plot::{Axis, Plot, Series, Shape, stacked};
use super::style::Style;
use pipeline::lens::{Lens, LensBand};

/// Maximum number of wavelengths in one plot.
const MAX_CURVES: usize = 6;

/// Plots of relative illumination and distortion.
///
/// # Errors
/// The lens has no band.
pub fn lens_curves(lens: &Lens, style: Style) -> Result<Figure, PictureError> {
    let distance = |b: usize| (lens.bands[b].wavelength_nm - lens.primary_wavelength_nm).abs();
    let nearest = (0..lens.bands.len()).min_by(|&a, &b| distance(a).total_cmp(&distance(b)));
    let Some(primary) = nearest else {
        let problem = format!("{} has no wavelength", lens.name);
        return Err(PictureError::Setting { setting: "lens", problem });
    };
    let drawn = drawn_bands(lens.bands.len(), primary);
    let series = |curve: fn(&LensBand) -> Vec<(f64, f64)>| {
        let one = |(i, &b): (usize, &usize)| {
            let width = if b == primary { 3.2 } else { 1.7 };
            let name = format!("{} nm", lens.bands[b].wavelength_nm);
            let shape = Shape::Line { width, dash: i };
            Series::distinct(name, curve(&lens.bands[b]), i).shaped(shape)
        };
        drawn.iter().enumerate().map(one).collect::<Vec<_>>()
    };
    let height = || Axis::new("real image height (mm)", 0.0, 0.0);
    let illumination_axis = Axis::new("relative illumination", 0.0, 1.05);
    let distortion_axis = Axis::new("distortion (% of f tan θ)", 0.0, 0.0);
    let plots = [
        Plot { series: series(illumination), ..Plot::new("", height(), illumination_axis) },
        Plot { series: series(distortion_percent), ..Plot::new("", height(), distortion_axis) },
    ];
    let (f, nm) = (lens.distortion_focal_length_mm, lens.primary_wavelength_nm);
    let title = format!("{}: f = {f:.4} mm at {nm} nm", lens.name);
    Ok(stacked(&title, &plots, style))
}

/// Relative illumination over real height.
fn illumination(band: &LensBand) -> Vec<(f64, f64)> {
    band.image_height_mm.iter().copied().zip(band.relative_illumination.iter().copied()).collect()
}

/// Distortion in percent over real height.
fn distortion_percent(band: &LensBand) -> Vec<(f64, f64)> {
    let points = std::iter::zip(&band.image_height_mm, &band.ideal_height_mm);
    let mut curve: Vec<_> = points.map(|(&real, &ideal)| (real, 100.0 * (real - ideal) / ideal)).collect();
    if let [axis, (r1, d1), rest @ ..] = curve.as_mut_slice() {
        let slope = rest.first().map_or(0.0, |(r2, d2)| (*d2 - *d1) / (*r2 * *r2 - *r1 * *r1));
        *axis = (0.0, *d1 - slope * *r1 * *r1);
    }
    curve
}

/// Evenly spaced bands with the first, the last and `primary` among them, ascending.
fn drawn_bands(bands: usize, primary: usize) -> Vec<usize> {
    let count = bands.min(MAX_CURVES);
    let mut drawn: Vec<usize> =
        (0..count).map(|i| (i * (bands - 1) + (count - 1) / 2) / (count - 1).max(1)).collect();
    // The primary replaces the nearest band other than the first and the last.
    if !drawn.contains(&primary) {
        let inner = 1..count - 1;
        if let Some(i) = inner.min_by_key(|&i| drawn[i].abs_diff(primary)) {
            drawn[i] = primary;
        }
    }
    drawn.sort_unstable();
    drawn
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A lens of distortion −1e-4·r² (−1 % at 10 mm), with lateral colour of up to 1e-3.
    fn lens(bands: usize) -> Lens {
        let heights: Vec<f64> = (0..400).map(|i| 0.05 * f64::from(i)).collect();
        let band = |b: usize| LensBand {
            image_height_mm: heights
                .iter()
                .map(|h| h * (1.0 + 1e-3 * b as f64 / bands as f64 - 1e-4 * h * h))
                .collect(),
            relative_illumination: heights.iter().map(|h| (1.0 + h * h / 900.0).powi(-2)).collect(),
            psf_height_mm: vec![0.0, 20.0],
            ..LensBand::ideal(400.0 + 300.0 * b as f64 / (bands - 1).max(1) as f64, heights.clone())
        };
        Lens {
            name: "Test lens, 30 mm".into(),
            distortion_focal_length_mm: 30.0,
            effective_focal_length_mm: 30.01,
            f_number: 2.8,
            primary_wavelength_nm: 550.0,
            object_distance_mm: None,
            magnification: 0.0,
            psf_sample: pipeline::lens::PsfSample::Point,
            bands: (0..bands).map(band).collect(),
            depth: None,
        }
    }

    #[test]
    fn distortion_matches_the_tables_and_its_limit_on_axis() {
        let curve = distortion_percent(&lens(1).bands[0]);
        assert!(curve[0].0 == 0.0 && curve[0].1.abs() < 1e-6, "{:?}", curve[0]);
        let (_, at_10) = curve[200];
        assert!((at_10 + 1.0).abs() < 1e-9, "{at_10}");
        let red = distortion_percent(&lens(31).bands[30]);
        assert!((red[0].1 - 0.1 * 30.0 / 31.0).abs() < 1e-5, "{:?}", red[0]);
    }

    #[test]
    fn first_last_and_primary_are_always_drawn() {
        for bands in 1..40 {
            for primary in 0..bands {
                let drawn = drawn_bands(bands, primary);
                assert!(drawn.contains(&primary) && drawn.windows(2).all(|w| w[0] < w[1]), "{drawn:?}");
                assert_eq!((drawn[0], drawn[drawn.len() - 1]), (0, bands - 1));
                assert_eq!(drawn.len(), bands.min(MAX_CURVES));
            }
        }
    }

    #[test]
    fn labels_appear_once_in_png_and_svg_and_no_band_is_an_error() {
        let folder = tempfile::tempdir().unwrap();
        for (bands, style) in [(1, Style::Light), (31, Style::Dark)] {
            let figure = lens_curves(&lens(bands), style).unwrap();
            let svg = figure.to_svg();
            for text in
                ["f = 30.0000 mm at 550 nm", "relative illumination", "distortion (% of f tan θ)", "400 nm"]
            {
                assert_eq!(svg.matches(text).count(), 1, "{text}");
            }
            for name in ["c.png", "c.svg"] {
                figure.write(&folder.path().join(name)).unwrap();
            }
            assert_eq!(std::fs::read_to_string(folder.path().join("c.svg")).unwrap(), svg);
        }
        assert!(lens_curves(&Lens { bands: vec![], ..lens(1) }, Style::Light).is_err());
    }
}
