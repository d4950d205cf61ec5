//! OECF, noise, SNR and dynamic range (ISO 14524, ISO 15739) of grey patches, colour by colour, and visual noise.

use super::place::Placed;
use super::section::{Section, cells, shown};
use crate::args::ReportArgs;
use crate::failure::usage;
use anyhow::{Result, bail};
use formats::picture::plot::{Axis, Plot, Series};
use pipeline::geometry::Rect;
use pipeline::measure::photon_transfer::{PhotonTransfer, photon_transfer};
use pipeline::measure::tones::{DynamicRange, Patch, Tone, dynamic_range, statistics, tones};
use pipeline::measure::visual_noise::{VisualNoise, visual_noise};
use serde_json::json;

/// Wavelength at which reflectances are taken: the patches are grey.
const GREY_NM: f64 = 550.0;
/// Share of clipped pixels from which on a patch has no SNR.
const MAX_CLIPPED: f64 = 1e-3;
/// Least side of the part of a patch that is measured without a remark, px: that of visual noise.
const MIN_SIDE: usize = 16;
/// Largest side of the part of a patch that is looked at for visual noise, px.
const VISUAL_SIDE: usize = 256;

/// Tones of a colour.
struct Scale {
    name: String,
    tones: Vec<Tone>,
    range: Option<DynamicRange>,
}

/// Measures the grey patches of the chart.
///
/// # Errors
/// A patch that is too small, or not in the picture.
pub fn measure(placed: &Placed<'_>, args: &ReportArgs) -> Result<Section> {
    let reflectances = placed.chart.patch_reflectance(GREY_NM);
    let mut scales: Vec<(String, Vec<Patch>)> = Vec::new();
    let mut visual = Vec::new();
    for (film, reflectance) in std::iter::zip(placed.chart.patches_px(), &reflectances) {
        let rect = placed.patch(*film);
        let colours = placed.picture.colours(rect)?;
        scales.resize_with(colours.len(), Default::default);
        for (scale, colour) in std::iter::zip(&mut scales, colours) {
            let (mean, sigma) = statistics(&colour.pixels).ok_or_else(|| {
                usage(format!(
                    "{}: the patch at {rect} has {} pixels of {}, expected at least 16",
                    placed.picture.name,
                    colour.pixels.len(),
                    colour.name
                ))
            })?;
            let clipped = colour.clipped as f64 / colour.pixels.len() as f64;
            scale.0.clone_from(&colour.name);
            scale.1.push(Patch { reflectance: *reflectance, mean, sigma, clipped });
        }
        visual.push(seen(placed, rect, args.pixels_per_degree)?);
    }
    for (name, patches) in &scales {
        check_order(placed, name, patches)?;
    }
    let of = |(name, patches): (String, Vec<Patch>)| {
        let tones = tones(&patches);
        Scale { name, range: dynamic_range(&tones, MAX_CLIPPED), tones }
    };
    let scales: Vec<Scale> = scales.into_iter().map(of).collect();
    Ok(section(placed, args, &scales, &visual))
}

/// Fails if a lighter patch is darker in the picture, by more than noise: the chart is another, or elsewhere.
fn check_order(placed: &Placed<'_>, name: &str, patches: &[Patch]) -> Result<()> {
    let falls = |pair: &&[Patch]| {
        pair[0].mean - pair[1].mean > 0.5 * (pair[0].sigma + pair[1].sigma) + 0.02 * pair[0].mean.abs()
    };
    let Some(pair) = patches.windows(2).find(falls) else { return Ok(()) };
    bail!(
        "{}: the grey patches do not become lighter with their reflectance: {name} falls from {:.4e} at {:.4} to {:.4e} at {:.4}; the chart has other settings, or is elsewhere in the picture",
        placed.picture.name,
        pair[0].mean,
        pair[0].reflectance,
        pair[1].mean,
        pair[1].reflectance
    )
}

/// Visual noise of the middle of a patch.
fn seen(placed: &Placed<'_>, rect: Rect, pixels_per_degree: f64) -> Result<Option<VisualNoise>> {
    let (h, w) = (rect.height.min(VISUAL_SIDE), rect.width.min(VISUAL_SIDE));
    let part =
        Rect::new(rect.y + ((rect.height - h) / 2) as i64, rect.x + ((rect.width - w) / 2) as i64, h, w);
    let channels = placed.picture.channels(part)?;
    let colour = |i: usize| [0, 1, 2].map(|c| f64::from(channels[c.min(channels.len() - 1)][i]));
    let pixels: Vec<[f64; 3]> = (0..h * w).map(colour).collect();
    Ok(visual_noise(&pixels, w, pixels_per_degree))
}

/// Dynamic range in words.
fn in_words(range: Option<DynamicRange>) -> String {
    range.map_or("none".into(), |r| {
        let sign = if r.is_bound { "at least " } else { "" };
        format!("{sign}{:.0} ({:.1} dB, {:.1} stops)", r.ratio, 20.0 * r.ratio.log10(), r.ratio.log2())
    })
}

fn section(
    placed: &Placed<'_>,
    args: &ReportArgs,
    scales: &[Scale],
    visual: &[Option<VisualNoise>],
) -> Section {
    let unit = placed.picture.unit();
    let axis = || Axis::new("log10 reflectance", 0.0, 0.0);
    let mut oecf = Plot::new("OECF", axis(), Axis::new(format!("log10 mean ({unit})"), 0.0, 0.0));
    let mut snr = Plot::new("Signal to noise", axis(), Axis::new("SNR (dB)", 0.0, 0.0));
    for (i, scale) in scales.iter().enumerate() {
        let over = |value: &dyn Fn(&Tone) -> f64| {
            scale.tones.iter().map(|t| (t.patch.reflectance.log10(), value(t))).collect::<Vec<_>>()
        };
        oecf.series.push(Series::distinct(&scale.name, over(&|t| t.patch.mean.log10()), i));
        let of_unclipped =
            |t: &Tone| if t.patch.clipped > MAX_CLIPPED { f64::NAN } else { 20.0 * t.snr.log10() };
        snr.series.push(Series::distinct(&scale.name, over(&of_unclipped), i));
    }
    let reflectances = placed.chart.patch_reflectance(GREY_NM);
    let mut seen = Plot::new("Visual noise", axis(), Axis::new("visual noise", 0.0, 0.0));
    let points = std::iter::zip(&reflectances, visual).filter_map(|(r, v)| Some((r.log10(), (*v)?.value)));
    seen.series.push(Series::distinct("", points.collect(), 0));
    let middle = (0..reflectances.len()).min_by(|a, b| {
        let off = |k: usize| (reflectances[k] / 0.18).ln().abs();
        off(*a).total_cmp(&off(*b))
    });
    let mut figures = Vec::new();
    let mut table = vec![cells([
        "colour",
        "reflectance",
        &format!("mean ({unit})"),
        &format!("standard deviation ({unit})"),
        "SNR (dB)",
        "clipped (%)",
    ])];
    for scale in scales {
        if let Some(k) = middle {
            let at = reflectances[k];
            figures.push((
                format!("SNR at reflectance {at:.2}, {} (dB)", scale.name),
                shown(scale.tones.get(k).map(|t| 20.0 * t.snr.log10()), 1),
            ));
        }
        figures.push((format!("dynamic range, {}", scale.name), in_words(scale.range)));
        table.extend(scale.tones.iter().map(|t| {
            let p = t.patch;
            vec![
                scale.name.clone(),
                format!("{:.4}", p.reflectance),
                format!("{:.5e}", p.mean),
                format!("{:.4e}", p.sigma),
                format!("{:.2}", 20.0 * t.snr.log10()),
                format!("{:.2}", 100.0 * p.clipped),
            ]
        }));
    }
    if let Some(k) = middle {
        figures.push((
            format!("visual noise at reflectance {:.2}", reflectances[k]),
            shown(visual[k].map(|v| v.value), 2),
        ));
    }
    let clipped = scales.iter().flat_map(|s| &s.tones).filter(|t| t.patch.clipped > MAX_CLIPPED).count();
    let mut remarks = Vec::new();
    if clipped > 0 {
        remarks.push(format!(
            "{clipped} patches of a colour are clipped: they have no SNR, and the dynamic range ends below them; expose less"
        ));
    }
    let narrow = |film: &&Rect| {
        let rect = placed.patch(**film);
        rect.width.min(rect.height) < MIN_SIDE
    };
    if placed.chart.patches_px().iter().any(|film| narrow(&film)) {
        remarks.push(format!(
            "patches are measured on less than {MIN_SIDE} pixels a side: blur of their edges counts as noise, and they have no visual noise; use a larger picture, or a chart `oecf`"
        ));
    }
    let one = |scale: &Scale| {
        let tones = scale.tones.iter().map(|t| {
            json!({ "reflectance": t.patch.reflectance, "mean": t.patch.mean, "standard_deviation": t.patch.sigma, "clipped": t.patch.clipped, "slope": t.slope, "snr": t.snr })
        });
        json!({
            "colour": scale.name, "unit": unit, "tones": tones.collect::<Vec<_>>(),
            "dynamic_range": scale.range.map(|r| json!({ "ratio": r.ratio, "is_lower_bound": r.is_bound })),
        })
    };
    let patches = |scale: &Scale| scale.tones.iter().map(|t| t.patch).collect::<Vec<_>>();
    let transfers: Vec<Option<PhotonTransfer>> =
        scales.iter().map(|s| photon_transfer(&patches(s), MAX_CLIPPED).filter(|_| unit == "DN")).collect();
    if unit == "DN" {
        remarks.push(match transfers.iter().all(Option::is_none) {
            true => "electrons are not known: values are digital numbers above black; the patches are too few, or their noise does not grow with light, to estimate the gain".into(),
            false => "electrons are not known: values are digital numbers above black; the gain is estimated by photon transfer, from the noise of one picture".to_owned(),
        });
    }
    for (scale, transfer) in std::iter::zip(scales, &transfers) {
        if let Some(found) = transfer {
            figures.push((
                format!("gain by photon transfer, {} (DN/e-)", scale.name),
                format!("{:.4}", found.gain_dn_per_e),
            ));
            let dark_e = found.dark_noise_dn / found.gain_dn_per_e;
            figures.push((
                format!("noise in the dark by photon transfer, {} (e-)", scale.name),
                format!("{dark_e:.1}"),
            ));
        }
    }
    let transfer = |found: &Option<PhotonTransfer>| {
        found.map(|f| json!({ "gain_dn_per_e": f.gain_dn_per_e, "dark_noise_dn": f.dark_noise_dn, "fixed_pattern": f.fixed_pattern, "relative_residual": f.residual }))
    };
    let transfers: Vec<_> = transfers.iter().map(transfer).collect();
    let visual: Vec<_> =
        visual.iter().map(|v| v.map(|v| json!({ "value": v.value, "sigma_luv": v.luv }))).collect();
    Section {
        slug: "noise",
        title: "Tones, noise and dynamic range",
        standard: "after ISO 14524:2009 and ISO 15739:2023, from published descriptions of them; total noise of one picture; raws in electrons, or digital numbers of a DNG, before demosaicing",
        picture: placed.picture.name.clone(),
        camera: None,
        figures,
        remarks,
        plots: vec![oecf.figure(args.style), snr.figure(args.style), seen.figure(args.style)],
        tables: vec![table],
        json: json!({ "colours": scales.iter().map(one).collect::<Vec<_>>(), "photon_transfer": transfers, "visual_noise": visual, "pixels_per_degree": args.pixels_per_degree }),
    }
}
