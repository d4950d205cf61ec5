//! Layers against the NumPy reference, closed forms and invariants.

use super::*;
use crate::field::Outside;
use crate::flow::{ChartSource, SourceSinkError};
use crate::geometry::Rect;
use crate::layer::{Layer, Taps};
use crate::options::PsfBetween;
use crate::remap::ChartInterpolation;
use crate::resample::{Interp, Surround};
use crate::simd::Simd;
use crate::stages::default_stages;
use std::sync::atomic::AtomicBool;

/// A chart with the value f(row, column).
struct Drawn<F>(Size, F);

impl<F: Fn(usize, usize) -> f32 + Sync> ChartSource for Drawn<F> {
    fn size(&self) -> Size {
        self.0
    }
    fn read(&self, _: usize, rect: Rect, out: &mut [f32]) -> Result<(), SourceSinkError> {
        let at = |i: usize| (rect.y as usize + i / rect.width, rect.x as usize + i % rect.width);
        out.iter_mut().enumerate().for_each(|(i, value)| *value = self.1(at(i).0, at(i).1));
        Ok(())
    }
}

fn options(surround: Surround) -> Options {
    Options {
        stages: default_stages(),
        interpolation: ChartInterpolation { interp: Interp::Bicubic, surround, outside: Outside::Clamp },
        azimuths: None,
        psf_window: None,
        between: PsfBetween::Error,
        simd: Simd::PORTABLE,
    }
}

/// A lens with the ideal heights and relative illumination `ideal_and_ri` of REAL heights 0, 0.01, … 1 mm times `unit`.
fn band(unit: f64, ideal_and_ri: impl Fn(f64) -> (f64, f64)) -> LensBand {
    let real: Vec<f64> = (0..101).map(|i| f64::from(i) * 0.01).collect();
    LensBand {
        ideal_height_mm: real.iter().map(|r| unit * ideal_and_ri(*r).0).collect(),
        relative_illumination: real.iter().map(|r| ideal_and_ri(*r).1).collect(),
        psf_height_mm: vec![0.0, 1.0],
        ..LensBand::ideal(550.0, real.iter().map(|r| unit * r).collect())
    }
}

fn layer_of(
    (frame, plan): (&Frame, VeilPlan),
    band: &LensBand,
    (gain, shares): (f64, VeilShares),
    surround: Surround,
    chart: &dyn ChartSource,
) -> Vec<f32> {
    let reduced = ReducedChart::read(chart, 0, plan.reduced_px, 2, &AtomicBool::new(false)).unwrap();
    VeilMaker::new(plan).layer(frame, band, &options(surround), (gain, shares), &reduced, None, 2)
}

/// A scene with a bright square through a lens without aberrations, whose chart coordinates are exact between the corners of bins, and through one that
/// distorts and shades: there the interpolation of the coordinates is allowed 2e-4.
#[test]
fn layers_equal_the_reference() {
    let chart = |y: usize, x: usize| {
        let is_bright = (30..50).contains(&y) && (100..120).contains(&x);
        ((y * 7 + x * 13) % 32) as f32 / 16.0 + if is_bright { 40.0 } else { 0.0 }
    };
    let chart = Drawn(Size::new(120, 170), chart);
    let frame = Frame { axis_px: (48.25, 70.5), ..Frame::centred(Size::new(100, 140), chart.size(), 5.0) };
    let plan = VeilPlan::new(&frame, 8, Some((0.02, 2.5, Some(0.3)))).unwrap();
    assert_eq!((plan.grid.size(), plan.reduced_px), (Size::new(17, 22), 8));
    let shares = VeilShares { glare: 0.02, scatter: 0.03 };
    let ideal = band(1.0, |r| (r, 1.0));
    let distorting = band(1.0, |r| (r * (1.0 + 0.03 * r * r), 1.0 - 0.2 * r * r));
    for (band, expected, sum, tolerance) in
        [(ideal, IDEAL, 68.10538480369314, 2e-7), (distorting, DISTORTING, 67.14931350666268, 2e-4)]
    {
        let layer = layer_of((&frame, plan), &band, (2.0, shares), Surround::Edge, &chart);
        for ((i, j), expected) in expected {
            let found = f64::from(layer[i * 22 + j]);
            assert!((found / expected - 1.0).abs() < tolerance, "({i}, {j}): {found} {expected}");
        }
        let found: f64 = layer.iter().map(|value| f64::from(*value)).sum();
        assert!((found / sum - 1.0).abs() < tolerance, "{found} {sum}");
    }
}

type Bins = [((usize, usize), f64); 7];

/// `reduce_chart`, `light_of_bins`, `cell_kernel` and `fftconvolve` of light_reference.py (NumPy 2.4.6, SciPy 1.17.1) on the scene of the test, continued by
/// 160 px of its outermost pixels; glare the mean over the film of the same light.
const IDEAL: Bins = [
    ((0, 0), 0.12739239362161953),
    ((2, 2), 0.14152237986234253),
    ((3, 11), 0.22978328662545733),
    ((6, 14), 0.9892585355899034),
    ((8, 9), 0.1620348317730822),
    ((16, 21), 0.15132651861578178),
    ((7, 20), 0.15083196542557173),
];
const DISTORTING: Bins = [
    ((0, 0), 0.12276257583559316),
    ((2, 2), 0.13861878115072226),
    ((3, 11), 0.22763004361683342),
    ((6, 14), 0.9826679008154718),
    ((8, 9), 0.16087875306043062),
    ((16, 21), 0.14710121795629952),
    ((7, 20), 0.14798437053075464),
];

/// A film of 512 x 512 px of 16 µm, chart one to one, lens without aberrations.
fn white_film() -> (Frame, LensBand) {
    let side = Size::new(512, 512);
    (Frame::centred(side, side, 16.0), band(20.0, |r| (r, 1.0)))
}

/// White but for a disc of `radius_px` about the centre of bin (32, 32).
fn black_disc(radius_px: f64) -> Drawn<impl Fn(usize, usize) -> f32 + Sync> {
    let is_black = move |y: usize, x: usize| (y as f64 - 259.5).hypot(x as f64 - 259.5) <= radius_px;
    Drawn(Size::new(512, 512), move |y, x| f32::from(!is_black(y, x)))
}

#[test]
fn glare_of_a_black_disc_has_its_closed_form() {
    let ((frame, band), chart, glare) = (white_film(), black_disc(60.0), 0.02);
    let plan = VeilPlan::new(&frame, 8, None).unwrap();
    let shares = VeilShares { glare, scatter: 0.0 };
    let layer = layer_of((&frame, plan), &band, (1.0, shares), Surround::Edge, &chart);
    let pixels = (0..512 * 512).filter(|i| chart.1(i / 512, i % 512) == 0.0).count();
    let share = pixels as f64 / (512.0 * 512.0);
    let expected = glare * (1.0 - share) / (1.0 - glare * share);
    for veil in layer {
        let index = f64::from(veil) / (1.0 - glare + f64::from(veil));
        assert!((index / expected - 1.0).abs() < 1e-6, "{index} {expected}");
    }
}

#[test]
fn scatter_of_a_black_disc_has_its_closed_form() {
    let ((frame, band), chart, share) = (white_film(), black_disc(1.5 / 0.016), 0.03);
    for (slope, shoulder_mm) in [(2.0, 0.05), (2.5, 0.1), (3.0, 0.5)] {
        let plan = VeilPlan::new(&frame, 8, Some((shoulder_mm, slope, Some(4.0)))).unwrap();
        let shares = VeilShares { glare: 0.0, scatter: share };
        let layer = layer_of((&frame, plan), &band, (1.0, shares), Surround::Edge, &chart);
        let found = f64::from(layer[34 * plan.grid.size().width + 34]);
        let expected = share * (1.0 - plan.scatter.unwrap().share_within(1.5));
        assert!((found / expected - 1.0).abs() < 0.01, "{slope}: {found} {expected}");
    }
}

/// Rounding of f32 of the coefficients.
#[test]
fn uniform_field_stays_uniform() {
    let (frame, band) = white_film();
    let plan = VeilPlan::new(&frame, 16, Some((0.02, 2.2, None))).unwrap();
    let shares = VeilShares { glare: 0.04, scatter: 0.06 };
    let chart = Drawn(Size::new(512, 512), |_, _| 3.0);
    for value in layer_of((&frame, plan), &band, (1.0, shares), Surround::Edge, &chart) {
        assert!((f64::from(value) / 0.3 - 1.0).abs() < 1e-6, "{value}");
    }
}

/// All light of a bright spot is on the film and what its scatter reaches around it.
#[test]
fn light_is_conserved() {
    let (frame, band) = white_film();
    let chart =
        Drawn(Size::new(512, 512), |y, x| f32::from((200..260).contains(&y) && (250..300).contains(&x)));
    let plan = VeilPlan::new(&frame, 8, Some((0.02, 2.5, Some(3.0)))).unwrap();
    let shares = VeilShares { glare: 0.01, scatter: 0.05 };
    let layer = layer_of((&frame, plan), &band, (1.0, shares), Surround::Black, &chart);
    let layer = Layer::new(plan.grid, Taps::BSpline, layer);
    let mut pixels = crate::buffer::ShardPixels::new(frame.film);
    pixels.reach(512, Vec::new);
    layer.add(frame.film.rect(), &mut pixels);
    let sum: f64 = (0..512).flat_map(|y| pixels.row(y)).map(|value| f64::from(*value)).sum();
    assert!((sum / (0.06 * 60.0 * 50.0) - 1.0).abs() < 1e-6, "{sum}");
}

#[test]
fn bins_and_reach_fit_the_film() {
    let usual = |side| VeilPlan::usual_bin_px(Size::new(side, side / 2));
    assert_eq!([100, 4096, 4097, 14141, 16385, 100_000].map(usual), [8, 8, 16, 32, 64, 64]);
    let small = Frame::centred(Size::new(30, 40), Size::new(30, 40), 2.0);
    assert!(matches!(VeilPlan::new(&small, 64, None), Err(VeilError::Bin { bin_px: 64, .. })));
    let (frame, _) = white_film();
    let reach = |reach_mm| VeilPlan::new(&frame, 8, Some((0.02, 2.5, reach_mm)));
    assert!(reach(Some(0.5)).is_err() && reach(Some(7.95)).is_err() && reach(Some(7.9)).is_ok());
    // Half the diagonal, 5.8 mm.
    assert!((reach(None).unwrap().scatter.unwrap().reach_mm - 256.0 * 2f64.sqrt() * 0.016).abs() < 1e-12);
    // The largest grid: 512 bins with a reach of 510.
    let side = Size::new(4096, 4096);
    let frame = Frame::centred(side, side, 1.0);
    let plan = VeilPlan::new(&frame, 8, Some((0.02, 2.5, Some(4.08)))).unwrap();
    assert_eq!(plan.padded(), Size::new(1536, 1536));
    assert!(plan.making_bytes(side, 1) < 80 << 20);
}

/// One bright pixel in black surroundings: glare is a share of the light of the film, whatever the sizes.
#[test]
fn glare_is_the_mean_of_films_of_any_size() {
    // A last cell of one row lacks a part of the light of the cell before it.
    for (film, chart, tolerance) in [
        ((101, 97), (101, 77), 1e-3),
        ((64, 64), (64, 64), 1e-3),
        ((51, 90), (61, 99), 1e-3),
        ((240, 202), (20, 300), 1e-3),
        ((240, 202), (17, 300), 0.07),
    ] {
        let (film, size) = (Size::new(film.0, film.1), Size::new(chart.0, chart.1));
        // The chart's last column, or well within the film.
        let (row, column) = (size.height / 2, ((size.width + film.width) / 2 - 17).min(size.width - 1));
        let chart = Drawn(size, move |y, x| if (y, x) == (row, column) { 7.0 } else { 0.0 });
        let frame = Frame::centred(film, size, 5.0);
        let plan = VeilPlan::new(&frame, 8, None).unwrap();
        let ideal = band(1.0, |r| (r, 1.0));
        let shares = VeilShares { glare: 0.1, scatter: 0.0 };
        let layer = layer_of((&frame, plan), &ideal, (3.0, shares), Surround::Black, &chart);
        let expected = 0.1 * 3.0 * 7.0 / film.pixels() as f64;
        assert!(layer.iter().all(|v| v.to_bits() == layer[0].to_bits()));
        let found = f64::from(layer[0]);
        assert!((found / expected - 1.0).abs() < tolerance, "{film} of {size}: {found}, {expected}");
    }
    // Uniform light, in black surroundings, too.
    let film = Size::new(61, 93);
    let frame = Frame::centred(film, film, 5.0);
    let plan = VeilPlan::new(&frame, 8, None).unwrap();
    let shares = VeilShares { glare: 0.1, scatter: 0.0 };
    let uniform = Drawn(film, |_, _| 2.0);
    let layer = layer_of((&frame, plan), &band(1.0, |r| (r, 1.0)), (1.0, shares), Surround::Black, &uniform);
    assert!((f64::from(layer[0]) - 0.2).abs() < 1e-7, "{}", layer[0]);
}
