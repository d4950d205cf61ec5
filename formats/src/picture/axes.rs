//! Axes of a plot: ranges of any data, ticks at round numbers, where values lie in px.

use super::figure::{Anchor, FONT, Figure, Stroke, Text};
use super::style::Colour;
use super::text;

/// Values beyond are left out, as those that are not finite: their differences overflow.
const HUGE: f64 = 1e300;
/// Values below are 0: ticks between them cannot be told apart.
const TINY: f64 = 1e-290;

/// Whether a value can be drawn.
pub(super) fn drawable(v: f64) -> bool {
    v.abs() <= HUGE
}

/// Lowest and highest of the values and of `holds`. `air` is added beyond values, a share of the range; none beyond
/// `holds`. Never empty.
pub(super) fn range(values: impl Iterator<Item = f64>, holds: (f64, f64), air: f64) -> (f64, f64) {
    let values = values.filter(|v| drawable(*v)).map(|v| if v.abs() < TINY { 0.0 } else { v });
    let (low, high) = values.fold(holds, |(low, high), v| (low.min(v), high.max(v)));
    let magnitude = low.abs().max(high.abs());
    // A constant still gets an axis, with numbers of at most seven digits.
    let least = if magnitude == 0.0 { 1.0 } else { 1e-6 * magnitude };
    if high - low < least {
        return (low - least / 2.0, high + least / 2.0);
    }
    let air = air * (high - low);
    let beyond = |v: f64, held: f64, air: f64| if v == held { v } else { v + air };
    (beyond(low, holds.0, -air), beyond(high, holds.1, air))
}

/// Ticks of an axis.
pub(super) struct Ticks {
    /// Values and their numbers.
    pub(super) at: Vec<(f64, String)>,
    /// Power of ten that the numbers are multiples of.
    pub(super) exponent: i32,
}

impl Ticks {
    /// At most `most` + 1 round values in a range.
    pub(super) fn new((low, high): (f64, f64), most: usize) -> Self {
        let least = (high - low) / most.max(1) as f64;
        let ten = 10f64.powi(least.log10().floor() as i32);
        let round = [1.0, 2.0, 5.0].map(|k| k * ten).into_iter().find(|s| *s >= least * (1.0 - 1e-9));
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

    /// As many as `length` px hold: labels side by side, or below each other.
    pub(super) fn along(range: (f64, f64), length: f64, upwards: bool) -> Self {
        let most = (length / if upwards { 44.0 } else { 70.0 }).clamp(1.0, 9.0) as usize;
        let fits = |ticks: &Self| {
            if ticks.at.len() < 2 {
                return false;
            }
            let step = length / (range.1 - range.0) * (ticks.at[1].0 - ticks.at[0].0);
            upwards || ticks.width() + 14.0 <= step
        };
        let tried = (1..=most).rev().map(|most| Self::new(range, most));
        tried.into_iter().find(fits).unwrap_or_else(|| Self::new(range, 1))
    }

    /// Width of the widest number, px.
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

/// One pair of axes: its rectangle in px and its ranges.
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
    /// Where a value lies, px; far outside values just outside.
    pub(super) fn place(&self, (x, y): (f64, f64)) -> (f64, f64) {
        let along = |v: f64, (low, high): (f64, f64)| ((v - low) / (high - low)).clamp(-50.0, 50.0);
        (
            self.left + (self.right - self.left) * along(x, self.x),
            self.bottom - (self.bottom - self.top) * along(y, self.y),
        )
    }

    /// Makes a unit as long upwards as to the right: the panel's height follows, within `heights`; what they leave over or
    /// lack is added to a range.
    pub(super) fn scale_equally(&mut self, heights: (f64, f64)) {
        let wider = |(low, high): (f64, f64), to: f64| {
            let more = ((to - (high - low)) / 2.0).max(0.0);
            (low - more, high + more)
        };
        let width = self.right - self.left;
        let (dx, dy) = (self.x.1 - self.x.0, self.y.1 - self.y.0);
        let height = (width * (dy / dx)).clamp(heights.0, heights.1);
        self.bottom = self.top + height;
        self.y = wider(self.y, dx * (height / width));
        self.x = wider(self.x, dy * (width / height));
    }

    /// A curve in px, cut where values are missing, thinned to two points a px.
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

    /// Draws grid, frame and numbers, x and y; `x_label` none: no numbers along x.
    pub(super) fn draw(&self, figure: &mut Figure, x_label: Option<&str>, y_label: &str) {
        let grid = Stroke { colour: Colour::Grid, width: 1.0, dash: 0 };
        let tick = Stroke { colour: Colour::Ink, width: 1.0, dash: 0 };
        let (width, height) = (self.right - self.left, self.bottom - self.top);
        let across = Ticks::along(self.x, width, false);
        for (v, number) in &across.at {
            let x = self.place((*v, self.y.0)).0;
            figure.line(&[(x, self.top), (x, self.bottom)], grid);
            figure.line(&[(x, self.bottom), (x, self.bottom + 5.0)], tick);
            if x_label.is_some() {
                figure.text(Text::new((x, self.bottom + 16.0), Anchor::Middle, number));
            }
        }
        let up = Ticks::along(self.y, height, true);
        for (v, number) in &up.at {
            let y = self.place((self.x.0, *v)).1;
            figure.line(&[(self.left, y), (self.right, y)], grid);
            figure.line(&[(self.left - 5.0, y), (self.left, y)], tick);
            figure.text(Text::new((self.left - 9.0, y), Anchor::End, number));
        }
        let zero = Stroke { colour: Colour::Muted, ..tick };
        if self.y.0 < 0.0 && self.y.1 > 0.0 {
            let y = self.place((self.x.0, 0.0)).1;
            figure.line(&[(self.left, y), (self.right, y)], zero);
        }
        let middle = ((self.left + self.right) / 2.0, (self.top + self.bottom) / 2.0);
        let at = (self.left - 9.0 - up.width() - 18.0, middle.1);
        let words = up.label(y_label);
        figure.text(Text { upwards: true, most: height + 50.0, ..Text::new(at, Anchor::Middle, &words) });
        if let Some(x_label) = x_label {
            let words = across.label(x_label);
            let at = (middle.0, self.bottom + 42.0);
            figure.text(Text { most: width + 80.0, ..Text::new(at, Anchor::Middle, &words) });
        }
    }

    /// Draws a second x axis along the top: values `factor` times those of the first.
    pub(super) fn draw_top(&self, figure: &mut Figure, name: &str, factor: f64) {
        let tick = Stroke { colour: Colour::Ink, width: 1.0, dash: 0 };
        let ticks = Ticks::along((self.x.0 * factor, self.x.1 * factor), self.right - self.left, false);
        for (v, number) in &ticks.at {
            let x = self.place((v / factor, self.y.0)).0;
            figure.line(&[(x, self.top - 5.0), (x, self.top)], tick);
            figure.text(Text::new((x, self.top - 15.0), Anchor::Middle, number));
        }
        let words = ticks.label(name);
        figure.text(Text::new(((self.left + self.right) / 2.0, self.top - 37.0), Anchor::Middle, &words));
    }

    /// Draws the frame, over the curves.
    pub(super) fn frame(&self, figure: &mut Figure) {
        let (l, r, t, b) = (self.left, self.right, self.top, self.bottom);
        let frame = Stroke { colour: Colour::Ink, width: 1.0, dash: 0 };
        figure.line(&[(l, t), (r, t), (r, b), (l, b), (l, t), (r, t)], frame);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_numbers_inside() {
        let numbers = |r, n| Ticks::new(r, n).at.into_iter().map(|t| t.1).collect::<Vec<_>>();
        assert_eq!(numbers((0.0, 20.0), 8), ["0", "5", "10", "15", "20"]);
        assert_eq!(numbers((-0.11, 0.05), 6), ["−0.10", "−0.05", "0.00", "0.05"]);
        assert_eq!(numbers((0.0, 4.2e-6), 3), ["0", "2", "4"]);
        assert_eq!(numbers((0.0, 9e7), 5), ["0", "20", "40", "60", "80"]);
    }

    #[test]
    fn powers_of_ten_stand_with_the_unit() {
        assert_eq!(Ticks::new((0.0, 4e-6), 3).label("error (mm)"), "error (10⁻⁶ mm)");
        assert_eq!(Ticks::new((0.0, 4e12), 3).label("value"), "value (10¹²)");
        assert_eq!(Ticks::new((0.0, 4.0), 3).label("value"), "value");
    }

    #[test]
    fn any_data_have_a_range_with_few_ticks() {
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
            for holds in [(0.0, 0.0), (0.0, 1.0)] {
                let (low, high) = range(values.iter().copied(), holds, 0.05);
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
