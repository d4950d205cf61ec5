//! Charts with one kind of target each.

use super::coverage::{Disc, Polygon};
use super::drawing::{Drawing, EdgeSite, PatchColour};
use super::error::ChartError;
use super::picture::Shape;
use super::sine_star::{SineStar, StarProfile, StarSite};
use crate::real;

/// Shape of an isolated point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PointShape {
    /// Width = full width at half maximum.
    Gaussian,
    /// Width = diameter.
    Disc,
}

/// Places of slanted edges.
#[derive(Clone, Debug, PartialEq)]
pub enum EdgePlaces {
    /// In the middle of each of n × n equal parts of the film.
    Grid(usize),
    /// (row, column) in film pixels.
    Centres(Vec<(f64, f64)>),
}

/// Reflectance of white matt paper.
pub(super) const PAPER: f64 = 0.90;
/// Steps of an OECF grey scale (ISO 14524).
const GREY_STEPS: usize = 20;
/// Radiance of a lamp over that of paper.
const LAMP: f64 = 1e6;
/// Reflectance of black ink.
pub(super) const INK: f64 = 0.03;

impl Drawing {
    /// A uniform radiance.
    pub(super) fn uniform(&mut self, value: f64) {
        self.inks.radiance(value);
    }

    /// White points on perfect black, `count` × `count`, the outermost ones near the film's corners.
    pub(super) fn points(
        &mut self,
        count: usize,
        shape: PointShape,
        width_px: f64,
    ) -> Result<(), ChartError> {
        let black = self.inks.grey(0.0);
        debug_assert_eq!(black, 0);
        let white = self.inks.grey(PAPER);
        let (ys, xs) = self.lattice("points", count, width_px)?;
        for &row in &ys {
            for &column in &xs {
                let at = self.at(row, column);
                match shape {
                    // FWHM = 2√(2 ln 2)·σ
                    PointShape::Gaussian => self.picture.gaussian(at, width_px / 2.354_820_045, white),
                    PointShape::Disc => self.disc(at, width_px / 2.0, white),
                }
                self.note_point(at);
            }
        }
        Ok(())
    }

    /// Dark discs on paper, `count` × `count`, the outermost ones near the film's corners.
    pub(super) fn dot_grid(&mut self, count: usize, width_px: f64) -> Result<(), ChartError> {
        self.inks.grey(PAPER);
        let dark = self.inks.grey(INK);
        let (ys, xs) = self.lattice("dots", count, width_px)?;
        for &row in &ys {
            for &column in &xs {
                let at = self.at(row, column);
                self.disc(at, width_px / 2.0, dark);
                self.note_point(at);
            }
        }
        Ok(())
    }

    /// Perfectly black discs on paper, `along` × `along`, in the middle of equal parts of the film; their diameter over the film's height.
    pub(super) fn black_spots(&mut self, along: usize, diameter: f64) -> Result<(), ChartError> {
        self.inks.grey(PAPER);
        let black = self.inks.grey(0.0);
        let (height, width, n) = (self.film.height as f64, self.film.width as f64, along as f64);
        let (diameter_px, spacing_px) = (diameter * height, height.min(width) / n);
        // White around each disc is as wide as the disc.
        if spacing_px < 2.0 * diameter_px {
            let needed_px = 2.0 * diameter_px;
            return Err(ChartError::Crowded { what: "black spots", count: along, spacing_px, needed_px });
        }
        let middle = |i: usize, length: f64| (i as f64 + 0.5) * length / n - 0.5;
        for (i, j) in (0..along).flat_map(|i| (0..along).map(move |j| (i, j))) {
            let at = self.at(middle(i, height), middle(j, width));
            self.disc(at, diameter_px / 2.0, black);
            self.note_point(at);
        }
        Ok(())
    }

    /// A disc of [`LAMP`] times the radiance of the paper.
    pub(super) fn lamp(&mut self, radius_px: f64, column: Option<f64>, row: Option<f64>) {
        self.inks.grey(PAPER);
        let bright = self.inks.grey(LAMP * PAPER);
        let middle = |n: usize| (n as f64 - 1.0) / 2.0;
        let (row, column) = (
            row.unwrap_or_else(|| middle(self.film.height)),
            column.unwrap_or_else(|| middle(self.film.width)),
        );
        let at = self.at(row, column);
        self.disc(at, radius_px, bright);
        self.note_point(at);
    }

    /// Rows and columns of `count` × `count` details `width_px` wide, at least two widths from each other and from the film's border.
    fn lattice(
        &self,
        what: &'static str,
        count: usize,
        width_px: f64,
    ) -> Result<(Vec<f64>, Vec<f64>), ChartError> {
        let (rows, columns) = (self.film.height, self.film.width);
        let margin = (0.02 * rows.min(columns) as f64).max(2.0 * width_px);
        let (ys, xs) = (spread(rows, count, margin), spread(columns, count, margin));
        for places in [&ys, &xs] {
            if let Some(w) = places.windows(2).find(|w| w[1] - w[0] < 2.0 * width_px) {
                let (spacing_px, needed_px) = ((w[1] - w[0]).max(0.0), 2.0 * width_px);
                return Err(ChartError::Crowded { what, count, spacing_px, needed_px });
            }
        }
        Ok((ys, xs))
    }

    /// Dark squares on paper, rotated by `angle_deg`, in the middle of each of `grid` × `grid` equal parts of the film: half a part
    /// wide, so that an edge is at least a quarter of a part from any other detail.
    pub(super) fn esfr(&mut self, angle_deg: f64, contrast: f64, grid: usize) -> Result<(), ChartError> {
        self.inks.grey(PAPER);
        let dark = self.inks.grey(PAPER / contrast);
        let (height, width, n) = (self.film.height as f64, self.film.width as f64, grid as f64);
        let spacing_px = height.min(width) / n;
        // Edges shorter than 16 px are too short to measure.
        if spacing_px < 32.0 {
            return Err(ChartError::Crowded {
                what: "slanted squares",
                count: grid,
                spacing_px,
                needed_px: 32.0,
            });
        }
        let half = spacing_px / 4.0;
        for i in 0..grid {
            for j in 0..grid {
                let (row, column) = ((i as f64 + 0.5) * height / n - 0.5, (j as f64 + 0.5) * width / n - 0.5);
                let square = Polygon::rotated(self.at(row, column), [half, half], angle_deg.to_radians());
                self.picture.add(Shape::Polygons(vec![square], None), dark);
                for side in [0.0, 90.0, 180.0, -90.0] {
                    let out_deg = angle_deg + side;
                    let side_deg = if out_deg > 180.0 { out_deg - 360.0 } else { out_deg };
                    let (sin, cos) = real::sin_cos(side_deg.to_radians());
                    let centre_px = (row + half * sin, column + half * cos);
                    let [x, y] = self.at(centre_px.0, centre_px.1);
                    // Half as wide as the edge is long, without the corners.
                    let h = half / 2.0;
                    let patch = self.film_rect([x - h, y - h, x + h, y + h]).intersect(self.film.rect());
                    self.edges.push(EdgeSite { centre_px, angle_deg: side_deg, patch });
                }
            }
        }
        self.grey_steps(spacing_px);
        Ok(())
    }

    /// A row of steps from ink to paper, equal in density, above the first squares, where a quarter of a part (`spacing_px`) is clear.
    /// They measure the film's response (OECF, ISO 14524). Corner marks are beside them.
    fn grey_steps(&mut self, spacing_px: f64) {
        let inset = self.corner_px[0];
        let [x0, y0] = self.at(-0.5, -0.5 + inset);
        let step = (self.film.width as f64 - 2.0 * inset) / GREY_STEPS as f64;
        let top = y0 + 0.02 * spacing_px;
        for i in 0..GREY_STEPS {
            let share = i as f64 / (GREY_STEPS - 1) as f64;
            let grey = PatchColour::Grey(INK * real::pow(PAPER / INK, share));
            let left = x0 + i as f64 * step;
            self.patch([left, top, left + step, top + 0.1 * spacing_px], grey);
        }
    }

    /// Dark half-planes, each clipped to its patch; a single edge without a patch size crosses the complete chart.
    pub(super) fn slanted_edges(
        &mut self,
        angle_deg: f64,
        contrast: f64,
        places: &EdgePlaces,
        patch_px: Option<usize>,
    ) -> Result<(), ChartError> {
        self.inks.grey(PAPER);
        let dark = self.inks.grey(PAPER / contrast);
        let (height, width) = (self.film.height as f64, self.film.width as f64);
        let (centres, spacing) = match places {
            EdgePlaces::Grid(n) => {
                let line = |length: f64| (0..*n).map(move |i| (i as f64 + 0.5) * length / *n as f64 - 0.5);
                (
                    line(height).flat_map(|y| line(width).map(move |x| (y, x))).collect(),
                    height.min(width) / *n as f64,
                )
            }
            EdgePlaces::Centres(list) => (list.clone(), closest(list).min(height.min(width))),
        };
        let single = centres.len() == 1;
        let patch = patch_px.map_or(0.6 * spacing, |p| p as f64);
        if !single && spacing < patch + 2.0 {
            let (count, needed_px) = (centres.len(), patch + 2.0);
            return Err(ChartError::Crowded { what: "edge patches", count, spacing_px: spacing, needed_px });
        }
        let (sin, cos) = real::sin_cos(angle_deg.to_radians());
        let chart = self.chart();
        for (row, column) in centres {
            let [x, y] = self.at(row, column);
            let bounds = if single && patch_px.is_none() {
                [-0.5, -0.5, chart.width as f64 - 0.5, chart.height as f64 - 0.5]
            } else {
                let h = patch / 2.0;
                [x - h, y - h, x + h, y + h].map(super::drawing::snap)
            };
            let half_plane = Polygon::rectangle(bounds[0], bounds[1], bounds[2], bounds[3])
                .clipped([cos, sin], x * cos + y * sin);
            self.picture.add(Shape::Polygons(vec![half_plane], None), dark);
            let patch = self.film_rect(bounds).intersect(self.film.rect());
            self.edges.push(EdgeSite { centre_px: (row, column), angle_deg, patch });
        }
        Ok(())
    }

    /// Stars side by side, `grid` × `grid`.
    pub(super) fn siemens(&mut self, spokes: usize, grid: usize, profile: StarProfile) {
        self.inks.grey(PAPER);
        let dark = self.inks.grey(INK);
        let (height, width, n) = (self.film.height as f64, self.film.width as f64, grid as f64);
        let radius = 0.45 * height.min(width) / n;
        for i in 0..grid {
            for j in 0..grid {
                let centre_px = ((i as f64 + 0.5) * height / n - 0.5, (j as f64 + 0.5) * width / n - 0.5);
                let at = self.at(centre_px.0, centre_px.1);
                match profile {
                    StarProfile::Square => self.star(at, radius, spokes, dark),
                    StarProfile::Sine => {
                        let disc = Disc { centre: at, radius };
                        self.picture.add(Shape::SineStar(SineStar { disc, spokes }), dark);
                    }
                }
                self.stars.push(StarSite { centre_px, radius_px: radius, spokes, profile });
            }
        }
    }

    /// A ColorChecker that fills the film.
    pub(super) fn checker(&mut self) {
        self.inks.grey(INK);
        let (height, width) = (self.film.height as f64, self.film.width as f64);
        let [x0, y0] = self.at(-0.5, -0.5);
        self.checker_in([x0, y0, x0 + width, y0 + height], 0.06);
    }

    /// The 24 patches in 4 rows of 6 within x0..x1, y0..y1, each inset by `gap` of its cell.
    pub(super) fn checker_in(&mut self, [x0, y0, x1, y1]: [f64; 4], gap: f64) {
        let (w, h) = ((x1 - x0) / 6.0, (y1 - y0) / 4.0);
        let inset = gap * w.min(h);
        for patch in 0..24 {
            let (left, top) = (x0 + (patch % 6) as f64 * w, y0 + (patch / 6) as f64 * h);
            let place = [left + inset, top + inset, left + w - inset, top + h - inset];
            self.patch(place, PatchColour::Checker(patch));
        }
    }
}

/// `count` integer places along `length` pixels, evenly from `margin` off one end to the same off the other.
fn spread(length: usize, count: usize, margin: f64) -> Vec<f64> {
    let last = length as f64 - 1.0;
    let margin = margin.min(last / 2.0);
    let place = |i: usize| match count {
        1 => last / 2.0,
        n => margin + (last - 2.0 * margin) * i as f64 / (n - 1) as f64,
    };
    (0..count).map(|i| place(i).round()).collect()
}

/// Minimum over all pairs of places of the larger of their row and column distances.
fn closest(places: &[(f64, f64)]) -> f64 {
    let pairs = places.iter().enumerate().flat_map(|(i, a)| places[..i].iter().map(move |b| (a, b)));
    pairs.map(|(a, b)| (a.0 - b.0).abs().max((a.1 - b.1).abs())).fold(f64::INFINITY, f64::min)
}
