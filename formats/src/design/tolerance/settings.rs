//! What a description says of adjustments and of the criterion.

use pipeline::design::tolerance::{Boresight, Compensation, Criterion, CriterionFields, CriterionKind};

use crate::toml_table::{Entry, Field, TableError};

/// Most places of a criterion.
const MAX_PLACES: usize = 1000;

pub(super) const COMPENSATE: &[&str] = &["focus_um", "focus", "film_tilt", "boresight"];
pub(super) const CRITERION: &[&str] = &["kind", "frequency_per_mm", "fields"];

pub(super) fn compensation(entry: &Entry<'_>) -> Result<Compensation, TableError> {
    let mut found = Compensation::default();
    if let Some(field) = entry.field("focus_um") {
        let expected = "[low, high] in µm, the lower one first";
        let [low, high] = field.pair(expected)?;
        let (low, high) = (low.number()?, high.number()?);
        if low > high {
            return Err(field.error(expected));
        }
        found.focus_um = Some((low, high));
    }
    if let Some(field) = entry.field("focus")
        && !field.boolean()?
    {
        if entry.field("focus_um").is_some() {
            return Err(field.error("true, or no focus_um"));
        }
        found.focus_um = None;
    }
    if let Some(field) = entry.field("film_tilt") {
        found.film_tilt = field.boolean()?;
    }
    if let Some(field) = entry.field("boresight") {
        found.boresight = field.word(&[("keep", Boresight::Keep), ("remove", Boresight::Remove)])?;
    }
    Ok(found)
}

pub(super) fn criterion(entry: &Entry<'_>) -> Result<Criterion, TableError> {
    let mut found = Criterion::default();
    if let Some(field) = entry.field("kind") {
        found.kind = field.word(&[
            ("mtf", found.kind),
            ("rms-spot", CriterionKind::RmsSpot),
            ("rms-wavefront", CriterionKind::RmsWavefront),
        ])?;
    }
    if let Some(field) = entry.field("frequency_per_mm") {
        let CriterionKind::Mtf { frequency_per_mm } = &mut found.kind else {
            return Err(field.error("none: only kind = \"mtf\" has a frequency"));
        };
        *frequency_per_mm = field.number()?;
        if *frequency_per_mm <= 0.0 {
            return Err(field.error("a number above 0"));
        }
    }
    if let Some(field) = entry.field("fields") {
        found.fields = match field.elements() {
            None => field
                .word(&[("film", ())])
                .map(|()| CriterionFields::Film)
                .map_err(|_| field.error("\"film\" or a list of [x_mm, y_mm]"))?,
            Some(places) if (1..=MAX_PLACES).contains(&places.len()) => {
                CriterionFields::Places(places.iter().map(place).collect::<Result<_, _>>()?)
            }
            Some(_) => return Err(field.error(format!("1 to {MAX_PLACES} places"))),
        };
    }
    Ok(found)
}

fn place(field: &Field<'_>) -> Result<[f64; 2], TableError> {
    let [x, y] = field.pair("[x_mm, y_mm]")?;
    Ok([x.number()?, y.number()?])
}
