//! Exported files are read back bit for bit; plans of reads cover everything and decode as often as stated.

use super::exr::{ExrCompression, ExrOptions, channel_name, write_exr};
use super::flat::{envi_files, write_envi, write_npy};
use super::regions::Regions;
use super::tiff::write_bands;
use super::*;
use crate::chart::{NanPolicy, RasterChart};
use ::exr::prelude::Text;
use std::collections::HashMap;
use std::fs;
use std::path::Path;
use std::sync::Mutex;

const SIZE: Size = Size::new(300, 530);

/// Source of numbers of every kind, which records its reads.
#[derive(Default)]
struct Cube {
    reads: Mutex<Vec<(usize, Rect)>>,
}

fn value(band: usize, y: i64, x: i64) -> f32 {
    let n = (band as i64 * 7919 + y * 613 + x * 31) as f32;
    match (band + y as usize + x as usize) % 97 {
        0 => f32::NAN,
        1 => -0.0,
        2 => 1e-42,
        3 => -n * 1e20,
        _ => (n * 0.7311).sin(),
    }
}

impl ChartSource for Cube {
    fn size(&self) -> Size {
        SIZE
    }
    fn read(&self, band: usize, rect: Rect, out: &mut [f32]) -> Result<(), SourceSinkError> {
        if band == 99 {
            return Err("unreadable".into());
        }
        self.reads.lock().unwrap().push((band, rect));
        for (i, v) in out.iter_mut().enumerate() {
            *v = value(band, rect.y + (i / rect.width) as i64, rect.x + (i % rect.width) as i64);
        }
        Ok(())
    }
}

const NM: [f64; 5] = [700.0, 400.0, 410.25, 555.0, 1000.0];

fn samples(cube: &Cube, threads: usize) -> Samples<'_> {
    Samples {
        source: cube,
        wavelengths_nm: &NM,
        rect: Rect::new(13, 30, 280, 491),
        chunk: Size::new(128, 128),
        units: Some("W m-2 nm-1"),
        pitch_um: Some(2.5),
        description: "a cube of {µ}\nlines",
        threads,
    }
}

fn expected(s: &Samples<'_>, band: usize) -> Vec<f32> {
    let w = s.rect;
    (w.y..w.bottom()).flat_map(|y| (w.x..w.right()).map(move |x| value(band, y, x))).collect()
}

fn assert_same_bits(got: &[f32], s: &Samples<'_>, band: usize, format: &str) {
    let expected = expected(s, band);
    assert!(
        got.iter().map(|v| v.to_bits()).eq(expected.iter().map(|v| v.to_bits())),
        "{format}, band {band}"
    );
}

fn missing(s: &Samples<'_>) -> u64 {
    (0..5).flat_map(|b| expected(s, b)).filter(|v| v.is_nan()).count() as u64
}

#[test]
fn npy_and_envi_are_exact() {
    let dir = tempfile::tempdir().unwrap();
    for threads in [1, 3] {
        let cube = Cube::default();
        let s = samples(&cube, threads);
        let (npy, hdr) = (dir.path().join("c.npy"), dir.path().join("c.hdr"));
        let last = Mutex::new((0, 0));
        let written = write_npy(&npy, &s, &|done, all| *last.lock().unwrap() = (done, all)).unwrap();
        assert_eq!(written, Written { bytes: fs::metadata(&npy).unwrap().len(), missing: missing(&s) });
        assert_eq!(*last.lock().unwrap(), (5 * 280 * 491, 5 * 280 * 491));
        write_envi(&hdr, &s, &|_, _| ()).unwrap();
        assert_eq!(envi_files(&hdr).0, dir.path().join("c.bsq"));
        for path in [&npy, &hdr] {
            let chart = RasterChart::open(path, NanPolicy::Keep).unwrap();
            let mut out = vec![0.0; 280 * 491];
            for band in 0..5 {
                chart.read_rect(band, chart.size().rect(), &mut out).unwrap();
                assert_same_bits(&out, &s, band, "flat");
            }
            assert!(path == &npy || chart.wavelengths_nm() == Some(&NM[..]));
        }
        let header = fs::read_to_string(&hdr).unwrap();
        assert!(header.contains("data units = W m-2 nm-1"));
        // The rectangle begins at column 30, row 13.
        assert!(
            header.contains(
                "map info = {Arbitrary, 1, 1, 0.000075, -0.0000325, 0.0000025, 0.0000025, 0, units=Meters}"
            ),
            "{header}"
        );
    }
    assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 3, "other files remain");
}

#[test]
fn tiff_bands_are_exact_planes_of_one_picture() {
    let dir = tempfile::tempdir().unwrap();
    let cube = Cube::default();
    let s = samples(&cube, 2);
    let path = dir.path().join("c.tif");
    assert_eq!(write_bands(&path, &s, &|_, _| ()).unwrap().missing, missing(&s));
    let mut decoder = ::tiff::decoder::Decoder::new(fs::File::open(&path).unwrap()).unwrap();
    // 4000 pixels in a centimetre.
    let resolution = decoder.get_tag(::tiff::tags::Tag::XResolution).unwrap();
    assert_eq!(format!("{resolution:?}"), "Rational(4000000, 1000)");
    assert_eq!(decoder.get_tag_u32(::tiff::tags::Tag::ResolutionUnit).unwrap(), 3);
    assert!(!decoder.more_images());
    let chart = crate::chart::pictures::open_tiff(&path, NanPolicy::Keep).unwrap();
    assert_eq!(chart.wavelengths_nm(), Some(&NM[..]));
    chart.copy_bands(&[0, 1, 2, 3, 4], dir.path(), 2, &|_, _| ()).unwrap();
    for band in 0..NM.len() {
        let mut out = vec![0.0; s.rect.size().pixels()];
        chart.read(band, s.rect.size().rect(), &mut out).unwrap();
        assert_same_bits(&out, &s, band, "plane");
    }
}

/// Pixels of every channel by name.
fn read_exr(path: &Path) -> HashMap<String, Vec<f32>> {
    let image = ::exr::prelude::read_first_flat_layer_from_file(path).unwrap();
    let channels = image.layer_data.channel_data.list;
    channels.into_iter().map(|c| (c.name.to_string(), c.sample_data.values_as_f32().collect())).collect()
}

fn exr_options(s: &Samples<'_>, half: bool, compression: ExrCompression, memory: usize) -> ExrOptions {
    let bytes = ExrOptions::sample_bytes(half);
    ExrOptions { half, compression, regions: Regions::plan(s, bytes, memory).unwrap() }
}

#[test]
fn exr_is_exact_for_any_memory_and_threads() {
    let dir = tempfile::tempdir().unwrap();
    let (cube, path) = (Cube::default(), dir.path().join("c.exr"));
    for (threads, memory) in [(1, 64 << 20), (3, 64 << 20), (1, 8 << 20)] {
        let s = samples(&cube, threads);
        let written =
            write_exr(&path, &s, &exr_options(&s, false, ExrCompression::Zip, memory), &|_, _| ()).unwrap();
        assert_eq!(written, Written { bytes: fs::metadata(&path).unwrap().len(), missing: missing(&s) });
        let channels = read_exr(&path);
        assert_eq!(channels.len(), 5);
        (0..5).for_each(|b| assert_same_bits(&channels[&channel_name(NM[b])], &s, b, "exr"));
    }
    let s = samples(&cube, 2);
    for compression in [ExrCompression::Piz, ExrCompression::None] {
        write_exr(&path, &s, &exr_options(&s, false, compression, 64 << 20), &|_, _| ()).unwrap();
        let channels = read_exr(&path);
        (0..5).for_each(|b| assert_same_bits(&channels[&channel_name(NM[b])], &s, b, "exr"));
    }
    let meta = ::exr::meta::MetaData::read_from_file(&path, true).unwrap();
    let other = &meta.headers[0].own_attributes.other;
    assert_eq!(other[&Text::from("spectralLayoutVersion")].to_text().unwrap().to_string(), "1.0");
    assert_eq!(other[&Text::from("emissiveUnits")].to_text().unwrap().to_string(), "W m-2 nm-1");
    let names: Vec<String> = meta.headers[0].channels.list.iter().map(|c| c.name.to_string()).collect();
    assert!(names.is_sorted() && names[1] == "S0.400,000000nm", "{names:?}");
    assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 1);
}

/// Source of a ramp along x.
struct Ramp(f32);
impl ChartSource for Ramp {
    fn size(&self) -> Size {
        SIZE
    }
    fn read(&self, _: usize, rect: Rect, out: &mut [f32]) -> Result<(), SourceSinkError> {
        out.iter_mut().zip(rect.x..).for_each(|(v, x)| *v = self.0 * (x as f32 + 0.37));
        Ok(())
    }
}

#[test]
fn half_samples_are_rounded_and_overflow_is_an_error() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("h.exr");
    let ramp = Ramp(1e-3);
    let s = Samples { source: &ramp, rect: Rect::new(0, 0, 20, 60), ..samples_of(&ramp) };
    write_exr(&path, &s, &exr_options(&s, true, ExrCompression::Zip, 64 << 20), &|_, _| ()).unwrap();
    let mut expected = vec![0.0; 20 * 60];
    ramp.read(0, s.rect, &mut expected).unwrap();
    let halves = &read_exr(&path)[&channel_name(400.0)];
    assert_eq!(halves.len(), expected.len());
    for (got, expected) in halves.iter().zip(&expected) {
        assert!((got - expected).abs() <= expected * 2f32.powi(-11), "{got} {expected}");
    }
    let huge = Ramp(2000.0);
    let s = Samples { source: &huge, ..samples_of(&huge) };
    let error =
        write_exr(&path, &s, &exr_options(&s, true, ExrCompression::Zip, 64 << 20), &|_, _| ()).unwrap_err();
    assert!(error.to_string().contains("column 33") && error.to_string().contains("--half"), "{error}");
}

fn samples_of(source: &dyn ChartSource) -> Samples<'_> {
    Samples {
        source,
        wavelengths_nm: &NM,
        rect: Rect::new(0, 30, 280, 491),
        chunk: Size::new(128, 128),
        units: None,
        pitch_um: None,
        description: "",
        threads: 2,
    }
}

#[test]
fn unsupported_input_is_an_error_and_leaves_no_file() {
    let dir = tempfile::tempdir().unwrap();
    let cube = Cube::default();
    let s = samples(&cube, 2);
    let path = dir.path().join("x.exr");
    let twice = Samples { wavelengths_nm: &[500.0, 500.0], ..samples(&cube, 2) };
    let options = exr_options(&s, false, ExrCompression::Zip, 64 << 20);
    let error = write_exr(&path, &twice, &options, &|_, _| ()).unwrap_err().to_string();
    assert!(error.contains("bands 0 and 1 at 500"), "{error}");
    let error = Regions::plan(&s, 4, 1 << 20).unwrap_err().to_string();
    assert!(error.contains("need at least") && error.contains("--bands"), "{error}");
    let hundred = vec![500.0; 100];
    let failing = Samples { wavelengths_nm: &hundred, ..samples(&cube, 2) };
    let error = write_npy(&dir.path().join("x.npy"), &failing, &|_, _| ()).unwrap_err().to_string();
    assert!(error.contains("band 99") && error.contains("unreadable"), "{error}");
    assert!(
        write_npy(Path::new("/nowhere/x.npy"), &s, &|_, _| ()).unwrap_err().to_string().contains("/nowhere")
    );
    assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 0, "a file remains");
}

/// Every pixel once; a film of 14141² px in a GiB decodes every chunk once.
#[test]
fn regions_cover_all_pixels_once_and_decode_as_planned() {
    let cube = Cube::default();
    let nm: Vec<f64> = (0..31).map(|i| 400.0 + 10.0 * f64::from(i)).collect();
    let film = Rect::new(0, 0, 14141, 14141);
    for (rect, side, memory, max_decoded) in [
        (film, 512, 900 << 20, 1.0),
        (film, 256, 900 << 20, 1.0),
        (film, 512, 100 << 20, 2.0),
        (Rect::new(777, 1234, 9999, 12000), 512, 900 << 20, 1.6),
        (Rect::new(777, 1234, 99, 12), 512, 900 << 20, 1.0),
        (film, 2048, 900 << 20, 1.0),
        (film, 1, 300 << 20, 1.0),
    ] {
        let s = Samples { wavelengths_nm: &nm, rect, chunk: Size::new(side, side), ..samples(&cube, 2) };
        let plan = Regions::plan(&s, 4, memory).unwrap();
        assert!(plan.decoded <= max_decoded, "{rect} in chunks of {side}: {plan:?}");
        let planned_bytes = plan.region.pixels() * 31 * 4 + plan.cache_bytes;
        assert!(planned_bytes <= memory, "{plan:?}");
        let rects: Vec<Rect> = plan.rects(rect).collect();
        assert_eq!(rects.iter().map(|r| r.size().pixels()).sum::<usize>(), rect.size().pixels());
        assert!(rects.iter().all(|r| rect.contains(*r)));
        let begins_at_tile = |r: &Rect| {
            ((r.y - rect.y) as usize).is_multiple_of(plan.tile)
                && ((r.x - rect.x) as usize).is_multiple_of(plan.tile)
        };
        assert!(rects.iter().all(begins_at_tile));
    }
}
