//! Figures of a batch: yield, figures over the field, film shifts, sensitivities.
//!
//! Bands over the field: at each height of the criterion's places the percentiles 5 to 95 and 25 to 75 and the median, over all
//! lenses and all places of that height.

use super::found::Found;
use super::request::Request;
use super::sensitivity::Effect;
use super::summary::criterion_name;
use formats::picture::figure::{Anchor, Figure, Stroke, Text};
use formats::picture::plot::{Axis, Plot, Series, Shape, WIDTH, stacked};
use formats::picture::style::{Colour, Style};
use pipeline::design::tolerance::statistics::{Better, lens_at};
use pipeline::design::tolerance::{CriterionKind, FieldFigures};
use pipeline::geometry::Size;

const YIELD: &str = "yield.svg";
const FIELD: &str = "field.svg";
const FILM_SHIFT: &str = "film-shift.svg";
const SENSITIVITY: &str = "sensitivity.svg";
/// Names of all figures.
pub const FILES: [&str; 4] = [YIELD, FIELD, FILM_SHIFT, SENSITIVITY];

/// Two places have one height if they differ by less, mm.
const SAME_MM: f64 = 1e-6;
/// Most bars of a histogram, and of the sensitivities.
const BINS: usize = 40;
const MAX_BARS: usize = 25;

/// The figures that there are data for, with their names.
pub fn all(request: &Request<'_>, found: &Found, style: Style) -> Vec<(&'static str, Figure)> {
    let mut figures = vec![
        (YIELD, yield_curve(request, found).figure(style)),
        (FIELD, over_field(request, found, style)),
        (FILM_SHIFT, film_shifts(request, found).figure(style)),
    ];
    if let Some(sensitivity) = &found.sensitivity {
        figures.push((SENSITIVITY, bars(request, &sensitivity.effects, style)));
    }
    figures
}

/// Share of the lenses that are as good or better, against the criterion.
fn yield_curve(request: &Request<'_>, found: &Found) -> Plot {
    let mut values: Vec<f64> = found.rows.iter().filter_map(|row| row.figure(|f| f.criterion)).collect();
    values.sort_by(f64::total_cmp);
    let (n, all) = (values.len(), found.rows.len().max(1));
    let share = |count: usize| 100.0 * count as f64 / all as f64;
    let better = request.better();
    let mut points = Vec::with_capacity(2 * n);
    for (i, v) in values.iter().enumerate() {
        // Steps at the values of actual lenses.
        points.extend(match better {
            Better::Greater => [(*v, share(n - i)), (*v, share(n - i - 1))],
            Better::Less => [(*v, share(i)), (*v, share(i + 1))],
        });
    }
    let mut series = vec![Series::line("lenses as good or better", points, Colour::Palette(0))];
    if let Some(nominal) = found.nominal.figure(|f| f.criterion) {
        let line = vec![(nominal, 0.0), (nominal, 100.0)];
        series.push(Series::line("without errors", line, Colour::Muted).dashed(1));
    }
    if let Some(pass) = request.args.pass {
        series.push(Series::line("--pass", vec![(pass, 0.0), (pass, 100.0)], Colour::Palette(4)).dashed(2));
    }
    let ends = values.first().zip(values.last()).map_or((0.0, 1.0), |(a, b)| (*a, *b));
    let x = Axis::new(criterion_name(request), ends.0, ends.1);
    let title = format!("{}: yield", request.system.name);
    Plot { series, ..Plot::new(title, x, Axis::new("lenses (%)", 0.0, 100.0)) }
}

/// Bands of percentiles against the height: of the MTF, sagittal above tangential, else of the criterion's figure.
fn over_field(request: &Request<'_>, found: &Found, style: Style) -> Figure {
    let title = format!("{}: {}", request.system.name, criterion_name(request));
    let of = |kind: &str, top: f64, value: &dyn Fn(&FieldFigures) -> f64| {
        let y = Axis::new(kind, 0.0, top);
        Plot {
            series: bands(found, value),
            ..Plot::new("", Axis::new("real image height (mm)", 0.0, 0.0), y)
        }
    };
    let mtf = |i: usize| move |f: &FieldFigures| f.mtf.map_or(f64::NAN, |mtf| mtf[i]);
    let plots = match request.criterion().kind {
        CriterionKind::Mtf { .. } => {
            vec![of("sagittal MTF", 1.0, &mtf(0)), of("tangential MTF", 1.0, &mtf(1))]
        }
        CriterionKind::RmsSpot => vec![of("RMS spot radius (µm)", 0.0, &|f| f.rms_spot_um)],
        CriterionKind::RmsWavefront => vec![of("RMS wavefront error (waves)", 0.0, &|f| f.rms_wavefront)],
    };
    stacked(&title, &plots, style)
}

fn bands(found: &Found, value: &dyn Fn(&FieldFigures) -> f64) -> Vec<Series> {
    let mut heights: Vec<f64> = found.places.iter().map(|[x, y]| x.hypot(*y)).collect();
    heights.sort_by(f64::total_cmp);
    heights.dedup_by(|a, b| (*a - *b).abs() < SAME_MM);
    let at = |height: f64, percent: u32| {
        let is_there = |f: &&FieldFigures| (f.place_mm[0].hypot(f.place_mm[1]) - height).abs() < SAME_MM;
        let figures = found.rows.iter().flat_map(|row| row.outcome.iter()).flat_map(|f| f.fields.iter());
        let values: Vec<Option<f64>> = figures.filter(is_there).map(|f| Some(value(f))).collect();
        lens_at(&values, percent).and_then(|i| values[i]).unwrap_or(f64::NAN)
    };
    let curve = |percent: u32| heights.iter().map(|h| (*h, at(*h, percent))).collect::<Vec<_>>();
    let band = |name: &str, [low, high]: [u32; 2], colour: Colour| {
        let back = curve(low).into_iter().rev();
        Series::line(name, curve(high).into_iter().chain(back).collect(), colour).shaped(Shape::Area)
    };
    let nominal = found.nominal.outcome.iter().flat_map(|f| f.fields.iter());
    let mut without: Vec<(f64, f64)> =
        nominal.map(|f| (f.place_mm[0].hypot(f.place_mm[1]), value(f))).collect();
    without.sort_by(|a, b| a.0.total_cmp(&b.0));
    without.dedup_by(|a, b| (a.0 - b.0).abs() < SAME_MM);
    vec![
        band("percentiles 5 to 95", [5, 95], Colour::Palette(1)),
        band("25 to 75", [25, 75], Colour::Palette(0)),
        Series::line("median", curve(50), Colour::Ink).marked(0),
        Series::line("without errors", without, Colour::Palette(4)).dashed(1),
    ]
}

/// Histogram of the film's shift.
fn film_shifts(request: &Request<'_>, found: &Found) -> Plot {
    let um: Vec<f64> = found.rows.iter().filter_map(|row| row.figure(|f| 1e3 * f.film_shift_mm)).collect();
    let (low, high) = um.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(*v), b.max(*v)));
    // As many bars as the square root of the lenses.
    let bins = ((um.len() as f64).sqrt().ceil() as usize).clamp(1, BINS);
    let width = if high > low { (high - low) / bins as f64 } else { 1.0 };
    let mut counts = vec![0_usize; bins];
    for v in &um {
        counts[(((v - low) / width) as usize).min(bins - 1)] += 1;
    }
    let bar = |(i, count): (usize, &usize)| {
        let (left, right, top) = (low + i as f64 * width, low + (i + 1) as f64 * width, *count as f64);
        let corners = vec![(left, 0.0), (left, top), (right, top), (right, 0.0)];
        Series::line("", corners, Colour::Palette(0)).shaped(Shape::Area)
    };
    let series = counts.iter().enumerate().filter(|(_, count)| **count > 0).map(bar).collect();
    let ends = if um.is_empty() { (0.0, 1.0) } else { (low, high) };
    let x = Axis::new("film shift (µm)", ends.0, ends.1);
    let title = format!("{}: film shift of the best focus", request.system.name);
    Plot { series, ..Plot::new(title, x, Axis::new("lenses", 0.0, 1.0)) }
}

/// Changes of the criterion by each error alone, the strongest first: lower and upper limit.
fn bars(request: &Request<'_>, effects: &[Effect], style: Style) -> Figure {
    const ROW: f64 = 24.0;
    const TOP: f64 = 86.0;
    const LEFT: f64 = 250.0;
    const RIGHT: f64 = 40.0;
    let shown = &effects[..effects.len().min(MAX_BARS)];
    let changes = || shown.iter().flat_map(|e| e.changes.iter().flatten().map(|c| c.criterion));
    let (low, high) = changes().fold((0.0_f64, 0.0_f64), |(a, b), v| (a.min(v), b.max(v)));
    let span = if high > low { high - low } else { 1.0 };
    let width = WIDTH as f64 - LEFT - RIGHT;
    let x = |v: f64| LEFT + width * (v - low) / span;
    let bottom = TOP + ROW * shown.len() as f64;
    let mut figure = Figure::new(Size::new((bottom + 50.0) as usize, WIDTH), style);
    let title =
        format!("{}: change of the {} by each error alone", request.system.name, criterion_name(request));
    let heading = Text::new((20.0, 21.0), Anchor::Start, &title);
    figure.text(Text { size: 17.0, max_width: WIDTH as f64 - 40.0, ..heading });
    for (k, name) in ["lower limit", "upper limit"].into_iter().enumerate() {
        let left = LEFT + 150.0 * k as f64;
        figure.area(&rectangle(left, 48.0, left + 24.0, 60.0), Colour::Palette(4 * k));
        figure.text(Text::new((left + 32.0, 54.0), Anchor::Start, name));
    }
    for (row, effect) in shown.iter().enumerate() {
        let y = TOP + ROW * row as f64;
        let id = &request.tolerances.parameters()[effect.parameter].id;
        let label = Text::new((LEFT - 12.0, y + 0.5 * ROW), Anchor::End, id);
        figure.text(Text { max_width: LEFT - 30.0, ..label });
        for (k, change) in effect.changes.iter().enumerate() {
            let (top, end) = (y + 3.0 + 9.0 * k as f64, y + 12.0 + 9.0 * k as f64);
            match change {
                Some(c) => figure.area(&rectangle(x(0.0), top, x(c.criterion), end), Colour::Palette(4 * k)),
                None => figure.text(Text {
                    size: 10.0,
                    ..Text::new((x(0.0) + 6.0, 0.5 * (top + end)), Anchor::Start, "failed")
                }),
            }
        }
    }
    figure.line(
        &[(x(0.0), TOP - 6.0), (x(0.0), bottom + 6.0)],
        Stroke { colour: Colour::Ink, width: 1.0, dash: 0 },
    );
    let mut marks = vec![low, 0.0, high];
    marks.dedup();
    for v in marks {
        let text = if v == 0.0 { "0".to_owned() } else { format!("{v:+.3e}") };
        if v == 0.0 || v.abs() > 0.15 * span {
            figure.text(Text::new((x(v), bottom + 22.0), Anchor::Middle, &text));
        }
    }
    figure
}

fn rectangle(left: f64, top: f64, right: f64, bottom: f64) -> [(f64, f64); 4] {
    [(left, top), (right, top), (right, bottom), (left, bottom)]
}
