//! Channels of files that have no bands of a spectrum.

use super::*;
use ::exr::prelude::*;
use pipeline::flow::ChartSource;
use std::io::Cursor;

/// Writes 3 x 2 px: R, G and B of 32 bits, Z of 16 bits.
fn write_render(path: &Path) {
    let at = |pixel: Vec2<usize>| (pixel.y() * 3 + pixel.x()) as f32;
    let colour = |name: &str| AnyChannel::new(name, FlatSamples::F32((0..6).map(|i| i as f32).collect()));
    let z = (0..6).map(|i| f16::from_f32(1.0 + at(Vec2(i % 3, i / 3)))).collect();
    let list = [colour("B"), colour("G"), colour("R"), AnyChannel::new("Z", FlatSamples::F16(z))];
    let layer = Layer::new(
        (3, 2),
        LayerAttributes::default(),
        Encoding::UNCOMPRESSED,
        AnyChannels::sort(list.into_iter().collect()),
    );
    let mut bytes = Cursor::new(Vec::new());
    Image::from_layer(layer).write().non_parallel().to_buffered(&mut bytes).unwrap();
    std::fs::write(path, bytes.into_inner()).unwrap();
}

#[test]
fn a_channel_is_read_by_its_name() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("render.exr");
    write_render(&path);
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
