//! Pictures of a chart by known projective maps, with blur, noise and shading.

use super::*;
use crate::measure::projective::Projective;

const CHART: (f64, f64) = (300.0, 400.0);
const SIDE: f64 = 42.0;

/// Reflectance of the chart at a position (row, column) from its top left corner; 0.4 beyond it.
fn reflectance(row: f64, column: f64) -> f64 {
    let (height, width) = CHART;
    if row < 0.0 || column < 0.0 || row > height || column > width {
        return 0.4;
    }
    let module = SIDE / 7.0;
    let (r, c) = (row.min(height - row) / module, column.min(width - column) / module);
    let (top, left) = (row < height / 2.0, column < width / 2.0);
    let inverted = top && left;
    let from_centre = (r - 5.5).abs().max((c - 5.5).abs());
    let dark = match from_centre {
        d if d <= 1.5 => true,
        d if d <= 2.5 => false,
        d if d <= 3.5 => true,
        d if d <= 5.5 => false,
        _ if inverted && r <= 11.0 && c <= 14.0 => false,
        _ if inverted && r <= 13.0 && c <= 16.0 => true,
        // Contents: stripes of 12 px.
        _ => return if ((row + column) / 12.0).rem_euclid(2.0) < 1.0 { 0.7 } else { 0.1 },
    };
    if dark != inverted { 0.03 } else { 0.9 }
}

fn corners() -> Quad {
    let d = 5.5 * SIDE / 7.0;
    let ((h, w), e) = (CHART, d);
    [(d, e), (d, w - e), (h - d, w - e), (h - d, e)]
}

struct Random(u64);

impl Random {
    /// SplitMix64, whose bits are independent from draw to draw; the sum of 12 uniform numbers has variance 1.
    fn normal(&mut self) -> f64 {
        let mut next = || {
            self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
            let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
            ((z ^ (z >> 31)) >> 40) as f64 / f64::from(1 << 24)
        };
        (0..12).map(|_| next()).sum::<f64>() - 6.0
    }
}

/// A picture of the chart, and the positions of the marks in it.
struct Scene {
    size: Size,
    luma: Vec<f32>,
    marks: Quad,
}

/// Rotated by `angle_deg` (clockwise), enlarged by `scale`, with the given perspective.
fn scene(angle_deg: f64, scale: f64, perspective: f64, mirrored: bool) -> Scene {
    let (sin, cos) = real::sin_cos(angle_deg.to_radians());
    let size = Size::new(620, 640);
    let place = |(row, column): (f64, f64)| {
        let (y, x) = (row - CHART.0 / 2.0, column - CHART.1 / 2.0);
        let x = if mirrored { -x } else { x };
        let w = 1.0 + perspective * (0.6 * x + y) / 300.0;
        let (y, x) = (scale * y / w, scale * x / w);
        (309.3 + y * cos + x * sin, 320.8 + x * cos - y * sin)
    };
    let outline: Quad = [(0.0, 0.0), (0.0, CHART.1), CHART, (CHART.0, 0.0)];
    let to_chart = Projective::through(&outline.map(place), &outline).unwrap();
    // A lattice of 89 samples a pixel, of which no two share a row or a column: borders along them are exact to 1/178 px.
    let mut luma = Vec::with_capacity(size.pixels());
    for i in 0..size.pixels() {
        let mut sum = 0.0;
        for k in 0..89usize {
            let at = |j: usize| (j as f64 + 0.5) / 89.0 - 0.5;
            let (y, x) = ((i / size.width) as f64 + at(k), (i % size.width) as f64 + at(k * 55 % 89));
            let (row, column) = to_chart.apply((y, x));
            sum += reflectance(row, column);
        }
        luma.push((sum / 89.0) as f32);
    }
    Scene { size, luma, marks: corners().map(place) }
}

impl Scene {
    fn blurred(mut self, sigma: f64) -> Self {
        let reach = (4.0 * sigma).ceil() as i64;
        let kernel: Vec<f64> =
            (-reach..=reach).map(|i| real::exp(-((i * i) as f64) / (2.0 * sigma * sigma))).collect();
        let sum: f64 = kernel.iter().sum();
        let (h, w) = (self.size.height as i64, self.size.width as i64);
        for (dy, dx) in [(0, 1), (1, 0)] {
            let old = self.luma.clone();
            for (i, v) in self.luma.iter_mut().enumerate() {
                let (y, x) = (i as i64 / w, i as i64 % w);
                let tap = |k: i64| {
                    let (y, x) = ((y + k * dy).clamp(0, h - 1), (x + k * dx).clamp(0, w - 1));
                    f64::from(old[(y * w + x) as usize])
                };
                let total: f64 = (-reach..=reach).map(|k| kernel[(k + reach) as usize] * tap(k)).sum();
                *v = (total / sum) as f32;
            }
        }
        self
    }

    /// Light that falls by 30 % from the picture's first to its last pixel, along both sides.
    fn shaded(mut self) -> Self {
        for (i, v) in self.luma.iter_mut().enumerate() {
            let (y, x) = (i / self.size.width, i % self.size.width);
            let across = (y as f64 / self.size.height as f64 + x as f64 / self.size.width as f64) / 2.0;
            *v *= (1.0 - 0.3 * across) as f32;
        }
        self
    }

    fn noisy(mut self, sigma: f64) -> Self {
        let mut random = Random(5);
        self.luma.iter_mut().for_each(|v| *v += (sigma * random.normal()) as f32);
        self
    }

    /// Largest distance of a mark from its place.
    fn error_px(&self) -> f64 {
        let found = find(&self.luma, self.size).unwrap_or_else(|e| panic!("{e}"));
        std::iter::zip(found, self.marks).map(|(f, m)| real::hypot(f.0 - m.0, f.1 - m.1)).fold(0.0, f64::max)
    }
}

const ANGLES: [f64; 6] = [0.0, 7.0, 45.0, 90.0, 180.0, 200.0];

#[test]
fn sharp_marks_are_found_to_a_few_hundredths_of_a_pixel() {
    for (angle, scale, perspective) in ANGLES.map(|a| (a, 1.1, 0.0)).into_iter().chain([
        (7.0, 1.1, 0.1),
        (200.0, 1.0, -0.15),
        (-60.0, 0.7, 0.1),
    ]) {
        let error = scene(angle, scale, perspective, false).error_px();
        assert!(error < 0.015, "{angle}°, scale {scale}, perspective {perspective}: {error} px");
    }
}

/// Largest errors measured over four marks of 46 px and six angles: 0.012 px without noise, 0.06 px with noise of 5 % of white on every pixel, and
/// 0.19 px with that noise and blur of σ = 2 px, a third of a module.
#[test]
fn blurred_noisy_and_shaded_marks_are_found() {
    for angle in ANGLES.into_iter().step_by(2) {
        let shaded = |sigma: f64| scene(angle, 1.1, 0.05, false).blurred(sigma).shaded();
        for (sigma, noise, limit_px) in
            [(0.7, 0.0, 0.02), (2.0, 0.0, 0.02), (0.7, 0.05, 0.08), (2.0, 0.05, 0.25)]
        {
            let error = shaded(sigma).noisy(noise * 0.9).error_px();
            assert!(error < limit_px, "{angle}°, σ {sigma} px, noise {noise}: {error} px");
        }
    }
}

#[test]
fn low_contrast_and_any_scale_of_values_are_accepted() {
    let mut low = scene(7.0, 1.1, 0.0, false).blurred(1.0);
    low.luma.iter_mut().for_each(|v| *v = 1e-4 * (*v + 0.9));
    assert!(low.error_px() < 0.03, "{}", low.error_px());
}

#[test]
fn pictures_without_four_marks_are_errors() {
    let whole = scene(0.0, 1.1, 0.0, false);
    let found = |size: Size, luma: &[f32]| find(luma, size);
    assert_eq!(
        found(whole.size, &vec![0.5; whole.size.pixels()]),
        Err(FiducialError::NotFound { size: whole.size })
    );
    // A grey square over one mark, then two.
    let mut covered = whole.luma.clone();
    let cover = |luma: &mut Vec<f32>, (row, column): (f64, f64)| {
        for y in row as usize - 30..row as usize + 30 {
            luma[y * 640 + column as usize - 30..][..60].fill(0.5);
        }
    };
    cover(&mut covered, whole.marks[2]);
    assert_eq!(found(whole.size, &covered), Err(FiducialError::Missing { found: 3, inverted: 1 }));
    cover(&mut covered, whole.marks[0]);
    assert_eq!(found(whole.size, &covered), Err(FiducialError::Missing { found: 2, inverted: 0 }));
    // Two charts in one picture.
    let twice = [&whole.luma[..], &whole.luma[..]].concat();
    assert_eq!(found(Size::new(1240, 640), &twice), Err(FiducialError::TooMany { found: 8 }));
    assert_eq!(
        found(Size::new(2, 2), &[0.0; 3]),
        Err(FiducialError::Buffer { size: Size::new(2, 2), expected: 4, found: 3 })
    );
    assert!(found(Size::new(0, 7), &[]).is_err());
    assert!(found(Size::new(1, 1), &[1.0]).is_err());
}

#[test]
fn mirrored_pictures_are_errors() {
    for angle in [0.0, 90.0, 200.0] {
        let mirrored = scene(angle, 1.1, 0.05, true).blurred(1.0);
        assert_eq!(find(&mirrored.luma, mirrored.size), Err(FiducialError::Mirrored), "{angle}°");
    }
}

#[test]
fn noise_and_regular_patterns_hold_no_marks() {
    let size = Size::new(400, 500);
    let mut random = Random(11);
    let noise: Vec<f32> = (0..size.pixels()).map(|_| (0.5 + 0.3 * random.normal()) as f32).collect();
    let star: Vec<f32> = (0..size.pixels())
        .map(|i| real::atan2((i / 500) as f64 - 200.2, (i % 500) as f64 - 250.7))
        .map(|angle| f32::from(u8::from(real::sin(36.0 * angle) > 0.0)))
        .collect();
    let squares: Vec<f32> = (0..size.pixels()).map(|i| ((i / 500 / 9 + i % 500 / 9) % 2) as f32).collect();
    for luma in [noise, star, squares] {
        assert_eq!(find(&luma, size), Err(FiducialError::NotFound { size }));
    }
}
