//! `lenscube chart image`: converts a picture to a chart, its colours to spectra of reflected light.
//!
//!   L_b = (R·ρ_R(λ_b) + G·ρ_G(λ_b) + B·ρ_B(λ_b)) · S(λ_b)
//! with linear sRGB (R, G, B), the three reflectances ρ of [`pipeline::reflectance`] and the illuminant S, which is 1 at 560 nm. With
//! `--scale-to Y` white has luminance Y in cd/m²: S = Y·P/(683 ∫ P·ȳ dλ) for the relative power P of the illuminant. Grey:
//! L_b = v·S(λ_b). The channels of a spectral OpenEXR are the bands; reflectances are multiplied by S. Negative values of an OpenEXR
//! become 0; values above 1 are kept.

use super::store;
use crate::args::ImageArgs;
use crate::failure::usage;
use crate::machine::{MAX_DEFAULT, MemoryLimit, threads};
use crate::outputs::check_absent;
use crate::progress::{counting, log_line};
use anyhow::Result;
use formats::chart::exr::ExrContent;
use formats::chart::image::{ImageFile, Transfer};
use formats::chart::{ChartMeta, NewChart};
use formats::durable::{create_directories, parent_of};
use pipeline::colour::Illuminant;
use pipeline::flow::{ChartSource, SourceSinkError};
use pipeline::geometry::{Rect, Size};
use pipeline::reflectance::{EXACT, Primaries, ReflectanceError, primaries};
use serde_json::{Map, json};
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

/// Default bands.
pub const DEFAULT_BANDS: &str = "400:700:10";
/// Maximum memory of a thread: a shard of the store, its encoded bytes, a row of shards of linear samples.
const MAX_THREAD_BYTES: u64 = 96 << 20;

/// Linear samples under an illuminant.
struct IlluminatedPicture {
    linear: Box<dyn ChartSource>,
    /// Factors by band and channel.
    factors: Vec<Vec<f32>>,
    /// Whether channel b alone is band b, as in a spectral picture.
    spectral: bool,
    negative_samples: AtomicU64,
}

impl ChartSource for IlluminatedPicture {
    fn size(&self) -> Size {
        self.linear.size()
    }

    fn read(&self, band: usize, rect: Rect, out: &mut [f32]) -> Result<(), SourceSinkError> {
        let factors = &self.factors[band];
        if self.spectral {
            self.linear.read(band, rect, out)?;
            out.iter_mut().for_each(|v| *v *= factors[0]);
            return Ok(());
        }
        out.fill(0.0);
        let mut samples = vec![0.0; out.len()];
        for (channel, &factor) in factors.iter().enumerate() {
            self.linear.read(channel, rect, &mut samples)?;
            if band == 0 {
                let negative = samples.iter().filter(|v| **v < 0.0).count() as u64;
                self.negative_samples.fetch_add(negative, Relaxed);
            }
            out.iter_mut().zip(&samples).for_each(|(to, v)| *to += factor * v.max(0.0));
        }
        Ok(())
    }
}

/// Runs the command.
pub fn command(args: &ImageArgs) -> Result<()> {
    if let Some((light, exposure)) = convert(args)? {
        log_line(format!(
            "to display white as 255: lenscube export {} OUT.png --white {} --exposure {exposure}",
            args.out.display(),
            light.name()
        ));
    }
    Ok(())
}

/// Converts the picture; the illuminant of the chart, if it has one, and the exposure that displays its white as 255.
///
/// # Errors
/// Flags that do not fit the file; a file that cannot be read; the store.
pub fn convert(args: &ImageArgs) -> Result<Option<(Illuminant, f64)>> {
    let light: Illuminant =
        args.illuminant.parse().map_err(|e| usage(format!("--illuminant {}: {e}", args.illuminant)))?;
    check_absent(&args.out, args.overwrite)?;
    let file = ImageFile::open(&args.file)?;
    file.notes().iter().for_each(|note| log_line(format!("note: {note}")));
    let (scale, exposure) = match args.scale_to {
        None => (0.01, 1.0),
        Some(luminance) => {
            let scale = light.irradiance_scale(luminance);
            (scale, 0.01 / scale)
        }
    };
    let power = |nm: f64| scale * light.relative_power(nm);
    let conversion = conversion(args, &file, light, &power)?;
    let size = file.size();
    let limit = MemoryLimit::new(args.memory, MAX_DEFAULT);
    let needed = file.decoder_bytes() as u64 + MAX_THREAD_BYTES;
    if file.decoder_bytes() > 0 && needed > limit.bytes {
        return Err(limit.too_small(format!(
            "{} is decoded as a whole, which requires {needed} bytes; raise the limit, or convert it to PNG or TIFF, which are read row by row",
            args.file.display()
        )));
    }
    let parent = parent_of(&args.out);
    create_directories(parent, true)?;
    let threads = threads(args.threads);
    let max_threads = (limit.bytes / MAX_THREAD_BYTES).max(1) as usize;
    let threads = threads.min(max_threads);
    let (bar, progress) = counting("reading the picture");
    let transfer = if args.linear { Transfer::Linear } else { Transfer::Srgb };
    let linear = file.linear(transfer, parent, threads, &progress)?;
    bar.finish_and_clear();
    let picture = IlluminatedPicture {
        linear,
        factors: conversion.factors,
        spectral: conversion.spectral,
        negative_samples: AtomicU64::new(0),
    };
    let mut attributes = Map::new();
    let name = args.file.file_name().map_or(String::new(), |n| n.to_string_lossy().into_owned());
    attributes.insert("image".into(), json!(name));
    attributes.insert("program".into(), concat!("lenscube ", env!("CARGO_PKG_VERSION")).into());
    if let Some(light) = conversion.illuminant {
        attributes.insert("illuminant".into(), json!(light.name()));
        attributes.insert("white_exposure".into(), json!(exposure));
    }
    let meta = ChartMeta {
        wavelengths_nm: conversion.wavelengths_nm,
        pitch_um: args.pitch_um,
        film_size: Some(size),
        units: Some(conversion.units),
        attributes,
    };
    let chart = NewChart { source: &picture, meta: &meta, surfaces: &[] };
    store(&chart, &args.out, args.codec, threads, args.overwrite)?;
    let negative = picture.negative_samples.into_inner();
    if negative > 0 {
        log_line(format!("note: {negative} negative samples were replaced by 0"));
    }
    Ok(conversion.illuminant.map(|light| (light, exposure)))
}

/// Conversion of channels to bands.
struct Conversion {
    wavelengths_nm: Vec<f64>,
    /// Factors by band and channel.
    factors: Vec<Vec<f32>>,
    spectral: bool,
    units: String,
    /// Illuminant; none for a picture of radiances.
    illuminant: Option<Illuminant>,
}

fn conversion(
    args: &ImageArgs,
    file: &ImageFile,
    light: Illuminant,
    power: &dyn Fn(f64) -> f64,
) -> Result<Conversion> {
    let units = if args.scale_to.is_some() { "W m-2 sr-1 nm-1" } else { "relative" };
    if let Some(exr) = file.spectral() {
        let ExrContent::Spectral { wavelengths_nm, reflective } = exr.content.clone() else {
            unreachable!("`spectral` returns spectral files only")
        };
        if args.wavelengths.is_some() {
            return Err(usage(format!(
                "--wavelengths is not supported for {}: the file has bands at {} nm",
                args.file.display(),
                pipeline::wavelengths::format(&wavelengths_nm)
            )));
        }
        if args.scale_to.is_some() && !reflective {
            return Err(usage(
                "--scale-to is not supported for radiances; the file holds radiances, not reflectances",
            ));
        }
        let factor = |nm: &f64| vec![if reflective { power(*nm) as f32 } else { 1.0 }];
        let units = if reflective { units } else { exr.chart.units().unwrap_or("relative") };
        return Ok(Conversion {
            factors: wavelengths_nm.iter().map(factor).collect(),
            wavelengths_nm,
            spectral: true,
            units: units.into(),
            illuminant: reflective.then_some(light),
        });
    }
    let wavelengths_nm = bands(args.wavelengths.as_deref())?;
    let factors: Vec<Vec<f32>> = if file.is_grey() {
        wavelengths_nm.iter().map(|&nm| vec![power(nm) as f32]).collect()
    } else {
        let found = colours(&wavelengths_nm, light, args.max_colour_error)?;
        if found.error > EXACT {
            log_line(format!(
                "note: colours in error by up to {:.1} % of white ({}): the bands cannot represent all of sRGB",
                100.0 * found.error,
                found.corner
            ));
        }
        std::iter::zip(&wavelengths_nm, found.rho)
            .map(|(&nm, rho)| rho.map(|r| (r * power(nm)) as f32).to_vec())
            .collect()
    };
    Ok(Conversion { wavelengths_nm, factors, spectral: false, units: units.into(), illuminant: Some(light) })
}

/// The bands of `--wavelengths`.
fn bands(wavelengths: Option<&str>) -> Result<Vec<f64>> {
    pipeline::wavelengths::parse(wavelengths.unwrap_or(DEFAULT_BANDS))
        .map_err(|e| usage(format!("--wavelengths: {e}")))
}

/// The reflectances of red, green and blue at `wavelengths_nm`.
fn colours(wavelengths_nm: &[f64], light: Illuminant, max_error: Option<f64>) -> Result<Primaries> {
    primaries(wavelengths_nm, light, max_error.unwrap_or(EXACT)).map_err(|e| {
        let nearest = match e {
            ReflectanceError::Unreachable { .. } => ", or accept the nearest colours with --max-colour-error",
            _ => "",
        };
        usage(format!("--wavelengths: {e}{nearest}"))
    })
}

/// Fails if the picture `file` cannot be converted to these bands under D65.
///
/// # Errors
/// Usage.
pub fn check_colours(file: &ImageFile, wavelengths: Option<&str>, max_error: Option<f64>) -> Result<()> {
    let wavelengths_nm = bands(wavelengths)?;
    match file.is_grey() {
        true => Ok(()),
        false => colours(&wavelengths_nm, Illuminant::D65, max_error).map(|_| ()),
    }
}
