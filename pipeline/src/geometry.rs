//! Coordinates: pixels of film and chart, rectangles of pixels, millimetres on the film.
//!
//! Film and chart are images: row y grows DOWN, column x grows RIGHT, upright as the viewer sees them, pixel centres
//! at integers. A film pixel (y, x) lies at
//! ```text
//! X = (x − cx)·pitch,  Y = (y − cy)·pitch   (mm),   r = hypot(X, Y) = its REAL image height,
//! azimuth θ = atan2(Y, X):  0 on +x, 90° DOWN,
//! ```
//! where (cy, cx) is the optical axis in film pixels, by default the middle ((H−1)/2, (W−1)/2). The chart lies on the
//! IDEAL (undistorted) image plane, or, of a scene made so, where the lens puts each direction on the film ([`Projection`]): one chart pixel covers `scale` film
//! pixels, and the chart's centre lies `center_mm` from the axis.

use crate::projection::Projection;
use crate::real;

/// Height and width of an image in pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Size {
    /// Rows.
    pub height: usize,
    /// Columns.
    pub width: usize,
}

impl Size {
    /// An image of `height` rows and `width` columns.
    pub const fn new(height: usize, width: usize) -> Self {
        Self { height, width }
    }

    /// Number of pixels.
    pub const fn pixels(self) -> usize {
        self.height * self.width
    }

    /// The complete image as a rectangle.
    pub const fn rect(self) -> Rect {
        Rect::new(0, 0, self.height, self.width)
    }
}

impl std::fmt::Display for Size {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}x{}", self.width, self.height)
    }
}

/// A rectangle of pixels, possibly outside the image (margins, surround).
///
/// ```
/// use lenscube_pipeline::geometry::Rect;
///
/// let tile = Rect::new(0, 0, 512, 512);
/// let with_margin = tile.grown(25);
/// assert_eq!(with_margin, Rect::new(-25, -25, 562, 562));
/// assert_eq!(with_margin.intersect(Rect::new(0, 0, 600, 530)), Rect::new(0, 0, 537, 530));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Rect {
    /// First row.
    pub y: i64,
    /// First column.
    pub x: i64,
    /// Rows.
    pub height: usize,
    /// Columns.
    pub width: usize,
}

impl Rect {
    /// The rectangle of `height` × `width` pixels whose first pixel is (y, x).
    pub const fn new(y: i64, x: i64, height: usize, width: usize) -> Self {
        Self { y, x, height, width }
    }

    /// One past the last row.
    pub const fn bottom(self) -> i64 {
        self.y + self.height as i64
    }

    /// One past the last column.
    pub const fn right(self) -> i64 {
        self.x + self.width as i64
    }

    /// Height and width.
    pub const fn size(self) -> Size {
        Size::new(self.height, self.width)
    }

    /// Whether it contains no pixel.
    pub const fn is_empty(self) -> bool {
        self.height == 0 || self.width == 0
    }

    /// Grown by `margin` pixels on every side.
    pub const fn grown(self, margin: usize) -> Self {
        let m = margin as i64;
        Self::new(self.y - m, self.x - m, self.height + 2 * margin, self.width + 2 * margin)
    }

    /// The intersection with `other`; empty if there is none.
    pub fn intersect(self, other: Self) -> Self {
        let (y, x) = (self.y.max(other.y), self.x.max(other.x));
        let bottom = self.bottom().min(other.bottom()).max(y);
        let right = self.right().min(other.right()).max(x);
        Self::new(y, x, (bottom - y) as usize, (right - x) as usize)
    }

    /// Whether `other` lies entirely inside.
    pub const fn contains(self, other: Self) -> bool {
        other.y >= self.y
            && other.x >= self.x
            && other.bottom() <= self.bottom()
            && other.right() <= self.right()
    }

    /// Divides it into rectangles of at most `height` × `width`, row by row from its origin.
    pub fn tiles(self, height: usize, width: usize) -> impl Iterator<Item = Rect> {
        (0..self.height.div_ceil(height)).flat_map(move |i| {
            (0..self.width.div_ceil(width)).map(move |j| {
                let (y, x) = (i * height, j * width);
                Rect::new(
                    self.y + y as i64,
                    self.x + x as i64,
                    height.min(self.height - y),
                    width.min(self.width - x),
                )
            })
        })
    }
}

impl std::fmt::Display for Rect {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}x{} at x {}, y {}", self.width, self.height, self.x, self.y)
    }
}

/// Relative positions of film, lens and chart.
///
/// ```
/// use lenscube_pipeline::geometry::{Frame, Size};
///
/// // A film of 14141 x 14141 px of 2 µm with the chart's pixels one to one.
/// let size = Size::new(14141, 14141);
/// let frame = Frame::centred(size, size, 2.0);
/// assert_eq!(frame.axis_px, (7070.0, 7070.0));
/// // Its corner lies 20 mm from the axis.
/// assert!((frame.farthest_mm(size.rect()) - 19.997).abs() < 1e-3);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame {
    /// Film size in pixels.
    pub film: Size,
    /// Film pixel pitch in µm.
    pub pitch_um: f64,
    /// Optical axis (row, column) in film pixels; may be fractional or outside the film.
    pub axis_px: (f64, f64),
    /// Chart size in pixels.
    pub chart: Size,
    /// Film pixels per chart pixel, (y, x).
    pub scale: (f64, f64),
    /// Chart centre (Y, X) on the chart's plane, in mm from the axis.
    pub center_mm: (f64, f64),
    /// The chart's plane.
    pub projection: Projection,
}

impl Frame {
    /// Axis in the middle of the film, chart centred, scale 1.
    pub fn centred(film: Size, chart: Size, pitch_um: f64) -> Self {
        Self {
            film,
            pitch_um,
            axis_px: ((film.height as f64 - 1.0) / 2.0, (film.width as f64 - 1.0) / 2.0),
            chart,
            scale: (1.0, 1.0),
            center_mm: (0.0, 0.0),
            projection: Projection::Planar,
        }
    }

    /// Film pixel pitch in mm.
    pub fn pitch_mm(&self) -> f64 {
        self.pitch_um * 1e-3
    }

    /// The largest REAL image height in mm among the pixel centres of `rect` (film pixels).
    pub fn farthest_mm(&self, rect: Rect) -> f64 {
        let far = |first: i64, end: i64, axis: f64| {
            (first as f64 - axis).abs().max(((end - 1) as f64 - axis).abs())
        };
        let dy = far(rect.y, rect.bottom(), self.axis_px.0);
        let dx = far(rect.x, rect.right(), self.axis_px.1);
        real::hypot(dy, dx) * self.pitch_mm()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tiles_cover_each_pixel_once() {
        let rect = Rect::new(-3, 5, 10, 7);
        let mut seen = vec![0; rect.size().pixels()];
        for t in rect.tiles(4, 3) {
            assert!(rect.contains(t));
            for y in t.y..t.bottom() {
                for x in t.x..t.right() {
                    seen[(y - rect.y) as usize * 7 + (x - rect.x) as usize] += 1;
                }
            }
        }
        assert!(seen.iter().all(|&n| n == 1));
    }

    #[test]
    fn disjoint_rectangles_have_an_empty_intersection_and_overlapping_ones_their_overlap() {
        let a = Rect::new(0, 0, 4, 4);
        assert!(a.intersect(Rect::new(4, 0, 2, 2)).is_empty());
        assert_eq!(a.intersect(Rect::new(2, -1, 9, 3)), Rect::new(2, 0, 2, 2));
    }

    #[test]
    fn corner_is_the_farthest_pixel() {
        let f = Frame::centred(Size::new(3, 5), Size::new(3, 5), 1000.0);
        assert!((f.farthest_mm(f.film.rect()) - 1f64.hypot(2.0)).abs() < 1e-15);
    }
}
