//! `lenscube chart image`: a picture as a chart, its colours as spectra of reflected light.
//!
//!   L_b = (R·ρ_R(λ_b) + G·ρ_G(λ_b) + B·ρ_B(λ_b)) · S(λ_b)
//! with linear sRGB (R, G, B), the three reflectances of [`pipeline::reflectance`] and the light S, which is 1 at 560 nm, or for
//! `--scale-to Y` such that a white has luminance Y: S = Y·P/(683 ∫ P·ȳ dλ) for the light's relative power P. Grey: L_b = v·S(λ_b). An
//! OpenEXR of spectral channels is taken band by band, reflectances times S. Values of an OpenEXR below 0 are no light and become 0;
//! above 1 they stay brighter than white.

use super::store;
use crate::args::ImageArgs;
use crate::failure::usage;
use crate::job::{codec, threads};
use crate::memory::default_limit;
use crate::progress::{counting, say};
use anyhow::Result;
use formats::chart::ChartMeta;
use formats::chart::exr::ExrContent;
use formats::chart::image::{ImageFile, Transfer};
use formats::durable::{create_directories, parent_of};
use pipeline::colour::Illuminant;
use pipeline::flow::{ChartSource, SourceSinkError};
use pipeline::geometry::{Rect, Size};
use pipeline::reflectance::primaries;
use serde_json::{Map, json};
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

/// Bands unless asked for.
const BANDS: &str = "400:700:10";
/// What a thread holds at most: a shard of the store, its encoded bytes, a row of shards of linear samples.
const PER_THREAD: u64 = 96 << 20;

/// Linear samples lit by a light.
struct Lit {
    linear: Box<dyn ChartSource>,
    /// Light of each channel per band.
    light: Vec<Vec<f32>>,
    /// For pictures of bands: a band is the channel of its number, times its light.
    band_by_band: bool,
    below_zero: AtomicU64,
}

impl ChartSource for Lit {
    fn size(&self) -> Size {
        self.linear.size()
    }

    fn read(&self, band: usize, rect: Rect, out: &mut [f32]) -> Result<(), SourceSinkError> {
        let light = &self.light[band];
        if self.band_by_band {
            self.linear.read(band, rect, out)?;
            out.iter_mut().for_each(|v| *v *= light[0]);
            return Ok(());
        }
        out.fill(0.0);
        let mut channel = vec![0.0; out.len()];
        for (number, &light) in light.iter().enumerate() {
            self.linear.read(number, rect, &mut channel)?;
            if band == 0 {
                self.below_zero.fetch_add(channel.iter().filter(|v| **v < 0.0).count() as u64, Relaxed);
            }
            out.iter_mut().zip(&channel).for_each(|(to, v)| *to += light * v.max(0.0));
        }
        Ok(())
    }
}

/// Runs the command.
pub fn command(args: &ImageArgs) -> Result<()> {
    let light: Illuminant =
        args.illuminant.parse().map_err(|e| usage(format!("--illuminant {}: {e}", args.illuminant)))?;
    if !args.overwrite && args.out.symlink_metadata().is_ok() {
        let out = args.out.display();
        return Err(crate::failure::other_job(format!("{out} exists already; replace it with --overwrite")));
    }
    let file = ImageFile::open(&args.file)?;
    file.notes().iter().for_each(|note| say(format!("note: {note}")));
    let (scale, exposure) = match args.scale_to {
        None => (0.01, 1.0),
        Some(luminance) => {
            let scale = light.irradiance_scale(luminance);
            (scale, 0.01 / scale)
        }
    };
    let power = |nm: f64| scale * light.relative_power(nm);
    let plan = plan(args, &file, light, &power)?;
    let size = file.size();
    let parent = parent_of(&args.out);
    create_directories(parent, true)?;
    let threads = threads(args.threads);
    let most = (args.memory.unwrap_or_else(default_limit) / PER_THREAD).max(1) as usize;
    let threads = threads.min(most);
    let (bar, progress) = counting("reading the picture");
    let transfer = if args.linear { Transfer::Linear } else { Transfer::Srgb };
    let linear = file.linear(transfer, parent, threads, &progress)?;
    bar.finish_and_clear();
    let lit =
        Lit { linear, light: plan.light, band_by_band: plan.band_by_band, below_zero: AtomicU64::new(0) };
    let mut attributes = Map::new();
    let name = args.file.file_name().map_or(String::new(), |n| n.to_string_lossy().into_owned());
    attributes.insert("image".into(), json!(name));
    attributes.insert("program".into(), concat!("lenscube ", env!("CARGO_PKG_VERSION")).into());
    if let Some(light) = plan.lit_by {
        attributes.insert("illuminant".into(), json!(light.name()));
        attributes.insert("white_exposure".into(), json!(exposure));
    }
    let meta = ChartMeta {
        wavelengths_nm: plan.wavelengths_nm,
        pitch_um: args.pitch_um,
        film_size: Some(size),
        units: Some(plan.units),
        attributes,
    };
    store(&lit, &meta, &args.out, codec(args.codec), threads, args.overwrite)?;
    let below = lit.below_zero.into_inner();
    if below > 0 {
        say(format!("note: {below} samples below 0 are no light and were taken as 0"));
    }
    if let Some(light) = plan.lit_by {
        say(format!(
            "its white is 255 in `lenscube export {} OUT.png --white {} --exposure {exposure}`",
            args.out.display(),
            light.name()
        ));
    }
    Ok(())
}

/// What becomes of the channels.
struct Plan {
    wavelengths_nm: Vec<f64>,
    light: Vec<Vec<f32>>,
    band_by_band: bool,
    units: String,
    /// The light, if the picture is lit by one.
    lit_by: Option<Illuminant>,
}

fn plan(args: &ImageArgs, file: &ImageFile, light: Illuminant, power: &dyn Fn(f64) -> f64) -> Result<Plan> {
    let lit_units = if args.scale_to.is_some() { "W m-2 sr-1 nm-1" } else { "relative" };
    if let Some(exr) = file.spectral() {
        let ExrContent::Spectral { wavelengths_nm, reflective } = exr.content().clone() else {
            unreachable!("spectral is what was asked for")
        };
        if args.wavelengths.is_some() {
            return Err(usage(format!(
                "--wavelengths: {} has bands of its own, at {} nm",
                args.file.display(),
                pipeline::wavelengths::format(&wavelengths_nm)
            )));
        }
        if args.scale_to.is_some() && !reflective {
            return Err(usage("--scale-to: the file holds light, not reflectances; it is taken as it is"));
        }
        let of = |nm: &f64| vec![if reflective { power(*nm) as f32 } else { 1.0 }];
        let units = if reflective { lit_units } else { exr.units().unwrap_or("relative") };
        return Ok(Plan {
            light: wavelengths_nm.iter().map(of).collect(),
            wavelengths_nm,
            band_by_band: true,
            units: units.into(),
            lit_by: reflective.then_some(light),
        });
    }
    let words = args.wavelengths.as_deref().unwrap_or(BANDS);
    let wavelengths_nm =
        pipeline::wavelengths::parse(words).map_err(|e| usage(format!("--wavelengths: {e}")))?;
    let lit: Vec<Vec<f32>> = if file.is_grey() {
        wavelengths_nm.iter().map(|&nm| vec![power(nm) as f32]).collect()
    } else {
        let rho = primaries(&wavelengths_nm, light).map_err(|e| usage(format!("--wavelengths: {e}")))?;
        std::iter::zip(&wavelengths_nm, rho)
            .map(|(&nm, rho)| rho.map(|r| (r * power(nm)) as f32).to_vec())
            .collect()
    };
    Ok(Plan { wavelengths_nm, light: lit, band_by_band: false, units: lit_units.into(), lit_by: Some(light) })
}
