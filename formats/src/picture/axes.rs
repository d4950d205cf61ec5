//! Axes of a plot: range of the data, ticks at round numbers, conversion of values to px.

use super::figure::{Anchor, FONT, Figure, Stroke, Text};
use super::style::Colour;
use super::text;

/// Larger values are left out, like those that are not finite: their differences overflow.
const MAX_VALUE: f64 = 1e300;
/// Smaller values count as 0: their ticks would coincide.
const MIN_VALUE: f64 = 1e-290;

/// Whether a value can be drawn.
pub(super) fn drawable(v: f64) -> bool {
    v.abs() <= MAX_VALUE
}

/// Lowest and highest of the values and of `includes`. `margin`, a share of the range, is added beyond values but not beyond
/// `includes`. Never empty.
pub(super) fn range(values: impl Iterator<Item = f64>, includes: (f64, f64), margin: f64) -> (f64, f64) {
    let values = values.filter(|v| drawable(*v)).map(|v| if v.abs() < MIN_VALUE { 0.0 } else { v });
    let (low, high) = values.fold(includes, |(low, high), v| (low.min(v), high.max(v)));
    let magnitude = low.abs().max(high.abs());
    // A constant still gets an axis, with numbers of at most seven digits.
    let min_length = if magnitude == 0.0 { 1.0 } else { 1e-6 * magnitude };
    if high - low < min_length {
        return (low - min_length / 2.0, high + min_length / 2.0);
    }
    let margin = margin * (high - low);
    let extended = |v: f64, included: f64, margin: f64| if v == included { v } else { v + margin };
    (extended(low, includes.0, -margin), extended(high, includes.1, margin))
}

/// Ticks of an axis.
pub(super) struct Ticks {
    /// Values and their labels.
    pub(super) at: Vec<(f64, String)>,
    /// Power of ten by which the labels are to be multiplied.
    pub(super) exponent: i32,
}

impl Ticks {
    /// At most `max_steps` + 1 round values in a range.
    pub(super) fn new((low, high): (f64, f64), max_steps: usize) -> Self {
        let min_step = (high - low) / max_steps.max(1) as f64;
        let ten = 10f64.powi(min_step.log10().floor() as i32);
        let round = [1.0, 2.0, 5.0].map(|k| k * ten).into_iter().find(|s| *s >= min_step * (1.0 - 1e-9));
        let step = round.unwrap_or(10.0 * ten);
        let magnitude = low.abs().max(high.abs());
        let power = magnitude.log10().floor() as i32;
        let exponent = if (-2..5).contains(&power) { 0 } else { 3 * power.div_euclid(3) };
        let unit = 10f64.powi(exponent);
        let digits = (-(step / unit * (1.0 + 1e-9)).log10().floor()).clamp(0.0, 9.0) as usize;
        let (first, last) = ((low / step - 1e-6).ceil() as i64, (high / step + 1e-6).floor() as i64);
        let tick = |i: i64| {
            let number = format!("{:.digits$}", (i as f64 * step / unit).abs());
            (i as f64 * step, if i < 0 { format!("−{number}") } else { number })
        };
        Self { at: (first..=last).map(tick).collect(), exponent }
    }

    /// As many as fit into `length` px: labels side by side, or above each other (`upwards`).
    pub(super) fn along(range: (f64, f64), length: f64, upwards: bool) -> Self {
        let max_steps = (length / if upwards { 44.0 } else { 70.0 }).clamp(1.0, 9.0) as usize;
        let fits = |ticks: &Self| {
            if ticks.at.len() < 2 {
                return false;
            }
            let step = length / (range.1 - range.0) * (ticks.at[1].0 - ticks.at[0].0);
            upwards || ticks.width() + 14.0 <= step
        };
        let candidates = (1..=max_steps).rev().map(|steps| Self::new(range, steps));
        candidates.into_iter().find(fits).unwrap_or_else(|| Self::new(range, 1))
    }

    /// Width of the widest label, px.
    pub(super) fn width(&self) -> f64 {
        self.at.iter().map(|(_, number)| text::width(number, FONT)).fold(0.0, f64::max)
    }

    /// An axis label with the power of ten in its unit: `value (10⁻⁶ mm)`.
    pub(super) fn label(&self, label: &str) -> String {
        if self.exponent == 0 {
            return label.to_owned();
        }
        let superscript = |c: char| match c {
            '-' => '⁻',
            '1' => '¹',
            '2' => '²',
            '3' => '³',
            digit => char::from_u32(0x2070 + digit.to_digit(10).unwrap_or(0)).unwrap_or(digit),
        };
        let power: String = self.exponent.to_string().chars().map(superscript).collect();
        match label.rsplit_once(" (") {
            Some((name, unit)) => format!("{name} (10{power} {unit}"),
            None => format!("{label} (10{power})"),
        }
    }
}

/// One pair of axes: rectangle in px, range of x and y.
#[derive(Clone, Copy, Debug)]
pub(super) struct Panel {
    pub(super) left: f64,
    pub(super) right: f64,
    pub(super) top: f64,
    pub(super) bottom: f64,
    pub(super) x: (f64, f64),
    pub(super) y: (f64, f64),
}

impl Panel {
    pub(super) fn width(&self) -> f64 {
        self.right - self.left
    }

    pub(super) fn height(&self) -> f64 {
        self.bottom - self.top
    }

    pub(super) fn middle(&self) -> (f64, f64) {
        ((self.left + self.right) / 2.0, (self.top + self.bottom) / 2.0)
    }

    /// A value in px; limited to 50 panel sizes outside the panel.
    pub(super) fn place(&self, (x, y): (f64, f64)) -> (f64, f64) {
        let along = |v: f64, (low, high): (f64, f64)| ((v - low) / (high - low)).clamp(-50.0, 50.0);
        (self.left + self.width() * along(x, self.x), self.bottom - self.height() * along(y, self.y))
    }

    /// Gives both axes the same scale: the panel's height is computed, limited to `heights`, and a range is widened where
    /// the limit applies.
    pub(super) fn scale_equally(&mut self, heights: (f64, f64)) {
        let widened = |(low, high): (f64, f64), length: f64| {
            let more = ((length - (high - low)) / 2.0).max(0.0);
            (low - more, high + more)
        };
        let width = self.width();
        let (dx, dy) = (self.x.1 - self.x.0, self.y.1 - self.y.0);
        let height = (width * (dy / dx)).clamp(heights.0, heights.1);
        self.bottom = self.top + height;
        self.y = widened(self.y, dx * (height / width));
        self.x = widened(self.x, dy * (width / height));
    }

    /// A curve in px, cut where values are missing, thinned to points at least 0.5 px apart.
    pub(super) fn segments(&self, curve: &[(f64, f64)]) -> Vec<Vec<(f64, f64)>> {
        let mut segments = Vec::new();
        for run in curve.split(|p| !(drawable(p.0) && drawable(p.1))).filter(|run| !run.is_empty()) {
            let mut places: Vec<(f64, f64)> = Vec::new();
            for (i, p) in run.iter().enumerate() {
                let (x, y) = self.place(*p);
                if i + 1 == run.len() || places.last().is_none_or(|q| (x - q.0).hypot(y - q.1) >= 0.5) {
                    places.push((x, y));
                }
            }
            segments.push(places);
        }
        segments
    }

    /// Draws grid, ticks and labels of both axes; `x_label` none: no labels along x.
    pub(super) fn draw(&self, figure: &mut Figure, x_label: Option<&str>, y_label: &str) {
        let grid = Stroke { colour: Colour::Grid, ..Stroke::THIN };
        let (width, height) = (self.width(), self.height());
        let across = Ticks::along(self.x, width, false);
        for (v, number) in &across.at {
            let x = self.place((*v, self.y.0)).0;
            figure.line(&[(x, self.top), (x, self.bottom)], grid);
            figure.line(&[(x, self.bottom), (x, self.bottom + 5.0)], Stroke::THIN);
            if x_label.is_some() {
                figure.text(Text::new((x, self.bottom + 16.0), Anchor::Middle, number));
            }
        }
        let up = Ticks::along(self.y, height, true);
        for (v, number) in &up.at {
            let y = self.place((self.x.0, *v)).1;
            figure.line(&[(self.left, y), (self.right, y)], grid);
            figure.line(&[(self.left - 5.0, y), (self.left, y)], Stroke::THIN);
            figure.text(Text::new((self.left - 9.0, y), Anchor::End, number));
        }
        let zero = Stroke { colour: Colour::Muted, ..Stroke::THIN };
        if self.y.0 < 0.0 && self.y.1 > 0.0 {
            let y = self.place((self.x.0, 0.0)).1;
            figure.line(&[(self.left, y), (self.right, y)], zero);
        }
        let middle = self.middle();
        let at = (self.left - 9.0 - up.width() - 18.0, middle.1);
        let label = up.label(y_label);
        figure.text(Text {
            upwards: true,
            max_width: height + 50.0,
            ..Text::new(at, Anchor::Middle, &label)
        });
        if let Some(x_label) = x_label {
            let label = across.label(x_label);
            let at = (middle.0, self.bottom + 42.0);
            figure.text(Text { max_width: width + 80.0, ..Text::new(at, Anchor::Middle, &label) });
        }
    }

    /// Draws a second x axis along the top: values `factor` times those of the first.
    pub(super) fn draw_top(&self, figure: &mut Figure, name: &str, factor: f64) {
        let ticks = Ticks::along((self.x.0 * factor, self.x.1 * factor), self.width(), false);
        for (v, number) in &ticks.at {
            let x = self.place((v / factor, self.y.0)).0;
            figure.line(&[(x, self.top - 5.0), (x, self.top)], Stroke::THIN);
            figure.text(Text::new((x, self.top - 15.0), Anchor::Middle, number));
        }
        figure.text(Text::new((self.middle().0, self.top - 37.0), Anchor::Middle, &ticks.label(name)));
    }

    /// Draws the frame, over the curves.
    pub(super) fn frame(&self, figure: &mut Figure) {
        let (l, r, t, b) = (self.left, self.right, self.top, self.bottom);
        figure.line(&[(l, t), (r, t), (r, b), (l, b), (l, t), (r, t)], Stroke::THIN);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_numbers_inside_the_range() {
        let numbers = |r, n| Ticks::new(r, n).at.into_iter().map(|t| t.1).collect::<Vec<_>>();
        assert_eq!(numbers((0.0, 20.0), 8), ["0", "5", "10", "15", "20"]);
        assert_eq!(numbers((-0.11, 0.05), 6), ["−0.10", "−0.05", "0.00", "0.05"]);
        assert_eq!(numbers((0.0, 4.2e-6), 3), ["0", "2", "4"]);
        assert_eq!(numbers((0.0, 9e7), 5), ["0", "20", "40", "60", "80"]);
    }

    #[test]
    fn label_has_the_power_of_ten_in_its_unit() {
        assert_eq!(Ticks::new((0.0, 4e-6), 3).label("error (mm)"), "error (10⁻⁶ mm)");
        assert_eq!(Ticks::new((0.0, 4e12), 3).label("value"), "value (10¹²)");
        assert_eq!(Ticks::new((0.0, 4.0), 3).label("value"), "value");
    }

    #[test]
    fn any_data_have_a_finite_range_with_1_to_10_ticks() {
        let nan = f64::NAN;
        for values in [
            vec![],
            vec![nan],
            vec![f64::INFINITY, -f64::INFINITY],
            vec![0.0],
            vec![1e300, -1e300],
            vec![f64::MAX, 1.0],
            vec![1e-320, 0.0],
            vec![1e-200, 3e-200],
            vec![1e9, 1e9 + 1e-7],
            vec![-5.0, -5.0],
        ] {
            for includes in [(0.0, 0.0), (0.0, 1.0)] {
                let (low, high) = range(values.iter().copied(), includes, 0.05);
                assert!(low < high && (high - low).is_finite(), "{values:?}: {low} {high}");
                for upwards in [true, false] {
                    let ticks = Ticks::along((low, high), 400.0, upwards);
                    assert!((1..=10).contains(&ticks.at.len()), "{values:?}: {}", ticks.at.len());
                    assert!(ticks.at.iter().all(|t| t.1.chars().count() < 14), "{:?}", ticks.at);
                }
            }
        }
    }
}
