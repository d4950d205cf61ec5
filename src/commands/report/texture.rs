//! Texture MTF of dead leaves by cross-correlation with the chart (ISO 19567-2), in luminance.
//!
//! The chart is drawn again at the pixels of the picture, tile by tile, at the place where it agrees best: the chart must be as large in the picture as on its film, upright.

use super::place::Placed;
use super::section::{Section, shown};
use super::sfr::MAX_CY_PX;
use crate::args::ReportArgs;
use crate::failure::usage;
use anyhow::{Context, Result};
use formats::picture::plot::{Axis, Plot, Series};
use pipeline::flow::ChartSource;
use pipeline::geometry::Rect;
use pipeline::measure::sfr::mtf50_cy_px;
use pipeline::measure::texture::{TILE_PX, Texture, TileError};
use serde_json::json;

/// Largest rotation or difference of scale, as a share.
const MAX_TILT: f64 = 0.01;
/// Tries of a tile at displaced places of the chart.
const TRIES: usize = 3;
/// Largest displacement of a tile, px.
const MAX_SHIFT_PX: i64 = TILE_PX as i64;
/// Tiles along a side, at most.
const MAX_ALONG: usize = 24;

/// Measures the leaves.
///
/// # Errors
/// A chart of another size, or rotated; none of its tiles is found.
pub fn measure(placed: &Placed<'_>, args: &ReportArgs) -> Result<Section> {
    let leaves =
        placed.chart.texture_px().with_context(|| format!("{} has no leaves", placed.chart.spec()))?;
    check_upright(placed)?;
    let mut texture = Texture::default();
    let mut missed = 0;
    for (y, x) in tiles(leaves) {
        missed += usize::from(!add(placed, &mut texture, (y, x))?);
    }
    let tiles = texture.tiles() + missed;
    let mtf = texture.mtf(MAX_CY_PX).filter(|_| 2 * missed <= tiles).with_context(|| {
        format!(
            "{}: {missed} of {tiles} tiles of {TILE_PX} px do not agree with the chart: it has other settings, or another place or size in the picture",
            placed.picture.name
        )
    })?;
    let mtf50 = mtf50_cy_px(&mtf.frequency_cy_px, &mtf.modulation);
    let mut plot = Plot::new(
        "Texture MTF",
        Axis::new("spatial frequency (cycles/px)", 0.0, MAX_CY_PX),
        Axis::new("MTF", 0.0, 1.05),
    );
    let points = |values: &[f64]| {
        std::iter::zip(&mtf.frequency_cy_px, values).map(|(f, m)| (*f, *m)).collect::<Vec<_>>()
    };
    plot.series.push(Series::distinct("by cross-correlation", points(&mtf.modulation), 0));
    plot.series.push(Series::distinct("by power, with noise", points(&mtf.by_power), 1));
    let remarks = match missed {
        0 => Vec::new(),
        n => {
            vec![format!("{n} of {tiles} tiles do not agree with the chart and are left out")]
        }
    };
    Ok(Section {
        slug: "texture",
        title: "Texture by dead leaves",
        standard: "after ISO 19567-2:2019, from published descriptions of it; cross-correlation with the chart, luminance in linear light",
        picture: placed.picture.name.clone(),
        camera: None,
        figures: vec![("texture MTF50 (cycles/px)".into(), shown(mtf50, 4))],
        remarks,
        plots: vec![plot.figure(args.style)],
        tables: Vec::new(),
        json: json!({
            "mtf50_cy_px": mtf50, "tiles": texture.tiles(), "tiles_missed": missed, "frequency_cy_px": mtf.frequency_cy_px,
            "modulation": mtf.modulation, "by_power": mtf.by_power,
        }),
    })
}

/// Fails unless the chart has the picture's scale and directions.
fn check_upright(placed: &Placed<'_>) -> Result<()> {
    let ((y0, x0), side) = (placed.middle(), 100.0);
    let at = |dy: f64, dx: f64| placed.at((y0 + dy, x0 + dx));
    let (origin, down, right) = (at(0.0, 0.0), at(side, 0.0), at(0.0, side));
    let unit = [
        (down.0 - origin.0) / side,
        (down.1 - origin.1) / side,
        (right.0 - origin.0) / side,
        (right.1 - origin.1) / side,
    ];
    let off = std::iter::zip(unit, [1.0, 0.0, 0.0, 1.0]).map(|(u, e)| (u - e).abs()).fold(0.0, f64::max);
    match off <= MAX_TILT {
        true => Ok(()),
        false => Err(usage(format!(
            "{}: dead leaves are measured where they are as large as on the chart's film and upright, found a map of {:.3} by {:.3} pixels a pixel, rotated by {:.2} deg; give the chart the size that it has in the picture",
            placed.picture.name,
            unit[0].hypot(unit[1]),
            unit[2].hypot(unit[3]),
            unit[2].atan2(unit[3]).to_degrees()
        ))),
    }
}

/// Corners of tiles that cover `rect` half over half, at most [`MAX_ALONG`] along a side.
fn tiles(rect: Rect) -> Vec<(i64, i64)> {
    let along = |first: i64, length: usize| -> Vec<i64> {
        let last = length.saturating_sub(TILE_PX);
        let count = if length < TILE_PX { 0 } else { (last / (TILE_PX / 2) + 1).min(MAX_ALONG) };
        (0..count).map(|k| first + (last * k).checked_div(count - 1).unwrap_or_default() as i64).collect()
    };
    let columns = along(rect.x, rect.width);
    along(rect.y, rect.height).into_iter().flat_map(|y| columns.iter().map(move |x| (y, *x))).collect()
}

/// Adds the tile of the picture at the place of the film tile at `corner`; whether it agrees with the chart.
fn add(placed: &Placed<'_>, texture: &mut Texture, corner: (i64, i64)) -> Result<bool> {
    let at = placed.at((corner.0 as f64, corner.1 as f64));
    let tile = Rect::new(at.0.round() as i64, at.1.round() as i64, TILE_PX, TILE_PX);
    if !placed.picture.size().rect().contains(tile) {
        return Ok(false);
    }
    let picture = placed.picture.luminance(tile)?;
    let margin = placed.chart.overscan_px() as i64;
    let (mut y, mut x) = corner;
    for _ in 0..TRIES {
        let from = Rect::new(y + margin, x + margin, TILE_PX, TILE_PX);
        let moved = (y - corner.0).abs().max((x - corner.1).abs());
        if !placed.chart.size().rect().contains(from) || moved > MAX_SHIFT_PX {
            return Ok(false);
        }
        let mut chart = vec![0.0; TILE_PX * TILE_PX];
        placed.chart.read(0, from, &mut chart).map_err(anyhow::Error::from_boxed)?;
        match texture.add(&chart, &picture) {
            Ok(()) => return Ok(true),
            Err(TileError::Displaced((down, right))) => (y, x) = (y - down, x - right),
            Err(TileError::Differs) => return Ok(false),
        }
    }
    Ok(false)
}
