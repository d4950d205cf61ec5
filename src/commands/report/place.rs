//! Where a chart is in a picture: a plane projective map of film positions of the chart to the picture, by its fiducials, by corners that are given, or by the corners of the picture.

use super::picture::Picture;
use crate::args::Corners;
use crate::failure::usage;
use anyhow::{Context, Result};
use pipeline::chart::{ChartSpec, Generator};
use pipeline::geometry::{Rect, Size};
use pipeline::measure::fiducial;
use pipeline::measure::projective::Projective;

/// Largest picture in which fiducials are sought pixel by pixel; larger ones are reduced.
const SEARCH_PIXELS: usize = 24 << 20;
/// Part of a patch that is measured, in the middle: the rest is left to the blur of its edges and to distortion.
const PATCH_SHARE: f64 = 0.6;

/// (row, column), px.
pub type Position = (f64, f64);

/// A chart in a picture.
pub struct Placed<'a> {
    /// The picture.
    pub picture: &'a Picture,
    /// The chart.
    pub chart: Generator,
    map: Projective,
}

impl<'a> Placed<'a> {
    /// Finds the chart `text` in `picture`.
    ///
    /// # Errors
    /// Usage: an unknown chart or setting; fiducials that are not found; corners that are no quadrilateral.
    pub fn find(picture: &'a Picture, text: &str, corners: Option<&Corners>) -> Result<Self> {
        let chart = chart(text, picture.size())?;
        let context = || format!("chart {text} in {}", picture.name);
        let film = corners_of(chart.film_size());
        let map = match (corners, chart.fiducials()) {
            (Some(corners), _) => Projective::through(&film, &corners.0),
            (None, Some(marks)) => {
                let found = fiducials(picture).map_err(|e| usage(e.to_string())).with_context(context)?;
                Projective::through(&marks, &found)
            }
            (None, None) => Projective::through(&film, &corners_of(picture.size())),
        };
        let map = map.map_err(|e| usage(e.to_string())).with_context(context)?;
        Ok(Self { picture, chart, map })
    }

    /// Place in the picture of a film position of the chart, without distortion.
    pub fn at(&self, film: Position) -> Position {
        self.map.apply(film)
    }

    /// Pixels of the picture per pixel of the chart at a film position.
    pub fn scale(&self, film: Position) -> f64 {
        self.map.area_scale(film).abs().sqrt()
    }

    /// The middle of the film, where distortion is least.
    pub fn middle(&self) -> Position {
        let size = self.chart.film_size();
        ((size.height as f64 - 1.0) / 2.0, (size.width as f64 - 1.0) / 2.0)
    }

    /// The pixels within the middle part of a patch of the film.
    pub fn patch(&self, film: Rect) -> Rect {
        let (y, x) = (
            film.y as f64 + (film.height as f64 - 1.0) / 2.0,
            film.x as f64 + (film.width as f64 - 1.0) / 2.0,
        );
        let (h, w) = (PATCH_SHARE * film.height as f64 / 2.0, PATCH_SHARE * film.width as f64 / 2.0);
        let corners = [(y - h, x - w), (y - h, x + w), (y + h, x + w), (y + h, x - w)].map(|p| self.at(p));
        inside(corners)
    }

    /// Distance of a place of the picture from its middle over half its diagonal.
    pub fn height(&self, at: Position) -> f64 {
        let size = self.picture.size();
        let middle = ((size.height as f64 - 1.0) / 2.0, (size.width as f64 - 1.0) / 2.0);
        (at.0 - middle.0).hypot(at.1 - middle.1) / ((size.height as f64).hypot(size.width as f64) / 2.0)
    }
}

/// The square of pixels within `half` of a place, as far as it is in a picture of `size`.
pub fn square(at: Position, half: f64, size: Size) -> Rect {
    let (y, x) = ((at.0 - half).round() as i64, (at.1 - half).round() as i64);
    let side = (2.0 * half).round() as usize + 1;
    Rect::new(y, x, side, side).intersect(size.rect())
}

/// A rectangle of whole pixels inside a quadrilateral that is nearly one.
fn inside(corners: [Position; 4]) -> Rect {
    let sorted = |of: &dyn Fn(&Position) -> f64| {
        let mut all = [of(&corners[0]), of(&corners[1]), of(&corners[2]), of(&corners[3])];
        all.sort_by(f64::total_cmp);
        (all[1].ceil() as i64, all[2].floor() as i64)
    };
    let ((top, bottom), (left, right)) = (sorted(&|p| p.0), sorted(&|p| p.1));
    let count = |a: i64, b: i64| (b - a + 1).max(0) as usize;
    Rect::new(top, left, count(top, bottom), count(left, right))
}

/// Middles of the corner pixels, clockwise from the top left.
fn corners_of(size: Size) -> [Position; 4] {
    let (bottom, right) = (size.height as f64 - 1.0, size.width as f64 - 1.0);
    [(0.0, 0.0), (0.0, right), (bottom, right), (bottom, 0.0)]
}

/// The chart of a text, of the size of the picture unless it has its own.
fn chart(text: &str, size: Size) -> Result<Generator> {
    let mut spec: ChartSpec = text.parse().map_err(|e| usage(format!("--chart {text}: {e}")))?;
    let settings = text.split_once('?').map_or("", |(_, settings)| settings);
    if !settings.split('&').any(|setting| setting.starts_with("size=")) {
        spec.film = size;
    }
    Generator::new(spec).map_err(|e| usage(format!("--chart {text}: {e}")))
}

/// The fiducials of a picture, which is reduced to means of squares if it is large.
fn fiducials(picture: &Picture) -> Result<[Position; 4]> {
    let size = picture.size();
    let by = (1..).find(|by| size.pixels() / (by * by) <= SEARCH_PIXELS).unwrap_or(1);
    let small = Size::new(size.height / by, size.width / by);
    let mut luma = vec![0.0f32; small.pixels()];
    for (row, to) in luma.chunks_exact_mut(small.width).enumerate() {
        let lines = picture.luminance(Rect::new((row * by) as i64, 0, by, small.width * by))?;
        for line in lines.chunks_exact(small.width * by) {
            for (to, part) in std::iter::zip(&mut *to, line.chunks_exact(by)) {
                *to += part.iter().sum::<f32>() / (by * by) as f32;
            }
        }
    }
    let found = fiducial::find(&luma, small)?;
    let middle = (by as f64 - 1.0) / 2.0;
    Ok(found.map(|(y, x)| (y * by as f64 + middle, x * by as f64 + middle)))
}
