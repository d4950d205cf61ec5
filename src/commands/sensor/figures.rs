//! Figures of a sensor's report: maps of its fixed patterns, and the colours of a ColorChecker: reference and reproduction.

use crate::progress::log_line;
use anyhow::Result;
use formats::picture::figure::{Anchor, Figure, Text};
use formats::picture::image::Image;
use formats::picture::style::Style;
use pipeline::colour::{CHECKER_PATCHES, Illuminant, checker_names};
use pipeline::develop::ColourMatrix;
use pipeline::develop::matrix::{patch_responses, patch_targets};
use pipeline::develop::{Quantizer, Tone};
use pipeline::geometry::Size;
use pipeline::sensor::Sensor;
use std::path::Path;

/// Deviations from the mean, in standard deviations, that are black and white in a map.
const MAP_SIGMAS: f64 = 3.0;
/// Side of a patch, px, and the space around it.
const PATCH: usize = 120;
const GAP: usize = 34;
/// Patches of a row.
const COLUMNS: usize = 6;

/// A mean frame as grey: its mean is middle grey, three standard deviations are black and white.
pub fn map(path: &Path, name: &str, frame: &[f64], size: Size) -> Result<()> {
    let n = frame.len() as f64;
    let mean = frame.iter().sum::<f64>() / n;
    let sigma = (frame.iter().map(|v| (v - mean) * (v - mean)).sum::<f64>() / n).sqrt().max(1e-9);
    let mut image = Image::new(size, [0; 3]);
    for (y, line) in frame.chunks_exact(size.width).enumerate() {
        for (pixel, v) in image.row_mut(y).iter_mut().zip(line) {
            let shade = 0.5 + (v - mean) / (2.0 * MAP_SIGMAS * sigma);
            *pixel = [(255.0 * shade.clamp(0.0, 1.0)).round() as u8; 3];
        }
    }
    image.write_png(
        path,
        &format!("{name}: mean {mean:.4} DN, black and white at {:.4} DN from it", MAP_SIGMAS * sigma),
    )?;
    log_line(format!("wrote {}", path.display()));
    Ok(())
}

/// The patches of a ColorChecker under D65: reference on the left, by the fitted matrix on the right, with their ΔE2000. Nothing for a sensor
/// without three planes.
pub fn patches(path: &Path, sensor: &Sensor) -> Result<()> {
    let light = Illuminant::D65;
    let matrix = match ColourMatrix::fitted(sensor, light) {
        Ok(matrix) if sensor.planes().len() > 1 => matrix,
        _ => return Ok(()),
    };
    let (wanted, camera) = (patch_targets(light), patch_responses(sensor, light));
    let quantizer = Quantizer::new(Tone::Srgb, 8);
    let shown = |rgb: [f64; 3]| rgb.map(|v| quantizer.code(v as f32) as u8);
    let rows = CHECKER_PATCHES / COLUMNS;
    let size = Size::new(50 + rows * (PATCH + GAP), COLUMNS * (PATCH + GAP) + GAP);
    let mut figure = Figure::new(size, Style::Light);
    let title = format!(
        "{}: ColorChecker under D65, reference (left) and by the fitted matrix (right); ΔE2000 mean {:.2}, largest {:.2}",
        sensor.name,
        matrix.mean_delta_e(),
        matrix.max_delta_e()
    );
    let at = (GAP as f64, 22.0);
    figure.text(Text { max_width: (size.width - 2 * GAP) as f64, ..Text::new(at, Anchor::Start, &title) });
    for (k, (wanted, camera)) in std::iter::zip(&wanted, &camera).enumerate() {
        let got = std::array::from_fn(|c| std::iter::zip(&matrix.rows[c], camera).map(|(m, v)| m * v).sum());
        let mut image = Image::new(Size::new(PATCH, PATCH), shown(*wanted));
        for y in 0..PATCH {
            image.row_mut(y)[PATCH / 2..].fill(shown(got));
        }
        let x = (GAP + k % COLUMNS * (PATCH + GAP)) as f64;
        let y = (44 + k / COLUMNS * (PATCH + GAP)) as f64;
        figure.picture((x, y), &image, 1);
        let label = format!("{} {:.2}", checker_names()[k], matrix.delta_e[k]);
        let below = (x, y + PATCH as f64 + 12.0);
        figure.text(Text {
            size: 12.0,
            max_width: (PATCH + GAP - 6) as f64,
            ..Text::new(below, Anchor::Start, &label)
        });
    }
    figure.write(path)?;
    log_line(format!("wrote {}", path.display()));
    Ok(())
}
