//! What is written is read again, bit for bit; regions cover all, and decode as often as they say.

use super::exr::{ExrOptions, Packing, channel_name, write_exr};
use super::flat::{envi_files, write_envi, write_npy};
use super::regions::Regions;
use super::tiff::write_pages;
use super::*;
use crate::chart::{NanPolicy, RasterChart};
use ::exr::prelude::Text;
use std::collections::HashMap;
use std::fs;
use std::path::Path;
use std::sync::Mutex;

const SIZE: Size = Size::new(300, 530);

/// Numbers of every kind, and which pieces were asked for.
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
            return Err("gone".into());
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
        window: Rect::new(13, 30, 280, 491),
        piece: Size::new(128, 128),
        units: Some("W m-2 nm-1"),
        description: "a cube of {µ}\nlines",
        threads,
    }
}

fn expected(s: &Samples<'_>, band: usize) -> Vec<f32> {
    let w = s.window;
    (w.y..w.bottom()).flat_map(|y| (w.x..w.right()).map(move |x| value(band, y, x))).collect()
}

fn same(got: &[f32], s: &Samples<'_>, band: usize, what: &str) {
    let want = expected(s, band);
    assert!(got.iter().map(|v| v.to_bits()).eq(want.iter().map(|v| v.to_bits())), "{what}, band {band}");
}

fn missing(s: &Samples<'_>) -> u64 {
    (0..5).flat_map(|b| expected(s, b)).filter(|v| v.is_nan()).count() as u64
}

#[test]
fn npy_and_envi_hold_the_bits() {
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
                same(&out, &s, band, "flat");
            }
            assert!(path == &npy || chart.wavelengths_nm() == Some(&NM[..]));
        }
        assert!(fs::read_to_string(&hdr).unwrap().contains("data units = W m-2 nm-1"));
    }
    assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 3, "nothing else is left");
}

#[test]
fn tiff_pages_hold_the_bits() {
    let dir = tempfile::tempdir().unwrap();
    let cube = Cube::default();
    let s = samples(&cube, 2);
    let path = dir.path().join("c.tif");
    assert_eq!(write_pages(&path, &s, &|_, _| ()).unwrap().missing, missing(&s));
    let mut decoder = ::tiff::decoder::Decoder::new(fs::File::open(&path).unwrap()).unwrap();
    for (band, nm) in NM.iter().enumerate() {
        let ::tiff::decoder::DecodingResult::F32(out) = decoder.read_image().unwrap() else { panic!() };
        same(&out, &s, band, "page");
        let words = decoder.get_tag_ascii_string(::tiff::tags::Tag::ImageDescription).unwrap();
        assert!(words.contains(&format!("wavelength {nm} nm")), "{words}");
        assert_eq!(decoder.more_images(), band < 4);
        if band < 4 {
            decoder.next_image().unwrap();
        }
    }
}

/// Pixels of every channel by name.
fn read_exr(path: &Path) -> HashMap<String, Vec<f32>> {
    let image = ::exr::prelude::read_first_flat_layer_from_file(path).unwrap();
    let channels = image.layer_data.channel_data.list;
    channels.into_iter().map(|c| (c.name.to_string(), c.sample_data.values_as_f32().collect())).collect()
}

fn exr_options(s: &Samples<'_>, half: bool, packing: Packing, memory: usize) -> ExrOptions {
    let bytes = ExrOptions::sample_bytes(half);
    ExrOptions { half, packing, regions: Regions::plan(s, bytes, memory).unwrap() }
}

#[test]
fn exr_holds_the_bits_whatever_memory_and_threads() {
    let dir = tempfile::tempdir().unwrap();
    let (cube, path) = (Cube::default(), dir.path().join("c.exr"));
    for (threads, memory) in [(1, 64 << 20), (3, 64 << 20), (1, 8 << 20)] {
        let s = samples(&cube, threads);
        let written =
            write_exr(&path, &s, &exr_options(&s, false, Packing::Zip, memory), &|_, _| ()).unwrap();
        assert_eq!(written, Written { bytes: fs::metadata(&path).unwrap().len(), missing: missing(&s) });
        let channels = read_exr(&path);
        assert_eq!(channels.len(), 5);
        (0..5).for_each(|b| same(&channels[&channel_name(NM[b])], &s, b, "exr"));
    }
    let s = samples(&cube, 2);
    for packing in [Packing::Piz, Packing::None] {
        write_exr(&path, &s, &exr_options(&s, false, packing, 64 << 20), &|_, _| ()).unwrap();
        let channels = read_exr(&path);
        (0..5).for_each(|b| same(&channels[&channel_name(NM[b])], &s, b, "exr"));
    }
    let meta = ::exr::meta::MetaData::read_from_file(&path, true).unwrap();
    let other = &meta.headers[0].own_attributes.other;
    assert_eq!(other[&Text::from("spectralLayoutVersion")].to_text().unwrap().to_string(), "1.0");
    assert_eq!(other[&Text::from("emissiveUnits")].to_text().unwrap().to_string(), "W m-2 nm-1");
    let names: Vec<String> = meta.headers[0].channels.list.iter().map(|c| c.name.to_string()).collect();
    assert!(names.is_sorted() && names[1] == "S0.400,000000nm", "{names:?}");
    assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 1);
}

/// f32 of a smooth cube.
struct Smooth(f32);
impl ChartSource for Smooth {
    fn size(&self) -> Size {
        SIZE
    }
    fn read(&self, _: usize, rect: Rect, out: &mut [f32]) -> Result<(), SourceSinkError> {
        out.iter_mut().zip(rect.x..).for_each(|(v, x)| *v = self.0 * (x as f32 + 0.37));
        Ok(())
    }
}

#[test]
fn halves_are_within_a_half_of_their_last_bit_or_refused() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("h.exr");
    let smooth = Smooth(1e-3);
    let s = Samples { source: &smooth, window: Rect::new(0, 0, 20, 60), ..samples_of(&smooth) };
    write_exr(&path, &s, &exr_options(&s, true, Packing::Zip, 64 << 20), &|_, _| ()).unwrap();
    let mut want = vec![0.0; 20 * 60];
    smooth.read(0, s.window, &mut want).unwrap();
    let halves = &read_exr(&path)[&channel_name(400.0)];
    assert_eq!(halves.len(), want.len());
    for (got, want) in halves.iter().zip(&want) {
        assert!((got - want).abs() <= want * 2f32.powi(-11), "{got} {want}");
    }
    let huge = Smooth(2000.0);
    let s = Samples { source: &huge, ..samples_of(&huge) };
    let error = write_exr(&path, &s, &exr_options(&s, true, Packing::Zip, 64 << 20), &|_, _| ()).unwrap_err();
    assert!(error.to_string().contains("column 33") && error.to_string().contains("--half"), "{error}");
}

fn samples_of(source: &dyn ChartSource) -> Samples<'_> {
    Samples {
        source,
        wavelengths_nm: &NM,
        window: Rect::new(0, 30, 280, 491),
        piece: Size::new(128, 128),
        units: None,
        description: "",
        threads: 2,
    }
}

#[test]
fn what_a_file_cannot_hold_is_said() {
    let dir = tempfile::tempdir().unwrap();
    let cube = Cube::default();
    let s = samples(&cube, 2);
    let path = dir.path().join("x.exr");
    let twice = Samples { wavelengths_nm: &[500.0, 500.0], ..samples(&cube, 2) };
    let options = exr_options(&s, false, Packing::Zip, 64 << 20);
    let error = write_exr(&path, &twice, &options, &|_, _| ()).unwrap_err().to_string();
    assert!(error.contains("bands 0 and 1 at 500"), "{error}");
    let error = Regions::plan(&s, 4, 1 << 20).unwrap_err().to_string();
    assert!(error.contains("need at least") && error.contains("--bands"), "{error}");
    let gone = vec![500.0; 100];
    let failing = Samples { wavelengths_nm: &gone, ..samples(&cube, 2) };
    let error = write_npy(&dir.path().join("x.npy"), &failing, &|_, _| ()).unwrap_err().to_string();
    assert!(error.contains("band 99") && error.contains("gone"), "{error}");
    assert!(
        write_npy(Path::new("/nowhere/x.npy"), &s, &|_, _| ()).unwrap_err().to_string().contains("/nowhere")
    );
    assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 0, "nothing is left");
}

/// Every pixel once; the paper's film in a GiB decodes every chunk once.
#[test]
fn regions_cover_all_and_decode_as_planned() {
    let cube = Cube::default();
    let nm: Vec<f64> = (0..31).map(|i| 400.0 + 10.0 * f64::from(i)).collect();
    let film = Rect::new(0, 0, 14141, 14141);
    for (window, piece, memory, most) in [
        (film, 512, 900 << 20, 1.0),
        (film, 256, 900 << 20, 1.0),
        (film, 512, 100 << 20, 2.0),
        (Rect::new(777, 1234, 9999, 12000), 512, 900 << 20, 1.6),
        (Rect::new(777, 1234, 99, 12), 512, 900 << 20, 1.0),
        (film, 2048, 900 << 20, 1.0),
        (film, 1, 300 << 20, 1.0),
    ] {
        let s = Samples { wavelengths_nm: &nm, window, piece: Size::new(piece, piece), ..samples(&cube, 2) };
        let plan = Regions::plan(&s, 4, memory).unwrap();
        assert!(plan.decoded <= most, "{window} in pieces of {piece}: {plan:?}");
        let held = plan.region.pixels() * 31 * 4 + plan.cache_bytes;
        assert!(held <= memory, "{plan:?}");
        let rects: Vec<Rect> = plan.rects(window).collect();
        assert_eq!(rects.iter().map(|r| r.size().pixels()).sum::<usize>(), window.size().pixels());
        assert!(rects.iter().all(|r| window.contains(*r)));
        let whole_tiles = |r: &Rect| {
            ((r.y - window.y) as usize).is_multiple_of(plan.tile)
                && ((r.x - window.x) as usize).is_multiple_of(plan.tile)
        };
        assert!(rects.iter().all(whole_tiles));
    }
}
