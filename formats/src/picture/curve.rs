//! A lens's tables as curves: relative illumination and distortion over REAL image height, a few wavelengths each.
//!
//!   distortion = (real − ideal) / ideal · 100 %,   ideal = f·tan w, w the field angle,
//! with f the DISTORTION focal length of the primary wavelength for all wavelengths, so lateral colour shows as curves
//! that part already on axis. At height 0 the quotient is taken as its limit: it is even in height, so the first two
//! field points off axis give it as D₁ − (D₂ − D₁)·r₁²/(r₂² − r₁²).
//! Up to six wavelengths are drawn, evenly chosen with the first, the last and the one nearest the primary, which is
//! heavy. The distortion axis names f and its wavelength. Each curve has its own colour as an eye sees it, darkened to
//! stand out from paper.

use std::path::Path;

use super::PictureError;
use super::axes::{Panel, range, text};
use super::figure::{Anchor, Figure, Mark};
use super::image::Rgb;
use pipeline::colour;
use pipeline::geometry::Size;
use pipeline::lens::{Lens, LensBand};

/// Most wavelengths in one plot.
const MOST_CURVES: usize = 6;
/// Least size at which labels do not collide.
const LEAST: Size = Size::new(700, 700);
/// Pixels left of, right of, above and below the plots, and between them.
const MARGIN: (f64, f64, f64, f64, f64) = (136.0, 150.0, 60.0, 60.0, 40.0);

/// Draws the curves of a lens.
///
/// # Errors
/// If `size` is below 700 × 700, or the lens has no band.
pub fn lens_curves(lens: &Lens, size: Size) -> Result<Figure, PictureError> {
    let bad = |setting, problem| Err(PictureError::Setting { setting, problem });
    if size.height < LEAST.height || size.width < LEAST.width {
        return bad("size", format!("{size} is too small for curves with labels; take at least {LEAST}"));
    }
    let Some(heavy) = primary(lens) else {
        return bad("lens", format!("{} has no wavelength to draw", lens.name));
    };
    let chosen = chosen(lens.bands.len(), heavy);
    let last_mm = lens.bands.iter().filter_map(|b| b.image_height_mm.last()).fold(0.0, |a, b| b.max(a));
    let (left, right, top, bottom, gap) = MARGIN;
    let panel_height = (size.height as f64 - top - bottom - gap) / 2.0;
    let panel = |index: f64, y: (f64, f64)| Panel {
        left,
        right: size.width as f64 - right,
        top: top + index * (panel_height + gap),
        bottom: top + index * (panel_height + gap) + panel_height,
        x: (0.0, last_mm),
        y,
    };
    let illumination: Vec<_> = chosen.iter().map(|&b| illumination(&lens.bands[b])).collect();
    let distortion: Vec<_> = chosen.iter().map(|&b| distortion_percent(&lens.bands[b])).collect();
    let mut marks = vec![text(
        (left, top / 2.0),
        format!("{}   f/{:.3}   f = {:.4} mm", lens.name, lens.f_number, lens.effective_focal_length_mm),
        2,
        Anchor::Start,
        false,
    )];
    let upper = panel(0.0, range(&illumination, 1.0));
    upper.draw(&mut marks, "relative illumination", None);
    let lower = panel(1.0, range(&distortion, 0.0));
    lower.draw(&mut marks, "distortion (% of f tan w)", Some("real image height (mm)"));
    let reference =
        format!("f = {:.4} mm, {} nm", lens.distortion_focal_length_mm, lens.primary_wavelength_nm);
    let middle = (lower.top + lower.bottom) / 2.0;
    marks.push(text((left - 92.0, middle), reference, 2, Anchor::Middle, true));
    // The heavy curve last: it lies on top.
    let order =
        (0..chosen.len()).filter(|&i| chosen[i] != heavy).chain(chosen.iter().position(|&b| b == heavy));
    for i in order {
        let nm = lens.bands[chosen[i]].wavelength_nm;
        let width = if chosen[i] == heavy { 4.0 } else { 1.6 };
        let colour = ink(nm);
        marks.push(Mark::Line { points: upper.places(&illumination[i]), width, colour });
        marks.push(Mark::Line { points: lower.places(&distortion[i]), width, colour });
        let (x, y) = (upper.right + 16.0, upper.top + 12.0 + 26.0 * i as f64);
        marks.push(Mark::Line { points: vec![(x, y), (x + 26.0, y)], width, colour });
        marks.push(text((x + 36.0, y), format!("{nm} nm"), 2, Anchor::Start, false));
    }
    Ok(Figure { size, marks })
}

/// Draws the curves of a lens into a file: SVG if its name ends so, else PNG.
///
/// # Errors
/// As [`lens_curves`], and if the file cannot be written.
pub fn write_lens_curves(path: &Path, lens: &Lens, size: Size) -> Result<(), PictureError> {
    let figure = lens_curves(lens, size)?;
    if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("svg")) {
        return super::file::write_text(path, &figure.to_svg());
    }
    figure.to_image().write_png(path, &format!("lenscube curves of {}", latin(&lens.name)))
}

/// Relative illumination over real height.
fn illumination(band: &LensBand) -> Vec<(f64, f64)> {
    band.image_height_mm.iter().copied().zip(band.relative_illumination.iter().copied()).collect()
}

/// Distortion in percent over real height.
pub fn distortion_percent(band: &LensBand) -> Vec<(f64, f64)> {
    let mut curve: Vec<_> = band
        .image_height_mm
        .iter()
        .zip(&band.ideal_height_mm)
        .map(|(&real, &ideal)| (real, 100.0 * (real - ideal) / ideal))
        .collect();
    if let [axis, (r1, d1), rest @ ..] = curve.as_mut_slice() {
        let slope = rest.first().map_or(0.0, |(r2, d2)| (*d2 - *d1) / (*r2 * *r2 - *r1 * *r1));
        *axis = (0.0, *d1 - slope * *r1 * *r1);
    }
    curve
}

/// The band nearest to the primary wavelength.
fn primary(lens: &Lens) -> Option<usize> {
    let away = |b: usize| (lens.bands[b].wavelength_nm - lens.primary_wavelength_nm).abs();
    (0..lens.bands.len()).min_by(|&a, &b| away(a).total_cmp(&away(b)))
}

/// Evenly chosen bands with the first, the last and `heavy` among them, ascending.
fn chosen(bands: usize, heavy: usize) -> Vec<usize> {
    let count = bands.min(MOST_CURVES);
    let mut chosen: Vec<usize> =
        (0..count).map(|i| (i * (bands - 1) + (count - 1) / 2) / (count - 1).max(1)).collect();
    // It takes the place of the nearest that is not an end.
    if !chosen.contains(&heavy) {
        let inner = 1..count - 1;
        if let Some(i) = inner.min_by_key(|&i| chosen[i].abs_diff(heavy)) {
            chosen[i] = heavy;
        }
    }
    chosen.sort_unstable();
    chosen
}

/// A wavelength's own colour, dark enough to read on white.
pub fn ink(nm: f64) -> Rgb {
    // Beyond what the eye sees well hues stay as at its ends; from 640 nm up, where all are one red, they darken.
    let rgb = colour::xyz_to_linear_srgb(colour::observer(nm.clamp(410.0, 680.0))).map(|v| v.max(0.0));
    let most = rgb.iter().fold(1e-12, |a: f64, &b| a.max(b));
    let luminance = (0.2126 * rgb[0] + 0.7152 * rgb[1] + 0.0722 * rgb[2]) / most;
    // Contrast of at least 4.5 against white asks for luminance up to 0.18.
    let scale = (0.18 / luminance).min(1.0) / most * (1.0 - (nm - 640.0) / 80.0).clamp(0.25, 1.0);
    rgb.map(|v| (255.0 * colour::srgb_encode(v * scale)).round() as u8)
}

/// What Latin-1 cannot hold, a PNG's text cannot either.
fn latin(name: &str) -> String {
    name.chars().map(|c| if (c as u32) < 256 { c } else { '?' }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A lens of distortion −1e-4·r²: −1 % at 10 mm; magnified by 1e-3 a band.
    fn lens(bands: usize) -> Lens {
        let heights: Vec<f64> = (0..400).map(|i| 0.05 * f64::from(i)).collect();
        let band = |b: usize| LensBand {
            wavelength_nm: 400.0 + 300.0 * b as f64 / (bands - 1).max(1) as f64,
            ideal_height_mm: heights.clone(),
            image_height_mm: heights
                .iter()
                .map(|h| h * (1.0 + 1e-3 * b as f64 / bands as f64 - 1e-4 * h * h))
                .collect(),
            relative_illumination: heights.iter().map(|h| (1.0 + h * h / 900.0).powi(-2)).collect(),
            psf_height_mm: vec![0.0, 20.0],
            azimuth_count: vec![1, 8],
            psf_size: 3,
            psf_pitch_um: 2.0,
            psf_energy: vec![1.0; 2],
            solid_angle_sr: 0.1,
            transmission: 1.0,
        };
        Lens {
            name: "Made-up 30 mm".into(),
            distortion_focal_length_mm: 30.0,
            effective_focal_length_mm: 30.01,
            f_number: 2.8,
            primary_wavelength_nm: 550.0,
            object_distance_mm: None,
            magnification: 0.0,
            psf_sample: pipeline::lens::PsfSample::Point,
            bands: (0..bands).map(band).collect(),
        }
    }

    #[test]
    fn distortion_is_what_the_tables_say() {
        let curve = distortion_percent(&lens(1).bands[0]);
        assert!(curve[0].0 == 0.0 && curve[0].1.abs() < 1e-6, "{:?}", curve[0]);
        let (_, at_10) = curve[200];
        assert!((at_10 + 1.0).abs() < 1e-9, "{at_10}");
        let red = distortion_percent(&lens(31).bands[30]);
        assert!((red[0].1 - 0.1 * 30.0 / 31.0).abs() < 1e-5, "{:?}", red[0]);
    }

    #[test]
    fn the_primary_is_always_drawn() {
        for bands in 1..40 {
            for heavy in 0..bands {
                let chosen = chosen(bands, heavy);
                assert!(chosen.contains(&heavy) && chosen.windows(2).all(|w| w[0] < w[1]), "{chosen:?}");
                assert_eq!((chosen[0], chosen[chosen.len() - 1]), (0, bands - 1));
                assert_eq!(chosen.len(), bands.min(MOST_CURVES));
            }
        }
    }

    #[test]
    fn a_lens_becomes_a_picture() {
        let folder = tempfile::tempdir().unwrap();
        let size = Size::new(800, 1200);
        let figure = lens_curves(&lens(31), size).unwrap();
        let image = figure.to_image();
        assert_eq!(image.size(), size);
        // The heavy curve of 550 nm stands in both halves.
        let green = ink(550.0);
        for rows in [0..400, 400..800] {
            let count = rows
                .flat_map(|y| (0..1040).map(move |x| (y, x)))
                .filter(|&(y, x)| image.pixel(y, x) == green);
            assert!(count.count() > 1000);
        }
        for name in ["c.png", "c.svg"] {
            write_lens_curves(&folder.path().join(name), &lens(1), size).unwrap();
        }
        assert!(
            std::fs::read_to_string(folder.path().join("c.svg")).unwrap().contains("f = 30.0000 mm, 550 nm")
        );
        assert!(lens_curves(&lens(3), Size::new(100, 100)).is_err());
        assert!(lens_curves(&Lens { bands: vec![], ..lens(1) }, size).is_err());
    }
}
