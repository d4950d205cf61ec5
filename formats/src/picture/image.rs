//! An RGB picture in memory: sRGB-encoded bytes, rows downwards.

use std::path::Path;

use super::PictureError;
use super::file::{Samples, png_file};
use crate::durable::WholeFile;
use pipeline::geometry::Size;

pub use super::style::Rgb;

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
        Ok(self.png_file(path, comment)?.finish()?)
    }

    /// As [`Image::write_png`], a file that has not got its name yet.
    ///
    /// # Errors
    /// As [`Image::write_png`].
    pub fn png_file(&self, path: &Path, comment: &str) -> Result<WholeFile, PictureError> {
        let (whole, ()) = png_file(path, self.size, Samples::Srgb8, comment, |out| {
            out.write_all(self.pixels.as_flattened())
                .map_err(|source| PictureError::Write { path: path.to_owned(), source })
        })?;
        Ok(whole)
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
}
