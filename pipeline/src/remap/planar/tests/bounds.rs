//! Bounds: the chart that a part of the film reads, and the stretch of the map.

use super::*;
use crate::field::Stretch;
use crate::tiling::Tiling;

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
