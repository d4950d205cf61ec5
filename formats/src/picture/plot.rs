//! Plots: named curves, areas and dots over axes with units, one or several below each other, the legend beside them.
//!
//! The legend stands right of the axes, so that it covers nothing. Where curves are ordered by a quantity (wavelength), a
//! colour bar takes its place.

use super::axes::{Panel, Ticks, drawable, range};
use super::figure::{Anchor, FONT, Figure, Stroke, Text};
use super::style::{Colour, Rgb, Style};
use super::text;
use pipeline::geometry::Size;

/// Width of a figure, px; with type of 15 px it reads at the width of a printed column.
pub const WIDTH: usize = 760;
/// Height of the axes of a plot alone, and of one among several, px.
const HEIGHT: (f64, f64) = (400.0, 270.0);
/// Least and most height of axes of one scale, px.
const SCALED_HEIGHT: (f64, f64) = (140.0, 900.0);
/// Font size of the title, px, and the height reserved for it.
const TITLE: (f64, f64) = (17.0, 42.0);
/// Width for names in the legend, px.
const NAMES: f64 = 170.0;
/// Distance of rows of the legend, px, and length of its samples of lines.
const ROW: f64 = 23.0;
const SAMPLE: f64 = 36.0;
/// Height of a colour bar, px.
const BAR: f64 = 220.0;
/// Width of curves, px; of more than eight in one plot.
const LINE: (f64, f64) = (2.0, 1.3);

/// What goes along an axis.
#[derive(Clone, Debug, PartialEq)]
pub struct Axis {
    /// Its name, with the unit in brackets at the end.
    pub label: String,
    /// Values that it holds at least.
    pub holds: (f64, f64),
}

impl Axis {
    /// An axis that holds two values at least.
    pub fn new(label: impl Into<String>, low: f64, high: f64) -> Self {
        Self { label: label.into(), holds: (low, high) }
    }
}

/// How points are drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Shape {
    /// A curve.
    Line {
        /// Width, px; 0: what suits the plot.
        width: f64,
        /// Pattern of [`super::figure::DASHES`].
        dash: usize,
    },
    /// A filled polygon.
    Area,
    /// Dots of a radius in px.
    Dots(f64),
}

/// One curve, area or set of dots. A point that is not finite leaves a gap.
#[derive(Clone, Debug, PartialEq)]
pub struct Series {
    /// Its name in the legend, where the same name stands once; no name: no entry.
    pub name: String,
    /// Its points, in the units of the axes.
    pub points: Vec<(f64, f64)>,
    /// Its colour.
    pub colour: Colour,
    /// How they are drawn.
    pub shape: Shape,
    /// Shape of the markers along it, see [`Figure::marker`].
    pub marker: Option<usize>,
}

impl Series {
    /// A solid curve.
    pub fn line(name: impl Into<String>, points: Vec<(f64, f64)>, colour: Colour) -> Self {
        Self { name: name.into(), points, colour, shape: Shape::Line { width: 0.0, dash: 0 }, marker: None }
    }

    /// A curve without order among others: the `i`-th colour and dash pattern of the palette.
    pub fn distinct(name: impl Into<String>, points: Vec<(f64, f64)>, i: usize) -> Self {
        Self::line(name, points, Colour::Palette(i)).dashed(i)
    }

    /// With a dash pattern.
    pub fn dashed(self, dash: usize) -> Self {
        let width = if let Shape::Line { width, .. } = self.shape { width } else { 0.0 };
        Self { shape: Shape::Line { width, dash }, ..self }
    }

    /// With markers along it.
    pub fn marked(self, kind: usize) -> Self {
        Self { marker: Some(kind), ..self }
    }

    /// In another shape.
    pub fn shaped(self, shape: Shape) -> Self {
        Self { shape, ..self }
    }
}

/// What explains the colours.
#[derive(Clone, Debug, PartialEq)]
pub enum Key {
    /// Names beside samples.
    Legend,
    /// The scale of ordered curves: its quantity with unit, first and last value.
    Bar(String, f64, f64),
}

/// One pair of axes with what is drawn on them.
#[derive(Clone, Debug, PartialEq)]
pub struct Plot {
    /// What is shown.
    pub title: String,
    /// To the right.
    pub x: Axis,
    /// Upwards.
    pub y: Axis,
    /// A second x axis along the top: its name with unit, and its values over those of x.
    pub top: Option<(String, f64)>,
    /// What is drawn, the first lowest.
    pub series: Vec<Series>,
    /// What explains the colours.
    pub key: Key,
    /// What solid and dashed mean, if both are there.
    pub styles: Option<[&'static str; 2]>,
    /// Whether a unit is as long upwards as to the right.
    pub equal_scale: bool,
}

impl Plot {
    /// An empty plot with a legend.
    pub fn new(title: impl Into<String>, x: Axis, y: Axis) -> Self {
        let (title, series) = (title.into(), Vec::new());
        Self { title, x, y, top: None, series, key: Key::Legend, styles: None, equal_scale: false }
    }

    /// Draws it.
    pub fn figure(&self, style: Style) -> Figure {
        stacked(&self.title, std::slice::from_ref(self), style)
    }

    /// Ranges of x and y: no air beside the data, a little above and below.
    fn ranges(&self) -> ((f64, f64), (f64, f64)) {
        (range(self.values(|p| p.0), self.x.holds, 0.0), range(self.values(|p| p.1), self.y.holds, 0.05))
    }

    fn values(&self, of: fn(&(f64, f64)) -> f64) -> impl Iterator<Item = f64> {
        let all = self.series.iter().flat_map(|s| &s.points);
        all.filter(|p| drawable(p.0) && drawable(p.1)).map(of)
    }

    /// Names of the legend with the series that they stand for, each once.
    fn named(&self) -> Vec<&Series> {
        let mut named: Vec<&Series> = Vec::new();
        for s in &self.series {
            if !s.name.is_empty() && named.iter().all(|n| n.name != s.name) {
                named.push(s);
            }
        }
        named
    }

    /// Width and height of the key, px.
    fn key_size(&self) -> (f64, f64) {
        let named = match &self.key {
            Key::Legend => self.named(),
            Key::Bar(..) => Vec::new(),
        };
        let names = named.iter().map(|s| s.name.as_str()).chain(self.styles.into_iter().flatten());
        let widest = names.map(|n| text::width(n, FONT)).fold(0.0, f64::max).min(NAMES);
        let styles = if self.styles.is_some() { 2.5 * ROW } else { 0.0 };
        let rows = ROW * named.len() as f64 + styles;
        match &self.key {
            Key::Bar(..) => (112f64.max(SAMPLE + 8.0 + widest), BAR + 20.0 + styles),
            Key::Legend if rows == 0.0 => (0.0, 0.0),
            Key::Legend => (SAMPLE + 8.0 + widest, rows),
        }
    }

    fn line_width(&self) -> f64 {
        if self.series.len() > 16 { LINE.1 } else { LINE.0 }
    }

    fn draw(&self, figure: &mut Figure, panel: &Panel, x_label: Option<&str>) {
        panel.draw(figure, x_label, &self.y.label);
        if let Some((name, factor)) = &self.top {
            panel.draw_top(figure, name, *factor);
        }
        let (width, height) = (panel.right - panel.left, panel.bottom - panel.top);
        figure.clip([panel.left, panel.top, width, height]);
        for s in &self.series {
            let segments = panel.segments(&s.points);
            match s.shape {
                Shape::Area => segments.iter().for_each(|points| figure.area(points, s.colour)),
                Shape::Dots(radius) => segments.iter().for_each(|at| figure.dots(at, radius, s.colour)),
                Shape::Line { width, dash } => {
                    let width = if width > 0.0 { width } else { self.line_width() };
                    let stroke = Stroke { colour: s.colour, width, dash };
                    for points in &segments {
                        match points.as_slice() {
                            [alone] => figure.dots(&[*alone], 1.8 * width, s.colour),
                            points => figure.line(points, stroke),
                        }
                    }
                }
            }
            if let Some(kind) = s.marker {
                let points: Vec<_> = s.points.iter().filter(|p| drawable(p.0) && drawable(p.1)).collect();
                let count = points.len().min(5);
                for i in 0..count {
                    let at = points[(2 * i + 1) * points.len() / (2 * count)];
                    figure.marker(panel.place(*at), kind, s.colour);
                }
            }
        }
        figure.clip_end();
        panel.frame(figure);
        if self.values(|p| p.0).next().is_none() {
            let at = ((panel.left + panel.right) / 2.0, (panel.top + panel.bottom) / 2.0);
            figure.text(Text { most: width, ..Text::new(at, Anchor::Middle, "no data") });
        }
    }

    fn draw_key(&self, figure: &mut Figure, (x, top): (f64, f64)) {
        let mut y = top + ROW / 2.0;
        match &self.key {
            Key::Legend => {
                for s in self.named() {
                    let shape = match s.shape {
                        // What the pattern means stands below.
                        Shape::Line { width, .. } if self.styles.is_some() => Shape::Line { width, dash: 0 },
                        shape => shape,
                    };
                    key_row(figure, (x, y), &Series { shape, points: Vec::new(), ..s.clone() });
                    y += ROW;
                }
            }
            Key::Bar(label, low, high) => {
                let (low, high) = range([*low, *high].into_iter(), (*low, *high), 0.0);
                let ticks = Ticks::along((low, high), BAR, true);
                let numbers: Vec<_> =
                    ticks.at.iter().map(|(v, n)| ((v - low) / (high - low), n.clone())).collect();
                let style = figure.style();
                let colour = |t| style.rgb(Colour::Scale(t));
                colour_bar(figure, [x, top + 8.0, 18.0, BAR], &ticks.label(label), &numbers, colour);
                y += BAR + 20.0;
            }
        }
        for (dash, name) in self.styles.into_iter().flatten().enumerate() {
            y += if dash == 0 { ROW / 2.0 } else { ROW };
            key_row(figure, (x, y), &Series::line(name, Vec::new(), Colour::Muted).dashed(dash));
        }
    }
}

/// One row of a legend.
fn key_row(figure: &mut Figure, (x, y): (f64, f64), series: &Series) {
    let colour = series.colour;
    match series.shape {
        Shape::Line { width, dash } => {
            let width = if width > 0.0 { width } else { LINE.0 };
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
    figure.text(Text { most: NAMES, ..Text::new((x + SAMPLE + 8.0, y), Anchor::Start, &series.name) });
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
    let at = |share: f64| y + height * (1.0 - share);
    for i in 0..STEPS {
        let (low, high) = (i as f64 / STEPS as f64, (i + 1) as f64 / STEPS as f64);
        // Each reaches below its neighbour, so that no seam shows.
        let (top, bottom) = (at(high), at((low - 0.5 / STEPS as f64).max(0.0)));
        let corners = [(x, top), (x + width, top), (x + width, bottom), (x, bottom)];
        figure.area(&corners, Colour::Rgb(colour((low + high) / 2.0)));
    }
    let thin = Stroke { colour: Colour::Ink, width: 1.0, dash: 0 };
    let (r, b) = (x + width, y + height);
    figure.line(&[(x, y), (r, y), (r, b), (x, b), (x, y), (r, y)], thin);
    let mut widest: f64 = 0.0;
    for (share, number) in numbers {
        figure.line(&[(r, at(*share)), (r + 5.0, at(*share))], thin);
        figure.text(Text::new((r + 9.0, at(*share)), Anchor::Start, number));
        widest = widest.max(text::width(number, FONT));
    }
    let middle = (r + 9.0 + widest + 16.0, y + height / 2.0);
    figure.text(Text { upwards: true, ..Text::new(middle, Anchor::Middle, label) });
}

/// Draws plots below each other under one title, with the key of the first; neighbours with the same x axis share its
/// numbers.
pub fn stacked(title: &str, plots: &[Plot], style: Style) -> Figure {
    let title_height = if title.is_empty() { 14.0 } else { TITLE.1 };
    let inner_height = if plots.len() > 1 { HEIGHT.1 } else { HEIGHT.0 };
    let key = plots.first().map_or((0.0, 0.0), Plot::key_size);
    let ranges: Vec<_> = plots.iter().map(Plot::ranges).collect();
    let numbers = ranges.iter().map(|r| Ticks::along(r.1, inner_height, true).width()).fold(0.0, f64::max);
    let left = 12.0 + 20.0 + numbers + 14.0;
    let right = WIDTH as f64 - if key.0 > 0.0 { key.0 + 30.0 } else { 24.0 };
    let (mut panels, mut y) = (Vec::new(), title_height);
    for (i, (plot, &(x_range, y_range))) in std::iter::zip(plots, &ranges).enumerate() {
        let labelled = plots.get(i + 1).is_none_or(|next| next.x != plot.x || ranges[i + 1].0 != x_range);
        y += if plot.top.is_some() { 54.0 } else { 8.0 };
        let mut panel = Panel { left, right, top: y, bottom: y + inner_height, x: x_range, y: y_range };
        if plot.equal_scale {
            panel.scale_equally(SCALED_HEIGHT);
        }
        y = panel.bottom + if labelled { 62.0 } else { 14.0 };
        panels.push((panel, labelled));
    }
    let height = y.max(title_height + 8.0 + key.1 + 12.0).ceil();
    let mut figure = Figure::new(Size::new(height as usize, WIDTH), style);
    let at = (left, TITLE.1 / 2.0);
    let most = WIDTH as f64 - left - 12.0;
    figure.text(Text { size: TITLE.0, most, ..Text::new(at, Anchor::Start, title) });
    for (plot, (panel, labelled)) in std::iter::zip(plots, &panels) {
        plot.draw(&mut figure, panel, labelled.then_some(plot.x.label.as_str()));
    }
    if let (Some(first), Some((panel, _))) = (plots.first(), panels.first()) {
        first.draw_key(&mut figure, (right + 18.0, panel.top));
    }
    figure
}

#[cfg(test)]
mod tests {
    use super::*;
    use resvg::usvg::roxmltree::Document;

    fn axes(series: Vec<Series>) -> Plot {
        let (x, y) = (Axis::new("real image height (mm)", 0.0, 0.0), Axis::new("contrast", 0.0, 1.0));
        Plot { series, ..Plot::new("MTF", x, y) }
    }

    /// Checks that a plot is drawn in both formats and styles; its texts.
    fn drawn(plot: &Plot) -> Vec<String> {
        let dark = plot.figure(Style::Dark);
        assert_eq!(dark.to_image(1.0).unwrap().size(), dark.size());
        let figure = plot.figure(Style::Light);
        assert!(figure.size().width == WIDTH && figure.size().height < 2000, "{}", figure.size());
        assert_eq!(figure.to_image(0.5).unwrap().size().width, WIDTH / 2);
        let svg = figure.to_svg_element();
        assert!(!svg.contains("NaN") && !svg.contains("inf"), "{svg}");
        let document = Document::parse(&svg).unwrap();
        let texts = document.descendants().filter(|n| n.has_tag_name("text") || n.has_tag_name("title"));
        texts.filter_map(|n| n.children().find(|c| c.is_text())?.text().map(str::to_owned)).collect()
    }

    #[test]
    fn a_plot_names_its_curves_once_and_its_axes() {
        let curve =
            |dash| Series::line("550 nm", vec![(0.0, 0.2), (10.0, 0.9)], Colour::Palette(0)).dashed(dash);
        let plot = Plot { styles: Some(["sagittal", "tangential"]), ..axes(vec![curve(0), curve(1)]) };
        let texts = drawn(&plot);
        for word in ["550 nm", "real image height (mm)", "contrast", "sagittal", "tangential", "MTF"] {
            assert_eq!(texts.iter().filter(|t| *t == word).count(), 1, "{word}: {texts:?}");
        }
    }

    #[test]
    fn hostile_data_are_drawn() {
        let nan = f64::NAN;
        let many = |v: f64| (0..50).map(|i| (f64::from(i), v * f64::from(i % 7))).collect::<Vec<_>>();
        for points in [
            vec![],
            vec![(nan, nan)],
            vec![(1.0, 2.0)],
            vec![(0.0, nan), (1.0, 1.0), (2.0, nan), (3.0, 1.0), (4.0, 2.0), (5.0, f64::INFINITY)],
            vec![(0.0, -1e308), (1.0, 1e308), (2.0, 5.0)],
            vec![(f64::MIN_POSITIVE, 0.0), (0.0, 1e-320)],
            many(1e300),
            many(1e-300),
            many(-3e-12),
            many(7e11),
        ] {
            let finite = points.iter().any(|p| drawable(p.0) && drawable(p.1));
            let line = Series::distinct("a", points.clone(), 3).marked(1);
            let shapes = [Shape::Area, Shape::Dots(2.0)].map(|shape| line.clone().shaped(shape));
            for equal_scale in [false, true] {
                let series = std::iter::once(line.clone()).chain(shapes.clone()).collect();
                let plot = Plot { equal_scale, top: Some(("µm".into(), 2.0)), ..axes(series) };
                let texts = drawn(&plot);
                assert_eq!(texts.iter().any(|t| t == "no data"), !finite, "{points:?}: {texts:?}");
            }
        }
        assert!(stacked("", &[], Style::Light).to_image(1.0).is_ok());
    }

    #[test]
    fn curves_are_cut_where_values_are_missing() {
        let points = vec![(0.0, 0.5), (1.0, 0.5), (2.0, f64::NAN), (3.0, 0.5), (4.0, 0.5)];
        let plot = axes(vec![Series::line("", points, Colour::Palette(4))]);
        let image = plot.figure(Style::Light).to_image(1.0).unwrap();
        let red = Style::Light.rgb(Colour::Palette(4));
        let columns: Vec<usize> = (0..image.size().width)
            .filter(|&x| (0..image.size().height).any(|y| image.pixel(y, x) == red))
            .collect();
        let gaps = columns.windows(2).filter(|w| w[1] - w[0] > 100).count();
        assert_eq!(gaps, 1, "{columns:?}");
    }

    #[test]
    fn long_names_with_markup_stay_inside_and_whole() {
        let name = "a <lens> & \"its\" name that is far too long for any legend, ".repeat(5);
        let curve = Series::distinct(name.trim(), vec![(0.0, 0.0), (1.0, 1.0)], 0);
        let mut plot = axes(vec![curve]);
        plot.title = name.trim().into();
        plot.y.label = name.trim().into();
        plot.x.label = name.trim().into();
        let texts = drawn(&plot);
        assert_eq!(texts.iter().filter(|t| *t == name.trim()).count(), 4, "{texts:?}");
        assert_eq!(texts.iter().filter(|t| t.ends_with('…')).count(), 4, "{texts:?}");
    }

    #[test]
    fn many_names_make_the_figure_higher_and_a_bar_stands_for_31_bands() {
        let curve = |i: i32| {
            let t = f64::from(i) / 30.0;
            let points = (0..20).map(|k| (f64::from(k), t)).collect();
            Series::line(format!("{} nm", 400 + 10 * i), points, Colour::Scale(t))
        };
        let named = axes((0..31).map(curve).collect());
        let texts = drawn(&named);
        assert!((0..31).all(|i| texts.contains(&format!("{} nm", 400 + 10 * i))), "{texts:?}");
        assert!(named.figure(Style::Light).size().height > 700);
        let bar = Plot { key: Key::Bar("wavelength (nm)".into(), 400.0, 700.0), ..named };
        let texts = drawn(&bar);
        assert!(["wavelength (nm)", "400", "700"].iter().all(|w| texts.iter().any(|t| t == w)), "{texts:?}");
        assert!(!texts.contains(&"400 nm".to_owned()));
    }

    #[test]
    fn plots_with_one_x_axis_share_its_numbers() {
        let plot = axes(vec![Series::distinct("a", vec![(0.0, 0.0), (1.0, 1.0)], 0)]);
        let svg = stacked("two", &[plot.clone(), plot], Style::Light).to_svg();
        assert_eq!(svg.matches("real image height (mm)").count(), 1);
        assert_eq!(svg.matches("contrast").count(), 2);
    }

    #[test]
    fn a_circle_stays_a_circle_on_axes_of_one_scale() {
        let circle = (0..360).map(|i| f64::from(i).to_radians().sin_cos());
        let points = circle.map(|(s, c)| (30.0 + 4.0 * c, 4.0 * s)).collect();
        let disc = Series::line("disc", points, Colour::Palette(0)).shaped(Shape::Area);
        let (x, y) = (Axis::new("z (mm)", 0.0, 100.0), Axis::new("x (mm)", -10.0, 10.0));
        let plot = Plot { series: vec![disc], equal_scale: true, ..Plot::new("circle", x, y) };
        let image = plot.figure(Style::Light).to_image(2.0).unwrap();
        let blue = Style::Light.rgb(Colour::Palette(0));
        let inside: Vec<(usize, usize)> = (0..image.size().height)
            .flat_map(|y| (0..1100).map(move |x| (y, x)))
            .filter(|&(y, x)| image.pixel(y, x) == blue)
            .collect();
        let extent = |of: fn(&(usize, usize)) -> usize| {
            inside.iter().map(of).max().unwrap() - inside.iter().map(of).min().unwrap()
        };
        assert!(extent(|p| p.0).abs_diff(extent(|p| p.1)) <= 1 && extent(|p| p.0) > 40);
    }
}
