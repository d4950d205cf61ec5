//! Limits of an error: a number (±), `[low, high]`, or a table of them and of their law.

use pipeline::design::tolerance::{Law, Limits};

use crate::toml_table::{Field, TableError};

/// Limits with the law of the description, or their own.
pub(super) fn limits(field: &Field<'_>, law: Law) -> Result<Limits, TableError> {
    match field.inner_table(&["limits", "law"])? {
        None => plain(field, law),
        Some(table) => {
            let law = table.field("law").map_or(Ok(law), |field| law_of(&field))?;
            plain(&table.required("limits", "[low, high] or a number")?, law)
        }
    }
}

fn plain(field: &Field<'_>, law: Law) -> Result<Limits, TableError> {
    if field.elements().is_some() {
        let [low, high] = field.pair("[low, high]")?;
        let limits = Limits { low: low.number()?, high: high.number()?, law };
        return match limits.low <= limits.high {
            true => Ok(limits),
            false => Err(field.error("the lower limit first")),
        };
    }
    let size =
        field.number().map_err(|_| field.error("a number (±), [low, high] or {limits = …, law = …}"))?;
    match size >= 0.0 {
        true => Ok(Limits::symmetric(size, law)),
        false => Err(field.error("a number that is not negative (it is ±), or [low, high]")),
    }
}

/// A law by its name.
pub(super) fn law_of(field: &Field<'_>) -> Result<Law, TableError> {
    field.word(&Law::ALL.map(|law| (law.name(), law)))
}
