//! Rows of an element, given to a sink that takes what it needs.

use super::super::context::Context;
use super::super::error::MeshError;
use super::super::shown::shown;
use super::header::{Element, Property};
use super::rows::{Problem, Rows};

/// Why a row cannot be read.
pub(super) enum Fault {
    /// To be completed by the place.
    Row(Problem),
    Mesh(MeshError),
}

impl From<Problem> for Fault {
    fn from(problem: Problem) -> Self {
        Self::Row(problem)
    }
}

impl From<MeshError> for Fault {
    fn from(error: MeshError) -> Self {
        Self::Mesh(error)
    }
}

/// A value that is not as expected.
pub(super) fn wrong(expected: impl Into<String>, found: impl Into<String>) -> Fault {
    Fault::Row(Problem::Wrong(expected.into(), found.into()))
}

/// Takes the properties of each row in turn.
pub(super) trait Sink {
    /// Takes property `index`; must read or skip it.
    fn property<R: Rows>(&mut self, index: usize, property: &Property, rows: &mut R) -> Result<(), Fault>;
    /// Ends a row.
    fn end(&mut self) -> Result<(), Fault> {
        Ok(())
    }
}

/// Skips all properties.
pub(super) struct Skip;

impl Sink for Skip {
    fn property<R: Rows>(&mut self, _index: usize, property: &Property, rows: &mut R) -> Result<(), Fault> {
        skip(property, rows)
    }
}

/// Skips a property.
pub(super) fn skip<R: Rows>(property: &Property, rows: &mut R) -> Result<(), Fault> {
    let count = if property.count.is_some() { list_length(property, rows)? } else { 1 };
    Ok(rows.skip(property.of, count)?)
}

/// The number of items of a list, which the rest of the file can hold; 1 without a list.
pub(super) fn list_length<R: Rows>(property: &Property, rows: &mut R) -> Result<u64, Fault> {
    let Some(count) = property.count else { return Ok(1) };
    let count = rows.number(count)?;
    let most = rows.numbers_left(property.of);
    match count >= 0.0 && count <= most as f64 {
        true => Ok(count as u64),
        false => {
            let name = shown(&property.name);
            Err(wrong(
                format!("a list {name} of 0 to {most} values, for which there is data"),
                format!("{count} values"),
            ))
        }
    }
}

/// Rows of the element, at most, for which the file has data.
pub(super) fn possible_rows<R: Rows>(element: &Element, rows: &R) -> u64 {
    let bytes = element.properties.iter().map(|p| p.count.unwrap_or(p.of).bytes() as u64).sum();
    element.rows.min(rows.rows_left(element.properties.len() as u64, bytes))
}

/// Reads all rows of an element.
///
/// # Errors
/// [`MeshError::Invalid`] with line or byte, row and element; also if there are fewer rows than declared.
pub(super) fn read<R: Rows>(
    context: &Context<'_>,
    element: &Element,
    rows: &mut R,
    sink: &mut impl Sink,
) -> Result<(), MeshError> {
    if element.properties.is_empty() {
        return Ok(());
    }
    let short = |row: u64| {
        let expected = format!("{} rows; is the file truncated?", element.rows);
        let found = format!("{row} complete rows before the end of the file");
        context.invalid(format!("element {}", shown(&element.name)), expected, found)
    };
    // Before rows are read, which may be those of another size.
    let possible = possible_rows(element, rows);
    if rows.is_fixed_size() && element.properties.iter().all(|p| p.count.is_none()) && possible < element.rows
    {
        return Err(short(possible));
    }
    for row in 0..element.rows {
        read_row(element, rows, sink).map_err(|fault| match fault {
            Fault::Mesh(error) => error,
            Fault::Row(Problem::Wrong(expected, found)) => {
                let place = format!("{}, row {row} of element {}", rows.place(), shown(&element.name));
                context.invalid(place, expected, found)
            }
            Fault::Row(Problem::End) => short(row),
        })?;
    }
    Ok(())
}

fn read_row<R: Rows>(element: &Element, rows: &mut R, sink: &mut impl Sink) -> Result<(), Fault> {
    rows.start()?;
    for (index, property) in element.properties.iter().enumerate() {
        sink.property(index, property, rows)?;
    }
    rows.end()?;
    sink.end()
}

/// A note on properties that are skipped: all but those at `used`.
pub(super) fn note_skipped(context: &Context<'_>, element: &Element, used: impl Fn(usize) -> bool) {
    let skipped = element.properties.iter().enumerate().filter(|(index, _)| !used(*index));
    let names: Vec<String> = skipped.map(|(_, p)| shown(&p.name)).take(6).collect();
    if !names.is_empty() {
        let more = if names.len() > 5 { " and others" } else { "" };
        let list = names[..names.len().min(5)].join(", ");
        context.note(format!("properties {list}{more} of element {} are ignored", shown(&element.name)));
    }
}
