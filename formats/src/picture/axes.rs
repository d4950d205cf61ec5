//! Axes of a plot: ticks at round numbers, a faint grid, labels; where values lie in pixels.

use super::figure::{Anchor, Mark};
use super::image::Rgb;

pub(super) const BLACK: Rgb = [0; 3];
const GREY: Rgb = [222; 3];

/// Lowest and highest value, `also` among them, with a little air.
pub(super) fn range(curves: &[Vec<(f64, f64)>], also: f64) -> (f64, f64) {
    let all = curves.iter().flatten().map(|p| p.1).filter(|v| v.is_finite());
    let (low, high) = all.fold((also, also), |(low, high), v| (low.min(v), high.max(v)));
    // A flat curve still gets an axis: a thousandth of its value, or a thousandth.
    let air = (0.06 * (high - low)).max(1e-3 * high.abs().max(low.abs()).max(1.0));
    (low - air, high + air)
}

/// One pair of axes.
pub(super) struct Panel {
    pub(super) left: f64,
    pub(super) right: f64,
    pub(super) top: f64,
    pub(super) bottom: f64,
    pub(super) x: (f64, f64),
    pub(super) y: (f64, f64),
}

impl Panel {
    pub(super) fn place(&self, (x, y): (f64, f64)) -> (f64, f64) {
        let along = |v: f64, (low, high): (f64, f64)| (v - low) / (high - low);
        (
            self.left + (self.right - self.left) * along(x, self.x),
            self.bottom - (self.bottom - self.top) * along(y, self.y),
        )
    }

    /// A curve in pixels, thinned to one point a pixel.
    pub(super) fn places(&self, curve: &[(f64, f64)]) -> Vec<(f64, f64)> {
        let mut places: Vec<(f64, f64)> = Vec::new();
        let last = curve.len().saturating_sub(1);
        for (i, p) in curve.iter().enumerate().filter(|(_, p)| p.1.is_finite()) {
            let (x, y) = self.place(*p);
            if i == last || places.last().is_none_or(|&(px, py)| (x - px).hypot(y - py) >= 1.0) {
                places.push((x, y));
            }
        }
        places
    }

    pub(super) fn draw(&self, marks: &mut Vec<Mark>, y_label: &str, x_label: Option<&str>) {
        for v in ticks(self.x, 8) {
            let (x, _) = self.place((v, self.y.0));
            marks.push(line((x, self.top), (x, self.bottom), GREY));
            if x_label.is_some() {
                marks.push(text((x, self.bottom + 16.0), label(v, self.x, 8), 2, Anchor::Middle, false));
            }
        }
        for v in ticks(self.y, 6) {
            let (_, y) = self.place((0.0, v));
            marks.push(line((self.left, y), (self.right, y), GREY));
            marks.push(text((self.left - 8.0, y), label(v, self.y, 6), 2, Anchor::End, false));
        }
        if self.y.0 < 0.0 && self.y.1 > 0.0 {
            let (_, y) = self.place((0.0, 0.0));
            marks.push(line((self.left, y), (self.right, y), [120; 3]));
        }
        let corners = [
            (self.left, self.top),
            (self.right, self.top),
            (self.right, self.bottom),
            (self.left, self.bottom),
            (self.left, self.top),
        ];
        marks.push(Mark::Line { points: corners.into(), width: 1.0, colour: BLACK });
        let middle = (self.top + self.bottom) / 2.0;
        marks.push(text((self.left - 116.0, middle), y_label.into(), 2, Anchor::Middle, true));
        if let Some(x_label) = x_label {
            let at = ((self.left + self.right) / 2.0, self.bottom + 42.0);
            marks.push(text(at, x_label.into(), 2, Anchor::Middle, false));
        }
    }
}

/// Distance between ticks: 1, 2 or 5 times a power of ten, at most `most` in a range.
fn step((low, high): (f64, f64), most: usize) -> f64 {
    let least = (high - low) / most as f64;
    let ten = 10f64.powf(least.log10().floor());
    [1.0, 2.0, 5.0, 10.0]
        .map(|k| k * ten)
        .into_iter()
        .find(|&s| s >= least * (1.0 - 1e-9))
        .unwrap_or(10.0 * ten)
}

fn ticks(range: (f64, f64), most: usize) -> impl Iterator<Item = f64> {
    let step = step(range, most);
    let (first, last) = ((range.0 / step - 1e-9).ceil() as i64, (range.1 / step + 1e-9).floor() as i64);
    (first..=last).map(move |i| i as f64 * step)
}

/// A tick's number, with as many digits as the step has.
fn label(value: f64, range: (f64, f64), most: usize) -> String {
    let digits = (-step(range, most).log10().floor()).max(0.0) as usize;
    // Not "-0.0".
    format!("{:.digits$}", if value == 0.0 { 0.0 } else { value })
}

pub(super) fn line(from: (f64, f64), to: (f64, f64), colour: Rgb) -> Mark {
    Mark::Line { points: vec![from, to], width: 1.0, colour }
}

pub(super) fn text(at: (f64, f64), text: String, dot: usize, anchor: Anchor, up: bool) -> Mark {
    Mark::Text { at, text, dot, anchor, up, colour: BLACK }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_numbers_inside() {
        let labels = |r, n| ticks(r, n).map(|v| label(v, r, n)).collect::<Vec<_>>();
        assert_eq!(labels((0.0, 20.0), 8), ["0", "5", "10", "15", "20"]);
        assert_eq!(labels((-0.11, 0.05), 6), ["-0.10", "-0.05", "0.00", "0.05"]);
    }
}
