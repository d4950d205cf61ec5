//! `lenscube lens show --plot`: figures of a lens, each as SVG and PNG.
//!
//! Relative illumination, distortion and lateral colour against REAL height; MTF against field and against frequency at the primary
//! wavelength (of the optics without the pixel; light outside the PSF window counts as a uniform background); PSFs by field and
//! wavelength; encircled energy; the nodes of the PSF field. Of a design also spot diagrams, ray fans, OPD fans, field curvature, MTF through
//! focus, and its cross-section with rays.

use super::aberrations::{Fan, MAX_PANELS, encircled_energy, fans, field_curvature, through_focus};
use super::cross_section::cross_section;
use super::curves::{against_height, height_axis, mtf_field, mtf_frequency, nodes};
use super::psf_figure::psf_figure;
use super::spot_figure::spot_figure;
use crate::job::lens::samples::{LensData, evenly_spaced, nearest};
use crate::outputs::check_absent_in;
use crate::progress::log_line;
use crate::progress::short_number;
use anyhow::Result;
use formats::durable::{create_directories, finish_together};
use formats::picture::plot::{Axis, stacked};
use formats::picture::style::Style;
use pipeline::lens::LensBand;
use std::path::Path;

/// Formats of a figure.
pub const EXTENSIONS: [&str; 2] = ["svg", "png"];
/// Figures of any lens.
const FIGURES: [&str; 8] = [
    "relative-illumination",
    "distortion",
    "lateral-colour",
    "mtf-field",
    "mtf-frequency",
    "nodes",
    "encircled-energy",
    "psf",
];
/// Further figures of a design.
const DESIGN_FIGURES: [&str; 6] = ["layout", "field-curvature", "mtf-focus", "ray-fans", "opd-fans", "spots"];

/// Heights of the MTF against field.
const MTF_HEIGHTS: usize = 25;

/// Names of all files that [`write()`] may write.
pub fn all_files() -> impl Iterator<Item = String> {
    FIGURES.iter().chain(&DESIGN_FIGURES).flat_map(|name| EXTENSIONS.map(|e| format!("{name}.{e}")))
}

/// Fails (exit code 3) if [`write()`] would replace a file, unless `overwrite`.
pub fn check_absent(dir: &Path, lens: &LensData, overwrite: bool) -> Result<()> {
    let more = if matches!(lens, LensData::Design(..)) { &DESIGN_FIGURES[..] } else { &[] };
    let names = FIGURES.iter().chain(more).flat_map(|name| EXTENSIONS.map(|e| format!("{name}.{e}")));
    check_absent_in(dir, names, overwrite)
}

/// Writes all figures that `lens` has data for into `dir`: [`FIGURES`], and [`DESIGN_FIGURES`] of a design. A design whose field points are all on the
/// axis has no figures against the height.
pub fn write(
    dir: &Path,
    lens: &LensData,
    nm: &[f64],
    heights_mm: &[f64],
    lp_mm: &[f64],
    style: Style,
) -> Result<()> {
    create_directories(dir, true)?;
    let samples = lens.sample(nm, heights_mm)?;
    let max_mm = heights_mm[heights_mm.len() - 1];
    let name = lens.name();
    let all_nm = lens.wavelengths_nm();
    let primary = all_nm[nearest(all_nm.iter().copied(), lens.primary_nm())];
    let fields = lens.sample(&[primary], heights_mm)?;
    let illumination = Axis::new("relative illumination", 0.0, 1.05);
    let distortion = Axis::new("distortion (% of f tan θ)", 0.0, 0.0);
    let lateral = Axis::new("lateral colour (µm)", 0.0, 0.0);
    let focal = format!("distortion, f = {:.3} mm", samples.lens.distortion_focal_length_mm);
    let reference = format!("lateral colour from {} nm", short_number(samples.primary.wavelength_nm));
    let curves = |title: &str, axis: Axis, value: &dyn Fn(&LensBand, f64) -> f64| {
        let axes = (height_axis(&samples.lens, &samples.primary, max_mm), axis);
        against_height(&samples.lens.bands, &format!("{name}: {title}"), axes, max_mm, value)
    };
    let lateral_um = |band: &LensBand, r_mm: f64| band.lateral_colour_um(&samples.primary, r_mm);
    let mut plots = vec![("mtf-frequency", mtf_frequency(&fields, name, lp_mm))];
    // What depends on the height, where there is another than that of the axis.
    let has_field = max_mm > 0.0;
    if has_field {
        let dense: Vec<f64> =
            (0..MTF_HEIGHTS).map(|i| max_mm * i as f64 / (MTF_HEIGHTS - 1) as f64).collect();
        let dense = lens.sample(&[primary], &dense)?;
        plots.extend([
            (
                "relative-illumination",
                curves("relative illumination", illumination, &LensBand::illumination_at),
            ),
            ("distortion", curves(&focal, distortion, &LensBand::distortion_percent)),
            ("lateral-colour", curves(&reference, lateral, &lateral_um)),
            ("mtf-field", mtf_field(&dense, name, lp_mm)),
            ("nodes", nodes(name, &lens.nodes(primary, max_mm)?)),
        ]);
    }
    let psfs: Vec<_> = fields.fields[0].iter().map(|f| (f.height_mm, &f.psf)).collect();
    plots.push(("encircled-energy", encircled_energy(name, &psfs, primary)));
    let shown: Vec<f64> =
        evenly_spaced(heights_mm.len(), MAX_PANELS).into_iter().map(|k| heights_mm[k]).collect();
    if let LensData::Design(system, _) = lens {
        plots.push(("layout", cross_section(system)?));
        if has_field {
            let heights = height_axis(&samples.lens, &samples.primary, max_mm);
            plots.push(("field-curvature", field_curvature(system, nm, max_mm, heights)?));
        }
        let lp_mm = lp_mm[lp_mm.len() / 2];
        plots.push(("mtf-focus", through_focus(system, &shown, lp_mm)?));
    }
    let mut figures: Vec<_> = plots.iter().map(|(file, plot)| (*file, plot.figure(style))).collect();
    figures.push(("psf", psf_figure(&samples, name, style)));
    if let LensData::Design(system, _) = lens {
        for (file, fan, title) in
            [("ray-fans", Fan::Ray, "ray fans"), ("opd-fans", Fan::Path, "optical path differences")]
        {
            let panels = fans(system, nm, &shown, fan)?;
            figures.push((file, stacked(&format!("{name}: {title}"), &panels, style)));
        }
        figures.push(("spots", spot_figure(system, nm, heights_mm, style)?));
    }
    let mut files = Vec::new();
    for (file, figure) in &figures {
        for extension in EXTENSIONS {
            files.push(figure.file(&dir.join(format!("{file}.{extension}")))?);
        }
    }
    finish_together(files)?;
    let names: Vec<&str> = figures.iter().map(|f| f.0).collect();
    log_line(format!("{}: SVG and PNG of {}", dir.display(), names.join(", ")));
    Ok(())
}
