//! An RGB image in memory: sRGB-encoded bytes, rows downwards.

use std::io::Write;
use std::path::Path;

use super::PictureError;
use super::file::{Samples, png_file};
use crate::durable::AtomicFile;
use pipeline::geometry::Size;

pub use super::style::Rgb;

/// An image of 8-bit sRGB pixels.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Image {
    size: Size,
    pixels: Vec<Rgb>,
}

impl Image {
    /// An image of one colour.
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

    /// Writes a PNG with an sRGB chunk and `comment` as text, atomically.
    ///
    /// # Errors
    /// The file cannot be written, or the image has no pixels.
    pub fn write_png(&self, path: &Path, comment: &str) -> Result<(), PictureError> {
        Ok(self.png_file(path, comment)?.finish()?)
    }

    /// As [`Image::write_png`], but the file appears when [`AtomicFile::finish`] is called.
    ///
    /// # Errors
    /// As [`Image::write_png`].
    pub fn png_file(&self, path: &Path, comment: &str) -> Result<AtomicFile, PictureError> {
        let write = |source| PictureError::Write { path: path.to_owned(), source };
        let fill = |out: &mut (dyn Write + Send)| out.write_all(self.pixels.as_flattened()).map_err(write);
        Ok(png_file(path, self.size, Samples::Srgb8, comment, fill)?.0)
    }

    /// The bytes of a PNG with an sRGB chunk and `comment` as text, at the fastest compression.
    pub fn to_quick_png(&self, comment: &str) -> Vec<u8> {
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, self.size.width as u32, self.size.height as u32);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        encoder.set_source_srgb(png::SrgbRenderingIntent::RelativeColorimetric);
        encoder.set_compression(png::Compression::Fast);
        // Writing to memory cannot fail, and all comments are Latin-1.
        let text = encoder.add_text_chunk("Comment".into(), comment.into());
        let written = text
            .and_then(|()| encoder.write_header())
            .and_then(|mut w| w.write_image_data(self.pixels.as_flattened()));
        written.expect("an image in memory can be encoded");
        bytes
    }
}
