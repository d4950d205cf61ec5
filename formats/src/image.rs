//! Decoders of image files: PNG and TIFF row by row, JPEG and WebP as a whole. OpenEXR files are decoded by [`crate::chart::exr`].
//!
//! | file | supported samples | memory |
//! |---|---|---|
//! | PNG (ISO/IEC 15948) | grey, RGB or palette of up to 16 bits, not interlaced | one row |
//! | JPEG, WebP | grey or RGB of 8 bits | four times the image, at most 1 GiB |
//! | TIFF 6.0, BigTIFF | grey or RGB of 8 or 16 bits, strips or tiles, chunky | one row if uncompressed, else a row of strips or tiles |
//!
//! Headers are checked before memory is allocated, decoders are limited to 256 MiB, and a decoder that panics is an error of the file.
//! An alpha channel is dropped if it is opaque everywhere (PNG, WebP), else an error: the background is unknown. Not supported: colour profiles and gamma chunks (reported as a
//! note), further pages of a TIFF, other colour models.

pub(crate) mod gdal;
pub(crate) mod header;
pub(crate) mod png;
pub(crate) mod tiff;
pub(crate) mod tiff_bands;
pub(crate) mod whole;
