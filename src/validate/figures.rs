//! The report's pictures, as SVG.

use super::distortion::Point;
use super::ri::DIRECTIONS;
use super::{Band, Setup};
use formats::picture::curve::ink;
use formats::picture::figure::{Anchor, Figure, Mark};
use formats::picture::plot::{COLOURS, Curve, Plot};
use pipeline::geometry::Size;
use pipeline::measure::sfr::{Mtf, line_spread};

/// Edges are shown to this distance in overlays of bands whose windows differ.
const NEAR_PX: f64 = 50.0;
/// MTFs are shown to here, cycles per px: past the film's Nyquist frequency they are aliases.
const SHOWN_CY_PX: f64 = 0.6;
/// Most names in a legend of bands.
const NAMES: usize = 8;
/// Film and lens.
const STYLES: Option<[&str; 2]> = Some(["film", "lens"]);
const GREY: [u8; 3] = [120; 3];

fn curve(name: String, points: Vec<(f64, f64)>, colour: [u8; 3], dashed: bool) -> Curve {
    Curve { name, points, colour, dashed }
}

fn svg(title: &str, x: &str, y: &str, holds: (f64, f64), curves: Vec<Curve>) -> String {
    let both = curves.iter().any(|c| c.dashed) && curves.iter().any(|c| !c.dashed);
    let plot = Plot {
        title: title.into(),
        x_label: x.into(),
        y_label: y.into(),
        y_holds: holds,
        curves,
        styles: STYLES.filter(|_| both),
    };
    plot.figure().to_svg()
}

/// The legend's name of band `i`: of many bands only some are named.
fn name(bands: &[Band], i: usize) -> String {
    let every = bands.len().div_ceil(NAMES).max(1);
    if i.is_multiple_of(every) || i + 1 == bands.len() {
        format!("{} nm", bands[i].nm)
    } else {
        String::new()
    }
}

/// Two curves a band, film solid and lens dashed.
fn overlay(bands: &[Band], of: impl Fn(&Band, bool) -> Vec<(f64, f64)>) -> Vec<Curve> {
    let one = |i: usize, dashed: bool| curve(name(bands, i), of(&bands[i], dashed), ink(bands[i].nm), dashed);
    (0..bands.len()).flat_map(|i| [one(i, false), one(i, true)]).collect()
}

/// R over height to the lower right corner, film and lens, and their difference everywhere.
pub fn illumination(bands: &[Band]) -> Vec<String> {
    let value = |b: &Band, lens: bool| {
        let diagonal = b.illumination.bins.iter().filter(|b| b.direction + 1 == DIRECTIONS.len());
        diagonal.map(|b| (b.height_mm, if lens { b.lens } else { b.film })).collect()
    };
    let shown = &bands[bands.len() / 2];
    let difference = DIRECTIONS.iter().enumerate().map(|(d, name)| {
        let here = shown.illumination.bins.iter().filter(|b| b.direction == d);
        let points = here.map(|b| (b.height_mm, 1e6 * (b.film - b.lens))).collect();
        curve((*name).into(), points, COLOURS[d], false)
    });
    let difference = difference.collect();
    vec![
        svg(
            "Relative illumination to the lower right corner",
            "real image height (mm)",
            "R",
            (1.0, 1.0),
            overlay(bands, value),
        ),
        svg(
            &format!("Film - lens by direction, {} nm", shown.nm),
            "real image height (mm)",
            "difference of R (1e-6)",
            (0.0, 0.0),
            difference,
        ),
    ]
}

/// The film's departure from R with the PSF on.
pub fn departure(bands: &[Band]) -> String {
    let value = |b: &Band, lens: bool| {
        let all = b.illumination.departures.iter();
        all.map(|d| (d.height_mm, 1e3 * if lens { d.lens } else { d.film })).collect()
    };
    svg(
        "Uniform chart through the PSF: film / R - 1",
        "real image height (mm)",
        "departure (1e-3)",
        (0.0, 0.0),
        overlay(bands, value),
    )
}

/// The round number below `v`: 1, 2 or 5 times a power of ten.
fn round(v: f64) -> f64 {
    let ten = 10f64.powf(v.log10().floor());
    [5.0, 2.0, 1.0].map(|k| k * ten).into_iter().find(|r| *r <= v * (1.0 + 1e-9)).unwrap_or(ten)
}

/// A square of the film with a vector at each point, `factor` times as long as it is.
fn vectors(setup: &Setup, title: &str, points: &[Point], lens: bool) -> String {
    let of = |p: &Point| match lens {
        true => (p.lens_px.0 - p.chart_px.0, p.lens_px.1 - p.chart_px.1),
        false => p.error_px(),
    };
    let most = points.iter().map(|p| of(p).0.hypot(of(p).1)).fold(1e-12, f64::max);
    let factor = round(0.1 * setup.size as f64 / most);
    let (side, left, top) = (480.0, 60.0, 64.0);
    let scale = side / setup.size as f64;
    let place = |(y, x): (f64, f64)| (left + (x + 0.5) * scale, top + (y + 0.5) * scale);
    let text =
        |at, text: String| Mark::Text { at, text, dot: 2, anchor: Anchor::Start, up: false, colour: [0; 3] };
    let frame = [(0.0, 0.0), (0.0, side), (side, side), (side, 0.0), (0.0, 0.0)];
    let frame = frame.map(|(y, x)| (left + x, top + y)).to_vec();
    let mut marks =
        vec![text((left, 32.0), title.to_owned()), Mark::Line { points: frame, width: 1.0, colour: [0; 3] }];
    for p in points {
        let from = if lens { p.chart_px } else { p.lens_px };
        let by = |(y, x): (f64, f64)| place((from.0 + factor * y, from.1 + factor * x));
        marks.push(Mark::Dot { at: place(from), radius: 2.5, colour: GREY });
        marks.push(Mark::Line { points: vec![place(from), by(of(p))], width: 2.0, colour: COLOURS[0] });
        if lens {
            let film = (p.film_px.0 - p.chart_px.0, p.film_px.1 - p.chart_px.1);
            marks.push(Mark::Dot { at: by(film), radius: 3.5, colour: COLOURS[4] });
        }
    }
    let longest = if most < 0.1 { format!("{most:.1e}") } else { format!("{most:.1}") };
    marks.push(text((left, top + side + 28.0), format!("{factor} x exaggerated; longest {longest} px")));
    Figure { size: Size::new(600, 600), marks }.to_svg()
}

/// Displacements and errors of the points of one band.
pub fn distortion(setup: &Setup, band: &Band) -> Vec<String> {
    vec![
        vectors(
            setup,
            &format!("Displacement at {} nm: lens (line), film (dot)", band.nm),
            &band.points,
            true,
        ),
        vectors(setup, &format!("Error, film - lens, at {} nm", band.nm), &band.points, false),
    ]
}

fn esf(samples: &[(f64, f64, f64)], most_px: f64, lens: bool) -> Vec<(f64, f64)> {
    let near = samples.iter().filter(|s| s.0.abs() <= most_px);
    near.map(|s| (s.0, if lens { s.2 } else { s.1 })).collect()
}

fn mtf(mtf: &Mtf) -> Vec<(f64, f64)> {
    let all = mtf.frequency_cy_px.iter().copied().zip(mtf.modulation.iter().copied());
    all.take_while(|p| p.0 <= SHOWN_CY_PX).collect()
}

/// A mark at the film's Nyquist frequency, and one where each of `all` falls to 1/2.
fn marks<'a>(all: impl Iterator<Item = (&'a Mtf, [u8; 3])>) -> Vec<Curve> {
    let mut marks = vec![curve("Nyquist".into(), vec![(0.5, 0.0), (0.5, 1.0)], GREY, false)];
    marks.extend(all.filter_map(|(m, colour)| {
        let f = m.mtf50_cy_px()?;
        Some(curve(String::new(), vec![(f, 0.44), (f, 0.56)], colour, false))
    }));
    marks
}

const ACROSS: &str = "distance from the edge (px)";
const FREQUENCY: &str = "frequency (cycles/px); ticks: MTF50";

/// ESF and MTF of all bands at edge `k`.
pub fn edge_overlays(bands: &[Band], k: usize, title: &str) -> Vec<String> {
    let spread = |b: &Band, lens: bool| esf(&b.edges[k].samples, NEAR_PX, lens);
    let transfer = |b: &Band, lens: bool| {
        let e = &b.edges[k];
        mtf(if lens { &e.lens_mtf } else { &e.film_mtf })
    };
    let mut transfers = overlay(bands, transfer);
    transfers.extend(marks(bands.iter().map(|b| (&b.edges[k].film_mtf, ink(b.nm)))));
    vec![
        svg(&format!("ESF, {title}"), ACROSS, "edge spread", (0.0, 1.0), overlay(bands, spread)),
        svg(&format!("MTF, {title}"), FREQUENCY, "modulation", (0.0, 1.0), transfers),
    ]
}

/// ESF, LSF, their difference and MTF of all edges in one band.
pub fn band_edges(band: &Band) -> Vec<String> {
    // As short as a legend.
    let titles: Vec<String> =
        band.edges.iter().map(|e| format!("{}, {}.", e.place.name, &e.place.direction[..3])).collect();
    let both = |of: &dyn Fn(usize, bool) -> Vec<(f64, f64)>| -> Vec<Curve> {
        let one = |k: usize, dashed: bool| curve(titles[k].clone(), of(k, dashed), COLOURS[k], dashed);
        (0..titles.len()).flat_map(|k| [one(k, false), one(k, true)]).collect()
    };
    let samples = |k: usize| &band.edges[k].samples;
    let lsf = |k: usize, lens: bool| {
        let values: Vec<f64> = samples(k).iter().map(|s| if lens { s.2 } else { s.1 }).collect();
        let places = samples(k).iter().map(|s| s.0);
        places.zip(line_spread(&values)).filter(|p| p.0.abs() <= band.edges[k].half_px).collect()
    };
    let transfer = |k: usize, lens: bool| {
        let e = &band.edges[k];
        mtf(if lens { &e.lens_mtf } else { &e.film_mtf })
    };
    let difference = (0..titles.len()).map(|k| {
        let inside = samples(k).iter().filter(|s| s.0.abs() <= band.edges[k].half_px);
        curve(titles[k].clone(), inside.map(|s| (s.0, 1e3 * (s.1 - s.2))).collect(), COLOURS[k], false)
    });
    let mut transfers = both(&transfer);
    transfers.extend(marks(band.edges.iter().zip(COLOURS).map(|(e, c)| (&e.film_mtf, c))));
    let at = |what: &str| format!("{what}, {} nm", band.nm);
    let near = |k: usize, lens: bool| esf(samples(k), band.edges[k].half_px, lens);
    vec![
        svg(&at("ESF"), ACROSS, "edge spread", (0.0, 1.0), both(&near)),
        svg(&at("ESF, film - lens"), ACROSS, "difference (1e-3)", (0.0, 0.0), difference.collect()),
        svg(&at("LSF"), ACROSS, "line spread (1/px)", (0.0, 0.0), both(&lsf)),
        svg(&at("MTF"), FREQUENCY, "modulation", (0.0, 1.0), transfers),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn factors_are_round() {
        for (v, want) in [(7.3, 5.0), (2.0, 2.0), (0.019, 0.01), (99_999.0, 50_000.0)] {
            assert!((round(v) / want - 1.0).abs() < 1e-12, "{v}: {}", round(v));
        }
    }
}
