//! `lens show --plot`: a lens in pictures, SVG, one a file.
//!
//! RI, distortion and lateral colour against REAL height for the wavelengths shown; MTF against field and against frequency at
//! the primary wavelength (of the optics alone, light outside the PSF's window as veil); PSFs over field and wavelength;
//! the nodes that the film's kernels hang on; of a design, its cross-section with rays.

use super::look::{Look, Subject};
use crate::progress::say;
use anyhow::Result;
use formats::durable::{WholeFile, create_directories, finish_together};
use formats::picture::drawing::{Drawing, Shape};
use formats::picture::figure::{Anchor, Figure, Mark};
use formats::picture::image::{Image, Rgb};
use formats::picture::plot::{COLOURS, Curve, Plot};
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
/// Most wavelengths in one plot: as many as there are colours apart from black.
const MOST: usize = COLOURS.len() - 1;
const HEIGHT: &str = "real image height (mm)";
const GLASS: Rgb = [222, 235, 247];
const DARK: Rgb = [60; 3];

/// Writes every plot that `subject` has data for into `dir`.
pub fn write(dir: &Path, subject: &Subject, nm: &[f64], at: &[f64], lp_mm: &[f64]) -> Result<()> {
    create_directories(dir, true)?;
    let look = subject.look(nm, at)?;
    let reach = at[at.len() - 1];
    let name = subject.name();
    let of_primary = nearest(&subject.wavelengths_nm(), subject.primary_nm());
    let heights: Vec<f64> = (0..MTF_HEIGHTS).map(|i| reach * i as f64 / (MTF_HEIGHTS - 1) as f64).collect();
    let dense = subject.look(&[of_primary], &heights)?;
    let fields = subject.look(&[of_primary], at)?;
    let mut figures = vec![
        (
            "relative-illumination",
            against_height(&look, name, "relative illumination", (1.0, 1.0), reach, |b, r| {
                b.illumination_of(r)
            }),
        ),
        (
            "distortion",
            against_height(&look, name, &distortion_label(&look), (0.0, 0.0), reach, |b, r| {
                b.distortion_percent(r)
            }),
        ),
        (
            "lateral-colour",
            against_height(
                &look,
                name,
                &format!("lateral colour from {} nm (µm)", look.primary.wavelength_nm),
                (0.0, 0.0),
                reach,
                |b, r| b.lateral_colour_um(&look.primary, r),
            ),
        ),
        ("mtf-field", mtf_field(&dense, name, lp_mm)),
        ("mtf-frequency", mtf_frequency(&fields, name, lp_mm)),
        ("psf", montage(&look, name)),
        ("nodes", nodes(name, &subject.nodes(of_primary, reach)?)),
    ];
    if let Subject::Design(system, _) = subject {
        figures.push(("layout", layout(system)?));
    }
    let whole = |(file, figure): &(&str, Figure)| {
        WholeFile::with_text(&dir.join(format!("{file}.svg")), &figure.to_svg())
    };
    finish_together(figures.iter().map(whole).collect::<Result<_, _>>()?)?;
    let names: Vec<&str> = figures.iter().map(|f| f.0).collect();
    say(format!("{}: {}.svg", dir.display(), names.join(".svg, ")));
    Ok(())
}

fn nearest(all: &[f64], nm: f64) -> f64 {
    all.iter().copied().min_by(|a, b| (a - nm).abs().total_cmp(&(b - nm).abs())).unwrap_or(nm)
}

fn distortion_label(look: &Look) -> String {
    format!("distortion (% of f tan w, f = {:.3} mm)", look.lens.distortion_focal_length_mm)
}

/// Evenly chosen bands, the first and the last among them.
fn chosen(bands: usize) -> Vec<usize> {
    let count = bands.min(MOST);
    (0..count).map(|i| (i * (bands - 1) + (count - 1) / 2) / (count - 1).max(1)).collect()
}

fn against_height(
    look: &Look,
    name: &str,
    y_label: &str,
    y_holds: (f64, f64),
    reach: f64,
    value: impl Fn(&LensBand, f64) -> f64,
) -> Figure {
    let bands = chosen(look.lens.bands.len());
    let curve = |(i, &b): (usize, &usize)| {
        let band = &look.lens.bands[b];
        let at = |i: usize| reach * i as f64 / (POINTS - 1) as f64;
        Curve {
            name: format!("{} nm", short(band.wavelength_nm)),
            points: (0..POINTS).map(|i| (at(i), value(band, at(i)))).collect(),
            colour: COLOURS[i * (MOST - 1) / (bands.len() - 1).max(1)],
            dashed: false,
        }
    };
    let what = y_label.split(" (").next().unwrap_or(y_label);
    Plot {
        title: format!("{name}: {what}"),
        x_label: HEIGHT.into(),
        y_label: y_label.to_owned(),
        y_holds,
        curves: bands.iter().enumerate().map(curve).collect(),
        styles: None,
    }
    .figure()
}

/// At most four digits after the point, none that say nothing.
fn short(v: f64) -> String {
    let text = format!("{v:.4}");
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

const STYLES: Option<[&str; 2]> = Some(["sagittal", "tangential"]);

fn both(curve: impl Fn(Direction) -> Vec<(f64, f64)>, name: &str, colour: Rgb) -> [Curve; 2] {
    [(Direction::Sagittal, false), (Direction::Tangential, true)].map(|(direction, dashed)| Curve {
        name: name.to_owned(),
        points: curve(direction),
        colour,
        dashed,
    })
}

fn mtf_field(look: &Look, name: &str, lp_mm: &[f64]) -> Figure {
    let fields = &look.fields[0];
    let curves = lp_mm.iter().enumerate().flat_map(|(i, lp)| {
        let curve = |d| fields.iter().map(|f| (f.height_mm, f.psf.mtf(*lp, d))).collect();
        both(curve, &format!("{} lp/mm", short(*lp)), COLOURS[2 * i % COLOURS.len()])
    });
    Plot {
        title: format!("{name}: MTF against field, {} nm", short(look.lens.bands[0].wavelength_nm)),
        x_label: HEIGHT.into(),
        y_label: "MTF".into(),
        y_holds: (0.0, 1.0),
        curves: curves.collect(),
        styles: STYLES,
    }
    .figure()
}

fn mtf_frequency(look: &Look, name: &str, lp_mm: &[f64]) -> Figure {
    let most = 2.5 * lp_mm.iter().fold(0.0, |a: f64, b| a.max(*b));
    let fields = &look.fields[0];
    let step = fields.len().div_ceil(COLOURS.len());
    let curves = fields.iter().step_by(step).enumerate().flat_map(|(i, f)| {
        let at = |i: usize| most * i as f64 / (POINTS - 1) as f64;
        let curve = |d| (0..POINTS).map(|i| (at(i), f.psf.mtf(at(i), d))).collect();
        both(curve, &format!("{:.2} mm", f.height_mm), COLOURS[i])
    });
    Plot {
        title: format!("{name}: MTF against frequency, {} nm", short(look.lens.bands[0].wavelength_nm)),
        x_label: "spatial frequency on the film (lp/mm)".into(),
        y_label: "MTF".into(),
        y_holds: (0.0, 1.0),
        curves: curves.collect(),
        styles: STYLES,
    }
    .figure()
}

/// Side of a PSF in the montage, and the gap between two, px.
const CELL: usize = 140;
const GAP: usize = 8;

/// PSFs over field (right) and wavelength (down), all at one scale.
fn montage(look: &Look, name: &str) -> Figure {
    let bands = chosen(look.fields.len());
    let heights: Vec<usize> = chosen(look.fields[0].len());
    let all = || bands.iter().flat_map(|&b| heights.iter().map(move |&k| &look.fields[b][k].psf));
    // Half of them fit well; a band far out of focus fills its square rather than shrinking the others to dots.
    let mut halves: Vec<f64> = all().map(half_width_um).collect();
    halves.sort_by(f64::total_cmp);
    let side_um = (3.0 * halves[halves.len() / 2] / 10.0).ceil() * 10.0;
    let (left, top) = (110, 92);
    let step = CELL + GAP;
    let size = Size::new(top + bands.len() * step + 70, (left + heights.len() * step + 20).max(760));
    let text = |at, text: String, anchor| Mark::Text { at, text, dot: 2, anchor, up: false, colour: [0; 3] };
    let mut marks = vec![text((16.0, 24.0), format!("{name}: PSF"), Anchor::Start)];
    for (column, &k) in heights.iter().enumerate() {
        let x = (left + column * step + CELL / 2) as f64;
        marks.push(text(
            (x, top as f64 - 20.0),
            format!("{:.2} mm", look.fields[0][k].height_mm),
            Anchor::Middle,
        ));
    }
    for (row, &b) in bands.iter().enumerate() {
        let y = top + row * step;
        let words = format!("{} nm", short(look.lens.bands[b].wavelength_nm));
        marks.push(text((left as f64 - 12.0, (y + CELL / 2) as f64), words, Anchor::End));
        for (column, &k) in heights.iter().enumerate() {
            let at = ((left + column * step) as f64, y as f64);
            marks.push(Mark::Picture { at, image: cell(&look.fields[b][k].psf, side_um), enlarge: 1 });
        }
    }
    let below = (top + bands.len() * step) as f64;
    let words = format!(
        "each square {side_um:.0} µm wide, chief ray in the middle, away from the axis to the right;"
    );
    marks.push(text((16.0, below + 18.0), words, Anchor::Start));
    marks.push(text(
        (16.0, below + 44.0),
        "brightness: square root of the PSF over its own peak".into(),
        Anchor::Start,
    ));
    Figure { size, marks }
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
    let mut image = Image::new(Size::new(CELL, CELL), [0; 3]);
    for y in 0..CELL {
        let row = sample(y);
        for (x, pixel) in image.row_mut(y).iter_mut().enumerate() {
            if let (Some(row), Some(column)) = (row, sample(x)) {
                let v = psf.samples[row * psf.size + column].max(0.0) / peak;
                *pixel = [(255.0 * v.sqrt()).round() as u8; 3];
            }
        }
    }
    image
}

/// Nodes of the primary band on the film.
fn nodes(name: &str, band: &LensBand) -> Figure {
    let reach = band.psf_height_mm[band.psf_height_mm.len() - 1];
    let circle = |r: f64| {
        (0..=180).map(move |i| (TAU * f64::from(i) / 180.0).sin_cos()).map(move |(s, c)| (r * c, r * s))
    };
    let mut shapes = vec![Shape::Line(circle(reach).collect(), 1.5, DARK)];
    for (&r, &count) in std::iter::zip(&band.psf_height_mm, &band.azimuth_count) {
        let dots = (0..count).map(|j| (TAU * j as f64 / count as f64).sin_cos()).map(|(s, c)| (r * c, r * s));
        shapes.push(Shape::Dots(dots.collect(), 1.4, COLOURS[0]));
    }
    let most = 1.04 * reach;
    Drawing {
        title: format!(
            "{name}: {} kernels at {} heights, {} nm",
            band.azimuth_count.iter().sum::<usize>(),
            band.psf_height_mm.len(),
            short(band.wavelength_nm)
        ),
        x_label: "X on the film (mm)".into(),
        y_label: "up on the film (mm)".into(),
        x: (-most, most),
        y: (-most, most),
        shapes,
        legend: vec![("kernel".into(), COLOURS[0]), ("field".into(), DARK)],
    }
    .figure()
}

/// The lens in section, with rays of up to three field points.
fn layout(system: &System) -> Result<Figure> {
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
    let (mut rays, mut legend, mut starts) = (Vec::new(), Vec::new(), Vec::new());
    let mut radius: Vec<f64> =
        system.surfaces.iter().map(|s| s.aperture_mm.unwrap_or(s.semi_diameter_mm)).collect();
    for (tan, colour) in picked.iter().zip([COLOURS[0], COLOURS[2], COLOURS[4]]) {
        for p in [-1.0, -0.5, 0.0, 0.5, 1.0] {
            if tracer.overshoot(*tan, p, 0.0).0 > 0.0 {
                continue;
            }
            let path = tracer.path(*tan, p, before)?;
            for (r, (_, x)) in radius.iter_mut().zip(&path[1..]) {
                *r = r.max(x.abs());
            }
            starts.push(path[0].1.abs());
            rays.push(Shape::Line(path, 1.3, colour));
        }
        legend.push((format!("{:.2} mm", tracer.chief_height_mm(*tan)?), colour));
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
            glass.push(Shape::Area(around.clone(), GLASS));
            around.extend(around.first().copied());
            edges.push(Shape::Line(around, 1.5, DARK));
        }
    }
    let most = 1.06 * radius.iter().copied().chain(starts).fold(0.0, f64::max);
    let (stop, image) = (vertices[system.stop], vertices[system.image()]);
    let open = primary.stop_radius_mm;
    for side in [-1.0, 1.0] {
        edges.push(Shape::Line(vec![(stop, side * open), (stop, side * (open + 0.2 * most))], 5.0, [0; 3]));
    }
    let film = radius[system.image()];
    edges.push(Shape::Line(vec![(image, -film), (image, film)], 3.0, [0; 3]));
    Ok(Drawing {
        title: format!("{}: section, rays at {} nm", system.name, short(system.primary_um() * 1e3)),
        x_label: "along the axis from the first surface (mm)".into(),
        y_label: "height (mm)".into(),
        x: (-before, image + 0.04 * primary.total_track_mm),
        y: (-most, most),
        shapes: glass.into_iter().chain(rays).chain(edges).collect(),
        legend,
    }
    .figure())
}
