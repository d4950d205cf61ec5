//! Maps without rotational symmetry: every engine against the f64 map, bounds, and the film of a lens that has the symmetry.

use super::super::{ChartInterpolation, Remap, RemapScratch};
use super::*;
use crate::field::{Field, Outside, Stretch};
use crate::flow::{ChartSource, SourceSinkError};
use crate::geometry::Size;
use crate::lens::LensBand;
use crate::lens::planar::PlanarMap;
use crate::lens::planar::tests::{golden, golden_map};
use crate::remap::map::Map;
use crate::resample::{Interp, Surround};
use crate::simd::{Isa, Simd};
use crate::stage::{Stage, Stages};
use crate::tiling::Tiling;

const PITCH_MM: f64 = 2e-3;
const FIRST_TWO: Stages = Stages::of(&[Stage::Ri, Stage::Distortion]);

/// Repeatable numbers between 0 and 1 (xorshift64*).
struct Noise(u64);

impl Noise {
    fn next(&mut self) -> f64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        (self.0.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 11) as f64 / (1u64 << 53) as f64
    }

    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.next()
    }
}

/// The map with `of`(X, Y) = ideal X, ideal Y, R on a grid about the axis: `cells` cells of `cell_px` film pixels down and
/// across.
fn map_of(cells: (usize, usize), cell_px: f64, mut of: impl FnMut(f64, f64) -> [f64; 3]) -> PlanarMap {
    let nodes = |cells: usize| -> Vec<f64> {
        (0..=cells).map(|i| (i as f64 - cells as f64 / 2.0) * cell_px * PITCH_MM).collect()
    };
    let (y_mm, x_mm) = (nodes(cells.0), nodes(cells.1));
    let all: Vec<[f64; 3]> =
        y_mm.iter().flat_map(|&y| x_mm.iter().map(move |&x| (x, y))).map(|(x, y)| of(x, y)).collect();
    let table = |k: usize| all.iter().map(|v| v[k]).collect();
    PlanarMap { ideal_x_mm: table(0), ideal_y_mm: table(1), relative_illumination: table(2), x_mm, y_mm }
}

/// A map of independent displacements of up to `amplitude` cells at each node, sheared and keystoned: as rough as a map can be.
fn rough(noise: &mut Noise, cells: (usize, usize), cell_px: f64, amplitude: f64) -> PlanarMap {
    let (shear, squeeze) = (noise.between(-0.05, 0.05), noise.between(0.7, 1.4));
    map_of(cells, cell_px, |x, y| {
        let mut off = || noise.between(-amplitude, amplitude) * cell_px * PITCH_MM;
        let (ideal_x, ideal_y) = (squeeze * x + shear * y + off(), y - 0.02 * x + off());
        [ideal_x, ideal_y, noise.between(0.8, 1.0)]
    })
}

fn interpolation(interp: Interp) -> ChartInterpolation {
    ChartInterpolation { interp, surround: Surround::Mirror, outside: Outside::Clamp }
}

/// The instruction sets of this processor.
fn available() -> impl Iterator<Item = Simd> {
    Isa::ALL.into_iter().filter_map(|isa| Simd::require(isa).ok())
}

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

/// Coordinates and gain of the pixels of `rect` as SIMD has them, and the bounds of their cells.
#[cfg(target_arch = "x86_64")]
mod simd_coordinates {
    use super::super::super::lanes::Expand;
    use super::super::anchors::PlanarAnchors;
    use super::super::lanes::FillPlanarAnchors;
    use super::*;
    use crate::simd::lanes::{Dispatch, Lanes, MAX_LANES, SimdOp};
    use crate::simd::{Avx2, Avx512};

    pub(super) type Found = (Vec<(f64, f64, f64)>, ((i64, i64), (i64, i64)));

    struct Collect<'a> {
        map: PlanarChartMap<'a>,
        rect: Rect,
        to: &'a mut Found,
    }

    impl<V: Lanes> SimdOp<V> for Collect<'_> {
        #[inline(always)]
        fn run(self) {
            let (mut anchors, mut row) = (PlanarAnchors::default(), FilmRow::default());
            let fill =
                FillPlanarAnchors { map: self.map, rect: self.rect, film_row: &mut row, to: &mut anchors };
            SimdOp::<V>::run(fill);
            self.to.1 = anchors.cells;
            let expand = &&anchors;
            let (x0, count) = expand.blocks();
            for y in 0..self.rect.height {
                for (block, first) in (0..count).flat_map(|b| (0..16).step_by(V::LANES).map(move |f| (b, f)))
                {
                    let group = &expand.groups(y)[block / 8];
                    let p = expand.pixels::<V>(&(), (block / 8, group), block % 8, first);
                    let mut cells = [[0; MAX_LANES]; 2];
                    V::store_i32(p.rows, &mut cells[0]);
                    V::store_i32(p.cols, &mut cells[1]);
                    let mut rest = [[0.0; MAX_LANES]; 3];
                    p.row_fraction.store(&mut rest[0]);
                    p.col_fraction.store(&mut rest[1]);
                    p.gain.store(&mut rest[2]);
                    for i in 0..V::LANES {
                        let x = x0 + (block * 16 + first + i) as i64;
                        if (self.rect.x..self.rect.right()).contains(&x) {
                            let at = |k: usize| f64::from(cells[k][i]) + f64::from(rest[k][i]);
                            self.to.0.push((at(0), at(1), f64::from(rest[2][i])));
                        }
                    }
                }
            }
        }
    }

    pub(super) fn found(map: PlanarChartMap<'_>, rect: Rect, simd: Simd) -> Option<Found> {
        let mut found = (Vec::new(), ((0, 0), (0, 0)));
        let collect = Collect { map, rect, to: &mut found };
        match simd.isa() {
            Isa::Avx512 => Dispatch::<Avx512>::new(simd).run(collect),
            Isa::Avx2 => Dispatch::<Avx2>::new(simd).run(collect),
            Isa::Portable => return None,
        }
        Some(found)
    }
}

/// Frames with any axis, centre and scale, about maps with cells from much narrower than a block to much wider.
fn for_each_rough_case(cases: usize, mut check: impl FnMut(&Frame, &PlanarMap, Rect)) {
    let mut noise = Noise(5);
    for case in 0..cases {
        let cell_px = [112.3, 35.0, 16.5, 15.2, 7.9, 900.0][case % 6];
        let cells = ((noise.between(4.0, 30.0)) as usize, (noise.between(4.0, 30.0)) as usize);
        let amplitude = [0.0, 0.002, 0.05][case % 3];
        let map = rough(&mut noise, cells, cell_px, amplitude);
        let mut frame = Frame::centred(Size::new(1000, 1000), Size::new(40_000, 40_000), 2.0);
        frame.axis_px = (noise.between(-300.0, 1300.0), noise.between(-300.0, 1300.0));
        if case % 2 == 1 {
            frame.scale = (noise.between(1.0, 2.5), noise.between(1.0, 2.5));
            frame.center_mm = (noise.between(-1.0, 1.0), noise.between(-1.0, 1.0));
        }
        // About a place of the map or an end of it.
        let place = |axis: f64, cells: usize, noise: &mut Noise| {
            (axis + noise.between(-0.55, 0.55) * cells as f64 * cell_px) as i64 - 60
        };
        let (y, x) =
            (place(frame.axis_px.0, cells.0, &mut noise), place(frame.axis_px.1, cells.1, &mut noise));
        check(&frame, &map, Rect::new(y, x, 13, 157));
    }
}

#[cfg(target_arch = "x86_64")]
#[test]
fn simd_coordinates_are_within_2e_6_px_of_the_f64_map() {
    let mut worst_gain = 0f64;
    for_each_rough_case(360, |frame, map, rect| {
        let field = PlanarField::new(map, PITCH_MM, true, true, 1.0);
        let map = PlanarChartMap::new(frame, &field);
        for (found, cells) in available().filter_map(|simd| simd_coordinates::found(map, rect, simd)) {
            assert_eq!(found.len(), rect.size().pixels());
            for (i, (row, col, gain)) in found.into_iter().enumerate() {
                let (y, x) = (rect.y + (i / rect.width) as i64, rect.x + (i % rect.width) as i64);
                let exact = map.at_place(y as f64, x as f64);
                let off = (row - exact.0).abs().max((col - exact.1).abs());
                assert!(off < 2e-6, "{off:.1e} px at ({y}, {x}) of {rect}, {frame:?}");
                worst_gain = worst_gain.max((gain - exact.2).abs());
                let ((top, bottom), (left, right)) = cells;
                let inside =
                    |at: f64, low: i64, high: i64| at.floor() as i64 >= low && at.floor() as i64 <= high;
                assert!(
                    inside(row, top, bottom) && inside(col, left, right),
                    "cells at ({y}, {x}) of {rect}"
                );
            }
        }
    });
    assert!(worst_gain < 5e-7, "R within {worst_gain:.1e}");
}

#[test]
fn portable_pixels_have_the_bits_of_the_map_at_their_places() {
    for_each_rough_case(60, |frame, map, rect| {
        let field = PlanarField::new(map, PITCH_MM, true, true, 1.0);
        let map = PlanarChartMap::new(frame, &field);
        let (mut points, mut row) = (Points::default(), FilmRow::default());
        map.fill(rect, &mut points, &mut row);
        for (y, x) in (0..rect.height).flat_map(|y| (0..rect.width).map(move |x| (y, x))) {
            let exact = map.at_place((rect.y + y as i64) as f64, (rect.x + x as i64) as f64);
            let i = y * points.stride + x;
            let found = [
                Coordinate { cell: points.row[i], fraction: points.row_fraction[i] },
                Coordinate { cell: points.col[i], fraction: points.col_fraction[i] },
            ];
            assert_eq!(found, [Coordinate::new(exact.0), Coordinate::new(exact.1)]);
            assert_eq!(points.gain[i], exact.2 as f32);
        }
    });
}

/// A band of a lens with `map`.
fn band_of(map: &PlanarMap) -> LensBand {
    LensBand::ideal(550.0, vec![0.0, 1.0]).with_map(map.clone())
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

#[test]
fn upload_rectangle_contains_every_tap_of_the_pixels_and_little_more() {
    for_each_rough_case(120, |frame, map, rect| {
        let remap =
            Remap::new(frame, &band_of(map), FIRST_TWO, interpolation(Interp::Bilinear), 1.0, Simd::PORTABLE);
        let upload = remap.upload_rect(rect);
        let field = PlanarField::new(map, PITCH_MM, true, true, 1.0);
        let map = PlanarChartMap::new(frame, &field);
        let (mut points, mut row) = (Points::default(), FilmRow::default());
        map.fill(rect, &mut points, &mut row);
        for y in 0..rect.height {
            for i in y * points.stride..y * points.stride + rect.width {
                let (row, col) = (i64::from(points.row[i]), i64::from(points.col[i]));
                assert!(upload.contains(Rect::new(row, col, 2, 2)), "({row}, {col}), {upload}, {rect}");
            }
        }
    });
    // A real lens: within two pixels of the exact rectangle.
    let map = map_of((128, 128), 112.0, |x, y| {
        let m = 1.0 + 6e-5 * (x * x + y * y);
        [x * m, y * m, 1.0]
    });
    let size = Size::new(14_141, 14_141);
    let frame = Frame::centred(size, size, 2.0);
    let remap =
        Remap::new(&frame, &band_of(&map), FIRST_TWO, interpolation(Interp::Bilinear), 1.0, Simd::PORTABLE);
    let (rect, map) = (Rect::new(0, 0, 512, 512), remap.map());
    let span = |along: &dyn Fn(i64) -> f64| {
        let all = (0..512).map(along);
        all.fold((f64::INFINITY, f64::NEG_INFINITY), |s, v| (s.0.min(v), s.1.max(v)))
    };
    let (top, bottom) = (span(&|x| map.at(0, x).0).0, span(&|x| map.at(511, x).0).1);
    let exact = bottom.floor() - top.floor() + 2.0;
    let height = remap.upload_rect(rect).height as f64;
    assert!(height >= exact && height <= exact + 2.0, "{height}, expected {exact}");
}

#[test]
fn stretch_contains_all_difference_quotients_and_chart_area_all_parts() {
    let mut noise = Noise(3);
    for case in 0..12 {
        let (cells, cell_px) = ((8, 11), [40.0, 90.0][case % 2]);
        let map = rough(&mut noise, cells, cell_px, 0.03);
        let size = Size::new(300 + 40 * case, 420);
        let frame = Frame::centred(size, Size::new(2000, 2000), 2.0);
        let remap = Remap::new(
            &frame,
            &band_of(&map),
            FIRST_TWO,
            interpolation(Interp::Bicubic),
            1.0,
            Simd::PORTABLE,
        );
        let tiling = Tiling::new(size, None);
        let Stretch { least, greatest, shear } = remap.stretch(&tiling);
        let at = remap.map();
        for _ in 0..2000 {
            let (y, x) =
                (noise.between(0.5, size.height as f64 - 1.5), noise.between(0.5, size.width as f64 - 1.5));
            let h = 1e-3;
            let slope = |dy: f64, dx: f64| {
                let (a, b) = (at.at_place(y + dy * h, x + dx * h), at.at_place(y - dy * h, x - dx * h));
                [(a.0 - b.0) / (2.0 * h), (a.1 - b.1) / (2.0 * h)]
            };
            let (down, across) = (slope(1.0, 0.0), slope(0.0, 1.0));
            for i in 0..16 {
                let (s, c) = crate::real::sin_cos(f64::from(i) * 0.2);
                let length = (down[0] * s + across[0] * c).hypot(down[1] * s + across[1] * c);
                assert!(length > least - 1e-6 && length < greatest + 1e-6, "{length}, {least} to {greatest}");
            }
            assert!(down[1].abs().max(across[0].abs()) < shear + 1e-6);
        }
        let bound = remap.max_chart_px(&tiling);
        for part in size.rect().tiles(64, 512) {
            assert!(remap.upload_rect(part).size().pixels() as u64 <= bound);
        }
    }
    // A map without distortion: 1, but for rounding.
    let map = map_of((8, 9), 60.0, |x, y| [x, y, 1.0]);
    let size = Size::new(300, 400);
    let remap = Remap::new(
        &Frame::centred(size, size, 2.0),
        &band_of(&map),
        FIRST_TWO,
        interpolation(Interp::Bicubic),
        1.0,
        Simd::PORTABLE,
    );
    let stretch = remap.stretch(&Tiling::new(size, None));
    assert!(
        (stretch.least - 1.0).abs() < 1e-12
            && (stretch.greatest - 1.0).abs() < 1e-12
            && stretch.shear < 1e-12
    );
}
