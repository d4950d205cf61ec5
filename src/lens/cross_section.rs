//! Cross-section of a design with rays.

use super::curves::short_number;
use anyhow::Result;
use formats::picture::plot::{Axis, Plot, Series, Shape};
use formats::picture::style::Colour;
use pipeline::design::System;
use pipeline::design::describe::field_tan;
use pipeline::design::paraxial::Paraxial;
use pipeline::design::ray::Tracer;
use pipeline::design::system::Medium;

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
    let (mut rays, mut starts) = (Vec::new(), Vec::new());
    let mut radius: Vec<f64> =
        system.surfaces.iter().map(|s| s.aperture_mm.unwrap_or(s.semi_diameter_mm)).collect();
    for (i, tan) in picked.iter().enumerate() {
        let name = format!("{:.2} mm", tracer.chief_height_mm(*tan)?);
        for p in [-1.0, -0.5, 0.0, 0.5, 1.0] {
            if !tracer.passes(*tan, p, 0.0) {
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
    // Each surface up to its aperture radius, then flat up to the edge of the element.
    let outline = |i: usize, edge: f64| -> Vec<(f64, f64)> {
        let (shape, r) = (&system.surfaces[i].shape, radius[i]);
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
            let edge = radius[i].max(radius[i + 1]);
            let mut around = outline(i, edge);
            around.extend(outline(i + 1, edge).into_iter().rev());
            glass.push(Series::line("", around.clone(), Colour::Glass).shaped(Shape::Area));
            around.extend(around.first().copied());
            edges.push(line(around, Colour::Muted, 1.4));
        }
    }
    // A mirror from its hole to its rim.
    for i in (0..system.image()).filter(|i| system.surfaces[*i].is_mirror) {
        let hole = system.surfaces[i].obscuration_mm.unwrap_or(0.0);
        for side in [-1.0, 1.0] {
            let half = outline(i, radius[i]).into_iter().filter(|p| side * p.1 >= hole).collect();
            edges.push(line(half, Colour::Ink, 2.4));
        }
    }
    let max_mm = 1.06 * radius.iter().copied().chain(starts).fold(0.0, f64::max);
    let (stop, image) = (vertex(system.stop), vertex(system.image()));
    let open = primary.stop_radius_mm;
    for side in [-1.0, 1.0] {
        edges.push(line(vec![(stop, side * open), (stop, side * (open + 0.2 * max_mm))], Colour::Ink, 4.0));
    }
    let film = radius[system.image()];
    edges.push(line(vec![(image, -film), (image, film)], Colour::Ink, 3.0));
    let title =
        format!("{}: rays at {} nm by image height", system.name, short_number(system.primary_um() * 1e3));
    let x = Axis::new("z from the first surface (mm)", -before, last + 0.04 * (last - first));
    Ok(Plot {
        series: glass.into_iter().chain(rays).chain(edges).collect(),
        equal_scale: true,
        ..Plot::new(title, x, Axis::new("height (mm)", -max_mm, max_mm))
    })
}
