//! Coordinates and gain of pixels against the map.

use super::*;

/// Coordinates and gain of the pixels of `rect` as SIMD has them, and the bounds of their cells.
#[cfg(target_arch = "x86_64")]
mod simd_coordinates {
    use super::super::super::super::lanes::Expand;
    use super::super::super::anchors::PlanarAnchors;
    use super::super::super::lanes::FillPlanarAnchors;
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
