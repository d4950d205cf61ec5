//! Films: any engine and tile, the reference, the identity, a lens that has the symmetry.

use super::super::super::RemapScratch;
use super::*;
use crate::field::Field;
use crate::flow::{ChartSource, SourceSinkError};
use crate::lens::planar::tests::{golden, golden_map};
use crate::remap::map::Map;

/// A chart with a value for each row and column.
struct Chart {
    size: Size,
    value: fn(i64, i64) -> f32,
}

impl ChartSource for Chart {
    fn size(&self) -> Size {
        self.size
    }

    fn read(&self, _: usize, rect: Rect, out: &mut [f32]) -> Result<(), SourceSinkError> {
        for (i, to) in out.iter_mut().enumerate() {
            let (y, x) = (rect.y + (i / rect.width) as i64, rect.x + (i % rect.width) as i64);
            *to = (self.value)(y, x);
        }
        Ok(())
    }
}

fn white(y: i64, x: i64) -> f32 {
    let mixed = ((y * 100_003 + x) as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    ((mixed ^ mixed >> 29).wrapping_mul(0xbf58_476d_1ce4_e5b9) >> 40) as f32 / (1 << 24) as f32
}

fn film(remap: &Remap, chart: &Chart, rect: Rect) -> Vec<f32> {
    let mut out = vec![0.0; rect.size().pixels()];
    remap.apply(chart, 0, rect, &mut out, &mut RemapScratch::default()).unwrap();
    out
}

#[test]
fn engines_agree_and_pixels_do_not_depend_on_the_tiles() {
    let mut noise = Noise(13);
    let size = Size::new(150, 700);
    let chart = Chart { size: Size::new(300, 900), value: white };
    for (case, scale) in [(1.0, 1.0), (1.3, 1.1), (0.37, 0.6)].into_iter().enumerate() {
        let map = rough(&mut noise, (9, 17), [37.0, 12.0, 51.0][case], 0.02);
        let frame = Frame { scale, ..Frame::centred(size, chart.size, 2.0) };
        let mut films = Vec::new();
        for simd in available() {
            let remap =
                Remap::new(&frame, &band_of(&map), FIRST_TWO, interpolation(Interp::Bicubic), 1.5, simd);
            let full = film(&remap, &chart, size.rect());
            for part in size.rect().tiles(37, 129) {
                for (i, v) in film(&remap, &chart, part).iter().enumerate() {
                    let (y, x) = (part.y as usize + i / part.width, part.x as usize + i % part.width);
                    assert_eq!(
                        v.to_bits(),
                        full[y * size.width + x].to_bits(),
                        "{part}, {}",
                        simd.isa().name()
                    );
                }
            }
            films.push(full);
        }
        let portable = films.pop().unwrap();
        for (v, expected) in films.iter().flat_map(|film| film.iter().zip(&portable)) {
            assert!((v - expected).abs() < 1e-5, "{v}, expected {expected}");
        }
    }
}

#[test]
fn remapped_image_equals_the_reference() {
    let (film_size, chart_size) = (Size::new(12, 16), Size::new(40, 50));
    let value = |y: i64, x: i64| ((y * 7919 + x * 104_729) % 1009) as f32 / 1009.0;
    let chart = Chart { size: chart_size, value };
    let frame = Frame { axis_px: (5.3, 7.6), ..Frame::centred(film_size, chart_size, 1700.0) };
    let interpolation = ChartInterpolation { surround: Surround::Edge, ..interpolation(Interp::Bicubic) };
    let expected = golden()[201..].concat();
    for simd in available() {
        let remap = Remap::new(&frame, &band_of(&golden_map()), FIRST_TWO, interpolation, 1.0, simd);
        let found = film(&remap, &chart, film_size.rect());
        assert_eq!(found.len(), expected.len());
        for (i, (v, expected)) in found.iter().zip(&expected).enumerate() {
            assert!((f64::from(*v) - expected).abs() < 1e-6, "pixel {i}: {v}, expected {expected}");
        }
    }
}

#[test]
fn identity_returns_the_chart_bit_for_bit() {
    let size = Size::new(100, 333);
    let chart = Chart { size, value: white };
    let map = map_of((8, 9), 40.0, |x, y| [x, y, 1.0]);
    for simd in available() {
        let remap = Remap::new(
            &Frame::centred(size, size, 2.0),
            &band_of(&map),
            FIRST_TWO,
            interpolation(Interp::Bicubic),
            1.0,
            simd,
        );
        for (i, v) in film(&remap, &chart, size.rect()).iter().enumerate() {
            assert_eq!(*v, white((i / size.width) as i64, (i % size.width) as i64));
        }
    }
}

/// 2 % of barrel distortion and 30 % of vignetting at the corner of a film of 28.3 mm.
fn radial_band() -> LensBand {
    let real: Vec<f64> = (0..=20_000).map(|i| 20.5 * f64::from(i) / 20_000.0).collect();
    LensBand {
        ideal_height_mm: real.iter().map(|h| h * (1.0 + 6e-5 * h * h - 2e-8 * h.powi(4))).collect(),
        relative_illumination: real.iter().map(|h| 1.0 - 8e-4 * h * h + 1e-7 * h.powi(4)).collect(),
        ..LensBand::ideal(550.0, real)
    }
}

#[test]
fn planar_map_of_a_lens_with_symmetry_gives_its_film() {
    let size = Size::new(14_141, 14_141);
    let frame = Frame::centred(size, size, 2.0);
    let band = radial_band();
    let field = Field::new(&band, PITCH_MM, true, true, 1.0);
    let map = map_of((64, 64), 14_200.0 / 64.0, |x, y| {
        let (m, r) = field.at((x * x + y * y).sqrt() / PITCH_MM);
        [x * m, y * m, r]
    });
    let planar = PlanarField::new(&map, PITCH_MM, true, true, 1.0);
    let (planar, radial) = (PlanarChartMap::new(&frame, &planar), Map::new(&frame, &field));
    let (mut worst, mut worst_gain) = (0f64, 0f64);
    for (y, x) in (0..size.height as i64)
        .step_by(97)
        .flat_map(|y| (0..size.width as i64).step_by(89).map(move |x| (y, x)))
    {
        let (expected, found) = (radial.at(y, x), planar.at_place(y as f64, x as f64));
        worst = worst.max((found.0 - expected.0).abs()).max((found.1 - expected.1).abs());
        worst_gain = worst_gain.max((found.2 - expected.2).abs());
    }
    assert!(worst < 1e-4 && worst_gain < 1e-7, "{worst:.1e} px, R {worst_gain:.1e}");
    // And so the pixels, of any engine: values of white noise change by less than 4 a pixel.
    let chart = Chart { size, value: white };
    for simd in available() {
        let interpolation = interpolation(Interp::Bicubic);
        let radial = Remap::new(&frame, &band, FIRST_TWO, interpolation, 1.0, simd);
        let planar = Remap::new(&frame, &band_of(&map), FIRST_TWO, interpolation, 1.0, simd);
        for rect in
            [Rect::new(0, 13_900, 100, 241), Rect::new(7000, 7000, 100, 241), Rect::new(3000, 9000, 100, 241)]
        {
            for (a, b) in film(&radial, &chart, rect).iter().zip(&film(&planar, &chart, rect)) {
                assert!((a - b).abs() < 4e-4, "{a}, {b}");
            }
        }
    }
}
