//! Tails of the bands of a pack: the group `tail`.

use super::{Arrays, PackArray};
use crate::lens::error::LensPackError;
use pipeline::bounds;
use pipeline::lens::middle::Middle;
use pipeline::lens::tail::{BandTail, ORDERS, TERMS};

/// Reads the tail of each band; none where its `inner_radius` is NaN. `has_middle`: some have a middle part.
pub(super) fn read(tables: &Arrays<'_>, has_middle: bool) -> Result<Vec<Option<BandTail>>, LensPackError> {
    let radius = PackArray::open(tables.store, "tail/inner_radius")?;
    radius.expect_shape(&[tables.bands], "bands")?;
    let radius = radius.read()?;
    let mut middles = match has_middle {
        true => middles(tables, &radius)?,
        false => vec![None; tables.bands],
    };
    let heights = tables.rows("tail/height", None)?;
    let array = PackArray::open(tables.store, "tail/coefficient")?;
    array.expect_shape(
        &[tables.bands, heights.width, ORDERS * TERMS],
        "bands, heights of tail/height, terms of all harmonics",
    )?;
    array.expect_at_most(&bounds::TABLE_NUMBERS)?;
    let values = array.read()?;
    let row = |b: usize, k: usize| {
        let at = |m: usize, j: usize| values[((b * heights.width + k) * ORDERS + m) * TERMS + j];
        std::array::from_fn(|m| std::array::from_fn(|j| at(m, j)))
    };
    let mut band = |b: usize| {
        let middle = middles[b].take();
        if radius[b].is_nan() {
            return Ok(None);
        }
        let height_mm = heights.numbers(b)?;
        let coefficients = (0..height_mm.len()).map(|k| row(b, k)).collect();
        // Checked with the other tables of the band.
        Ok(Some(BandTail { inner_mm: radius[b], height_mm, coefficients, middle }))
    };
    (0..tables.bands).map(&mut band).collect()
}

/// The middle parts of the bands that have one: those with a pitch. Their samples cover a square of twice the `radius`.
fn middles(tables: &Arrays<'_>, radius: &[f64]) -> Result<Vec<Option<Middle>>, LensPackError> {
    const PITCH: &str = "tail/middle_pitch";
    /// Largest relative difference of the square's side.
    const DIFFERENCE: f64 = 0.01;
    let pitch = PackArray::open(tables.store, PITCH)?;
    pitch.expect_shape(&[tables.bands], "bands")?;
    let of_band = |(b, pitch_mm): (usize, f64)| {
        if pitch_mm.is_nan() {
            return Ok(None);
        }
        let array = PackArray::open(tables.store, &format!("tail/middle/{b}"))?;
        let size = match array.shape[..] {
            [_, rows, columns] if rows == columns => rows as usize,
            _ => return Err(array.shape_error("[heights of tail/height, samples, as many samples]".into())),
        };
        array.expect_at_most(&bounds::TABLE_NUMBERS)?;
        let covers = size as f64 * pitch_mm / (2.0 * radius[b]);
        // Also false of a band without a radius.
        let fits = (covers - 1.0).abs() <= DIFFERENCE;
        if !fits {
            return Err(tables.value(
                PITCH,
                b,
                0,
                pitch_mm,
                "twice tail/inner_radius over the samples a side",
            ));
        }
        let read = array.read_as(|v| v as f32)?;
        if let Some(chunk) = read.missing {
            return Err(array.missing_chunk(chunk));
        }
        // Checked with the other tables of the band.
        Ok(Some(Middle { size, pitch_mm, samples: read.values.into() }))
    };
    pitch.read()?.into_iter().enumerate().map(of_band).collect()
}
