//! Layers against the sum that defines them, in f64.

use super::*;
use crate::geometry::Size;

/// A repeatable value between 0 and 1.
fn noise(i: usize) -> f64 {
    let mixed = (i as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    ((mixed ^ mixed >> 29).wrapping_mul(0xbf58_476d_1ce4_e5b9) >> 40) as f64 / (1 << 24) as f64
}

fn layer_of(grid: BinGrid, taps: Taps, value: impl Fn(usize) -> f64) -> Layer {
    Layer::new(grid, taps, (0..grid.size().pixels()).map(|i| value(i) as f32).collect())
}

/// The pixels of `rect` of a layer added to `base`.
fn added(layer: &Layer, rect: Rect, base: f32) -> Vec<f32> {
    let mut pixels = ShardPixels::new(rect.size());
    pixels.reach(rect.height, Vec::new);
    for y in 0..rect.height {
        pixels.row_mut(y).fill(base);
    }
    layer.add(rect, &mut pixels);
    (0..rect.height).flat_map(|y| pixels.row(y).to_vec()).collect()
}

/// The layer at film pixel (y, x), from its equation.
fn expected(layer: &Layer, taps: Taps, (y, x): (i64, i64)) -> f64 {
    let grid = layer.grid();
    let along = |pixel: i64| {
        let place = (pixel as f64 + 0.5) / grid.bin_px as f64 - 0.5;
        ((place.floor() as i64 + grid.margin as i64) as usize, taps.weights(place - place.floor()))
    };
    let ((k, wy), (l, wx)) = (along(y), along(x));
    let width = grid.size().width;
    let term =
        |i: usize, j: usize| wy[i] * wx[j] * f64::from(layer.coefficients()[(k + i - 1) * width + l + j - 1]);
    (0..4).flat_map(|i| (0..4).map(move |j| (i, j))).map(|(i, j)| term(i, j)).sum()
}

#[test]
fn layer_is_the_sum_over_sixteen_coefficients() {
    let film = Size::new(53, 90);
    for taps in [Taps::BSpline, Taps::Lagrange] {
        for bin_px in [2, 4, 8, 16, 32, 64] {
            let layer = layer_of(BinGrid::new(film, bin_px, 2), taps, noise);
            let found = added(&layer, film.rect(), 0.5);
            for (i, found) in found.into_iter().enumerate() {
                let at = ((i / film.width) as i64, (i % film.width) as i64);
                let sum = 0.5 + expected(&layer, taps, at);
                assert!((f64::from(found) - sum).abs() < 4e-7, "{taps:?} {bin_px}, {at:?}: {found} {sum}");
            }
        }
    }
}

#[test]
fn part_of_the_film_has_the_bits_of_all_of_it() {
    let film = Size::new(100, 131);
    for bin_px in [4, 8, 32] {
        let layer = layer_of(BinGrid::new(film, bin_px, 3), Taps::BSpline, noise);
        let all = added(&layer, film.rect(), 0.3);
        for rect in [Rect::new(0, 0, 64, 64), Rect::new(17, 5, 30, 101), Rect::new(99, 130, 1, 1)] {
            let part = added(&layer, rect, 0.3);
            let same = |(i, value): (usize, &f32)| {
                let (y, x) = (rect.y as usize + i / rect.width, rect.x as usize + i % rect.width);
                value.to_bits() == all[y * film.width + x].to_bits()
            };
            assert!(part.iter().enumerate().all(same), "{bin_px}, {rect}");
        }
    }
}

/// Sums over the film pixels that a bin reaches: of its weights, and of its weights times (row, column).
fn moments(bin_px: usize) -> (f64, (f64, f64)) {
    let at: Vec<[f64; 4]> = (0..bin_px)
        .map(|i| {
            let place = (i as f64 + 0.5) / bin_px as f64 - 0.5;
            Taps::BSpline.weights(place - place.floor())
        })
        .collect();
    // The weight of bin 6 at film pixel 6·b + d.
    let weight = |d: i64| {
        let b = bin_px as i64;
        let place = d.div_euclid(b) - i64::from(2 * d.rem_euclid(b) < b);
        let tap = 1 - place;
        if (0..4).contains(&tap) { at[d.rem_euclid(b) as usize][tap as usize] } else { 0.0 }
    };
    let b = bin_px as i64;
    let line: Vec<(f64, f64)> = (-3 * b..4 * b).map(|d| (weight(d), (6 * b + d) as f64)).collect();
    let (sum, first) = line.iter().fold((0.0, 0.0), |(s, f), (w, x)| (s + w, f + w * x));
    (sum * sum, (first * sum, first * sum))
}

/// Tolerances: some hundred terms in f64.
#[test]
fn spline_keeps_uniform_fields_energy_and_the_centre_of_a_bin() {
    for bin_px in [8, 16, 32, 64] {
        for i in 0..bin_px {
            let place = (i as f64 + 0.5) / bin_px as f64 - 0.5;
            let weights = Taps::BSpline.weights(place - place.floor());
            assert!((weights.iter().sum::<f64>() - 1.0).abs() < 1e-15 && weights.iter().all(|w| *w >= 0.0));
        }
        let area = (bin_px * bin_px) as f64;
        let (sum, (row, column)) = moments(bin_px);
        assert!((sum / area - 1.0).abs() < 1e-14, "{bin_px}: {sum}");
        let centre = 6.5 * bin_px as f64 - 0.5;
        assert!((row / sum / centre - 1.0).abs() < 1e-14 && (column / sum / centre - 1.0).abs() < 1e-14);
    }
}

#[test]
fn lagrange_is_exact_for_cubics() {
    let cubic = |t: f64| 0.3 - 0.2 * t + 0.05 * t * t + 0.01 * t * t * t;
    for i in 0..16 {
        let f = f64::from(i) / 16.0;
        let weights = Taps::Lagrange.weights(f);
        let value: f64 = weights.iter().zip([-1.0, 0.0, 1.0, 2.0]).map(|(w, t)| w * cubic(t)).sum();
        assert!((value - cubic(f)).abs() < 1e-15, "{f}");
    }
}

/// Rounding of f32: four weights, four products and sums, twice.
#[test]
fn uniform_layer_is_uniform_on_the_film() {
    let film = Size::new(70, 70);
    for taps in [Taps::BSpline, Taps::Lagrange] {
        for bin_px in [4, 8, 64] {
            let layer = layer_of(BinGrid::new(film, bin_px, 2), taps, |_| 3.0);
            for value in added(&layer, film.rect(), 0.0) {
                assert!((value - 3.0).abs() < 2e-6, "{taps:?} {bin_px}: {value}");
            }
        }
    }
}
