//! Channels of files that have no bands of a spectrum.

use super::*;
use ::exr::meta::attribute::Chromaticities;
use ::exr::prelude::*;
use pipeline::flow::ChartSource;
use std::io::Cursor;

/// Writes 3 x 2 px: R, G and B of 32 bits, Z of 16 bits.
fn write_render(path: &Path, of_image: ImageAttributes, at_px: Vec2<i32>) {
    let at = |pixel: Vec2<usize>| (pixel.y() * 3 + pixel.x()) as f32;
    let colour = |name: &str| AnyChannel::new(name, FlatSamples::F32((0..6).map(|i| i as f32).collect()));
    let z = (0..6).map(|i| f16::from_f32(1.0 + at(Vec2(i % 3, i / 3)))).collect();
    let list = [colour("B"), colour("G"), colour("R"), AnyChannel::new("Z", FlatSamples::F16(z))];
    let layer = Layer::new(
        (3, 2),
        LayerAttributes { layer_position: at_px, ..LayerAttributes::default() },
        Encoding::UNCOMPRESSED,
        AnyChannels::sort(list.into_iter().collect()),
    );
    let mut bytes = Cursor::new(Vec::new());
    Image::new(of_image, layer).write().non_parallel().to_buffered(&mut bytes).unwrap();
    std::fs::write(path, bytes.into_inner()).unwrap();
}

#[test]
fn a_channel_is_read_by_its_name() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("render.exr");
    let window = IntegerBounds::from_dimensions((3, 2));
    write_render(&path, ImageAttributes::new(window), Vec2(0, 0));
    assert_eq!(open(&path, NanPolicy::Error).unwrap().chart.notes(), [""; 0]);
    let chart = open_channel(&path, &["Depth.Z", "Z"], NanPolicy::Keep).unwrap();
    assert_eq!((chart.size(), chart.bands()), (pipeline::geometry::Size::new(2, 3), 1));
    chart.copy_bands(&[0], dir.path(), 2, &|_, _| {}).unwrap();
    let mut pixels = [0.0; 6];
    chart.read_rect(0, pipeline::geometry::Rect::new(0, 0, 2, 3), &mut pixels).unwrap();
    assert_eq!(pixels, [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
    assert_eq!(chart.identity().unwrap().0["exr"]["channels"][0]["sample"], "f16");
    let error = open_channel(&path, &["depth"], NanPolicy::Keep).unwrap_err().to_string();
    assert!(error.contains("depth") && error.contains("B, G, R, Z"), "{error}");
}

#[test]
fn other_primaries_and_windows_are_noted() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("aces.exr");
    let window = IntegerBounds::from_dimensions((9, 8));
    // Primaries AP0 of SMPTE ST 2065-1.
    let ap0 = Chromaticities {
        red: Vec2(0.7347, 0.2653),
        green: Vec2(0.0, 1.0),
        blue: Vec2(0.0001, -0.077),
        white: Vec2(0.32168, 0.33767),
    };
    let attributes = ImageAttributes { chromaticities: Some(ap0), ..ImageAttributes::new(window) };
    write_render(&path, attributes, Vec2(5, 4));
    let file = crate::chart::image::ImageFile::open(&path).unwrap();
    let notes = file.notes();
    assert!(notes[0].contains("3x2 px at row 4, column 5") && notes[0].contains("9x8 px"), "{notes:?}");
    assert!(notes[1].contains("(0.7347, 0.2653)") && notes[1].contains("interpreted as sRGB"), "{notes:?}");
}
