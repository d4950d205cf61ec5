//! Unsupported, truncated, inconsistent and too large files.

use super::*;

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

/// About 1 KB whose tiles are 65536 x 65537 px of 12 bytes, on an image of 14 x 9 px.
#[test]
fn exr_tile_above_the_limit_is_an_error_before_it_is_allocated() {
    let bytes = include_bytes!("../../../../tests/data/tile-of-51-GB.exr");
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
