//! `lenscube lens show --plot`: figures of a lens, each as SVG and PNG.
//!
//! RI, distortion and lateral colour against REAL height for the wavelengths shown; MTF against field and against frequency at
//! the primary wavelength (of the optics alone, light outside the PSF's window as veil); PSFs over field and wavelength;
//! the nodes of the film's kernels; of a design, its cross-section with rays.

use super::look::{Look, Subject};
use crate::progress::say;
use anyhow::Result;
use formats::durable::{create_directories, finish_together};
use formats::picture::bands::{band_key, band_series};
use formats::picture::figure::{Anchor, Figure, Text};
use formats::picture::image::Image;
use formats::picture::plot::{Axis, Plot, Series, Shape, colour_bar};
use formats::picture::style::{Colour, PALETTE, Style, inferno};
use pipeline::design::System;
use pipeline::design::describe::field_tan;
use pipeline::design::paraxial::Paraxial;
use pipeline::design::ray::Tracer;
use pipeline::design::system::Medium;
use pipeline::figures::{Direction, PsfWindow};
use pipeline::geometry::Size;
use pipeline::lens::LensBand;
use std::f64::consts::TAU;
use std::path::Path;

/// Points of a curve against height; heights traced for the MTF against field.
const POINTS: usize = 200;
const MTF_HEIGHTS: usize = 25;
/// Most wavelengths and heights of the PSFs shown.
const PSF_ROWS: usize = 6;
const PSF_COLUMNS: usize = 5;

/// Writes every figure that `subject` has data for into `dir`.
pub fn write(
    dir: &Path,
    subject: &Subject,
    nm: &[f64],
    at: &[f64],
    lp_mm: &[f64],
    style: Style,
) -> Result<()> {
    create_directories(dir, true)?;
    let look = subject.look(nm, at)?;
    let reach = at[at.len() - 1];
    let name = subject.name();
    let of_primary = nearest(&subject.wavelengths_nm(), subject.primary_nm());
    let heights: Vec<f64> = (0..MTF_HEIGHTS).map(|i| reach * i as f64 / (MTF_HEIGHTS - 1) as f64).collect();
    let dense = subject.look(&[of_primary], &heights)?;
    let fields = subject.look(&[of_primary], at)?;
    let illumination = Axis::new("relative illumination", 0.0, 1.05);
    let distortion = Axis::new("distortion (% of f tan θ)", 0.0, 0.0);
    let lateral = Axis::new("lateral colour (µm)", 0.0, 0.0);
    let focal = format!("distortion, f = {:.3} mm", look.lens.distortion_focal_length_mm);
    let reference = format!("lateral colour from {} nm", short(look.primary.wavelength_nm));
    let mut plots = vec![
        (
            "relative-illumination",
            against_height(
                &look,
                name,
                "relative illumination",
                illumination,
                reach,
                LensBand::illumination_of,
            ),
        ),
        ("distortion", against_height(&look, name, &focal, distortion, reach, LensBand::distortion_percent)),
        (
            "lateral-colour",
            against_height(&look, name, &reference, lateral, reach, |band, r| {
                band.lateral_colour_um(&look.primary, r)
            }),
        ),
        ("mtf-field", mtf_field(&dense, name, lp_mm)),
        ("mtf-frequency", mtf_frequency(&fields, name, lp_mm)),
        ("nodes", nodes(name, &subject.nodes(of_primary, reach)?)),
    ];
    if let Subject::Design(system, _) = subject {
        plots.push(("layout", layout(system)?));
    }
    let mut figures: Vec<_> = plots.iter().map(|(file, plot)| (*file, plot.figure(style))).collect();
    figures.push(("psf", psfs(&look, name, style)));
    let mut files = Vec::new();
    for (file, figure) in &figures {
        for ending in ["svg", "png"] {
            files.push(figure.file(&dir.join(format!("{file}.{ending}")))?);
        }
    }
    finish_together(files)?;
    let names: Vec<&str> = figures.iter().map(|f| f.0).collect();
    say(format!("{}: SVG and PNG of {}", dir.display(), names.join(", ")));
    Ok(())
}

fn nearest(all: &[f64], nm: f64) -> f64 {
    all.iter().copied().min_by(|a, b| (a - nm).abs().total_cmp(&(b - nm).abs())).unwrap_or(nm)
}

/// At most `most` of `count`, evenly chosen, the first and the last among them.
fn chosen(count: usize, most: usize) -> Vec<usize> {
    let shown = count.min(most);
    (0..shown).map(|i| (i * (count - 1) + (shown - 1) / 2) / (shown - 1).max(1)).collect()
}

fn height_axis() -> Axis {
    Axis::new("real image height (mm)", 0.0, 0.0)
}

/// A value of each band against height.
fn against_height(
    look: &Look,
    name: &str,
    what: &str,
    y: Axis,
    reach: f64,
    value: impl Fn(&LensBand, f64) -> f64,
) -> Plot {
    let bands = &look.lens.bands;
    let nm: Vec<f64> = bands.iter().map(|b| b.wavelength_nm).collect();
    let at = |i: usize| reach * i as f64 / (POINTS - 1) as f64;
    let points = |b: usize| (0..POINTS).map(|i| (at(i), value(&bands[b], at(i)))).collect();
    let series = (0..bands.len()).map(|b| band_series(&nm, b, points(b))).collect();
    Plot { series, key: band_key(&nm), ..Plot::new(format!("{name}: {what}"), height_axis(), y) }
}

/// At most four digits after the point, without zeros at the end.
fn short(v: f64) -> String {
    let text = format!("{v:.4}");
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

const DIRECTIONS: Option<[&str; 2]> = Some(["sagittal", "tangential"]);

/// The sagittal curve solid, the tangential one dashed, both with the `i`-th colour and marker.
fn both(curve: impl Fn(Direction) -> Vec<(f64, f64)>, name: &str, i: usize) -> [Series; 2] {
    [(Direction::Sagittal, 0), (Direction::Tangential, 1)].map(|(direction, dash)| {
        Series::line(name, curve(direction), Colour::Palette(i)).dashed(dash).marked(i)
    })
}

fn modulation() -> Axis {
    Axis::new("MTF", 0.0, 1.05)
}

fn mtf_field(look: &Look, name: &str, lp_mm: &[f64]) -> Plot {
    let fields = &look.fields[0];
    let series = lp_mm.iter().enumerate().flat_map(|(i, lp)| {
        let curve = |d| fields.iter().map(|f| (f.height_mm, f.psf.mtf(*lp, d))).collect();
        both(curve, &format!("{} lp/mm", short(*lp)), i)
    });
    let title = format!("{name}: MTF at {} nm", short(look.lens.bands[0].wavelength_nm));
    Plot { series: series.collect(), styles: DIRECTIONS, ..Plot::new(title, height_axis(), modulation()) }
}

fn mtf_frequency(look: &Look, name: &str, lp_mm: &[f64]) -> Plot {
    let most = 2.5 * lp_mm.iter().fold(0.0, |a: f64, b| a.max(*b));
    let fields = &look.fields[0];
    let series = chosen(fields.len(), PALETTE).into_iter().enumerate().flat_map(|(i, k)| {
        let at = |i: usize| most * i as f64 / (POINTS - 1) as f64;
        let curve = |d| (0..POINTS).map(|i| (at(i), fields[k].psf.mtf(at(i), d))).collect();
        both(curve, &format!("{:.2} mm", fields[k].height_mm), i)
    });
    let title = format!("{name}: MTF at {} nm by image height", short(look.lens.bands[0].wavelength_nm));
    let x = Axis::new("spatial frequency on the film (lp/mm)", 0.0, 0.0);
    Plot { series: series.collect(), styles: DIRECTIONS, ..Plot::new(title, x, modulation()) }
}

/// Side of a PSF, and the gap between two, px.
const CELL: usize = 112;
const GAP: usize = 6;

/// PSFs over field (to the right) and wavelength (down), all at one scale, with a colour bar.
fn psfs(look: &Look, name: &str, style: Style) -> Figure {
    let bands = chosen(look.fields.len(), PSF_ROWS);
    let heights = chosen(look.fields[0].len(), PSF_COLUMNS);
    let all = || bands.iter().flat_map(|&b| heights.iter().map(move |&k| &look.fields[b][k].psf));
    // Half of them fit well; a band far out of focus fills its square rather than shrinking the others to dots.
    let mut halves: Vec<f64> = all().map(half_width_um).collect();
    halves.sort_by(f64::total_cmp);
    let side_um = (3.0 * halves[halves.len() / 2] / 10.0).ceil() * 10.0;
    let (left, top) = (84, 92);
    let step = CELL + GAP;
    let (right, below) = (left + heights.len() * step, top + bands.len() * step);
    let size = Size::new(below + 64, (right + 110).max(560));
    let mut figure = Figure::new(size, style);
    let title = format!("{name}: PSF");
    let most = size.width as f64 - 32.0;
    figure.text(Text { size: 17.0, most, ..Text::new((16.0, 22.0), Anchor::Start, &title) });
    let middle = (left + (right - GAP)) as f64 / 2.0;
    figure.text(Text::new((middle, 54.0), Anchor::Middle, "real image height (mm)"));
    figure.text(Text {
        upwards: true,
        most: below as f64,
        ..Text::new((18.0, (top + below - GAP) as f64 / 2.0), Anchor::Middle, "wavelength (nm)")
    });
    for (column, &k) in heights.iter().enumerate() {
        let x = (left + column * step + CELL / 2) as f64;
        let number = format!("{:.2}", look.fields[0][k].height_mm);
        figure.text(Text::new((x, 78.0), Anchor::Middle, &number));
    }
    for (row, &b) in bands.iter().enumerate() {
        let y = top + row * step;
        let number = short(look.lens.bands[b].wavelength_nm);
        figure.text(Text::new((left as f64 - 10.0, (y + CELL / 2) as f64), Anchor::End, &number));
        for (column, &k) in heights.iter().enumerate() {
            let at = ((left + column * step) as f64, y as f64);
            figure.picture(at, &cell(&look.fields[b][k].psf, side_um), 1);
        }
    }
    // Brightness is the square root, so that faint light shows; the numbers stand where their roots do.
    let numbers = [0.0, 0.01, 0.05, 0.1, 0.2, 0.4, 0.6, 0.8, 1.0f64];
    let high = (below - GAP - top) as f64;
    let all: Vec<_> = numbers.iter().map(|v| (v.sqrt(), format!("{v}"))).collect();
    // One row has not the height for all of them.
    let shown: Vec<_> = if high < 200.0 { [0, 3, 5, 8].map(|i| all[i].clone()).into() } else { all };
    let bar = [right as f64 + 12.0, top as f64, 16.0, high];
    colour_bar(&mut figure, bar, "PSF / peak", &shown, inferno);
    for (row, words) in [
        format!("Each square: {side_um:.0} µm × {side_um:.0} µm about the chief ray,"),
        "the direction away from the axis to the right".into(),
    ]
    .iter()
    .enumerate()
    {
        let at = (left as f64, below as f64 + 16.0 + 22.0 * row as f64);
        figure.text(Text::new(at, Anchor::Start, words));
    }
    figure
}

/// Half the side of the centred square that holds 85 % of a window's light, µm.
fn half_width_um(psf: &PsfWindow) -> f64 {
    let (n, half) = (psf.size, psf.size / 2);
    let mut rings = vec![0.0; half + 1];
    for (i, &v) in psf.samples.iter().enumerate() {
        rings[(i / n).abs_diff(half).max((i % n).abs_diff(half))] += f64::from(v);
    }
    let mut held = 0.0;
    let inside = rings.iter().take_while(|r| {
        held += **r;
        held < 0.85
    });
    (inside.count() as f64 + 1.0) * psf.pitch_um
}

fn cell(psf: &PsfWindow, side_um: f64) -> Image {
    let peak = psf.samples.iter().fold(0.0f32, |a, &b| a.max(b));
    let half = (psf.size / 2) as f64;
    let sample = |i: usize| {
        let at = ((i as f64 + 0.5) / CELL as f64 - 0.5) * side_um / psf.pitch_um + half;
        (at.round() >= 0.0 && at.round() < psf.size as f64).then_some(at.round() as usize)
    };
    let mut image = Image::new(Size::new(CELL, CELL), inferno(0.0));
    for y in 0..CELL {
        let row = sample(y);
        for (x, pixel) in image.row_mut(y).iter_mut().enumerate() {
            if let (Some(row), Some(column)) = (row, sample(x)) {
                let v = psf.samples[row * psf.size + column].max(0.0) / peak;
                *pixel = inferno(f64::from(v.sqrt()));
            }
        }
    }
    image
}

/// Nodes of the primary band on the film.
fn nodes(name: &str, band: &LensBand) -> Plot {
    let reach = band.psf_height_mm[band.psf_height_mm.len() - 1];
    let circle = |r: f64, count: usize| {
        (0..count).map(move |j| (TAU * j as f64 / count as f64).sin_cos()).map(move |(s, c)| (r * c, r * s))
    };
    let mut edge: Vec<_> = circle(reach, 180).collect();
    edge.push(edge[0]);
    let places = std::iter::zip(&band.psf_height_mm, &band.azimuth_count);
    let dots = places.flat_map(|(&r, &count)| circle(r, count)).collect();
    let title = format!(
        "{name}: {} kernels at {} heights, {} nm",
        band.azimuth_count.iter().sum::<usize>(),
        band.psf_height_mm.len(),
        short(band.wavelength_nm)
    );
    let most = 1.04 * reach;
    Plot {
        series: vec![
            Series::line("edge of the field", edge, Colour::Muted),
            Series::line("kernel", dots, Colour::Palette(0)).shaped(Shape::Dots(1.3)),
        ],
        equal_scale: true,
        ..Plot::new(
            title,
            Axis::new("x on the film (mm)", -most, most),
            Axis::new("y on the film (mm)", -most, most),
        )
    }
}

/// The lens in section, with rays of up to three field points.
fn layout(system: &System) -> Result<Plot> {
    let primary = Paraxial::new(system, system.primary_um())?;
    let tracer = Tracer::new(system, system.primary_um())?;
    let before = 0.15 * primary.total_track_mm;
    let mut fields: Vec<f64> = system.fields.iter().map(|f| field_tan(system, &primary, *f).abs()).collect();
    fields.sort_by(f64::total_cmp);
    fields.dedup();
    let picked: Vec<f64> = match fields.len() {
        0..=3 => fields,
        n => vec![fields[0], fields[n / 2], fields[n - 1]],
    };
    let thick =
        |points, colour, width| Series::line("", points, colour).shaped(Shape::Line { width, dash: 0 });
    let (mut rays, mut starts) = (Vec::new(), Vec::new());
    let mut radius: Vec<f64> =
        system.surfaces.iter().map(|s| s.aperture_mm.unwrap_or(s.semi_diameter_mm)).collect();
    for (i, tan) in picked.iter().enumerate() {
        let name = format!("{:.2} mm", tracer.chief_height_mm(*tan)?);
        for p in [-1.0, -0.5, 0.0, 0.5, 1.0] {
            if tracer.overshoot(*tan, p, 0.0).0 > 0.0 {
                continue;
            }
            let path = tracer.path(*tan, p, before)?;
            for (r, (_, x)) in radius.iter_mut().zip(&path[1..]) {
                *r = r.max(x.abs());
            }
            starts.push(path[0].1.abs());
            let shape = Shape::Line { width: 1.2, dash: i };
            rays.push(Series::line(&name, path, Colour::Palette(2 * i)).shaped(shape));
        }
    }
    let (mut z, mut vertices) = (0.0, Vec::new());
    for s in &system.surfaces {
        vertices.push(z);
        z += s.thickness_mm;
    }
    // Each surface to its own radius, then flat to the element's.
    let outline = |i: usize, edge: f64| -> Vec<(f64, f64)> {
        let (shape, r) = (&system.surfaces[i].shape, radius[i]);
        let at = |k: i32| r * f64::from(k) / 24.0;
        let mut points: Vec<_> =
            (-24..=24).filter_map(|k| Some((vertices[i] + shape.sag_mm(at(k).abs())?, at(k)))).collect();
        if let (Some(low), Some(high)) = (points.first().copied(), points.last().copied()) {
            points.insert(0, (low.0, -edge));
            points.push((high.0, edge));
        }
        points
    };
    let (mut glass, mut edges) = (Vec::new(), Vec::new());
    for i in 0..system.image() {
        if matches!(system.surfaces[i].medium, Medium::Glass(_)) {
            let edge = radius[i].max(radius[i + 1]);
            let mut around = outline(i, edge);
            around.extend(outline(i + 1, edge).into_iter().rev());
            glass.push(Series::line("", around.clone(), Colour::Glass).shaped(Shape::Area));
            around.extend(around.first().copied());
            edges.push(thick(around, Colour::Muted, 1.4));
        }
    }
    let most = 1.06 * radius.iter().copied().chain(starts).fold(0.0, f64::max);
    let (stop, image) = (vertices[system.stop], vertices[system.image()]);
    let open = primary.stop_radius_mm;
    for side in [-1.0, 1.0] {
        edges.push(thick(vec![(stop, side * open), (stop, side * (open + 0.2 * most))], Colour::Ink, 4.0));
    }
    let film = radius[system.image()];
    edges.push(thick(vec![(image, -film), (image, film)], Colour::Ink, 3.0));
    let title = format!("{}: rays at {} nm by image height", system.name, short(system.primary_um() * 1e3));
    let x = Axis::new("z from the first surface (mm)", -before, image + 0.04 * primary.total_track_mm);
    Ok(Plot {
        series: glass.into_iter().chain(rays).chain(edges).collect(),
        equal_scale: true,
        ..Plot::new(title, x, Axis::new("height (mm)", -most, most))
    })
}
