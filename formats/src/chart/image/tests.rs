//! Images of every supported kind decode to their samples; unsupported, truncated and inconsistent files are errors.

use super::*;
use ::png::{BitDepth, ColorType};
use ::tiff::encoder::{Compression, TiffEncoder, colortype};
use pipeline::geometry::Rect;
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

fn to_be16(v: &[u16]) -> Vec<u8> {
    v.iter().flat_map(|v| v.to_be_bytes()).collect()
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

    fn assert_rejected(&self, bytes: &[u8], expected: &str) {
        let error = self.linear(bytes).map(|_| ()).unwrap_err().to_string();
        assert!(error.contains(expected) && error.contains("a.picture"), "`{expected}` is not in: {error}");
        assert!(fs::read_dir(self.0.path()).unwrap().count() <= 1, "leftover temporary file");
    }
}

/// Channel after channel, white being 1.
fn planes(samples: &[u16], channels: usize, white: f64) -> Vec<Vec<f32>> {
    let of = |c: usize| samples.iter().skip(c).step_by(channels);
    (0..channels).map(|c| of(c).map(|&v| (f64::from(v) / white) as f32).collect()).collect()
}

#[test]
fn integers_are_exact_for_every_format_depth_and_compression() {
    let dir = Directory::new();
    for channels in [1usize, 3] {
        let (few, many) = (samples(channels, 255), samples(channels, 65535));
        let colour = if channels == 1 { ColorType::Grayscale } else { ColorType::Rgb };
        let (eight, sixteen) = (planes(&few, channels, 255.0), planes(&many, channels, 65535.0));
        assert_eq!(dir.linear(&png(colour, BitDepth::Eight, &to_u8(&few))).unwrap(), eight);
        assert_eq!(dir.linear(&png(colour, BitDepth::Sixteen, &to_be16(&many))).unwrap(), sixteen);
        for big in [true, false] {
            for (name, packing) in [
                ("none", Compression::Uncompressed),
                ("LZW", Compression::Lzw),
                ("PackBits", Compression::Packbits),
            ] {
                for rows in [1, 4, 11] {
                    let (a, b) = match channels {
                        1 => (
                            tiff::<colortype::Gray8>(big, packing, rows, &to_u8(&few)),
                            tiff::<colortype::Gray16>(big, packing, rows, &many),
                        ),
                        _ => (
                            tiff::<colortype::RGB8>(big, packing, rows, &to_u8(&few)),
                            tiff::<colortype::RGB16>(big, packing, rows, &many),
                        ),
                    };
                    assert_eq!(dir.linear(&a).unwrap(), eight, "{name}, {big}, {rows}");
                    assert_eq!(dir.linear(&b).unwrap(), sixteen, "{name}, {big}, {rows}");
                }
            }
        }
    }
    let few = samples(1, 255);
    let colours = dir.linear(&png(ColorType::Indexed, BitDepth::Eight, &to_u8(&few))).unwrap();
    assert_eq!(colours[1], planes(&few.iter().map(|v| 255 - v).collect::<Vec<_>>(), 1, 255.0)[0]);
}

fn fixture(name: &str) -> std::path::PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/pictures/colour").join(name)
}

/// Samples as integers, channel after channel, of a file by Pillow.
fn of_pillow(name: &str) -> Result<Vec<Vec<u8>>, ChartError> {
    let dir = tempfile::tempdir().unwrap();
    let file = ImageFile::open(&fixture(name))?;
    let (size, channels) = (file.size(), if file.is_grey() { 1 } else { 3 });
    assert_eq!(size, Size::new(9, 12));
    let source = file.linear(Transfer::Linear, dir.path(), 1, &|_, _| ())?;
    let read = |c| {
        let mut out = vec![0.0; size.pixels()];
        source.read(c, size.rect(), &mut out).unwrap();
        out.iter().map(|v| (v * 255.0).round() as u8).collect()
    };
    Ok((0..channels).map(read).collect())
}

#[test]
fn jpeg_webp_and_opaque_alpha_of_pillow_are_decoded() {
    let value = |c: usize, k: usize| ((60 * c + 5 * (k / 12) + 3 * (k % 12)) % 251) as u8;
    let exact: Vec<Vec<u8>> = (0..3).map(|c| (0..108).map(|k| value(c, k)).collect()).collect();
    for name in [
        "rgb.png",
        "opaque-alpha.png",
        "opaque-alpha.tif",
        "opaque-alpha-deflate.tif",
        "lossless.webp",
        "opaque-alpha.webp",
    ] {
        assert_eq!(of_pillow(name).unwrap(), exact, "{name}");
    }
    // Pillow drops the opaque alpha channel of a WebP.
    let notes = ImageFile::open(&fixture("opaque-alpha.png")).unwrap().notes().join(" ");
    assert!(notes.contains("alpha channel is dropped"), "{notes}");
    for name in ["alpha.png", "alpha.tif", "alpha.webp"] {
        let error = of_pillow(name).unwrap_err().to_string();
        assert!(error.contains("flatten") && error.contains("row 0, column 0"), "{name}: {error}");
    }
    // Pillow's decoder; transforms of other decoders differ by 1 or 2.
    let npy = fs::read(fixture("baseline.jpg.npy")).unwrap();
    let pillow = &npy[npy.len() - 324..];
    for (name, channels) in [("baseline.jpg", 3), ("progressive.jpg", 3), ("grey.jpg", 1)] {
        let found = of_pillow(name).unwrap();
        assert_eq!(found.len(), channels, "{name}");
        for (c, channel) in found.iter().enumerate() {
            for (k, v) in channel.iter().enumerate() {
                let expected = if channels == 3 { pillow[3 * k + c] } else { exact[0][k] };
                assert!(
                    v.abs_diff(expected) <= 3,
                    "{name}, channel {c}, pixel {k}: {v}, expected {expected}"
                );
            }
        }
    }
    let error = of_pillow("cmyk.jpg").unwrap_err().to_string();
    assert!(error.contains("colour"), "{error}");
}

#[test]
fn truncated_jpeg_and_webp_are_errors() {
    let dir = Directory::new();
    for (name, entropy_end) in [("baseline.jpg", 8), ("progressive.jpg", 8), ("lossless.webp", 4)] {
        let complete = fs::read(fixture(name)).unwrap();
        for cut in 0..40 {
            let length = (complete.len() - entropy_end) * cut / 40;
            assert!(dir.decode(&complete[..length]).is_err(), "{name} cut to {length} of {}", complete.len());
        }
    }
}

#[test]
fn jpeg_above_the_limit_is_an_error_before_it_is_allocated() {
    let mut bytes = fs::read(fixture("baseline.jpg")).unwrap();
    let frame = bytes.windows(2).position(|w| w == [0xff, 0xc0]).unwrap();
    bytes[frame + 5..frame + 9].copy_from_slice(&[0xff; 4]);
    Directory::new().assert_rejected(&bytes, "at most 256 MiB");
}

#[test]
fn srgb_samples_are_linearized() {
    let dir = Directory::new();
    let few = samples(1, 255);
    let file = dir.open(&png(ColorType::Grayscale, BitDepth::Eight, &to_u8(&few))).unwrap();
    let source = file.linear(Transfer::Srgb, dir.0.path(), 1, &|_, _| ()).unwrap();
    let mut out = vec![0.0; SIZE.width];
    source.read(0, Rect::new(3, 0, 1, SIZE.width), &mut out).unwrap();
    for (got, v) in out.iter().zip(&few[3 * SIZE.width..][..SIZE.width]) {
        assert_eq!(*got, srgb_decode(f64::from(*v) / 255.0) as f32);
    }
}

#[test]
fn exr_is_linear_and_bit_exact() {
    let dir = Directory::new();
    let expected: Vec<f32> = (0..SIZE.pixels()).map(|i| i as f32 * 0.37 - 1.0).collect();
    let rgb = dir.linear(&exr(&[("R", false), ("G", false), ("B", true)])).unwrap();
    assert_eq!((&rgb[0], &rgb[1]), (&expected, &expected));
    assert_eq!(rgb[2].len(), expected.len());
    assert!(rgb[2].iter().zip(&expected).all(|(a, b)| *a == half::f16::from_f32(*b).to_f32()));
    assert_eq!(dir.linear(&exr(&[("Y", false)])).unwrap(), vec![expected.clone()]);
    let file = dir.open(&exr(&[("T.0,55um", false), ("T.400nm", false), ("R", false)])).unwrap();
    let spectral = file.spectral().unwrap();
    let wavelengths_nm = vec![400.0, 550.0];
    assert_eq!(spectral.content, ExrContent::Spectral { wavelengths_nm, reflective: true });
}

/// About 1 KB whose tiles are 65536 x 65537 px of 12 bytes, on an image of 14 x 9 px.
#[test]
fn exr_tile_above_the_limit_is_an_error_before_it_is_allocated() {
    let bytes = include_bytes!("../../../tests/data/tile-of-51-GB.exr");
    Directory::new().assert_rejected(bytes, "at most 192 MiB");
}

/// CRC-32 of PNG chunks (ISO 3309).
fn crc(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(!0, |crc: u32, &b| {
        (0..8).fold(crc ^ u32::from(b), |c, _| if c & 1 == 1 { c >> 1 ^ 0xedb8_8320 } else { c >> 1 })
    })
}

#[test]
fn unsupported_properties_and_invalid_headers_are_errors() {
    let dir = Directory::new();
    let uniform = |c: usize| vec![7u8; SIZE.pixels() * c];
    for (colour, channels) in [(ColorType::Rgba, 4), (ColorType::GrayscaleAlpha, 2)] {
        dir.assert_rejected(&png(colour, BitDepth::Eight, &uniform(channels)), "flatten the image");
    }
    let valid = png(ColorType::Rgb, BitDepth::Eight, &uniform(3));
    let with_header = |change: &dyn Fn(&mut [u8])| {
        let mut bytes = valid.clone();
        change(&mut bytes[16..29]);
        let sum = crc(&bytes[12..29]);
        bytes[29..33].copy_from_slice(&sum.to_be_bytes());
        bytes
    };
    dir.assert_rejected(&with_header(&|h| h[12] = 1), "interlac");
    for side in
        [0x0000_0000_0000_0011u64, 0x0000_000b_ffff_ffff, 0x7fff_ffff_7fff_ffff, 0x0000_0011_0001_0000]
    {
        let bytes = with_header(&|h| h[0..8].copy_from_slice(&side.to_be_bytes()));
        let error = dir.decode(&bytes).unwrap_err().to_string();
        assert!(error.contains("a.picture"), "{error}");
    }
    let rgba = tiff::<colortype::RGBA8>(false, Compression::Uncompressed, 3, &uniform(4));
    dir.assert_rejected(&rgba, "flatten the image");
    let float = tiff::<colortype::Gray32Float>(true, Compression::Uncompressed, 3, &vec![0.5; SIZE.pixels()]);
    dir.assert_rejected(&float, "8 or 16 bits");
    let four = tiff::<colortype::CMYK8>(false, Compression::Uncompressed, 3, &uniform(4));
    dir.assert_rejected(&four, "grey or RGB");
    dir.assert_rejected(&exr(&[("R", false), ("G", false)]), "R, G and B");
    dir.assert_rejected(&exr(&[("S0.400nm", false), ("T.400nm", false)]), "both of them");
    dir.assert_rejected(&exr(&[("S0.4cm", false), ("S0.400nm", false)]), "a wavelength such as");
    for invalid in [
        &b""[..],
        b"\x89PNG",
        b"II*\0",
        b"MM\0+",
        b"\x76\x2f\x31\x01",
        b"GIF89a..",
        &[0x89, b'P', b'N', b'G', 0, 0],
    ] {
        assert!(dir.linear(invalid).is_err());
    }
    dir.assert_rejected(b"GIF89a", "first bytes");
}

impl Directory {
    fn decode(&self, bytes: &[u8]) -> Result<(), ChartError> {
        self.open(bytes)?.linear(Transfer::Srgb, self.0.path(), 1, &|_, _| ()).map(|_| ())
    }
}

/// Truncation anywhere before the end of the pixels is an error.
#[test]
fn truncated_file_is_an_error_and_leaves_no_temporary_file() {
    let dir = Directory::new();
    let rgb = samples(3, 255);
    for (name, complete, pixels_end) in [
        ("PNG", png(ColorType::Rgb, BitDepth::Eight, &to_u8(&rgb)), 40),
        ("TIFF", tiff::<colortype::RGB8>(false, Compression::Uncompressed, 4, &to_u8(&rgb)), 1),
        ("LZW", tiff::<colortype::RGB8>(true, Compression::Lzw, 4, &to_u8(&rgb)), 1),
        ("EXR", exr(&[("R", false), ("G", true), ("B", false)]), 1),
    ] {
        for cut in 0..60 {
            let length = (complete.len() - pixels_end) * cut / 60;
            assert!(dir.decode(&complete[..length]).is_err(), "{name} cut to {length} of {}", complete.len());
            assert_eq!(fs::read_dir(dir.0.path()).unwrap().count(), 1);
        }
    }
}

#[test]
fn oversized_dimensions_are_an_error_before_memory_is_allocated() {
    let dir = Directory::new();
    let valid = exr(&[("R", false), ("G", false), ("B", false)]);
    let at = valid.windows(11).position(|w| w == b"dataWindow\0").unwrap() + 11 + 6 + 4;
    for corner in [i32::MAX - 1, 1 << 28, 60_000] {
        let mut bytes = valid.clone();
        bytes[at + 8..at + 12].copy_from_slice(&corner.to_le_bytes());
        bytes[at + 12..at + 16].copy_from_slice(&corner.to_le_bytes());
        let error = dir.decode(&bytes).unwrap_err().to_string();
        assert!(error.contains("a.picture"), "{error}");
    }
    let few = samples(1, 255);
    let valid = tiff::<colortype::Gray8>(false, Compression::Uncompressed, 11, &to_u8(&few));
    let mut bytes = valid.clone();
    // The width, in the directory: tag 256, type LONG, one value.
    let tag = valid.windows(8).position(|w| w == [0, 1, 4, 0, 1, 0, 0, 0]).unwrap();
    bytes[tag + 8..tag + 12].copy_from_slice(&4_000_000_000u32.to_le_bytes());
    assert!(dir.decode(&bytes).is_err());
}

#[test]
fn primaries_and_orientation_are_noted() {
    let dir = tempfile::tempdir().unwrap();
    let notes = |name: &str, bytes: &[u8]| {
        let path = dir.path().join(name);
        fs::write(&path, bytes).unwrap();
        ImageFile::open(&path).unwrap().notes().to_vec()
    };
    let png = |set: &dyn Fn(&mut ::png::Info<'_>)| {
        let mut info = ::png::Info::with_size(2, 2);
        (info.color_type, info.bit_depth) = (ColorType::Rgb, BitDepth::Eight);
        set(&mut info);
        let mut bytes = Vec::new();
        let encoder = ::png::Encoder::with_info(&mut bytes, info).unwrap();
        encoder.write_header().unwrap().write_image_data(&[7; 12]).unwrap();
        bytes
    };
    let chromaticities =
        |red| ::png::SourceChromaticities::new((0.3127, 0.329), red, (0.3, 0.6), (0.15, 0.06));
    let srgb = png(&|info| info.source_chromaticities = Some(chromaticities((0.64, 0.33))));
    assert_eq!(notes("srgb.png", &srgb), [""; 0]);
    let p3 = png(&|info| info.source_chromaticities = Some(chromaticities((0.68, 0.32))));
    let found = notes("p3.png", &p3);
    assert!(found.len() == 1 && found[0].contains("red (0.6800, 0.3200)"), "{found:?}");
    let mut bytes = std::io::Cursor::new(Vec::new());
    let mut encoder = TiffEncoder::new(&mut bytes).unwrap();
    let mut image = encoder.new_image::<colortype::Gray8>(2, 2).unwrap();
    image.encoder().write_tag(::tiff::tags::Tag::Orientation, 6u16).unwrap();
    image.write_data(&[7; 4]).unwrap();
    let found = notes("turned.tif", &bytes.into_inner());
    assert!(found.len() == 1 && found[0].contains("TIFF orientation (6)"), "{found:?}");
}

#[test]
fn openexr_of_a_renderer_is_decoded_where_it_is_opaque() {
    let directory = Directory::new();
    let plain = directory.linear(&exr(&[("B", false), ("G", false), ("R", true)])).unwrap();
    let layer = ["A", "B", "G", "R"].map(|c| format!("ViewLayer.Combined.{c}"));
    let names: Vec<(&str, bool)> = layer.iter().map(|n| (n.as_str(), n.ends_with('R'))).collect();
    let bytes = exr(&names);
    assert_eq!(directory.linear(&bytes).unwrap(), plain);
    let notes = directory.open(&bytes).unwrap().notes().join(" ");
    assert!(notes.contains("layer ViewLayer.Combined") && notes.contains("must be opaque"), "{notes}");
    let channels = [("A", false), ("B", false), ("G", false), ("R", false)];
    assert!(directory.linear(&exr(&channels)).is_ok());
    let error = directory.linear(&exr_of_alpha(&channels, 0.5)).unwrap_err().to_string();
    assert!(error.contains("transparent pixel at row 0, column 0"), "{error}");
}

#[test]
fn palette_of_a_tiff_is_called_unsupported() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("palette.tif");
    let mut bytes = std::io::Cursor::new(Vec::new());
    let mut encoder = TiffEncoder::new(&mut bytes).unwrap();
    let mut image = encoder.new_image::<colortype::Gray8>(2, 2).unwrap();
    image.encoder().write_tag(::tiff::tags::Tag::PhotometricInterpretation, 3u16).unwrap();
    image.encoder().write_tag(::tiff::tags::Tag::ColorMap, &[0u16; 768][..]).unwrap();
    image.write_data(&[7; 4]).unwrap();
    fs::write(&path, bytes.into_inner()).unwrap();
    let error = ImageFile::open(&path).err().expect("a palette is not read").to_string();
    assert!(error.contains("grey or RGB of 8 or 16 bits") && !error.contains("damaged"), "{error}");
}
