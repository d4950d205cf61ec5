//! Cross-section of a design with rays.

use crate::progress::short_number;
use anyhow::Result;
use formats::picture::plot::{Axis, Plot, Series, Shape};
use formats::picture::style::Colour;
use pipeline::design::System;
use pipeline::design::describe::field_tan;
use pipeline::design::paraxial::Paraxial;
use pipeline::design::ray::Tracer;
use pipeline::design::system::Medium;

/// Height of the figure over the largest radius_mm of a surface or of the film.
const MARGIN: f64 = 1.2;
/// Rays from the centre of the pupil to its edge that are tried to find its open part.
const PUPIL_STEPS: i32 = 32;

/// The point on the segment from `end` to `start` that is farthest from `end` and not higher than `max_mm`.
fn within(start: (f64, f64), end: (f64, f64), max_mm: f64) -> (f64, f64) {
    if start.1.abs() <= max_mm {
        return start;
    }
    let t = (max_mm * start.1.signum() - end.1) / (start.1 - end.1);
    (end.0 + t * (start.0 - end.0), end.1 + t * (start.1 - end.1))
}

/// Five pupil coordinates over the part of the meridian that apertures leave open, without those behind an obscuration.
fn open_pupil(tracer: &Tracer<'_>, tan: f64) -> Vec<f64> {
    let passes = |p: &f64| tracer.passes(tan, *p, 0.0);
    let open: Vec<f64> =
        (-PUPIL_STEPS..=PUPIL_STEPS).map(|k| f64::from(k) / f64::from(PUPIL_STEPS)).filter(passes).collect();
    let (Some(first), Some(last)) = (open.first(), open.last()) else { return Vec::new() };
    (0..5).map(|k| first + (last - first) * f64::from(k) / 4.0).filter(passes).collect()
}

/// Cross-section with rays of up to three field points at the primary wavelength.
pub fn cross_section(system: &System) -> Result<Plot> {
    let primary = Paraxial::new(system, system.primary_um())?;
    let tracer = Tracer::new(system, system.primary_um())?;
    let axis = system.axis();
    let vertex = |i: usize| axis[i].0;
    let (first, last) = axis.iter().fold((0.0_f64, 0.0_f64), |(a, b), (z, _)| (a.min(*z), b.max(*z)));
    let before = 0.15 * (last - first) - first;
    let mut fields: Vec<f64> = system.fields.iter().map(|f| field_tan(system, &primary, *f).abs()).collect();
    fields.sort_by(f64::total_cmp);
    fields.dedup();
    let picked: Vec<f64> = match fields.len() {
        0..=3 => fields,
        n => vec![fields[0], fields[n / 2], fields[n - 1]],
    };
    let line =
        |points, colour, width| Series::line("", points, colour).shaped(Shape::Line { width, dash: 0 });
    let mut paths = Vec::new();
    let mut radius_mm: Vec<f64> =
        system.surfaces.iter().map(|s| s.aperture_mm.unwrap_or(s.semi_diameter_mm)).collect();
    for (i, tan) in picked.iter().enumerate() {
        let name = format!("image at {:.2} mm", tracer.chief_height_mm(*tan)?);
        for p in open_pupil(&tracer, *tan) {
            let path = tracer.path(*tan, p, before)?;
            for (r, (_, x)) in radius_mm.iter_mut().zip(&path[1..]) {
                *r = r.max(x.abs());
            }
            paths.push((i, name.clone(), path));
        }
    }
    let max_mm = MARGIN * radius_mm.iter().copied().fold(0.0, f64::max);
    let ray = |(i, name, mut path): (usize, String, Vec<(f64, f64)>)| {
        path[0] = within(path[0], path[1], 0.96 * max_mm);
        Series::line(name, path, Colour::Palette(2 * i)).shaped(Shape::Line { width: 1.2, dash: i })
    };
    let rays: Vec<_> = paths.into_iter().map(ray).collect();
    // Each surface up to its aperture radius, then flat up to the edge of the element.
    let outline = |i: usize, edge: f64| -> Vec<(f64, f64)> {
        let (shape, r) = (&system.surfaces[i].shape, radius_mm[i]);
        let at = |k: i32| r * f64::from(k) / 24.0;
        let place = |k: i32| Some((vertex(i) + axis[i].1 * shape.sag_mm(at(k).abs())?, at(k)));
        let mut points: Vec<_> = (-24..=24).filter_map(place).collect();
        if let (Some(low), Some(high)) = (points.first().copied(), points.last().copied()) {
            points.insert(0, (low.0, -edge));
            points.push((high.0, edge));
        }
        points
    };
    let (mut glass, mut edges) = (Vec::new(), Vec::new());
    for i in 0..system.image() {
        if matches!(system.surfaces[i].medium, Medium::Glass(_)) {
            let edge = radius_mm[i].max(radius_mm[i + 1]);
            // Around the hole of a mirror there are two halves.
            let hole = [i, i + 1].into_iter().filter(|k| system.surfaces[*k].is_mirror);
            let hole = hole.filter_map(|k| system.surfaces[k].obscuration_mm).fold(0.0, f64::max);
            let sides: &[f64] = if hole > 0.0 { &[-1.0, 1.0] } else { &[0.0] };
            for side in sides {
                let part =
                    |i: usize| outline(i, edge).into_iter().filter(|p| side * p.1 >= side * side * hole);
                let mut around: Vec<_> = part(i).collect();
                around.extend(part(i + 1).collect::<Vec<_>>().into_iter().rev());
                glass.push(Series::line("", around.clone(), Colour::Glass).shaped(Shape::Area));
                around.extend(around.first().copied());
                edges.push(line(around, Colour::Muted, 1.4));
            }
        }
    }
    for i in (0..system.image()).filter(|i| system.surfaces[*i].ideal_focal_mm.is_some()) {
        edges.push(line(outline(i, radius_mm[i]), Colour::Muted, 2.4));
    }
    // A mirror from its hole to its rim.
    for i in (0..system.image()).filter(|i| system.surfaces[*i].is_mirror) {
        let hole = system.surfaces[i].obscuration_mm.unwrap_or(0.0);
        for side in [-1.0, 1.0] {
            let half = outline(i, radius_mm[i]).into_iter().filter(|p| side * p.1 >= hole).collect();
            edges.push(line(half, Colour::Ink, 2.4));
        }
    }
    let (stop, image) = (vertex(system.stop), vertex(system.image()));
    let open = primary.stop_radius_mm;
    for side in [-1.0, 1.0] {
        edges.push(line(vec![(stop, side * open), (stop, side * (open + 0.2 * max_mm))], Colour::Ink, 4.0));
    }
    let film = radius_mm[system.image()];
    edges.push(line(vec![(image, -film), (image, film)], Colour::Ink, 3.0));
    let nm = short_number((system.primary_um() * 1e4).round() / 10.0);
    let title = format!("{}: rays at {nm} nm", system.name);
    let x = Axis::new("z from the first surface (mm)", -before, last + 0.04 * (last - first));
    Ok(Plot {
        series: glass.into_iter().chain(rays).chain(edges).collect(),
        equal_scale: true,
        ..Plot::new(title, x, Axis::new("height (mm)", -max_mm, max_mm))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use formats::design::builtin::LENSES;

    #[test]
    fn rays_of_a_fisheye_start_within_the_figure() {
        let fisheye = LENSES.iter().find(|l| l.name == "fisheye-170").unwrap().system();
        let plot = cross_section(&fisheye).unwrap();
        let largest = fisheye.surfaces.iter().map(|s| s.semi_diameter_mm).fold(0.0, f64::max);
        let heights = plot.series.iter().flat_map(|s| &s.points).map(|p| p.1.abs());
        assert!(heights.fold(0.0, f64::max) < 2.0 * largest.max(54.0));
        assert_eq!(within((-10.0, 5.0), (0.0, 1.0), 3.0), (-5.0, 3.0));
        assert_eq!(within((-10.0, -2.0), (0.0, 1.0), 3.0), (-10.0, -2.0));
    }
}
