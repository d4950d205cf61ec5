//! Levels against means over subdivided texels, lookups against values computed by hand and closed forms.

use super::*;
use crate::scene::description::Wrap::{Clamp, Mirror, Repeat};
use crate::scene::test_mesh::Random;

/// Rounding of a level to f32, in each of a few levels.
const ROUNDING: f64 = 4.0 * 6e-8;

fn texture(width: usize, height: usize, texel: impl Fn(usize, usize) -> [u8; 4]) -> Texture {
    let texels = (0..width * height).map(|i| texel(i % width, i / width)).collect();
    Texture { name: "test".into(), width, height, texels }
}

fn random(width: usize, height: usize) -> Texture {
    let mut random = Random(7);
    let texels =
        (0..width * height).map(|_| std::array::from_fn(|_| (256.0 * random.next()) as u8)).collect();
    Texture { name: "test".into(), width, height, texels }
}

/// The means of `m` equal parts of a side of `n` values: each value is divided in m equal pieces, each part has n.
fn means_of_side(values: &[[f64; 4]], m: usize) -> Vec<[f64; 4]> {
    let n = values.len();
    let mean = |part: usize, c: usize| {
        (part * n..(part + 1) * n).map(|piece| values[piece / m][c]).sum::<f64>() / n as f64
    };
    (0..m).map(|part| std::array::from_fn(|c| mean(part, c))).collect()
}

#[test]
fn levels_are_means_over_equal_areas_for_even_and_odd_sides() {
    for (width, height) in [(8, 4), (5, 3), (7, 6), (1, 5), (9, 1), (2, 3), (1, 1)] {
        let pyramid = Pyramid::new(random(width, height)).unwrap();
        for level in 1..pyramid.levels() {
            let ((w, h), (w0, h0)) = (pyramid.size(level), pyramid.size(level - 1));
            assert_eq!((w, h), ((w0 / 2).max(1), (h0 / 2).max(1)));
            let rows: Vec<Vec<[f64; 4]>> = (0..h0)
                .map(|r| {
                    means_of_side(&(0..w0).map(|c| pyramid.texel(level - 1, c, r)).collect::<Vec<_>>(), w)
                })
                .collect();
            for c in 0..w {
                let column = means_of_side(&rows.iter().map(|row| row[c]).collect::<Vec<_>>(), h);
                for (r, expected) in column.iter().enumerate() {
                    let found = pyramid.texel(level, c, r);
                    let off = (0..4).map(|k| (found[k] - expected[k]).abs()).fold(0.0, f64::max);
                    assert!(off <= ROUNDING, "{width} × {height}, level {level}, ({c}, {r}): {off}");
                }
            }
        }
        assert_eq!(pyramid.size(pyramid.levels() - 1), (1, 1));
    }
}

#[test]
fn the_last_level_is_the_mean_of_the_picture_in_linear_light() {
    let picture = random(13, 9);
    let sum = picture
        .texels
        .iter()
        .fold([0.0; 3], |sum, t| std::array::from_fn(|c| sum[c] + srgb_decode(f64::from(t[c]) / 255.0)));
    let pyramid = Pyramid::new(picture).unwrap();
    let last = pyramid.texel(pyramid.levels() - 1, 0, 0);
    for (found, sum) in last.iter().zip(sum) {
        assert!((found - sum / (13.0 * 9.0)).abs() < ROUNDING, "{found}");
    }
    // Black and white in equal parts: half the light, not half the code.
    let checker = texture(4, 4, |x, y| if (x + y) % 2 == 0 { [255; 4] } else { [0, 0, 0, 255] });
    let checker = Pyramid::new(checker).unwrap();
    assert_eq!(checker.sample([0.3, 0.6], 2.0, [Repeat; 2], false), [0.5, 0.5, 0.5, 1.0]);
}

#[test]
fn bytes_are_8_a_texel_without_alpha() {
    let bytes = |alpha| Pyramid::new(texture(64, 64, |_, _| [1, 2, 3, alpha])).unwrap().bytes();
    assert_eq!((bytes(255), bytes(254)), (4 * 4096 + 12 * 1365, 4 * 4096 + 16 * 1365));
    assert!((bytes(255)..bytes(255) + 16).contains(&Pyramid::bytes_of(4096, false)));
    assert!((bytes(254)..bytes(254) + 32).contains(&Pyramid::bytes_of(4096, true)));
}

#[test]
fn texels_beyond_the_edge_are_those_of_the_wrap_mode() {
    let of = |wrap| (-5..8).map(|i| wrapped(i, 3, wrap)).collect::<Vec<_>>();
    assert_eq!(of(Repeat), [1, 2, 0, 1, 2, 0, 1, 2, 0, 1, 2, 0, 1]);
    assert_eq!(of(Mirror), [1, 2, 2, 1, 0, 0, 1, 2, 2, 1, 0, 0, 1]);
    assert_eq!(of(Clamp), [0, 0, 0, 0, 0, 0, 1, 2, 2, 2, 2, 2, 2]);
}

#[test]
fn lookups_between_texels_have_the_values_computed_by_hand() {
    // Alpha is linear: 0, 51, 102, 204 are 0, 0.2, 0.4, 0.8.
    let row = Pyramid::new(texture(4, 1, |x, _| [0, 0, 0, [0, 51, 102, 204][x]])).unwrap();
    let alpha = |u: f64, wrap, nearest| row.sample([u, 0.5], 0.0, [wrap, Repeat], nearest)[3];
    for (u, wrap, nearest, expected) in [
        (0.125, Repeat, false, 0.0),
        (0.25, Repeat, false, 0.1),
        (0.4375, Repeat, false, 0.25),
        (0.0, Repeat, false, 0.4),
        (1.0, Repeat, false, 0.4),
        (-0.75, Repeat, false, 0.1),
        (0.0, Mirror, false, 0.0),
        (1.0, Mirror, false, 0.8),
        (1.25, Mirror, false, 0.6),
        (-0.25, Mirror, false, 0.1),
        (-3.0, Clamp, false, 0.0),
        (7.0, Clamp, false, 0.8),
        (0.75, Clamp, false, 0.6),
        (0.24, Repeat, true, 0.0),
        (0.26, Repeat, true, 0.2),
        (-0.01, Repeat, true, 0.8),
        (-0.01, Mirror, true, 0.0),
        (1.3, Mirror, true, 0.4),
        (1.3, Repeat, true, 0.2),
        (1.0, Clamp, true, 0.8),
        (1e300, Clamp, true, 0.8),
    ] {
        let found = alpha(u, wrap, nearest);
        // f32 of a/255, and the products.
        assert!((found - expected).abs() < 1e-7, "{u} {wrap:?} {nearest}: {found}, expected {expected}");
    }
    assert!(alpha(1e300, Repeat, false).is_finite() && alpha(-1e18, Mirror, false).is_finite());
}

#[test]
fn nearest_is_the_filter_of_magnification_alone() {
    let pyramid = Pyramid::new(random(8, 8)).unwrap();
    let at = |level, nearest| pyramid.sample([0.43, 0.71], level, [Repeat; 2], nearest);
    assert_eq!(at(0.0, true), pyramid.texel(0, 3, 5));
    assert_ne!(at(0.0, false), at(0.0, true));
    assert_eq!(at(1.3, false), at(1.3, true));
    assert_eq!(at(f64::NAN, true), at(0.0, true));
}

#[test]
fn between_levels_lookups_are_linear_and_end_at_the_last() {
    let pyramid = Pyramid::new(random(16, 16)).unwrap();
    let at = |level| pyramid.sample([0.43, 0.71], level, [Repeat; 2], false);
    for c in 0..4 {
        assert!((at(1.25)[c] - (0.75 * at(1.0)[c] + 0.25 * at(2.0)[c])).abs() < 1e-15);
    }
    assert_eq!(at(9.0), at(4.0));
    assert_eq!(at(4.0), pyramid.texel(4, 0, 0));
}

#[test]
fn trilinear_lookups_are_the_means_over_pixels_of_the_texture() {
    // A pixel as large as a texel of a level, at its place: the brute-force mean of the texels of level 0 under it.
    let pyramid = Pyramid::new(random(32, 32)).unwrap();
    for level in 1..=5 {
        let side = 1 << level;
        for (column, row) in [(0, 0), (32 / side - 1, 32 / side / 2)] {
            let texels =
                (0..side * side).map(|i| pyramid.texel(0, column * side + i % side, row * side + i / side));
            let mean = texels
                .fold([0.0; 4], |s, t| std::array::from_fn(|c| s[c] + t[c]))
                .map(|s| s / (side * side) as f64);
            let uv = [column, row].map(|i| (i as f64 + 0.5) * side as f64 / 32.0);
            let found = pyramid.sample(uv, level as f64, [Repeat; 2], false);
            assert!((0..4).all(|c| (found[c] - mean[c]).abs() < ROUNDING), "{found:?} {mean:?}");
        }
    }
    // A pixel of any size and place on a ramp of alpha, of which the mean is the middle.
    let ramp = Pyramid::new(texture(64, 64, |x, y| [0, 0, 0, (2 * x + y) as u8])).unwrap();
    let mut random = Random(3);
    for _ in 0..100 {
        let (u, v, level) =
            (random.between(0.25, 0.75), random.between(0.25, 0.75), random.between(0.0, 4.0));
        let found = ramp.sample([u, v], level, [Clamp; 2], false)[3];
        let expected = (2.0 * (64.0 * u - 0.5) + 64.0 * v - 0.5) / 255.0;
        assert!((found - expected).abs() < 3e-7, "{u} {v} {level}: {found}, expected {expected}");
    }
    // A smooth texture of 6 periods: brute-force mean over a square of 2^level texels. The levels' filter is at most a texel of the next level wider and
    // attenuates the amplitude ½ by at most (π·6·2·side/64)²/8 more.
    let smooth = |x: usize, y: usize| {
        let phase = |i: usize| (i as f64 + 0.5) / 64.0 * 6.0 * std::f64::consts::TAU;
        127.5 + 60.0 * phase(x).sin() + 60.0 * phase(y).cos()
    };
    let waves = Pyramid::new(texture(64, 64, |x, y| [0, 0, 0, smooth(x, y).round() as u8])).unwrap();
    for _ in 0..200 {
        let (u, v, level) = (random.next(), random.next(), random.between(0.0, 2.0));
        let side = level.exp2();
        let pieces = 32;
        let of_piece = |i: usize| {
            let at = |t: f64, k: usize| t + ((k as f64 + 0.5) / pieces as f64 - 0.5) * side / 64.0;
            waves.sample([at(u, i % pieces), at(v, i / pieces)], 0.0, [Repeat; 2], false)[3]
        };
        let mean = (0..pieces * pieces).map(of_piece).sum::<f64>() / (pieces * pieces) as f64;
        let found = waves.sample([u, v], level, [Repeat; 2], false)[3];
        let wider = (std::f64::consts::PI * 6.0 * 2.0 * side / 64.0).powi(2) / 8.0;
        let allowed = 2.0 * 60.0 / 255.0 * wider + 0.004;
        assert!((found - mean).abs() < allowed, "level {level}: {found}, mean {mean}, allowed {allowed}");
    }
}

#[test]
fn places_and_derivatives_on_a_tilted_plane_are_those_of_the_closed_form() {
    // N·P = k; texture coordinates are affine in the place, u = (P·a), v = (P·b).
    let (normal, k) = ([0.25, -0.5, 1.0], 2.0);
    let corner = |x: f64, y: f64| [x, y, (k - normal[0] * x - normal[1] * y) / normal[2]];
    let corners = [corner(-1.0, -1.0), corner(1.0, -1.0), corner(0.5, 1.5)];
    let axes = [[0.7, 0.1, -0.2], [-0.3, 0.9, 0.4]];
    let dot = |a: [f64; 3], b: [f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    let uv = corners.map(|p| axes.map(|a| dot(a, p)));
    let projection = Projection::new(&corners);
    for (x, y) in [(0.0, 0.0), (0.1, -0.2), (0.05, 0.3)] {
        let d = [x, y, 1.0];
        let z = k / dot(normal, d);
        let place = projection.at(x, y);
        let (found, slopes) = (place.value(&uv), place.slopes(&uv));
        for c in 0..2 {
            assert!((found[c] - z * dot(axes[c], d)).abs() < 1e-14, "{found:?}");
            for (axis, slope) in slopes.iter().enumerate() {
                // d(z d)/dx = z e_x − z²·N_x/k·d
                let expected = z * axes[c][axis] - z * z * normal[axis] / k * dot(axes[c], d);
                assert!((slope[c] - expected).abs() < 1e-13, "{slope:?} {expected}");
            }
        }
    }
}

#[test]
fn a_level_is_the_logarithm_of_the_longer_side_of_a_pixel_in_texels() {
    let size = (256, 128);
    // One column is 2 texels to the right, one row 3 and 4 texels.
    let slopes = [[2.0 / 256.0 / 0.01, 0.0], [3.0 / 256.0 / 0.02, 4.0 / 128.0 / 0.02]];
    assert!((level_of(slopes, size, [[0.01, 0.0], [0.0, 0.02]]) - 5f64.log2()).abs() < 1e-14);
    assert!((level_of(slopes, size, [[0.01, 0.0], [0.0, 0.002]]) - 1.0).abs() < 1e-14);
    assert_eq!(level_of(slopes, size, [[0.001, 0.0], [0.0, 0.001]]), 0.0);
    assert_eq!(level_of([[f64::NAN; 2]; 2], size, [[1.0, 0.0], [0.0, 1.0]]), 0.0);
}

#[test]
fn pictures_without_texels_are_errors() {
    let error = |width, height, texels| {
        Pyramid::new(Texture { name: "wood".into(), width, height, texels }).err().unwrap().to_string()
    };
    assert_eq!(error(0, 3, vec![]), "texture `wood` has no texels: it is 0 × 3");
    assert_eq!(error(2, 2, vec![[0; 4]; 3]), "texture `wood` has 3 texels; expected 2 × 2");
    assert!(error(usize::MAX, 2, vec![]).contains("0 texels"));
}
