//! Middle parts against the PSFs that they are a part of, on a grid that holds all of it.

use super::*;
use crate::design::prescription::system::System;
use crate::lens::tail::value;

/// A wavelength and the last height; samples of the window, and of the Huygens sum to either side.
struct Case {
    um: f64,
    last_mm: f64,
    window: usize,
    half: usize,
}

/// The largest errors of half planes, of white, that rays in place of waves make: at two edges through each PSF; the error of the light of all; the light beyond the window.
fn errors(system: &System, case: &Case) -> Vec<[f64; 4]> {
    let tracer = Tracer::new(system, case.um).unwrap();
    let heights = [0.0, 0.6 * case.last_mm, case.last_mm];
    let pupils = Pupils::new(&tracer, &heights).unwrap();
    let edges: Vec<Edge> = heights.iter().map(|h| pupils.at(*h).edge(tracer.surfaces())).collect();
    let pitch_um = heights.map(|h| 0.9 * pupils.at(h).nyquist_um()).into_iter().fold(f64::INFINITY, f64::min);
    let grid = PsfGrid::new(case.window / 2, pitch_um);
    let window = (grid.size(), pitch_um);
    let tail = tail_with_middle(&tracer, &pupils, (&heights, &edges), window, case.half).unwrap().unwrap();
    tail.check(1e3 * case.um).unwrap();
    let middle = tail.middle.as_ref().unwrap();
    let half_mm = 0.5e-3 * grid.size() as f64 * pitch_um;
    assert!(tail.inner_mm > half_mm, "rays land beyond the window");
    // All of the PSF, with as much again of its tail.
    let whole = PsfGrid::new((2e3 * tail.inner_mm / pitch_um) as usize, pitch_um);
    let (n, step) = (whole.size(), 1e-3 * pitch_um);
    let at = |i: usize| (i as f64 - (n / 2) as f64) * step;
    let of_height = |(k, h): (usize, &f64)| {
        let psf = whole.psf(pupils.at(*h), 0.0, &mut PsfScratch::default());
        // Light of middle part, found and expected, in columns and rows.
        let mut lines = [vec![[0.0; 2]; n], vec![[0.0; 2]; n]];
        let (mut all, mut beyond) = (0.0, 0.0);
        for (i, v) in psf.iter().enumerate() {
            let (y, x) = (at(i / n), at(i % n));
            let r = (x * x + y * y).sqrt();
            all += v;
            beyond += if x.abs().max(y.abs()) < half_mm { 0.0 } else { *v };
            if r > tail.inner_mm {
                continue;
            }
            let t = value(&tail.coefficients[k], tail.inner_mm, x, y) * step * step;
            let expected = (1.0 - core_share(r, half_mm)) * (v - t);
            let found = middle.density(k, x, y) * step * step;
            for (line, place) in lines.iter_mut().zip([i % n, i / n]) {
                line[place][0] += found;
                line[place][1] += expected;
            }
        }
        let worst = |line: &[[f64; 2]]| {
            let (mut sum, mut worst) = (0.0, 0.0_f64);
            for [found, expected] in line {
                sum += found - expected;
                worst = worst.max(sum.abs());
            }
            worst
        };
        let expected: f64 = lines[0].iter().map(|v| v[1]).sum();
        println!("{h} mm: middle part {:.4}, of rays {expected:.4}, light {all:.5}", middle.shares()[k]);
        [worst(&lines[0]), worst(&lines[1]), (middle.shares()[k] - expected).abs(), beyond]
    };
    heights.iter().enumerate().map(of_height).collect()
}

#[test]
fn edges_by_rays_are_about_those_of_the_whole_psf() {
    // The edge rays land up to 160 µm away, half a window is 108 µm.
    let case = Case { um: 0.4, last_mm: 20.0, window: 401, half: 0 };
    for [across, along, light, beyond] in errors(&System::double_gauss_28(), &case) {
        println!("columns {across:.1e}, rows {along:.1e}, light {light:.1e}; {beyond:.1e} beyond the window");
        // A window of 95 to 99 % of the light, which cuts through the caustic of the edge rays off the axis; without a middle part half of what is beyond it.
        let limit = 1.2e-3 + 0.15 * beyond;
        assert!(across < limit && along < limit && light < 2.5e-3, "{across} {along} {light}, {beyond}");
    }
}

#[test]
fn edges_by_huygens_sums_are_those_of_the_whole_psf() {
    let case = Case { um: 0.4, last_mm: 20.0, window: 301, half: MAX_HALF };
    for [across, along, light, beyond] in errors(&System::double_gauss_28(), &case) {
        println!("columns {across:.1e}, rows {along:.1e}, light {light:.1e}; {beyond:.1e} beyond the window");
        // Half of the light is in the middle part, most of it in a caustic that its samples of 3 µm widen.
        assert!(across < 2.5e-3 && along < 2.5e-3 && light < 1e-5, "{across} {along} {light}, {beyond}");
    }
}

#[test]
fn edges_by_sums_of_longer_waves_are_those_of_the_whole_psf() {
    // 2.5 mm out of focus: samples of the middle part, which has 94 % of the light, are 9 to 10 times as wide as the Nyquist pitch. On the axis 1.3e-3; the band's own waves have 6e-4.
    let mut system = System::double_gauss_28();
    let image = system.image();
    system.surfaces[image - 1].thickness_mm += 2.5;
    let case = Case { um: 0.4, last_mm: 20.0, window: 401, half: MAX_HALF };
    for [across, along, light, beyond] in errors(&system, &case) {
        println!("columns {across:.1e}, rows {along:.1e}, light {light:.1e}; {beyond:.1e} beyond the window");
        assert!(across < 3.5e-3 && along < 2.5e-3 && light < 4e-4, "{across} {along} {light}, {beyond}");
    }
}

#[test]
fn rays_much_beyond_the_window_leave_a_band_without_tails() {
    let system = System::double_gauss_28();
    let tracer = Tracer::new(&system, 0.4).unwrap();
    let heights = [0.0, 10.0, 20.0];
    let pupils = Pupils::new(&tracer, &heights).unwrap();
    let edges: Vec<Edge> = heights.iter().map(|h| pupils.at(*h).edge(tracer.surfaces())).collect();
    let none = tail_with_middle(&tracer, &pupils, (&heights, &edges), (11, 0.5), 0).unwrap().unwrap_err();
    assert!(none.blur_um > 100.0 && none.half_um < 3.0, "{none:?}");
}
