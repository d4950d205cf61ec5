//! Samples and notes of every supported kind.

use super::*;
use pipeline::geometry::Rect;

fn to_be16(v: &[u16]) -> Vec<u8> {
    v.iter().flat_map(|v| v.to_be_bytes()).collect()
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
