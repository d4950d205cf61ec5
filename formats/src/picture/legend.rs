//! Legend of a plot: names beside samples, or a colour bar for curves ordered by a quantity.

use super::axes::{Ticks, range};
use super::figure::{Anchor, FONT, Figure, Stroke, Text};
use super::series::{Series, Shape};
use super::style::{Colour, Rgb};
use super::text;

/// Maximum width of names, px.
const MAX_NAME_WIDTH: f64 = 170.0;
/// Distance of rows of the legend, px, and length of its line samples.
const ROW: f64 = 23.0;
const SAMPLE: f64 = 36.0;
/// Width of line samples without a width, px.
const LINE_WIDTH: f64 = 2.0;
/// Height of a colour bar, px.
const BAR: f64 = 220.0;

/// Explanation of the colours.
#[derive(Clone, Debug, PartialEq)]
pub enum Legend {
    /// Names beside samples.
    Names,
    /// Scale of ordered curves: quantity with unit, first and last value.
    Bar(String, f64, f64),
}

impl Legend {
    /// Width and height, px.
    pub(super) fn size(&self, series: &[Series], line_styles: Option<[&str; 2]>) -> (f64, f64) {
        let entries = self.entries(series);
        let names = entries.iter().map(|s| s.name.as_str()).chain(line_styles.into_iter().flatten());
        let widest = names.map(|n| text::width(n, FONT)).fold(0.0, f64::max).min(MAX_NAME_WIDTH);
        let styles = if line_styles.is_some() { 2.5 * ROW } else { 0.0 };
        let rows = ROW * entries.len() as f64 + styles;
        match self {
            Self::Bar(..) => (112f64.max(SAMPLE + 8.0 + widest), BAR + 20.0 + styles),
            Self::Names if rows == 0.0 => (0.0, 0.0),
            Self::Names => (SAMPLE + 8.0 + widest, rows),
        }
    }

    /// Draws it with its top left corner at (`x`, `top`), px.
    pub(super) fn draw(
        &self,
        figure: &mut Figure,
        (x, top): (f64, f64),
        series: &[Series],
        line_styles: Option<[&str; 2]>,
    ) {
        let mut y = top + ROW / 2.0;
        for s in self.entries(series) {
            let shape = match s.shape {
                // The patterns are explained below.
                Shape::Line { width, .. } if line_styles.is_some() => Shape::Line { width, dash: 0 },
                shape => shape,
            };
            legend_row(figure, (x, y), &Series { shape, points: Vec::new(), ..s.clone() });
            y += ROW;
        }
        if let Self::Bar(label, low, high) = self {
            let (low, high) = range([*low, *high].into_iter(), (*low, *high), 0.0);
            let ticks = Ticks::along((low, high), BAR, true);
            let share = |v: f64| (v - low) / (high - low);
            let numbers: Vec<_> = ticks.at.iter().map(|(v, n)| (share(*v), n.clone())).collect();
            let style = figure.style();
            let colour = |t| style.rgb(Colour::Scale(t));
            colour_bar(figure, [x, top + 8.0, 18.0, BAR], &ticks.label(label), &numbers, colour);
            y += BAR + 20.0;
        }
        for (dash, name) in line_styles.into_iter().flatten().enumerate() {
            y += if dash == 0 { ROW / 2.0 } else { ROW };
            legend_row(figure, (x, y), &Series::line(name, Vec::new(), Colour::Muted).dashed(dash));
        }
    }

    /// Entries of the legend: the first series of each name.
    fn entries<'s>(&self, series: &'s [Series]) -> Vec<&'s Series> {
        let mut entries: Vec<&Series> = Vec::new();
        for s in series.iter().filter(|s| *self == Self::Names && !s.name.is_empty()) {
            if entries.iter().all(|e| e.name != s.name) {
                entries.push(s);
            }
        }
        entries
    }
}

/// A sample of `series` and its name.
fn legend_row(figure: &mut Figure, (x, y): (f64, f64), series: &Series) {
    let colour = series.colour;
    match series.shape {
        Shape::Line { width, dash } => {
            let width = if width > 0.0 { width } else { LINE_WIDTH };
            figure.line(&[(x, y), (x + SAMPLE, y)], Stroke { colour, width, dash });
        }
        Shape::Area => {
            let (l, r, t, b) = (x + 8.0, x + SAMPLE - 8.0, y - 7.0, y + 7.0);
            figure.area(&[(l, t), (r, t), (r, b), (l, b)], colour);
        }
        Shape::Dots(radius) => figure.dots(&[(x + SAMPLE / 2.0, y)], radius.max(2.5), colour),
    }
    if let Some(kind) = series.marker {
        figure.marker((x + SAMPLE / 2.0, y), kind, colour);
    }
    let name = Text::new((x + SAMPLE + 8.0, y), Anchor::Start, &series.name);
    figure.text(Text { max_width: MAX_NAME_WIDTH, ..name });
}

/// Draws a colour bar in (left, top, width, height) with numbers at shares 0..1 of its height, 0 at the bottom, and its
/// label upwards to their right.
pub fn colour_bar(
    figure: &mut Figure,
    [x, y, width, height]: [f64; 4],
    label: &str,
    numbers: &[(f64, String)],
    colour: impl Fn(f64) -> Rgb,
) {
    const STEPS: usize = 110;
    let place = |share: f64| y + height * (1.0 - share);
    for i in 0..STEPS {
        let (low, high) = (i as f64 / STEPS as f64, (i + 1) as f64 / STEPS as f64);
        // Each reaches below its neighbour, so that no seam shows.
        let (top, bottom) = (place(high), place((low - 0.5 / STEPS as f64).max(0.0)));
        let corners = [(x, top), (x + width, top), (x + width, bottom), (x, bottom)];
        figure.area(&corners, Colour::Rgb(colour((low + high) / 2.0)));
    }
    let (r, b) = (x + width, y + height);
    figure.line(&[(x, y), (r, y), (r, b), (x, b), (x, y), (r, y)], Stroke::THIN);
    let mut widest: f64 = 0.0;
    for (share, number) in numbers {
        let y = place(*share);
        figure.line(&[(r, y), (r + 5.0, y)], Stroke::THIN);
        figure.text(Text::new((r + 9.0, y), Anchor::Start, number));
        widest = widest.max(text::width(number, FONT));
    }
    let middle = (r + 9.0 + widest + 16.0, y + height / 2.0);
    figure.text(Text { upwards: true, ..Text::new(middle, Anchor::Middle, label) });
}
