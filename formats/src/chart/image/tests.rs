//! Images of every supported kind decode to their samples; unsupported, truncated and inconsistent files are errors.

mod decoded;
mod refusals;

use super::*;
use ::png::{BitDepth, ColorType};
use ::tiff::encoder::{Compression, TiffEncoder, colortype};
use std::fs;

const SIZE: Size = Size::new(11, 17);

fn sample(row: usize, column: usize, channel: usize, white: usize) -> u16 {
    ((row * 5471 + column * 919 + channel * 29) * 37 % (white + 1)) as u16
}

fn samples(channels: usize, white: usize) -> Vec<u16> {
    let row = |y| (0..SIZE.width).flat_map(move |x| (0..channels).map(move |c| sample(y, x, c, white)));
    (0..SIZE.height).flat_map(row).collect()
}

fn png(colour: ColorType, depth: BitDepth, data: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = ::png::Encoder::new(&mut bytes, SIZE.width as u32, SIZE.height as u32);
    encoder.set_color(colour);
    encoder.set_depth(depth);
    if colour == ColorType::Indexed {
        encoder.set_palette((0..=255u8).flat_map(|i| [i, 255 - i, i / 2]).collect::<Vec<u8>>());
    }
    encoder.write_header().unwrap().write_image_data(data).unwrap();
    bytes
}

fn to_u8(v: &[u16]) -> Vec<u8> {
    v.iter().map(|&v| v as u8).collect()
}

fn tiff<C: colortype::ColorType>(big: bool, packing: Compression, rows: u32, data: &[C::Inner]) -> Vec<u8>
where
    [C::Inner]: ::tiff::encoder::TiffValue,
{
    let mut bytes = std::io::Cursor::new(Vec::new());
    let (w, h) = (SIZE.width as u32, SIZE.height as u32);
    macro_rules! put {
        ($encoder:expr) => {{
            let mut encoder = $encoder.unwrap().with_compression(packing);
            let mut image = encoder.new_image::<C>(w, h).unwrap();
            image.rows_per_strip(rows).unwrap();
            image.write_data(data).unwrap();
        }};
    }
    match big {
        true => put!(TiffEncoder::new_big(&mut bytes)),
        false => put!(TiffEncoder::new(&mut bytes)),
    }
    bytes.into_inner()
}

fn exr(channels: &[(&str, bool)]) -> Vec<u8> {
    exr_of_alpha(channels, 1.0)
}

fn exr_of_alpha(channels: &[(&str, bool)], alpha: f32) -> Vec<u8> {
    use ::exr::prelude::*;
    let list = channels.iter().map(|(name, half)| {
        let is_alpha = name.rsplit('.').next() == Some("A");
        let values = (0..SIZE.pixels()).map(move |i| if is_alpha { alpha } else { i as f32 * 0.37 - 1.0 });
        let data = match half {
            true => FlatSamples::F16(values.map(half::f16::from_f32).collect()),
            false => FlatSamples::F32(values.collect()),
        };
        AnyChannel::new(*name, data)
    });
    let layer = Layer::new(
        (SIZE.width, SIZE.height),
        LayerAttributes::default(),
        Encoding::SMALL_LOSSLESS,
        AnyChannels::sort(list.collect()),
    );
    let mut bytes = std::io::Cursor::new(Vec::new());
    Image::from_layer(layer).write().non_parallel().to_buffered(&mut bytes).unwrap();
    bytes.into_inner()
}

/// A directory for one image file.
struct Directory(tempfile::TempDir);

impl Directory {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn open(&self, bytes: &[u8]) -> Result<ImageFile, ChartError> {
        let path = self.0.path().join("a.picture");
        fs::write(&path, bytes).unwrap();
        ImageFile::open(&path)
    }

    /// All samples, channel after channel.
    fn linear(&self, bytes: &[u8]) -> Result<Vec<Vec<f32>>, ChartError> {
        let file = self.open(bytes)?;
        assert_eq!(file.size(), SIZE);
        let channels = if file.is_grey() { 1 } else { 3 };
        let source = file.linear(Transfer::Linear, self.0.path(), 2, &|_, _| ())?;
        let read = |c| {
            let mut out = vec![f32::NAN; SIZE.pixels()];
            source
                .read(c, SIZE.rect(), &mut out)
                .map(|()| out)
                .map_err(|e| *e.downcast::<ChartError>().unwrap())
        };
        (0..channels).map(read).collect()
    }

    fn decode(&self, bytes: &[u8]) -> Result<(), ChartError> {
        self.open(bytes)?.linear(Transfer::Srgb, self.0.path(), 1, &|_, _| ()).map(|_| ())
    }

    fn assert_rejected(&self, bytes: &[u8], expected: &str) {
        let error = self.linear(bytes).map(|_| ()).unwrap_err().to_string();
        assert!(error.contains(expected) && error.contains("a.picture"), "`{expected}` is not in: {error}");
        assert!(fs::read_dir(self.0.path()).unwrap().count() <= 1, "leftover temporary file");
    }
}

fn fixture(name: &str) -> std::path::PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/pictures/colour").join(name)
}
