//! Developed raws as pictures: PNG and TIFF of 8 or 16 bits, OpenEXR of linear floats.
//!
//! A picture is made in strips of rows, on all threads at once; the caller's function makes the samples of a strip, and the writers encode
//! them on the same thread and append them in order. Memory holds one strip per thread. Files have temporary names until they are complete.

mod exr;
mod png;
pub(crate) mod strips;

pub use exr::write_exr;
pub use png::write_png;
pub use strips::write_tiff;

use std::ops::Range;
use std::path::Path;

use pipeline::geometry::Size;

use crate::export::ExportError;

/// What a picture is.
#[derive(Clone, Copy, Debug)]
pub struct Developed<'a> {
    /// Its file.
    pub path: &'a Path,
    /// Its size in pixels.
    pub size: Size,
    /// 3: red, green, blue; 1: grey.
    pub channels: usize,
    /// Bits of a sample of PNG and TIFF: 8 or 16.
    pub depth: u32,
    /// Whether samples are proportional to light; else encoded by sRGB.
    pub linear: bool,
    /// Text for the header.
    pub comment: &'a str,
    /// Rows that are made together, a multiple of 16.
    pub rows: usize,
    /// Threads; the file is the same for any number.
    pub threads: usize,
}

impl Developed<'_> {
    fn strips(&self) -> usize {
        self.size.height.div_ceil(self.rows)
    }

    fn strip(&self, k: usize) -> Range<usize> {
        k * self.rows..((k + 1) * self.rows).min(self.size.height)
    }

    /// Bytes of a row.
    fn row_bytes(&self) -> usize {
        self.size.width * self.channels * (self.depth as usize / 8)
    }

    fn check(&self, format: &'static str, max_side: usize) -> Result<(), ExportError> {
        match self.size.height.max(self.size.width) <= max_side && self.size.pixels() > 0 {
            true => Ok(()),
            false => Err(ExportError::Format {
                path: self.path.into(),
                what: "side in pixels",
                expected: format!("1 to {max_side} in {format}"),
                found: self.size.to_string(),
            }),
        }
    }
}

#[cfg(test)]
mod tests;
