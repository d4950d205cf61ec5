//! Pictures and OpenEXR charts: small damaged files of each kind, in a directory in memory.

use crate::directory;
use crate::fuzz_support::extreme::name;
use crate::fuzz_support::{Random, damage, fuzz};
use lenscube_formats::chart::exr;
use lenscube_formats::chart::image::{ImageFile, Transfer};
use lenscube_formats::chart::pictures::{open_set, open_tiff};
use lenscube_formats::chart::{DecodedChart, NanPolicy};
use lenscube_formats::export::Samples;
use lenscube_formats::export::exr::{ExrCompression, ExrOptions, write_exr};
use lenscube_formats::export::regions::Regions;
use lenscube_formats::picture::grey::{GreyOptions, write_grey};
use lenscube_formats::picture::preview::{PreviewOptions, write_preview};
use lenscube_formats::picture::streamed::{ColourFile, write_streamed};
use pipeline::flow::{ChartSource, SourceSinkError};
use pipeline::geometry::{Rect, Size};
use std::fs;
use std::path::Path;

struct Ramp;

impl ChartSource for Ramp {
    fn size(&self) -> Size {
        Size::new(9, 14)
    }
    fn read(&self, band: usize, rect: Rect, out: &mut [f32]) -> Result<(), SourceSinkError> {
        out.iter_mut().enumerate().for_each(|(i, v)| *v = (i + band + rect.x as usize) as f32 * 0.01);
        Ok(())
    }
}

const NM: [f64; 3] = [450.0, 550.0, 650.0];

fn exr(path: &Path, compression: ExrCompression, half: bool) -> Vec<u8> {
    let samples = Samples {
        source: &Ramp,
        wavelengths_nm: &NM,
        rect: Ramp.size().rect(),
        chunk: Size::new(1, 1),
        units: None,
        pitch_um: None,
        description: "",
        threads: 1,
    };
    let regions = Regions::plan(&samples, ExrOptions::sample_bytes(half), 64 << 20).unwrap();
    write_exr(path, &samples, &ExrOptions { half, compression, regions }, &|_, _| ()).unwrap();
    fs::read(path).unwrap()
}

fn damaged_file(seeds: &[Vec<u8>], at: &Path, r: &mut Random) -> Vec<u8> {
    let mut bytes = seeds[r.below(seeds.len())].clone();
    damage(&mut bytes, r);
    // Sizes and counts are in the first bytes: replace four of them at a time.
    if r.below(2) == 0 && bytes.len() > 8 {
        let first = r.below(bytes.len().min(600) - 4);
        let size = [0u32, 1, 0x7fff_ffff, u32::MAX, 0x1000_0000, 65535][r.below(6)];
        let size = if r.below(2) == 0 { size.to_le_bytes() } else { size.to_be_bytes() };
        bytes[first..first + 4].copy_from_slice(&size);
    }
    // Names of channels, attributes and tags are there too.
    if r.below(4) == 0 && bytes.len() > 8 {
        let first = r.below(bytes.len().min(600));
        bytes.splice(first..first, name(r));
    }
    fs::write(at, &bytes).unwrap();
    bytes
}

#[test]
fn damaged_exr_charts_do_not_panic() {
    let dir = directory();
    let at = dir.path().join("c.exr");
    let seeds = [ExrCompression::Zip, ExrCompression::Piz, ExrCompression::None]
        .map(|p| exr(&at, p, p == ExrCompression::Piz));
    fuzz(
        "EXR chart",
        600,
        |r| damaged_file(&seeds, &at, r),
        |_| {
            let Ok(chart) = exr::open(&at, NanPolicy::Zero).map(|file| file.chart) else { return false };
            let all: Vec<usize> = (0..chart.bands()).collect();
            if chart.copy_bands(&all, dir.path(), 1, &|_, _| ()).is_err() {
                return false;
            }
            let size = chart.size();
            let rect = Rect::new(0, 0, size.height.min(40), size.width.min(40));
            let mut out = vec![0.0; rect.size().pixels()];
            all.iter().all(|&band| chart.read_rect(band, rect, &mut out).is_ok())
        },
    );
    assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 1, "a temporary file remains");
}

#[test]
fn damaged_pictures_do_not_panic() {
    let dir = directory();
    let at = dir.path().join("picture");
    let none: &(dyn Fn(u64, u64) + Sync) = &|_, _| ();
    let mut seeds = Vec::new();
    let (preview, grey) = (PreviewOptions::default(), GreyOptions::default());
    write_preview(&at, &Ramp, &NM, &preview, none).unwrap();
    seeds.push(fs::read(&at).unwrap());
    write_grey(&at, &Ramp, &NM, 550.0, &grey, ColourFile::Png, none).unwrap();
    seeds.push(fs::read(&at).unwrap());
    write_streamed(&at, &Ramp, &NM, &preview, ColourFile::Tiff, none).unwrap();
    seeds.push(fs::read(&at).unwrap());
    seeds.push(exr(&at, ExrCompression::Zip, false));
    for packing in [tiff::encoder::Compression::Lzw, tiff::encoder::Compression::Packbits] {
        let mut bytes = std::io::Cursor::new(Vec::new());
        let mut encoder = tiff::encoder::TiffEncoder::new(&mut bytes).unwrap().with_compression(packing);
        let data: Vec<u8> = (0..9 * 14 * 3).map(|i| i as u8).collect();
        encoder.write_image::<tiff::encoder::colortype::RGB8>(14, 9, &data).unwrap();
        seeds.push(bytes.into_inner());
    }
    for name in ["baseline.jpg", "progressive.jpg", "lossless.webp", "opaque-alpha.png"] {
        let colour = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/pictures/colour");
        seeds.push(fs::read(colour.join(name)).unwrap());
    }
    fuzz(
        "picture",
        600,
        |r| damaged_file(&seeds, &at, r),
        |_| {
            let Ok(file) = ImageFile::open(&at) else { return false };
            let size = file.size();
            let Ok(source) = file.linear(Transfer::Srgb, dir.path(), 1, none) else { return false };
            let rect = Rect::new(0, 0, size.height.min(40), size.width.min(40));
            source.read(0, rect, &mut vec![0.0; rect.size().pixels()]).is_ok()
        },
    );
    assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 1, "a temporary file remains");
}

#[test]
fn damaged_pictures_of_bands_do_not_panic() {
    let dir = directory();
    let at = dir.path().join("c.tif");
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/pictures");
    let seeds: Vec<Vec<u8>> = [
        "tiff/planar-deflate-f32.tif",
        "tiff/chunky-tiled-big-endian-bigtiff.tif",
        "tiff/chunky-lzw-u8.tif",
        "gdal/descriptions.tif",
        "gdal/scaled.tif",
        "gdal/tiled-big-endian-predictor-chunky-f32.tif",
        "gdal/tiled-big-endian-predictor-planar-u16.tif",
        "numbered-tif/band_2.tif",
        "png16/scene_400nm.png",
    ]
    .map(|name| fs::read(data.join(name)).unwrap())
    .into();
    fuzz(
        "band pictures",
        600,
        |r| damaged_file(&seeds, &at, r),
        |_| {
            type Open = fn(&Path, NanPolicy) -> Result<DecodedChart, lenscube_formats::chart::ChartError>;
            let open: [Open; 2] = [open_tiff, |p, nan| open_set(p.to_str().unwrap(), nan)];
            open.iter().any(|open| {
                let Ok(chart) = open(&at, NanPolicy::Zero) else { return false };
                let bands: Vec<usize> = (0..chart.bands().min(5)).collect();
                if chart.copy_bands(&bands, dir.path(), 1, &|_, _| ()).is_err() {
                    return false;
                }
                let size = chart.size();
                let rect = Rect::new(0, 0, size.height.min(40), size.width.min(40));
                let mut out = vec![0.0; rect.size().pixels()];
                bands.iter().all(|&band| chart.read_rect(band, rect, &mut out).is_ok())
            })
        },
    );
    assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 1, "a temporary file remains");
}
