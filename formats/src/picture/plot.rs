//! Plots: series on axes with units, one or several below each other, the key to their right.

use super::axes::{Panel, Ticks, range};
use super::figure::{Anchor, Figure, Text};
use super::style::Style;
use pipeline::geometry::Size;

pub use super::legend::{Legend, colour_bar};
pub use super::series::{Series, Shape};

/// Width of a figure, px; with type of 15 px it is readable at the width of a printed column.
pub const WIDTH: usize = 760;
/// Height of the axes of a plot alone, and of one among several, px.
const HEIGHT: (f64, f64) = (400.0, 270.0);
/// Minimum and maximum height of axes of equal scale, px.
const EQUAL_SCALE_HEIGHT: (f64, f64) = (140.0, 900.0);
/// Font size of the title, px, and the height reserved for it.
const TITLE: (f64, f64) = (17.0, 42.0);

/// An axis of a plot.
#[derive(Clone, Debug, PartialEq)]
pub struct Axis {
    /// Name, with the unit in brackets at the end.
    pub label: String,
    /// Two values that are always in its range.
    pub includes: (f64, f64),
}

impl Axis {
    /// An axis whose range includes `low` and `high`.
    pub fn new(label: impl Into<String>, low: f64, high: f64) -> Self {
        Self { label: label.into(), includes: (low, high) }
    }
}

/// One pair of axes with what is drawn on them.
#[derive(Clone, Debug, PartialEq)]
pub struct Plot {
    /// Title.
    pub title: String,
    /// Axis to the right.
    pub x: Axis,
    /// Axis upwards.
    pub y: Axis,
    /// A second x axis along the top: its name with unit, and its values over those of x.
    pub top: Option<(String, f64)>,
    /// Series, drawn in this order.
    pub series: Vec<Series>,
    /// Explanation of the colours.
    pub key: Legend,
    /// Names of the solid and the dashed line style.
    pub styles: Option<[&'static str; 2]>,
    /// Whether both axes have the same scale.
    pub equal_scale: bool,
}

impl Plot {
    /// An empty plot with a legend.
    pub fn new(title: impl Into<String>, x: Axis, y: Axis) -> Self {
        let (title, series) = (title.into(), Vec::new());
        Self { title, x, y, top: None, series, key: Legend::Names, styles: None, equal_scale: false }
    }

    /// The plot as a figure.
    pub fn figure(&self, style: Style) -> Figure {
        stacked(&self.title, std::slice::from_ref(self), style)
    }

    /// Ranges of x and y: no margin beside the data, a small one above and below.
    fn ranges(&self) -> ((f64, f64), (f64, f64)) {
        let points = || self.series.iter().flat_map(Series::drawable_points);
        (
            range(points().map(|p| p.0), self.x.includes, 0.0),
            range(points().map(|p| p.1), self.y.includes, 0.05),
        )
    }

    fn draw(&self, figure: &mut Figure, panel: &Panel, x_label: Option<&str>) {
        panel.draw(figure, x_label, &self.y.label);
        if let Some((name, factor)) = &self.top {
            panel.draw_top(figure, name, *factor);
        }
        let line_width = if self.series.len() > 16 { 1.3 } else { 2.0 };
        figure.clip([panel.left, panel.top, panel.width(), panel.height()]);
        for series in &self.series {
            series.draw(figure, panel, line_width);
        }
        figure.clip_end();
        panel.frame(figure);
        if self.series.iter().flat_map(Series::drawable_points).next().is_none() {
            let no_data = Text::new(panel.middle(), Anchor::Middle, "no data");
            figure.text(Text { max_width: panel.width(), ..no_data });
        }
    }
}

/// Plots below each other under one title, with the key of the first; neighbours with the same x axis share its numbers.
pub fn stacked(title: &str, plots: &[Plot], style: Style) -> Figure {
    let title_height = if title.is_empty() { 14.0 } else { TITLE.1 };
    let inner_height = if plots.len() > 1 { HEIGHT.1 } else { HEIGHT.0 };
    let key = plots.first().map_or((0.0, 0.0), |plot| plot.key.size(&plot.series, plot.styles));
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
            panel.scale_equally(EQUAL_SCALE_HEIGHT);
        }
        y = panel.bottom + if labelled { 62.0 } else { 14.0 };
        panels.push((panel, labelled));
    }
    let height = y.max(title_height + 8.0 + key.1 + 12.0).ceil();
    let mut figure = Figure::new(Size::new(height as usize, WIDTH), style);
    let at = (left, TITLE.1 / 2.0);
    let max_width = WIDTH as f64 - left - 12.0;
    figure.text(Text { size: TITLE.0, max_width, ..Text::new(at, Anchor::Start, title) });
    for (plot, (panel, labelled)) in std::iter::zip(plots, &panels) {
        plot.draw(&mut figure, panel, labelled.then_some(plot.x.label.as_str()));
    }
    if let (Some(first), Some((panel, _))) = (plots.first(), panels.first()) {
        first.key.draw(&mut figure, (right + 18.0, panel.top), &first.series, first.styles);
    }
    figure
}

#[cfg(test)]
mod tests {
    use super::super::axes::drawable;
    use super::super::style::Colour;
    use super::*;
    use resvg::usvg::roxmltree::Document;

    fn axes(series: Vec<Series>) -> Plot {
        let (x, y) = (Axis::new("real image height (mm)", 0.0, 0.0), Axis::new("contrast", 0.0, 1.0));
        Plot { series, ..Plot::new("MTF", x, y) }
    }

    /// Checks that a plot is drawn in both formats and styles. Returns its texts.
    fn texts_of(plot: &Plot) -> Vec<String> {
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
    fn labels_and_names_appear_once() {
        let curve =
            |dash| Series::line("550 nm", vec![(0.0, 0.2), (10.0, 0.9)], Colour::Palette(0)).dashed(dash);
        let plot = Plot { styles: Some(["sagittal", "tangential"]), ..axes(vec![curve(0), curve(1)]) };
        let texts = texts_of(&plot);
        for text in ["550 nm", "real image height (mm)", "contrast", "sagittal", "tangential", "MTF"] {
            assert_eq!(texts.iter().filter(|t| *t == text).count(), 1, "{text}: {texts:?}");
        }
    }

    #[test]
    fn extreme_and_missing_values_are_drawn() {
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
                let texts = texts_of(&plot);
                assert_eq!(texts.iter().any(|t| t == "no data"), !finite, "{points:?}: {texts:?}");
            }
        }
        assert!(stacked("", &[], Style::Light).to_image(1.0).is_ok());
    }

    #[test]
    fn missing_value_leaves_a_gap_in_the_curve() {
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
    fn long_texts_with_markup_are_cut_and_kept_as_tooltips() {
        let name = "a <lens> & \"its\" name that is far too long for any legend, ".repeat(5);
        let curve = Series::distinct(name.trim(), vec![(0.0, 0.0), (1.0, 1.0)], 0);
        let mut plot = axes(vec![curve]);
        plot.title = name.trim().into();
        plot.y.label = name.trim().into();
        plot.x.label = name.trim().into();
        let texts = texts_of(&plot);
        assert_eq!(texts.iter().filter(|t| *t == name.trim()).count(), 4, "{texts:?}");
        assert_eq!(texts.iter().filter(|t| t.ends_with('…')).count(), 4, "{texts:?}");
    }

    #[test]
    fn legend_of_31_names_enlarges_the_figure_and_a_colour_bar_replaces_it() {
        let curve = |i: i32| {
            let t = f64::from(i) / 30.0;
            let points = (0..20).map(|k| (f64::from(k), t)).collect();
            Series::line(format!("{} nm", 400 + 10 * i), points, Colour::Scale(t))
        };
        let named = axes((0..31).map(curve).collect());
        let texts = texts_of(&named);
        assert!((0..31).all(|i| texts.contains(&format!("{} nm", 400 + 10 * i))), "{texts:?}");
        assert!(named.figure(Style::Light).size().height > 700);
        let bar = Plot { key: Legend::Bar("wavelength (nm)".into(), 400.0, 700.0), ..named };
        let texts = texts_of(&bar);
        assert!(["wavelength (nm)", "400", "700"].iter().all(|w| texts.iter().any(|t| t == w)), "{texts:?}");
        assert!(!texts.contains(&"400 nm".to_owned()));
    }

    #[test]
    fn stacked_plots_with_equal_x_axes_label_it_once() {
        let plot = axes(vec![Series::distinct("a", vec![(0.0, 0.0), (1.0, 1.0)], 0)]);
        let svg = stacked("two", &[plot.clone(), plot], Style::Light).to_svg();
        assert_eq!(svg.matches("real image height (mm)").count(), 1);
        assert_eq!(svg.matches("contrast").count(), 2);
    }

    #[test]
    fn circle_on_axes_of_equal_scale_is_as_wide_as_high() {
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
        let extent = |side: fn(&(usize, usize)) -> usize| {
            inside.iter().map(side).max().unwrap() - inside.iter().map(side).min().unwrap()
        };
        assert!(extent(|p| p.0).abs_diff(extent(|p| p.1)) <= 1 && extent(|p| p.0) > 40);
    }
}
