//! Restoration with small operators: a matrix whose PSF varies, against dense solutions and invariants.

use super::blend::Tiles;
use super::discrepancy::{PartPower, lambda, next};
use super::local::LocalSpectrum;
use super::mosaic::Samples;
use super::noise::{NoiseEstimate, unit_noise};
use super::places::{Place, Places};
use super::response::Response;
use super::{Operator, Part, richardson_lucy, tikhonov, total_variation};
use crate::flow::SourceSinkError;
use crate::geometry::{Rect, Size};

/// A PSF of 5 x 5 px whose width grows along the rows; light beyond the border is lost.
struct Blur(Size);

impl Blur {
    fn kernel(&self, x: i64) -> [[f64; 5]; 5] {
        let sigma = 0.7 + 0.3 * x as f64 / self.0.width as f64;
        let along = [-2.0f64, -1.0, 0.0, 1.0, 2.0].map(|d| (-0.5 * (d / sigma).powi(2)).exp());
        let sum: f64 = along.iter().sum();
        along.map(|a| along.map(|b| a * b / (sum * sum)))
    }

    /// Calls `f` with (chart pixel, film pixel, weight).
    fn each(&self, mut f: impl FnMut(usize, usize, f64)) {
        let all = self.0.rect();
        for (y, x) in (0..all.bottom()).flat_map(|y| (0..all.right()).map(move |x| (y, x))) {
            let kernel = self.kernel(x);
            for (dy, dx) in (0..5).flat_map(|dy| (0..5).map(move |dx| (dy, dx))) {
                let (to_y, to_x) = (y + dy as i64 - 2, x + dx as i64 - 2);
                if all.contains(Rect::new(to_y, to_x, 1, 1)) {
                    let at = |y: i64, x: i64| y as usize * self.0.width + x as usize;
                    f(at(y, x), at(to_y, to_x), kernel[dy][dx]);
                }
            }
        }
    }
}

impl Operator for Blur {
    fn chart(&self) -> Size {
        self.0
    }

    fn film(&self) -> Size {
        self.0
    }

    fn apply(&self, chart: &[f32], film: &mut [f32]) -> Result<(), SourceSinkError> {
        film.fill(0.0);
        self.each(|from, to, weight| film[to] += weight as f32 * chart[from]);
        Ok(())
    }

    fn transpose(&self, film: &[f32], chart: &mut [f32]) -> Result<(), SourceSinkError> {
        chart.fill(0.0);
        self.each(|from, to, weight| chart[from] += weight as f32 * film[to]);
        Ok(())
    }
}

/// Bright squares on grey.
fn picture(size: Size) -> Vec<f64> {
    let value = |i: usize| match ((i / size.width / 5) + (i % size.width / 7)) % 3 {
        0 => 1.0,
        1 => 0.2,
        _ => 0.5,
    };
    (0..size.pixels()).map(value).collect()
}

fn film_of(operator: &Blur, chart: &[f64], sigma: f64) -> Vec<f32> {
    let chart: Vec<f32> = chart.iter().map(|v| *v as f32).collect();
    let mut film = vec![0.0; chart.len()];
    operator.apply(&chart, &mut film).unwrap();
    film.iter().zip(unit_noise(film.len(), 7)).map(|(v, n)| v + (sigma * n) as f32).collect()
}

/// The solution of A x = b by elimination with pivots.
fn solve(mut a: Vec<Vec<f64>>, mut b: Vec<f64>) -> Vec<f64> {
    let n = b.len();
    for k in 0..n {
        let pivot = (k..n).max_by(|i, j| a[*i][k].abs().total_cmp(&a[*j][k].abs())).unwrap();
        a.swap(k, pivot);
        b.swap(k, pivot);
        let top = a[k].clone();
        for i in k + 1..n {
            let factor = a[i][k] / top[k];
            a[i].iter_mut().zip(&top).skip(k).for_each(|(v, t)| *v -= factor * t);
            b[i] -= factor * b[k];
        }
    }
    for k in (0..n).rev() {
        let sum: f64 = (k + 1..n).map(|j| a[k][j] * b[j]).sum();
        b[k] = (b[k] - sum) / a[k][k];
    }
    b
}

/// The tolerance is that of the solver, and the rounding of f32 arrays times the condition of the matrix.
#[test]
fn tikhonov_is_the_solution_of_its_equation() {
    is_the_solution(None);
}

/// Every fourth pixel is measured alone, as behind a filter of a mosaic, each with its own weight.
#[test]
fn tikhonov_with_weights_is_the_solution_of_its_equation() {
    let weight = |i: usize| match (i / 18 % 2, i % 2) {
        (0, 1) => 0.5 + (i % 7) as f32 / 4.0,
        _ => 0.0,
    };
    is_the_solution(Some(&(0..14 * 18).map(weight).collect::<Vec<_>>()));
}

fn is_the_solution(weights: Option<&[f32]>) {
    let size = Size::new(14, 18);
    let operator = Blur(size);
    let (truth, lambda) = (picture(size), 3e-3);
    let film = film_of(&operator, &truth, 0.01);
    let used = Rect::new(1, 2, 12, 15);
    let free: Vec<bool> = (0..size.pixels()).map(|i| i / 18 > 1 && i % 18 > 2 && i % 18 < 16).collect();
    let start: Vec<f64> = film.iter().map(|v| f64::from(*v)).collect();
    let part =
        Part { operator: &operator, film: &film, used, start: &start, free: &free, weights, background: 0.0 };
    let spectrum =
        LocalSpectrum::new(&operator, 5, size.rect()).unwrap().with_density(weights.map_or(1.0, |_| 0.25));
    let stop = tikhonov::Stop { tolerance: 1e-7, max_iterations: 200 };
    let found = tikhonov::restore(&part, &spectrum, lambda, stop).unwrap();
    assert!(found.converged && found.iterations < 60, "{} iterations", found.iterations);

    // The normal equations, dense: rows of the film and of differences, columns of free pixels.
    let index: Vec<usize> = (0..free.len()).filter(|i| free[*i]).collect();
    let mut rows = vec![vec![0.0; size.pixels()]; size.pixels()];
    operator.each(|from, to, weight| rows[to][from] += f64::from(weight as f32));
    let is_used = |i: usize| used.contains(Rect::new((i / 18) as i64, (i % 18) as i64, 1, 1));
    let mut system: Vec<(Vec<f64>, f64)> = Vec::new();
    for (i, row) in rows.into_iter().enumerate().filter(|(i, _)| is_used(*i)) {
        let root = weights.map_or(1.0, |weights| f64::from(weights[i]).sqrt());
        system.push((row.into_iter().map(|v| root * v).collect(), root * f64::from(film[i])));
    }
    for i in 0..size.pixels() {
        let next = [(i % 18 + 1 < 18, i + 1), (i / 18 + 1 < 14, i + 18)];
        for (_, j) in next.into_iter().filter(|(exists, _)| *exists) {
            let mut row = vec![0.0; size.pixels()];
            (row[i], row[j]) = (-f64::sqrt(lambda), f64::sqrt(lambda));
            system.push((row, 0.0));
        }
    }
    let fixed =
        |row: &[f64]| -> f64 { (0..row.len()).filter(|i| !free[*i]).map(|i| row[i] * start[i]).sum() };
    let n = index.len();
    let (mut a, mut b) = (vec![vec![0.0; n]; n], vec![0.0; n]);
    for (row, value) in &system {
        let rest = value - fixed(row);
        for (k, i) in index.iter().enumerate().filter(|(_, i)| row[**i] != 0.0) {
            b[k] += row[*i] * rest;
            index.iter().enumerate().for_each(|(l, j)| a[k][l] += row[*i] * row[*j]);
        }
    }
    for (k, expected) in solve(a, b).into_iter().enumerate() {
        let error = (found.chart[index[k]] - expected).abs();
        assert!(error < 2e-5, "pixel {}: {error}", index[k]);
    }
    let is_kept = |i: usize| free[i] || found.chart[i] == start[i];
    assert!((0..free.len()).all(is_kept), "pixels that are not free keep their start");
}

#[test]
fn richardson_lucy_keeps_light_and_is_not_negative() {
    let size = Size::new(20, 24);
    let operator = Blur(size);
    // Dark beside the border: no light is lost there.
    let inner = |i: usize| (4..16).contains(&(i / 24)) && (4..20).contains(&(i % 24));
    let truth: Vec<f64> =
        picture(size).iter().enumerate().map(|(i, v)| if inner(i) { *v } else { 0.0 }).collect();
    let film = film_of(&operator, &truth, 0.0);
    let free = vec![true; size.pixels()];
    let start = vec![truth.iter().sum::<f64>() / truth.len() as f64; size.pixels()];
    let part = Part {
        operator: &operator,
        film: &film,
        used: size.rect(),
        start: &start,
        free: &free,
        weights: None,
        background: 0.0,
    };
    let sum = |film: &[f32]| film.iter().map(|v| f64::from(*v)).sum::<f64>();
    let error = |chart: &[f64]| chart.iter().zip(&truth).map(|(a, b)| (a - b).powi(2)).sum::<f64>();
    let before = error(&film.iter().map(|v| f64::from(*v)).collect::<Vec<_>>());
    for count in [1, 5, 60] {
        let found = richardson_lucy::restore(&part, count).unwrap();
        assert!(found.chart.iter().all(|v| *v >= 0.0));
        // Σ of the film is kept after each step, up to the light that steps put beside the border.
        let light = sum(&part.film_of(&found.chart).unwrap()) / sum(&film);
        assert!((light - 1.0).abs() < 1e-5, "{count} steps: {light}");
        if count == 60 {
            assert!(error(&found.chart) < 0.25 * before);
        }
    }
}

/// Within a twentieth, the aim of the command, and what the border adds.
#[test]
fn lambda_of_the_discrepancy_leaves_the_noise() {
    let size = Size::new(96, 96);
    let (operator, sigma) = (Blur(size), 0.02);
    let film = film_of(&operator, &picture(size), sigma);
    let spectrum = LocalSpectrum::new(&operator, 5, size.rect()).unwrap();
    let power = PartPower::new(&spectrum, &film, size);
    let lambda = lambda(std::slice::from_ref(&power), sigma * sigma);
    assert!((power.residual(lambda) / (sigma * sigma) - 1.0).abs() < 1e-3);
    let start: Vec<f64> = film.iter().map(|v| f64::from(*v)).collect();
    let free = vec![true; size.pixels()];
    let part = Part {
        operator: &operator,
        film: &film,
        used: size.rect(),
        start: &start,
        free: &free,
        weights: None,
        background: 0.0,
    };
    let stop = tikhonov::Stop { tolerance: 1e-6, max_iterations: 100 };
    let found = tikhonov::restore(&part, &spectrum, lambda, stop).unwrap();
    let (sum, count) = part.square_residual(&found.chart, Rect::new(8, 8, 80, 80)).unwrap();
    let measured = sum / count as f64;
    assert!((measured / (sigma * sigma) - 1.0).abs() < 0.15, "{}", measured / (sigma * sigma));
}

/// Of 250 000 pixels the median is known to 0.3 %.
#[test]
fn noise_is_that_of_a_film_with_edges() {
    let size = Size::new(500, 500);
    let picture: Vec<f64> = (0..size.pixels()).map(|i| ((i / 500 / 50) % 2) as f64).collect();
    let film: Vec<f32> =
        picture.iter().zip(unit_noise(size.pixels(), 3)).map(|(v, n)| (v + 0.01 * n) as f32).collect();
    for count in [size.pixels(), 40_000] {
        let mut estimate = NoiseEstimate::default();
        estimate.add(&film, 500, count);
        let sigma = estimate.sigma();
        assert!((sigma / 0.01 - 1.0).abs() < 0.05, "{sigma}");
    }
    assert_eq!(NoiseEstimate::default().sigma(), 0.0);
}

#[test]
fn weights_of_tiles_sum_to_one() {
    for (picture, side, overlap) in
        [(Size::new(50, 97), 16, 8), (Size::new(30, 20), 64, 16), (Size::new(40, 40), 20, 0)]
    {
        let tiles = Tiles { picture, side, overlap };
        let rect = Rect::new(3, 5, picture.height - 7, picture.width - 6);
        let mut sum = vec![0.0f32; rect.size().pixels()];
        for core in tiles.reaching(rect) {
            tiles.add(core, &vec![1.0; tiles.extent(core).size().pixels()], rect, &mut sum);
        }
        assert!(sum.iter().all(|s| (s - 1.0).abs() < 1e-6), "{picture} {side} {overlap}");
    }
}

/// A Gaussian of RMS s has MTF 1/2 at √(2 ln 2)/(2π s); one with a negative ring overshoots.
#[test]
fn response_is_that_of_a_gaussian() {
    let size = Size::new(41, 41);
    let image: Vec<f64> = (0..size.pixels())
        .map(|i| {
            let (y, x) = ((i / 41) as f64 - 20.0, (i % 41) as f64 - 20.0);
            (-0.5 * (x * x + y * y) / 4.0).exp()
        })
        .collect();
    let found = Response::new(&image, size, size.rect());
    assert!((found.mtf50 - (2.0 * 2f64.ln()).sqrt() / (2.0 * std::f64::consts::PI * 2.0)).abs() < 1e-3);
    assert!(found.overshoot < 1e-12);
    let mut ringing = image;
    ringing[20 * 41 + 10] -= 0.1 * ringing.iter().sum::<f64>();
    assert!((Response::new(&ringing, size, size.rect()).overshoot - 0.1 / 0.9).abs() < 0.01);
}

/// A film of half the picture's scale and illumination 1/2: a ramp on it is one in the picture, and parts agree.
#[test]
fn start_values_undo_scale_and_illumination() {
    let film_size = Size::new(20, 30);
    let film: Vec<f32> = (0..film_size.pixels()).map(|i| (i % 30) as f32 + 100.0 * (i / 30) as f32).collect();
    let part = |rect: Rect| {
        let place = |(y, x): (f64, f64)| Place { row: y / 2.0, column: x / 2.0, illumination: 0.5 };
        let places = Places::new(rect, Places::points(rect).into_iter().map(place).collect());
        let whole = Rect::new(0, 0, rect.height, rect.width);
        (places.start(&film, film_size.rect(), 3.0), places.shown(whole, film_size))
    };
    let rect = Rect::new(-5, 3, 60, 43);
    let (start, shown) = part(rect);
    for (i, (value, shown)) in start.iter().zip(shown).enumerate() {
        let (y, x) = ((i / 43) as f64 - 5.0, (i % 43) as f64 + 3.0);
        let (row, column) = ((y / 2.0).clamp(0.0, 19.0), (x / 2.0).clamp(0.0, 29.0));
        assert!((value - (column + 100.0 * row) / 1.5).abs() < 1e-9);
        assert_eq!(shown, (-1.0..=39.0).contains(&y) && (-1.0..=59.0).contains(&x));
    }
    let inner = Rect::new(7, 9, 13, 11);
    let (of_inner, _) = part(inner);
    assert!((0..13).all(|y| of_inner[y * 11..][..11] == start[(y + 12) * 43 + 6..][..11]));
}

#[test]
fn means_of_samples_are_bilinear_between_those_of_a_bayer_mosaic() {
    let rect = Rect::new(3, 5, 12, 14);
    // A plane; red at even rows and columns of the sensor, other values elsewhere.
    let value = |y: i64, x: i64| 2.0 * y as f32 - 3.0 * x as f32;
    let places = || (rect.y..rect.bottom()).flat_map(|y| (rect.x..rect.right()).map(move |x| (y, x)));
    let are_of_filter: Vec<bool> = places().map(|(y, x)| y % 2 == 0 && x % 2 == 0).collect();
    let values: Vec<f32> =
        places().zip(&are_of_filter).map(|((y, x), red)| if *red { value(y, x) } else { 1e6 }).collect();
    let samples = Samples { values: &values, are_of_filter: &are_of_filter, rect };
    let inner = Rect::new(5, 7, 8, 9);
    let found = samples.means(inner, 1);
    for (i, found) in found.iter().enumerate() {
        let (y, x) = (inner.y + (i / inner.width) as i64, inner.x + (i % inner.width) as i64);
        assert!((found - value(y, x)).abs() < 1e-4, "{y}, {x}: {found}");
    }
    let none = Samples { values: &values, are_of_filter: &vec![false; values.len()], rect };
    assert!(none.means(inner, 2).iter().all(|v| v.is_nan()));
}

/// A saturated pixel and those behind other filters have no influence; electrons with read noise of σ² = b count as Poisson numbers.
#[test]
fn richardson_lucy_leaves_out_what_is_not_measured() {
    let size = Size::new(20, 24);
    let operator = Blur(size);
    let truth = picture(size);
    let mut film = film_of(&operator, &truth, 0.0);
    let free = vec![true; size.pixels()];
    let start = vec![0.5; size.pixels()];
    let weights: Vec<f32> = (0..size.pixels()).map(|i| [0.0, 0.3, 2.0][i % 3]).collect();
    let restore = |film: &[f32], background: f32| {
        let part = Part {
            operator: &operator,
            film,
            used: size.rect(),
            start: &start,
            free: &free,
            weights: Some(&weights),
            background,
        };
        richardson_lucy::restore(&part, 40).unwrap().chart
    };
    let [without, with] = [0.0, 0.2].map(|background| restore(&film, background));
    for i in (0..film.len()).step_by(3) {
        film[i] = 9.0;
    }
    assert_eq!(restore(&film, 0.0), without);
    assert_ne!(with, without);
    let error = |chart: &[f64]| {
        let inner = (0..chart.len()).filter(|i| (3..17).contains(&(i / 24)) && (3..21).contains(&(i % 24)));
        let (sum, count) = inner.fold((0.0, 0), |(sum, n), i| (sum + (chart[i] - truth[i]).powi(2), n + 1));
        (sum / f64::from(count)).sqrt()
    };
    assert!(error(&without) < 0.1 && error(&with) < 0.12, "{} {}", error(&without), error(&with));
}

/// The condition of the minimum: no other chart near it has a smaller sum; and plateaus are restored better than by differences of neighbours.
#[test]
fn total_variation_is_least_at_its_solution() {
    let size = Size::new(40, 44);
    let operator = Blur(size);
    let (truth, sigma) = (picture(size), 0.02);
    let film = film_of(&operator, &truth, sigma);
    let start: Vec<f64> = film.iter().map(|v| f64::from(*v)).collect();
    let free: Vec<bool> = (0..size.pixels()).map(|i| i % 44 > 1).collect();
    let used = size.rect();
    let part = Part {
        operator: &operator,
        film: &film,
        used,
        start: &start,
        free: &free,
        weights: None,
        background: 0.0,
    };
    let spectrum = LocalSpectrum::new(&operator, 5, used).unwrap();
    let mu = 2e-3;
    let stop = tikhonov::Stop { tolerance: 1e-6, max_iterations: 1000 };
    let found = total_variation::restore(&part, &spectrum, mu, stop).unwrap();
    assert!(found.converged, "{} iterations", found.iterations);
    let variation = |chart: &[f64]| -> f64 {
        let next = |i: usize, ok: bool, j: usize| if ok { chart[j] - chart[i] } else { 0.0 };
        (0..chart.len())
            .map(|i| next(i, i / 44 + 1 < 40, i + 44).hypot(next(i, i % 44 + 1 < 44, i + 1)))
            .sum()
    };
    let sum = |chart: &[f64]| 0.5 * part.square_residual(chart, used).unwrap().0 + mu * variation(chart);
    let least = sum(&found.chart);
    let others =
        [start.clone(), truth.clone(), tikhonov::restore(&part, &spectrum, 4e-3, stop).unwrap().chart];
    for other in &others {
        for share in [1.0, 0.1, 0.01] {
            let chart: Vec<f64> = (0..other.len())
                .map(|i| found.chart[i] + if free[i] { share * (other[i] - found.chart[i]) } else { 0.0 })
                .collect();
            assert!(sum(&chart) > least, "share {share}: {} {least}", sum(&chart));
        }
    }
    assert!((0..free.len()).all(|i| free[i] || found.chart[i] == start[i]));
    let error = |chart: &[f64]| {
        let inner = (0..chart.len()).filter(|i| (3..37).contains(&(i / 44)) && (5..41).contains(&(i % 44)));
        inner.map(|i| (chart[i] - truth[i]).powi(2)).sum::<f64>()
    };
    assert!(error(&found.chart) < 0.7 * error(&others[2]), "{} {}", error(&found.chart), error(&others[2]));
}

#[test]
fn lambda_is_found_from_residuals_alone() {
    for (power, factor) in [(0.1, 3.0), (0.9, 1e-4), (0.3, 40.0), (0.02, 1.2)] {
        let residual = |lambda: f64| factor * lambda.powf(power) + 1e-3;
        let mut measured = vec![(1e-4, residual(1e-4))];
        while (measured[measured.len() - 1].1 - 1.0).abs() >= 0.05 {
            assert!(measured.len() < 9, "power {power}: {measured:?}");
            let lambda = next(&measured);
            measured.push((lambda, residual(lambda)));
        }
    }
}
