//! s-SFR: modulation of Siemens stars (ISO 12233), in luminance.

use super::place::{Placed, square};
use super::section::{Section, cells, shown};
use super::sfr::MAX_CY_PX;
use crate::args::ReportArgs;
use anyhow::{Context, Result, bail};
use formats::picture::plot::{Axis, Plot, Series};
use pipeline::chart::StarSite;
use pipeline::measure::sfr::mtf50_cy_px;
use pipeline::measure::star::{SECTORS, Star, StarCurve};
use serde_json::json;

/// Step of frequencies, cycles per pixel.
const STEP_CY_PX: f64 = 0.01;
/// Least modulation of the widest ring over that of the chart: below it there is no star.
const MIN_MODULATION: f64 = 0.05;
/// Largest side of the region of a star, px.
const MAX_SIDE_PX: f64 = 12_000.0;

/// Measures the stars of the chart.
///
/// # Errors
/// A star that is not in the picture, or too small.
pub fn measure(placed: &Placed<'_>, args: &ReportArgs) -> Result<Section> {
    let sites = placed.chart.stars();
    let stars: Vec<(Star, StarCurve)> = sites.iter().map(|site| star(placed, site)).collect::<Result<_>>()?;
    let mut plot = Plot::new(
        "Modulation of stars, mean of all azimuths",
        Axis::new("spatial frequency (cycles/px)", 0.0, MAX_CY_PX),
        Axis::new("MTF", 0.0, 1.05),
    );
    let mut table =
        vec![cells(["x", "y", "height", "MTF50 (cycles/px)", "lowest of a sector", "highest of a sector"])];
    let mut json_stars = Vec::new();
    let mut all_mtf50 = Vec::new();
    for (i, (star, curve)) in stars.iter().enumerate() {
        let mean = curve.mean();
        let points = std::iter::zip(&curve.frequency_cy_px, &mean).map(|(f, m)| (*f, *m)).collect();
        let height = placed.height(star.centre_px);
        plot.series.push(Series::distinct(format!("height {height:.2}"), points, i));
        let sectors: Vec<Option<f64>> = (0..SECTORS)
            .map(|k| {
                mtf50_cy_px(&curve.frequency_cy_px, &curve.sectors.iter().map(|s| s[k]).collect::<Vec<_>>())
            })
            .collect();
        let of_all = mtf50_cy_px(&curve.frequency_cy_px, &mean);
        let least = sectors.iter().flatten().copied().reduce(f64::min);
        let most = sectors
            .iter()
            .copied()
            .collect::<Option<Vec<f64>>>()
            .and_then(|v| v.into_iter().reduce(f64::max));
        table.push(vec![
            format!("{:.2}", star.centre_px.1),
            format!("{:.2}", star.centre_px.0),
            format!("{height:.3}"),
            shown(of_all, 4),
            shown(least, 4),
            shown(most, 4),
        ]);
        json_stars.push(json!({
            "row": star.centre_px.0, "column": star.centre_px.1, "height": height, "mtf50_cy_px": of_all,
            "sector_mtf50_cy_px": sectors, "frequency_cy_px": curve.frequency_cy_px, "modulation": mean, "sectors": curve.sectors,
        }));
        all_mtf50.push((height, of_all));
    }
    let nearest = all_mtf50.iter().min_by(|a, b| a.0.total_cmp(&b.0)).and_then(|v| v.1);
    Ok(Section {
        slug: "s-sfr",
        title: "Resolution by Siemens stars (s-SFR)",
        standard: "after ISO 12233:2023, from published descriptions of it; over the modulation of the chart, eight azimuths",
        picture: placed.picture.name.clone(),
        camera: None,
        figures: vec![("MTF50, star nearest to the middle (cycles/px)".into(), shown(nearest, 4))],
        remarks: Vec::new(),
        plots: vec![plot.figure(args.style)],
        tables: vec![table],
        json: json!({ "stars": json_stars }),
    })
}

fn star(placed: &Placed<'_>, site: &StarSite) -> Result<(Star, StarCurve)> {
    let scale = placed.scale(site.centre_px);
    let at = placed.at(site.centre_px);
    let guess = Star { centre_px: at, radius_px: site.radius_px * scale, pairs: site.spokes };
    let half = guess.radius_px + 4.0;
    if 2.0 * half > MAX_SIDE_PX {
        bail!(
            "{}: a star of radius {:.0} px is measured up to {:.0} px",
            placed.picture.name,
            guess.radius_px,
            MAX_SIDE_PX / 2.0
        );
    }
    let rect = square(at, half, placed.picture.size());
    let pixels = placed.picture.luminance(rect)?;
    let too_small = || {
        format!(
            "{}: expected a star of {} pairs and radius {:.0} px at {:.0},{:.0}, found none that can be measured: the chart has other settings, the star is cut off, or it is too small",
            placed.picture.name, guess.pairs, guess.radius_px, at.1, at.0
        )
    };
    let star = guess.centred(&pixels, rect).with_context(too_small)?;
    let offset = (star.centre_px.0 - at.0).hypot(star.centre_px.1 - at.1);
    if offset > guess.radius_px / 4.0 || !offset.is_finite() {
        bail!(too_small());
    }
    let first = (star.lowest_cy_px() / STEP_CY_PX).ceil() as usize;
    let last = (MAX_CY_PX / STEP_CY_PX) as usize;
    let frequencies: Vec<f64> = (first..=last).map(|k| k as f64 * STEP_CY_PX).collect();
    let curve = star.curve(&pixels, rect, &frequencies, site.modulation()).with_context(too_small)?;
    match curve.mean().first() {
        Some(first) if *first >= MIN_MODULATION => {}
        _ => bail!(too_small()),
    }
    Ok((star, curve))
}
