//! Lens tables as CSV: how patents and books print lenses.
//!
//! ```text
//! name, A triplet                              settings, before the header row: a name and its values
//! f-number, 4.5
//! field deg, 0, 14, 20
//! wavelengths nm, 486.1, 587.6, 656.3
//! surface, radius, thickness, glass, semi-diameter, conic, a4
//! 1, 22.01359, 3.25896, SK16, 6.5
//! stop, inf, 4.75041
//! 6, -18.3956
//! ```
//!
//! Settings and columns in any order (modules `settings`, `columns`); separated by commas, semicolons or tabs; numbers of tables with another
//! separator may have decimal commas. `#` begins a comment. A glass is a name, a glass code, or n and V of the d line; air is empty. A row whose first
//! cell says *stop* is the stop, *object* and *image* are the ends and may be missing. Without a last thickness the film is at the paraxial focus.
//! A semi-diameter is drawn and does not clip; an *aperture radius* clips, an *obscuration radius* blocks the light within.
//! A *mirror* for a glass reflects; thicknesses behind an odd number of mirrors are negative, as design programs write them. Rays are aimed at the real stop unless `aiming, paraxial`.

mod columns;
mod line;
mod row;
mod settings;
mod units;
mod write;

use super::draft::Draft;
use super::error::LensFileError;
use super::options::ReadOptions;
use super::text::decode;
use columns::Columns;
use line::Line;
use pipeline::design::glass_library::GlassLibrary;
use pipeline::design::paraxial::Paraxial;
use pipeline::design::system::{ImagePlane, RayAiming, System};
use settings::Settings;

pub use write::write;

/// Maximum difference between a printed and the computed focal length without a note.
const FOCAL_LENGTH_TOLERANCE: f64 = 0.01;

/// Cells of a line; a quoted cell may hold separators.
fn split(line: &str, separator: char) -> Vec<String> {
    let (mut cells, mut cell, mut is_quoted) = (Vec::new(), String::new(), false);
    for c in line.chars() {
        match c {
            '"' => is_quoted = !is_quoted,
            c if c == separator && !is_quoted => cells.push(std::mem::take(&mut cell).trim().to_owned()),
            c => cell.push(c),
        }
    }
    cells.push(cell.trim().to_owned());
    cells
}

/// The separator of the header row, and that row's index; the header row has a radius (or curvature) and a thickness.
fn header(lines: &[&str]) -> Option<(usize, char)> {
    let found = lines.iter().enumerate().find_map(|(i, line)| {
        let separator = [';', '\t', ','].into_iter().find(|s| columns::is_header(&split(line, *s)))?;
        Some((i, separator))
    });
    found.filter(|_| !lines.is_empty())
}

/// The glass catalogues that a table names, in its order.
pub fn catalogues(bytes: &[u8]) -> Vec<String> {
    let text = decode(bytes);
    let lines: Vec<&str> = text.lines().collect();
    let Some((last, separator)) = header(&lines) else { return Vec::new() };
    let cells = lines[..last].iter().map(|line| split(line, separator));
    let named = cells.filter(|cells| settings::is_catalogues(&cells[0]));
    named.flat_map(|cells| cells.into_iter().skip(1)).filter(|name| !name.is_empty()).collect()
}

/// Reads a lens.
///
/// # Errors
/// [`LensFileError::Line`] for a line that is wrong or not supported; [`LensFileError::Incomplete`] for a missing part.
pub fn parse(bytes: &[u8], glasses: &GlassLibrary, options: &ReadOptions) -> Result<System, LensFileError> {
    options.only_one_configuration()?;
    let text = decode(bytes);
    let lines: Vec<&str> = text.lines().collect();
    let Some((header_row, separator)) = header(&lines) else {
        let problem = "has no header row with a radius (or curvature) and a thickness: is it a lens table?";
        return Err(LensFileError::Incomplete { problem: problem.to_owned() });
    };
    let is_blank = |line: &str| line.trim().is_empty() || line.trim_start().starts_with('#');
    let split_line = |i: usize| Line {
        number: i + 1,
        text: lines[i],
        cells: split(lines[i], separator),
        has_decimal_commas: separator != ',',
    };
    let mut settings = Settings::default();
    for line in (0..header_row).filter(|i| !is_blank(lines[*i])).map(split_line) {
        settings.read(&line, options.strict)?;
    }
    // A line with the unit may follow the settings that it holds for.
    for line in (0..header_row).filter(|i| !is_blank(lines[*i])).map(split_line) {
        settings.check_unit(&line)?;
    }
    let columns = Columns::new(&split_line(header_row), settings.scale(), options.strict)?;
    let mut draft = Draft { aiming: Some(RayAiming::Real), ..Draft::default() };
    draft.notes.extend(columns.notes.iter().cloned());
    let mut table = row::Table::new(&columns, settings.scale(), glasses, settings.catalogues.clone());
    for line in (header_row + 1..lines.len()).filter(|i| !is_blank(lines[*i])).map(split_line) {
        table.read(&line, &mut draft)?;
    }
    let is_open = table.finish(&mut draft, settings.object_distance()?)?;
    let printed_mm = settings.focal_length_mm();
    settings.finish(&mut draft)?;
    let mut system = draft.finish()?;
    if is_open {
        system = system.with_image_plane(ImagePlane::Paraxial(system.primary_um()), 0.0)?;
        system.notes.push("no last thickness given: the film is at the paraxial focus".to_owned());
    }
    if let Some(printed) = printed_mm {
        let computed = Paraxial::new(&system, system.primary_um())?.effective_focal_length_mm;
        if (computed - printed).abs() > FOCAL_LENGTH_TOLERANCE * printed.abs() {
            system.notes.push(format!(
                "the table's focal length is {printed} mm, that of its surfaces {computed:.4} mm"
            ));
        }
    }
    Ok(system)
}

#[cfg(test)]
mod tests;
