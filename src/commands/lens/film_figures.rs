//! `lens show --plot` of a pack without rotational symmetry: its map as arrows over the film, its PSFs at 3 × 3 places of the film, the places of its PSF
//! nodes, its errors; at the band nearest the primary wavelength.
//!
//! An arrow begins at a film place and shows the film place less its ideal point, less the boresight: distortion, tangential distortion and keystone
//! without the constant shift, magnified. Film frame: X right, Y DOWN; the axis upwards is −Y.

use super::film_lens::FilmLens;
use super::plots::EXTENSIONS;
use super::psf_sheet::{Labels, PsfSheet, Samples};
use crate::job::lens::samples::nearest_band;
use crate::outputs::check_absent_in;
use crate::progress::{log_line, short_number};
use anyhow::Result;
use formats::durable::{create_directories, finish_together};
use formats::lens::PackAttributes;
use formats::picture::figure::{Anchor, Figure, Stroke, Text};
use formats::picture::plot::{Axis, Plot, Series, Shape, WIDTH};
use formats::picture::style::{Colour, Style};
use pipeline::figures::on_film::BandOnFilm;
use pipeline::geometry::Size;
use pipeline::lens::LensBand;
use pipeline::lens::planar::PsfPlaces;
use pipeline::real;
use serde_json::Value;
use std::path::Path;

const MAP: &str = "map";
const PSF: &str = "psf";
const NODES: &str = "nodes";
const ERRORS: &str = "errors";
/// Names of all figures.
const FIGURES: [&str; 4] = [MAP, PSF, NODES, ERRORS];

/// Arrows and PSFs along each side of the film.
const ARROWS: usize = 15;
const PSFS: usize = 3;
/// The outermost places, of half a side.
const MARGIN: f64 = 0.95;
/// Most errors in the figure.
const MAX_BARS: usize = 60;

/// Fails (exit code 3) if [`write()`] would replace a file, unless `overwrite`.
///
/// # Errors
/// A figure exists.
pub fn check_absent(dir: &Path, overwrite: bool) -> Result<()> {
    check_absent_in(dir, all_files(), overwrite)
}

/// Names of all files that [`write()`] may write.
pub fn all_files() -> impl Iterator<Item = String> {
    FIGURES.iter().flat_map(|name| EXTENSIONS.map(|e| format!("{name}.{e}")))
}

/// Writes all figures of `lens` into `dir`; without recorded errors none of them.
///
/// # Errors
/// A PSF cannot be read; the disk.
pub fn write(dir: &Path, lens: &FilmLens, attributes: &PackAttributes, style: Style) -> Result<()> {
    create_directories(dir, true)?;
    let index = nearest_band(&lens.lens.bands, lens.lens.primary_wavelength_nm);
    let (band, name) = (&lens.lens.bands[index], &lens.lens.name);
    let mut figures = vec![
        (MAP, map(name, band).figure(style)),
        (PSF, psfs(name, lens, index, style)?),
        (NODES, nodes(name, band).figure(style)),
    ];
    let errors = attributes.errors.as_ref().map(drawn).unwrap_or_default();
    if !errors.is_empty() {
        figures.push((ERRORS, bars(name, &errors, style)));
    }
    let mut files = Vec::new();
    for (file, figure) in &figures {
        for extension in EXTENSIONS {
            files.push(figure.file(&dir.join(format!("{file}.{extension}")))?);
        }
    }
    finish_together(files)?;
    let names: Vec<&str> = figures.iter().map(|f| f.0).collect();
    log_line(format!("{}: SVG and PNG of {}", dir.display(), names.join(", ")));
    Ok(())
}

/// `count` places along a half side, from −[`MARGIN`] to [`MARGIN`] of it.
fn along(half_mm: f64, count: usize) -> impl Iterator<Item = f64> + Clone {
    (0..count).map(move |i| MARGIN * half_mm * (2.0 * i as f64 / (count - 1) as f64 - 1.0))
}

fn film_axes(half_mm: [f64; 2]) -> (Axis, Axis) {
    let [x, y] = half_mm;
    (Axis::new("X on the film (mm)", -x, x), Axis::new("−Y on the film (mm)", -y, y))
}

/// Arrows over the film.
fn map(name: &str, band: &LensBand) -> Plot {
    let film = BandOnFilm::new(band, band.psf_pitch_um);
    let half_mm = film.half_sides_mm();
    let boresight = film.place_of([0.0; 2]).unwrap_or([0.0; 2]);
    let mut shifts = Vec::with_capacity(ARROWS * ARROWS);
    for y in along(half_mm[1], ARROWS) {
        for x in along(half_mm[0], ARROWS) {
            let ([ideal_x, ideal_y], _) = film.at([x, y]);
            shifts.push(([x, y], [x - ideal_x - boresight[0], y - ideal_y - boresight[1]]));
        }
    }
    let longest = shifts.iter().map(|(_, [x, y])| real::hypot(*x, *y)).fold(0.0_f64, f64::max);
    let cell_mm = 2.0 * MARGIN * half_mm[0].min(half_mm[1]) / (ARROWS - 1) as f64;
    let factor = if longest > 0.0 { magnification(1.6 * cell_mm / longest) } else { 1.0 };
    let arrow = |(from, shift): &([f64; 2], [f64; 2])| {
        Series::line("", head(*from, shift.map(|v| factor * v)), Colour::Palette(0))
            .shaped(Shape::Line { width: 1.2, dash: 0 })
    };
    let mut series: Vec<Series> = shifts.iter().map(arrow).collect();
    let dots = shifts.iter().map(|(at, _)| (at[0], -at[1])).collect();
    series.push(Series::line("", dots, Colour::Muted).shaped(Shape::Dots(1.2)));
    let title = format!("{name}: shift beyond the boresight, {} nm", short_number(band.wavelength_nm));
    let (x, y) = film_axes(half_mm);
    let label = format!(
        "{}; arrows × {factor}, the longest {} µm; boresight ({:.2}, {:.2}) µm",
        x.label,
        short_number((1e5 * longest).round() / 1e2),
        1e3 * boresight[0],
        1e3 * boresight[1],
    );
    let x = Axis { label, ..x };
    Plot { series, equal_scale: true, ..Plot::new(title, x, y) }
}

/// The largest of 1, 2, 5, 10, 20, … that is not above `factor`.
fn magnification(factor: f64) -> f64 {
    let decade = 10_f64.powf(factor.log10().floor());
    let step = [5.0, 2.0, 1.0].into_iter().find(|step| step * decade <= factor * (1.0 + 1e-9));
    step.unwrap_or(1.0) * decade
}

/// An arrow from a film place along `by`, with its head, upwards −Y.
fn head([x, y]: [f64; 2], [dx, dy]: [f64; 2]) -> Vec<(f64, f64)> {
    let to = (x + dx, -(y + dy));
    // Barbs of 30 % of the length, at 25 degrees.
    let barb = |turn: f64| {
        let (sin, cos) = turn.sin_cos();
        (to.0 - 0.3 * (cos * dx - sin * dy), to.1 + 0.3 * (sin * dx + cos * dy))
    };
    vec![(x, -y), to, barb(0.44), to, barb(-0.44)]
}

/// The PSFs at 3 × 3 places of the film.
fn psfs(name: &str, lens: &FilmLens, index: usize, style: Style) -> Result<Figure> {
    let band = &lens.lens.bands[index];
    let pitch_um = band.psf_pitch_um;
    let film = BandOnFilm::new(band, pitch_um);
    let half_mm = film.half_sides_mm();
    let mut kernels = Vec::with_capacity(PSFS * PSFS);
    for y in along(half_mm[1], PSFS) {
        for x in along(half_mm[0], PSFS) {
            kernels.push(lens.kernel(index, &film, [x, y])?);
        }
    }
    let numbers = |half: f64| along(half, PSFS).map(|v| format!("{:.2}", v + 0.0)).collect();
    let sheet = PsfSheet {
        title: format!("{name}: PSF at {} nm", short_number(band.wavelength_nm)),
        columns: Labels { name: "X on the film (mm)", numbers: numbers(half_mm[0]) },
        rows: Labels { name: "Y on the film (mm), down", numbers: numbers(half_mm[1]) },
        psfs: kernels.iter().map(|(size, values)| Samples { size: *size, pitch_um, values }).collect(),
        note: ["about the point", "that the map gives, as on the film"],
    };
    Ok(sheet.figure(style))
}

/// Azimuths with PSFs and of nodes over the height, or the nodes of a grid over the film.
fn nodes(name: &str, band: &LensBand) -> Plot {
    let nm = short_number(band.wavelength_nm);
    let places = band.planar.as_ref().map(|planar| &planar.psfs);
    if let Some(PsfPlaces::Cartesian { x_mm, y_mm }) = places {
        let dots = y_mm.iter().flat_map(|y| x_mm.iter().map(move |x| (*x, -*y))).collect();
        let title = format!("{name}: {} × {} PSFs, {nm} nm", x_mm.len(), y_mm.len());
        let ends = |at: &[f64]| (at[0], at[at.len() - 1]);
        let ((left, right), (first, last)) = (ends(x_mm), ends(y_mm));
        return Plot {
            series: vec![Series::line("PSF", dots, Colour::Palette(0)).shaped(Shape::Dots(1.8))],
            equal_scale: true,
            ..Plot::new(
                title,
                Axis::new("X on the film (mm)", left, right),
                Axis::new("−Y on the film (mm)", -last, -first),
            )
        };
    }
    let azimuth_samples = match places {
        Some(PsfPlaces::Polar { azimuth_samples }) => &azimuth_samples[..],
        _ => &[],
    };
    let curve = |counts: &[usize]| {
        std::iter::zip(&band.psf_height_mm, counts).skip(1).map(|(h, n)| (*h, *n as f64)).collect::<Vec<_>>()
    };
    let title = format!(
        "{name}: {} PSFs for {} nodes, {nm} nm",
        azimuth_samples.iter().sum::<usize>(),
        band.azimuth_count.iter().sum::<usize>()
    );
    let (samples, nodes) = (curve(azimuth_samples), curve(&band.azimuth_count));
    let x = Axis::new("real image height (mm)", 0.0, 0.0);
    Plot {
        series: vec![
            Series::line("", samples.clone(), Colour::Palette(0)).shaped(Shape::Dots(2.4)),
            Series::line("PSFs", samples, Colour::Palette(0)),
            Series::line("nodes", nodes, Colour::Palette(4)).dashed(1),
        ],
        ..Plot::new(title, x, Axis::new("azimuths", 0.0, 0.0))
    }
}

/// A drawn error.
struct Drawn {
    id: String,
    unit: String,
    value: f64,
}

/// The values that a pack records, those of directions left out.
fn drawn(errors: &Value) -> Vec<Drawn> {
    let text = |row: &Value, key: &str| row[key].as_str().unwrap_or_default().to_owned();
    let one = |row: &Value| {
        let (id, unit, value) = (text(row, "id"), text(row, "unit"), row["value"].as_f64()?);
        (!id.is_empty() && !id.contains("_angle")).then_some(Drawn { id, unit, value })
    };
    errors["values"].as_array().into_iter().flatten().filter_map(one).collect()
}

/// A bar an error, over the largest of its unit.
fn bars(name: &str, errors: &[Drawn], style: Style) -> Figure {
    const ROW: f64 = 20.0;
    const TOP: f64 = 74.0;
    const LEFT: f64 = 270.0;
    const RIGHT: f64 = 140.0;
    let shown = &errors[..errors.len().min(MAX_BARS)];
    let bottom = TOP + ROW * shown.len() as f64;
    let middle = 0.5 * (LEFT + WIDTH as f64 - RIGHT);
    let half = middle - LEFT;
    let mut figure = Figure::new(Size::new((bottom + 30.0) as usize, WIDTH), style);
    let title = format!("{name}: errors drawn");
    let heading = Text::new((20.0, 21.0), Anchor::Start, &title);
    figure.text(Text { size: 17.0, max_width: WIDTH as f64 - 40.0, ..heading });
    let note = match errors.len() - shown.len() {
        0 => "each bar over the largest error of its unit".to_owned(),
        more => format!("each bar over the largest error of its unit; {more} more errors"),
    };
    figure.text(Text::new((20.0, 50.0), Anchor::Start, &note));
    for (row, error) in shown.iter().enumerate() {
        let y = TOP + ROW * row as f64;
        let of_unit = errors.iter().filter(|other| other.unit == error.unit);
        let largest = of_unit.map(|other| other.value.abs()).fold(0.0, f64::max);
        let label = Text::new((LEFT - 12.0, y + 0.5 * ROW), Anchor::End, &error.id);
        figure.text(Text { max_width: LEFT - 30.0, ..label });
        if largest > 0.0 {
            let end = middle + half * error.value / largest;
            let corners = [(middle, y + 4.0), (end, y + 4.0), (end, y + ROW - 4.0), (middle, y + ROW - 4.0)];
            figure.area(&corners, Colour::Palette(0));
        }
        let value = format!("{:+.4} {}", error.value, error.unit);
        let at = (WIDTH as f64 - RIGHT + 12.0, y + 0.5 * ROW);
        figure.text(Text { max_width: RIGHT - 20.0, ..Text::new(at, Anchor::Start, &value) });
    }
    let axis = Stroke { colour: Colour::Ink, width: 1.0, dash: 0 };
    figure.line(&[(middle, TOP - 4.0), (middle, bottom + 4.0)], axis);
    figure
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn arrows_are_magnified_by_round_numbers_and_point_along_the_shift() {
        assert_eq!([1.0, 4.9, 5.0, 99.0, 730.0, 0.3].map(magnification), [1.0, 2.0, 5.0, 50.0, 500.0, 0.2]);
        // Down on the film is down in the figure.
        let points = head([1.0, 2.0], [0.0, 0.5]);
        assert_eq!(points[..2], [(1.0, -2.0), (1.0, -2.5)]);
        assert!(points[2].1 > -2.5 && points[4].1 > -2.5 && points[2].0 != points[4].0);
    }

    #[test]
    fn errors_are_those_with_a_size() {
        let row = |id: &str, value: f64| json!({ "id": id, "unit": "um", "value": value });
        let values = [row("element 1-2/decentre", -3.0), row("element 1-2/decentre_angle", 1.0)];
        let errors = drawn(&json!({ "values": values }));
        assert_eq!(errors.len(), 1);
        assert_eq!((errors[0].id.as_str(), errors[0].value), ("element 1-2/decentre", -3.0));
        assert!(drawn(&json!("as measured")).is_empty());
    }
}
