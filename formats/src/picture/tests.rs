//! Tests of pictures against charts of known colours.

use std::path::Path;
use std::sync::Mutex;

use pipeline::chart::Generator;
use pipeline::colour::Illuminant;
use pipeline::flow::{ChartSource, SourceSinkError};
use pipeline::geometry::{Rect, Size};

use super::area::{Grid, stream};
use super::exposure::Exposure;
use super::grey::{GreyOptions, write_grey};
use super::preview::{PreviewOptions, White, preview, write_preview};
use super::streamed::{ColourFile, write_streamed};
use super::{PictureError, View, nearest_band};

/// Bands in memory.
struct Stack {
    size: Size,
    bands: Vec<Vec<f32>>,
}

impl Stack {
    fn new(size: Size, bands: usize, value: impl Fn(usize, usize, usize) -> f32) -> Self {
        let band = |b| (0..size.pixels()).map(|i| value(b, i / size.width, i % size.width)).collect();
        Self { size, bands: (0..bands).map(band).collect() }
    }
}

impl ChartSource for Stack {
    fn size(&self) -> Size {
        self.size
    }

    fn read(&self, band: usize, rect: Rect, out: &mut [f32]) -> Result<(), SourceSinkError> {
        if self.bands[band].is_empty() {
            return Err(format!("band {band} is missing").into());
        }
        for (y, row) in (rect.y as usize..).zip(out.chunks_mut(rect.width)) {
            row.copy_from_slice(&self.bands[band][y * self.size.width + rect.x as usize..][..rect.width]);
        }
        Ok(())
    }
}

fn noise(b: usize, y: usize, x: usize) -> f32 {
    let v = (b * 7919 + y * 104_729 + x * 1_299_709).wrapping_mul(2_654_435_761) as u32;
    (v >> 8) as f32 / (1 << 24) as f32
}

fn view(max_side: usize, threads: usize) -> View {
    View { region: None, max_side: Some(max_side), threads }
}

fn means(source: &dyn ChartSource, view: &View) -> (Grid, Vec<f32>, u64) {
    let grid = Grid::new(source.size(), view).unwrap();
    let mut out = vec![0.0; grid.out.pixels()];
    let missing = stream(source, &[0], &grid, view.threads, &|_, _| (), &mut |_, y, row| {
        out[y * grid.out.width..][..grid.out.width].copy_from_slice(row);
        Ok(())
    });
    (grid, out, missing.unwrap())
}

/// Overlap of output pixel `i` of `m` and source pixel `k` of `n`, from the definition.
fn overlap(i: usize, m: usize, k: usize, n: usize) -> f64 {
    let (scale, i, k) = (n as f64 / m as f64, i as f64, k as f64);
    ((k + 1.0).min((i + 1.0) * scale) - k.max(i * scale)).max(0.0)
}

#[test]
fn area_averages_match_the_definition_at_any_ratio() {
    for (height, width, side) in
        [(7, 5, 3), (1300, 9, 700), (9, 1031, 13), (16, 16, 16), (3, 2, 1), (5, 5, 99)]
    {
        let size = Size::new(height, width);
        let source =
            Stack::new(size, 1, |b, y, x| if (y * width + x) % 7 == 3 { f32::NAN } else { noise(b, y, x) });
        let (grid, out, missing) = means(&source, &view(side, 3));
        let expected_missing = source.bands[0].iter().filter(|v| v.is_nan()).count();
        assert_eq!(missing, expected_missing as u64);
        for i in 0..grid.out.height {
            for j in 0..grid.out.width {
                let (mut sum, mut weight) = (0.0, 0.0);
                for (p, &v) in source.bands[0].iter().enumerate().filter(|(_, v)| v.is_finite()) {
                    let (k, l) = (p / width, p % width);
                    let w = overlap(i, grid.out.height, k, height) * overlap(j, grid.out.width, l, width);
                    (sum, weight) = (sum + w * f64::from(v), weight + w);
                }
                let (got, expected) = (out[i * grid.out.width + j], (sum / weight) as f32);
                // Half a unit of f32, and rounding of the overlaps here; an overlap of 1e-12 counts as none.
                let same = (got - expected).abs() <= 2e-7 || (got.is_nan() && weight < 1e-9);
                assert!(same, "{size} → {}: {i} {j} {got} {expected}", grid.out);
            }
        }
    }
}

#[test]
fn picture_has_the_same_bits_for_1_and_5_threads() {
    let source = Stack::new(Size::new(2100, 37), 1, noise);
    let (_, one, _) = means(&source, &view(701, 1));
    assert_eq!(one, means(&source, &view(701, 5)).1);
    // At full size the picture equals the source.
    assert_eq!(means(&source, &view(9999, 3)).1, source.bands[0]);
}

#[test]
fn region_is_that_part_of_the_source_and_outside_is_an_error() {
    let source = Stack::new(Size::new(1200, 40), 1, noise);
    let region = Rect::new(500, 3, 600, 20);
    let (grid, out, _) = means(&source, &View { region: Some(region), max_side: None, threads: 2 });
    assert_eq!(grid.out, region.size());
    assert_eq!(out[21], noise(0, 501, 4));
    let outside = View { region: Some(Rect::new(-1, 0, 4, 4)), ..View::default() };
    assert!(matches!(Grid::new(source.size(), &outside), Err(PictureError::Setting { .. })));
}

#[test]
fn reduced_sizes_keep_the_aspect_ratio() {
    for ((height, width), side, expected) in [
        ((1, 1), 2048, (1, 1)),
        ((1, 1_000_000), 100, (1, 100)),
        ((14_141, 14_141), 2048, (2048, 2048)),
        ((3000, 2000), 1500, (1500, 1000)),
        ((10, 20), 2048, (10, 20)),
    ] {
        let grid = Grid::new(Size::new(height, width), &view(side, 1)).unwrap();
        assert_eq!(grid.out, Size::new(expected.0, expected.1));
    }
}

fn bands() -> Vec<f64> {
    (0..31).map(|i| 400.0 + 10.0 * f64::from(i)).collect()
}

/// Grey chart: level times the spectrum of the light.
fn grey(size: Size, light: Illuminant, level: impl Fn(usize, usize) -> f32) -> Stack {
    let spectrum: Vec<f32> = bands().iter().map(|&nm| light.relative_power(nm) as f32 / 100.0).collect();
    Stack::new(size, 31, |b, y, x| spectrum[b] * level(y, x))
}

#[test]
fn grey_is_neutral_in_the_light_that_is_white() {
    for light in Illuminant::ALL {
        let chart = grey(Size::new(4, 30), light, |_, x| x as f32 / 29.0);
        let options = PreviewOptions {
            white: White::Illuminant(light),
            exposure: Exposure::Factor(1.0),
            view: view(2048, 2),
        };
        let (image, found) = preview(&chart, &bands(), &options, &|_, _| ()).unwrap();
        assert_eq!((found.missing_samples, found.missing_pixels), (0, 0));
        assert_eq!((image.pixel(3, 0), image.pixel(0, 29)), ([0; 3], [255; 3]));
        for p in image.pixels() {
            assert!(p.iter().max().unwrap() - p.iter().min().unwrap() <= 1, "{light:?} {p:?}");
        }
    }
}

#[test]
fn automatic_white_makes_a_grey_chart_neutral() {
    let chart = grey(Size::new(8, 40), Illuminant::A, |_, x| 7.0 * x as f32 / 39.0);
    let options = PreviewOptions { white: White::Auto, ..PreviewOptions::default() };
    let (image, _) = preview(&chart, &bands(), &options, &|_, _| ()).unwrap();
    for p in image.pixels() {
        assert!(p.iter().max().unwrap() - p.iter().min().unwrap() <= 2, "{p:?}");
    }
    assert!(image.pixel(0, 39)[1] >= 254);
}

#[test]
fn colorchecker_patches_match_published_srgb() {
    // 8-bit sRGB by the manufacturer of dark skin, blue sky, orange, green, red, yellow, white and neutral 5.
    let published = [
        (0, [115, 82, 68]),
        (2, [98, 122, 157]),
        (6, [214, 126, 44]),
        (13, [70, 148, 73]),
        (14, [175, 54, 60]),
        (15, [231, 199, 31]),
        (18, [243, 243, 242]),
        (21, [122, 122, 121]),
    ];
    let chart: Generator = "checker?size=300&overscan=0".parse().unwrap();
    // A perfect reflector at 1000 lx has L = E/π.
    let white = Illuminant::D65.irradiance_scale(1000.0) * 100.0 / std::f64::consts::PI;
    let options = PreviewOptions { exposure: Exposure::Factor(1.0 / white), ..PreviewOptions::default() };
    let (image, _) = preview(&chart, chart.wavelengths_nm(), &options, &|_, _| ()).unwrap();
    for (patch, expected) in published {
        let r = chart.patches_px()[patch];
        let got = image.pixel(r.y as usize + r.height / 2, r.x as usize + r.width / 2);
        let worst = got.iter().zip(expected).map(|(&a, b)| (i32::from(a) - b).abs()).max().unwrap();
        // The published values were made for D50 and adapted, from another average of charts.
        assert!(worst <= 12, "patch {patch}: {got:?} for {expected:?}");
    }
}

#[test]
fn missing_samples_show_as_chequer_and_leave_other_pixels_unchanged() {
    // Band 3 lacks a quarter of its samples, and some inside averages.
    let mut chart = grey(Size::new(64, 64), Illuminant::D65, |_, _| 0.5);
    for y in 0..64 {
        for x in 0..64 {
            if (y < 32 && x < 32) || (y == 40 && x % 2 == 0) {
                chart.bands[3][y * 64 + x] = f32::NAN;
            }
        }
    }
    let options = PreviewOptions { view: view(32, 2), exposure: Exposure::Factor(1.0), ..Default::default() };
    let (image, found) = preview(&chart, &bands(), &options, &|_, _| ()).unwrap();
    assert_eq!((found.missing_samples, found.missing_pixels), (32 * 32 + 32, 16 * 16));
    assert_eq!((image.pixel(0, 0), image.pixel(0, 8)), ([102; 3], [153; 3]));
    assert!(image.pixel(20, 0).iter().chain(&image.pixel(31, 31)).all(|v| v.abs_diff(188) <= 1));
}

#[test]
fn previews_of_tiny_black_negative_or_missing_charts_are_written() {
    let folder = tempfile::tempdir().unwrap();
    for size in [Size::new(1, 1), Size::new(2, 30_000), Size::new(1, 3)] {
        for value in [0.0, 1.0, -1.0, f32::NAN] {
            let chart = Stack::new(size, 2, |_, _, _| value);
            let path = folder.path().join("p.png");
            let found = write_preview(&path, &chart, &[500.0, 600.0], &PreviewOptions::default(), &|_, _| ())
                .unwrap();
            let info = open(&path).0;
            assert_eq!((info.width as usize, info.height as usize), (found.size.width, found.size.height));
            assert!(info.srgb.is_some() && found.exposure.is_finite());
        }
    }
}

#[test]
fn invisible_bands_are_an_error_that_names_them() {
    let chart = Stack::new(Size::new(2, 2), 1, noise);
    let error = preview(&chart, &[900.0], &PreviewOptions::default(), &|_, _| ()).unwrap_err();
    assert!(error.to_string().contains("900 nm"), "{error}");
}

fn open(path: &Path) -> (png::Info<'static>, Vec<u8>) {
    let file = std::io::BufReader::new(std::fs::File::open(path).unwrap());
    let mut reader = png::Decoder::new(file).read_info().unwrap();
    let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
    reader.next_frame(&mut bytes).unwrap();
    (reader.info().clone(), bytes)
}

#[test]
fn grey_png_decodes_to_its_values_and_progress_ends_at_the_total() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("g.png");
    let mut chart = Stack::new(Size::new(700, 53), 3, noise);
    chart.bands[1][0] = f32::NAN;
    chart.bands[1][1] = -3.0;
    chart.bands[1][2] = 9.0;
    let nm = [450.0, 550.0, 650.0];
    let view = View { max_side: None, threads: 3, region: None };
    let reported = Mutex::new(Vec::new());
    for exposure in [Exposure::Factor(0.5), Exposure::Auto] {
        reported.lock().unwrap().clear();
        let options = GreyOptions { view, exposure };
        let progress = |done, total| reported.lock().unwrap().push((done, total));
        let found = write_grey(&path, &chart, &nm, 550.3, &options, ColourFile::Png, &progress).unwrap();
        let (info, bytes) = open(&path);
        assert_eq!((info.bit_depth, info.color_type), (png::BitDepth::Sixteen, png::ColorType::Grayscale));
        assert_eq!(info.gama_chunk, Some(png::ScaledFloat::new(1.0)));
        assert!(info.uncompressed_latin1_text[0].text.contains("band 550 nm"));
        assert_eq!(bytes.len(), 2 * chart.bands[1].len());
        for (i, (sample, &v)) in bytes.chunks(2).zip(&chart.bands[1]).enumerate().skip(1) {
            let sample = f64::from(u16::from_be_bytes([sample[0], sample[1]]));
            let expected = (f64::from(v) * found.exposure).clamp(0.0, 1.0) * 65535.0;
            assert!((sample - expected).abs() <= 0.5, "{i}: {sample} {expected}");
        }
        let tif = folder.path().join("g.tif");
        write_grey(&tif, &chart, &nm, 550.3, &options, ColourFile::Tiff, &|_, _| ()).unwrap();
        let mut decoder = tiff::decoder::Decoder::new(std::fs::File::open(&tif).unwrap()).unwrap();
        let tiff::decoder::DecodingResult::U16(samples) = decoder.read_image().unwrap() else { panic!() };
        let of_png: Vec<u16> = bytes.chunks(2).map(|b| u16::from_be_bytes([b[0], b[1]])).collect();
        assert!(samples == of_png, "the TIFF has other samples than the PNG");
        assert_eq!((found.missing_samples, found.missing_pixels), (1, 1));
        let reported = reported.lock().unwrap();
        let complete = reported.last().is_some_and(|(done, total)| done == total);
        assert!(reported.is_sorted() && complete, "{reported:?}");
    }
}

#[test]
fn absent_wavelength_is_an_error_that_names_the_nearest_and_all_bands() {
    assert_eq!(nearest_band(&bands(), 550.5).unwrap(), 15);
    let error = nearest_band(&bands(), 555.0).unwrap_err().to_string();
    assert!(error.contains("555 nm") && error.contains("550 nm") && error.contains("400:700:10"), "{error}");
    assert!(nearest_band(&[], 550.0).is_err());
}

#[test]
fn read_error_stops_all_workers_and_names_the_band() {
    let mut chart = Stack::new(Size::new(3000, 4), 5, noise);
    chart.bands[2].clear();
    let nm = [450.0, 500.0, 550.0, 600.0, 650.0];
    let options = PreviewOptions { view: view(9, 4), ..PreviewOptions::default() };
    let error = preview(&chart, &nm, &options, &|_, _| ()).unwrap_err();
    assert!(matches!(error, PictureError::Read { band: 2, .. }), "{error}");
    assert!(error.to_string().contains("band 2 is missing"), "{error}");
}

#[test]
fn invalid_settings_are_errors() {
    let chart = Stack::new(Size::new(3, 4), 1, noise);
    for options in [
        PreviewOptions { view: view(0, 1), ..PreviewOptions::default() },
        PreviewOptions { exposure: Exposure::Factor(f64::NAN), ..PreviewOptions::default() },
        PreviewOptions { exposure: Exposure::Percentile(200.0), ..PreviewOptions::default() },
    ] {
        assert!(matches!(preview(&chart, &[550.0], &options, &|_, _| ()), Err(PictureError::Setting { .. })));
    }
}

#[test]
fn streamed_picture_equals_the_picture_made_in_memory() {
    let folder = tempfile::tempdir().unwrap();
    let mut chart = grey(Size::new(150, 131), Illuminant::D65, |y, x| (y * 131 + x) as f32 / 15000.0);
    chart.bands[7][4321] = f32::NAN;
    for (max_side, exposure) in [(None, Exposure::Auto), (Some(47), Exposure::Factor(0.9))] {
        let view = View { max_side, threads: 3, region: Some(Rect::new(3, 5, 140, 120)) };
        let options = PreviewOptions { view, exposure, ..PreviewOptions::default() };
        let (image, summary) = preview(&chart, &bands(), &options, &|_, _| ()).unwrap();
        let (png, tif) = (folder.path().join("s.png"), folder.path().join("s.tif"));
        let found = write_streamed(&png, &chart, &bands(), &options, ColourFile::Png, &|_, _| ()).unwrap();
        assert_eq!(found, summary);
        assert!(open(&png).1 == image.pixels().concat());
        write_streamed(&tif, &chart, &bands(), &options, ColourFile::Tiff, &|_, _| ()).unwrap();
        let mut decoder = tiff::decoder::Decoder::new(std::fs::File::open(&tif).unwrap()).unwrap();
        let (w, h) = (found.size.width as u32, found.size.height as u32);
        assert_eq!(decoder.dimensions().unwrap(), (w, h));
        let tiff::decoder::DecodingResult::U16(samples) = decoder.read_image().unwrap() else { panic!() };
        let coarse = open(&png).1;
        assert_eq!(samples.len(), coarse.len());
        for (fine, coarse) in samples.iter().zip(coarse) {
            assert!((f64::from(*fine) / 257.0 - f64::from(coarse)).abs() <= 0.51, "{fine} {coarse}");
        }
    }
    let auto = PreviewOptions { white: White::Auto, ..PreviewOptions::default() };
    let rejected =
        write_streamed(&folder.path().join("n.png"), &chart, &bands(), &auto, ColourFile::Png, &|_, _| ());
    assert!(rejected.unwrap_err().to_string().contains("smaller picture"));
}
