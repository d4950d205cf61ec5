//! The corner of the film as the observer sees it, beside the picture that a camera records of it.
//!
//! The camera is the sensor `example-2um`, one sensor pixel per film pixel, exposed and developed by the code of `lenscube sensor` and
//! `lenscube develop`. Both pictures have the same mean luminance.

use crate::args::{DevelopStyle, ExposeArgs};
use crate::camera::Developer;
use crate::camera::frame::Frame;
use crate::commands::sensor;
use anyhow::Result;
use formats::picture::image::Image;
use pipeline::colour::srgb_decode;
use pipeline::develop::{Quantizer, Tone};
use std::path::Path;

/// The sensor of the demo.
pub const SENSOR: &str = "example-2um";

/// Exposes the sensor, its middle at `center` (x, y) in mm from the axis, to `film`; the exit code.
pub fn expose(film: &str, raw: &Path, center: (f64, f64), threads: usize) -> Result<u8> {
    sensor::expose(&ExposeArgs {
        sensor: Some(SENSOR.into()),
        exposure: Some("auto".into()),
        center,
        threads: Some(threads),
        overwrite: true,
        ..ExposeArgs::new(film, raw)
    })
}

/// The developed raw with the mean luminance of `seen`.
pub fn picture(raw: &Path, seen: &Image, threads: usize) -> Result<Image> {
    let frame = Frame::open(&raw.to_string_lossy(), 0, 0)?;
    let developer = Developer::new(frame, &DevelopStyle::default(), threads, 0)?;
    let rect = developer.rect();
    let linear = developer.linear(rect)?;
    let luminance = |rgb: [f64; 3]| 0.2126 * rgb[0] + 0.7152 * rgb[1] + 0.0722 * rgb[2];
    let mean_seen: f64 =
        seen.pixels().iter().map(|p| luminance(p.map(|v| srgb_decode(f64::from(v) / 255.0)))).sum::<f64>()
            / seen.pixels().len() as f64;
    let pixels = linear.as_chunks::<3>().0;
    let mean: f64 = pixels.iter().map(|p| luminance(p.map(|v| f64::from(v.clamp(0.0, 1.0))))).sum::<f64>()
        / pixels.len() as f64;
    let factor = (mean_seen / mean.max(1e-6)) as f32;
    let quantizer = Quantizer::new(Tone::Srgb, 8);
    let mut image = Image::new(rect.size(), [0; 3]);
    for (y, line) in pixels.chunks_exact(rect.width).enumerate() {
        for (pixel, rgb) in image.row_mut(y).iter_mut().zip(line) {
            *pixel = rgb.map(|v| quantizer.code(v * factor) as u8);
        }
    }
    Ok(image)
}
