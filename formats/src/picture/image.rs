//! An RGB picture in memory, and the few things that are drawn on it.
//!
//! Samples are sRGB-encoded bytes, rows downwards. Shapes are blended in encoded values: what matters for thin lines
//! on paper is that they look even, not that they add light. Text is the 5 × 7 letters of the charts' legends.

use std::path::Path;

use super::PictureError;
use super::file::{Samples, write_png};
use pipeline::chart::glyphs;
use pipeline::geometry::Size;

/// A colour, sRGB-encoded.
pub type Rgb = [u8; 3];

/// A picture of 8-bit sRGB pixels.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Image {
    size: Size,
    pixels: Vec<Rgb>,
}

impl Image {
    /// A picture of one colour.
    pub fn new(size: Size, colour: Rgb) -> Self {
        Self { size, pixels: vec![colour; size.pixels()] }
    }

    /// Height and width.
    pub const fn size(&self) -> Size {
        self.size
    }

    /// The pixel of row `y` and column `x`.
    pub fn pixel(&self, y: usize, x: usize) -> Rgb {
        self.pixels[y * self.size.width + x]
    }

    /// All pixels, row by row.
    pub fn pixels(&self) -> &[Rgb] {
        &self.pixels
    }

    /// Row `y`.
    pub fn row_mut(&mut self, y: usize) -> &mut [Rgb] {
        &mut self.pixels[y * self.size.width..][..self.size.width]
    }

    /// Writes it as PNG with an sRGB chunk and `comment` as text, whole or not at all.
    ///
    /// # Errors
    /// If the file cannot be written, or the picture has no pixels.
    pub fn write_png(&self, path: &Path, comment: &str) -> Result<(), PictureError> {
        write_png(path, self.size, Samples::Srgb8, comment, |out| {
            out.write_all(self.pixels.as_flattened())
                .map_err(|source| PictureError::Write { path: path.to_owned(), source })
        })
    }

    /// It as the bytes of a PNG.
    pub fn to_png(&self) -> Vec<u8> {
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, self.size.width as u32, self.size.height as u32);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        // Memory takes whatever comes.
        let written = encoder.write_header().and_then(|mut w| w.write_image_data(self.pixels.as_flattened()));
        written.expect("a picture in memory can be encoded");
        bytes
    }

    /// It as the bytes of a PNG with an sRGB chunk and `comment` as text, encoded in the least time: for pictures that are
    /// looked at once.
    pub fn to_quick_png(&self, comment: &str) -> Vec<u8> {
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, self.size.width as u32, self.size.height as u32);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        encoder.set_source_srgb(png::SrgbRenderingIntent::RelativeColorimetric);
        encoder.set_compression(png::Compression::Fast);
        // Memory takes whatever comes, and words of ours are Latin-1.
        let text = encoder.add_text_chunk("Comment".into(), comment.into());
        let written = text
            .and_then(|()| encoder.write_header())
            .and_then(|mut w| w.write_image_data(self.pixels.as_flattened()));
        written.expect("a picture in memory can be encoded");
        bytes
    }

    /// Fills the shape with corners (x, y): the pixels whose centre lies inside, by the even-odd rule.
    pub fn area(&mut self, corners: &[(f64, f64)], colour: Rgb) {
        for y in 0..self.size.height {
            let at = y as f64;
            let edges = (0..corners.len()).map(|i| (corners[i], corners[(i + 1) % corners.len()]));
            let mut crossings: Vec<f64> = edges
                .filter(|(a, b)| (a.1 <= at) != (b.1 <= at))
                .map(|(a, b)| a.0 + (at - a.1) / (b.1 - a.1) * (b.0 - a.0))
                .collect();
            crossings.sort_by(f64::total_cmp);
            for pair in crossings.chunks_exact(2) {
                let (left, right) = (pair[0].ceil() as i64, pair[1].ceil() as i64);
                self.fill((y as i64, left), Size::new(1, (right - left).max(0) as usize), colour);
            }
        }
    }

    /// Fills the rectangle of `size` at (y, x), as far as it lies on the picture.
    pub fn fill(&mut self, (y, x): (i64, i64), size: Size, colour: Rgb) {
        let bound = |v: i64, most: usize| v.clamp(0, most as i64) as usize;
        let (left, right) = (bound(x, self.size.width), bound(x + size.width as i64, self.size.width));
        for y in bound(y, self.size.height)..bound(y + size.height as i64, self.size.height) {
            self.row_mut(y)[left..right].fill(colour);
        }
    }

    /// Lays another picture at (y, x), every pixel enlarged to a square of `enlarge`.
    pub fn lay(&mut self, (y, x): (usize, usize), other: &Self, enlarge: usize) {
        for (i, &colour) in other.pixels.iter().enumerate() {
            let (row, column) = (i / other.size.width, i % other.size.width);
            let at = ((y + row * enlarge) as i64, (x + column * enlarge) as i64);
            self.fill(at, Size::new(enlarge, enlarge), colour);
        }
    }

    /// Writes a line of text with its top left at (y, x), dots of `dot` pixels.
    pub fn text(&mut self, (y, x): (i64, i64), text: &str, dot: usize, colour: Rgb) {
        for (row, first, end) in glyphs::runs(text) {
            let at = (y + (row * dot) as i64, x + (first * dot) as i64);
            self.fill(at, Size::new(dot, (end - first) * dot), colour);
        }
    }

    /// Writes a line of text upwards, with the top left of its first letter at (y, x): bottom left of the turned line.
    pub fn text_up(&mut self, (y, x): (i64, i64), text: &str, dot: usize, colour: Rgb) {
        for (row, first, end) in glyphs::runs(text) {
            let at = (y - (end * dot) as i64, x + (row * dot) as i64);
            self.fill(at, Size::new((end - first) * dot, dot), colour);
        }
    }

    /// Draws a line through points (x, y) in pixels, centres at integers, `width` pixels wide.
    ///
    /// A pixel is covered by as much as a straight edge at its distance from the line would cover; the largest over
    /// all pieces counts, so joints are not darker than the rest.
    pub fn line(&mut self, points: &[(f64, f64)], width: f64, colour: Rgb) {
        let mut coverage = vec![0f32; self.size.pixels()];
        let half = width / 2.0;
        let reach = half + 1.0;
        for piece in points.windows(2) {
            let [a, b] = [piece[0], piece[1]];
            let range = |from: f64, to: f64, most: usize| {
                let most = most as f64;
                let (low, high) = (from.min(to) - reach, from.max(to) + reach + 1.0);
                low.floor().clamp(0.0, most) as usize..high.ceil().clamp(0.0, most) as usize
            };
            for y in range(a.1, b.1, self.size.height) {
                for x in range(a.0, b.0, self.size.width) {
                    let covered = half + 0.5 - distance((x as f64, y as f64), a, b);
                    let most = &mut coverage[y * self.size.width + x];
                    *most = most.max(covered.min(width).clamp(0.0, 1.0) as f32);
                }
            }
        }
        for (pixel, share) in self.pixels.iter_mut().zip(coverage).filter(|(_, share)| *share > 0.0) {
            for (v, c) in pixel.iter_mut().zip(colour) {
                *v = (f32::from(*v) + share * (f32::from(c) - f32::from(*v))).round() as u8;
            }
        }
    }
}

/// Width and height in pixels of a line of text.
pub fn text_size(text: &str, dot: usize) -> Size {
    Size::new(glyphs::HEIGHT * dot, glyphs::width(text) * dot)
}

/// Distance of `p` from the piece of line between `a` and `b`.
fn distance(p: (f64, f64), a: (f64, f64), b: (f64, f64)) -> f64 {
    let (dx, dy) = (b.0 - a.0, b.1 - a.1);
    let length2 = dx * dx + dy * dy;
    let along = if length2 > 0.0 { ((p.0 - a.0) * dx + (p.1 - a.1) * dy) / length2 } else { 0.0 };
    let t = along.clamp(0.0, 1.0);
    (p.0 - a.0 - t * dx).hypot(p.1 - a.1 - t * dy)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_covers_its_own_area() {
        let mut image = Image::new(Size::new(40, 60), [255; 3]);
        image.line(&[(10.0, 20.0), (30.0, 20.0), (50.0, 20.0)], 3.0, [0; 3]);
        let dark: f64 = image.pixels().iter().map(|p| 1.0 - f64::from(p[0]) / 255.0).sum();
        // 40 long, 3 wide, round ends of half width 1.5 at both sides.
        let area = 40.0 * 3.0 + std::f64::consts::PI * 1.5 * 1.5;
        assert!((dark - area).abs() < 0.05 * area, "{dark} for {area}");
        assert_eq!(image.pixel(20, 30), [0; 3]);
        assert_eq!(image.pixel(23, 30), [255; 3]);
    }

    #[test]
    fn text_reads_upwards_when_turned() {
        let (mut across, mut up) =
            (Image::new(Size::new(20, 20), [0; 3]), Image::new(Size::new(20, 20), [0; 3]));
        across.text((3, 2), "Lp", 1, [9; 3]);
        up.text_up((18, 3), "Lp", 1, [9; 3]);
        for y in 0..20 {
            for x in 0..18 {
                // Column c right of the start goes c rows up from row 17.
                let turned = (2..20).contains(&x) && (3..10).contains(&y);
                if turned {
                    assert_eq!(across.pixel(y, x), up.pixel(17 + 2 - x, y), "{y} {x}");
                }
            }
        }
        assert!(across.pixels().iter().filter(|p| p[0] == 9).count() > 15);
    }

    #[test]
    fn what_lies_outside_is_left_out() {
        let mut image = Image::new(Size::new(4, 4), [0; 3]);
        image.fill((-2, 3), Size::new(3, 9), [7; 3]);
        assert_eq!((image.pixel(0, 3), image.pixel(0, 2), image.pixel(1, 3)), ([7; 3], [0; 3], [0; 3]));
        image.text((-3, -9), "MM", 2, [1; 3]);
        image.line(&[(-50.0, -50.0), (50.0, 1e7)], 2.0, [5; 3]);
        image.lay((3, 3), &image.clone(), 2);
    }
}
