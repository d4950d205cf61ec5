//! Checks of the remap stage for every engine: any scale, surround, interpolation, axis, centre and table, compared with the f64 map.

use crate::oracle::{self, Image, Noise, Tables, errors};
use lenscube_pipeline::field::Outside;
use lenscube_pipeline::flow::{ChartSource, SourceSinkError};
use lenscube_pipeline::geometry::{Frame, Rect, Size};
use lenscube_pipeline::lens::LensBand;
use lenscube_pipeline::remap::ChartInterpolation;
use lenscube_pipeline::resample::{Interp, Surround};
use lenscube_pipeline::stage::{Stage, Stages};

/// An implementation of the remap stage.
pub trait Engine {
    /// The remapped pixels of `rect` for `job` and `chart`.
    fn remap(&self, job: &Job<'_>, chart: &dyn ChartSource, rect: Rect) -> Vec<f32>;
}

/// Parameters of one band's remap stage.
pub struct Job<'a> {
    pub frame: &'a Frame,
    pub lens: &'a LensBand,
    pub stages: Stages,
    pub interpolation: ChartInterpolation,
    pub gain: f64,
}

pub type Check = fn(&dyn Engine);

/// All of it.
pub const CHECKS: [(&str, Check); 8] = [
    ("coordinates_equal_the_exact_map", coordinates_equal_the_exact_map),
    ("remap_equals_the_f64_model", remap_equals_the_f64_model),
    (
        "white_noise_far_from_the_axis_equals_the_f64_model",
        white_noise_far_from_the_axis_equals_the_f64_model,
    ),
    ("strongly_bent_map_equals_the_f64_model", strongly_bent_map_equals_the_f64_model),
    ("uniform_chart_gives_the_relative_illumination", uniform_chart_gives_the_relative_illumination),
    ("identity_lens_returns_the_chart_bit_for_bit", identity_lens_returns_the_chart_bit_for_bit),
    ("pixels_do_not_depend_on_the_tiles", pixels_do_not_depend_on_the_tiles),
    ("last_table_values_apply_beyond_the_tables", last_table_values_apply_beyond_the_tables),
];

pub struct Chart(pub Image);

impl ChartSource for Chart {
    fn size(&self) -> Size {
        self.0.size
    }
    fn read(&self, _band: usize, rect: Rect, out: &mut [f32]) -> Result<(), SourceSinkError> {
        assert!(self.0.size.rect().contains(rect) && out.len() == rect.size().pixels());
        for (i, v) in out.iter_mut().enumerate() {
            *v = self.0.at(rect.y as usize + i / rect.width, rect.x as usize + i % rect.width) as f32;
        }
        Ok(())
    }
}

const ALL: Stages = Stages::of(&[Stage::Ri, Stage::Distortion, Stage::Svpsf]);
pub const FIRST_TWO: Stages = Stages::of(&[Stage::Ri, Stage::Distortion]);

pub fn noise_chart(noise: &mut Noise, size: Size) -> Chart {
    let data = (0..size.pixels()).map(|_| f64::from(noise.next() as f32)).collect();
    Chart(Image { size, data })
}

/// Tables of `points` unevenly spaced field points up to `last_mm`, with a few per cent of barrel or pincushion distortion.
pub fn band(noise: &mut Noise, points: usize, last_mm: f64) -> LensBand {
    let steps: Vec<f64> = (0..points - 1).map(|_| noise.between(0.3, 1.0)).collect();
    let sum: f64 = steps.iter().sum();
    let mut at = 0.0;
    let mut real = vec![0.0];
    real.extend(steps.iter().map(|s| {
        at += s / sum * last_mm;
        at
    }));
    oracle::lens_band(real, 1.01, noise.between(-0.05, 0.05))
}

fn remap_equals_the_f64_model(engine: &dyn Engine) {
    let mut noise = Noise(3);
    for case in 0..60 {
        let film = Size::new(1 + noise.below(90), 1 + noise.below(700));
        let chart = Size::new(1 + noise.below(120), 1 + noise.below(500));
        let mut scale = (noise.between(0.9, 2.5), noise.between(0.9, 2.5));
        match case % 4 {
            0 => scale = (1.0, 1.0),
            1 => scale = (noise.between(0.1, 1.0), noise.between(0.1, 2.0)),
            _ => (),
        }
        let mut frame = Frame { scale, ..Frame::centred(film, chart, 2.0) };
        if case % 3 == 1 {
            frame.axis_px = (noise.between(-50.0, 100.0), noise.between(-50.0, 600.0));
            frame.center_mm = (noise.between(-0.1, 0.1), noise.between(-0.1, 0.1));
        }
        let margin = noise.below(9);
        let rect = film.rect().grown(margin);
        let points = 3 + noise.below(400);
        let lens = band(&mut noise, points, frame.farthest_mm(rect) + 1e-9);
        let chart = noise_chart(&mut noise, chart);
        let t = Tables {
            ideal: &lens.ideal_height_mm,
            real: &lens.image_height_mm,
            ri: &lens.relative_illumination,
        };
        for (surround, outside) in [
            (Surround::Edge, oracle::Outside::Edge),
            (Surround::Black, oracle::Outside::Black),
            (Surround::Mirror, oracle::Outside::Mirror),
        ] {
            for interp in [Interp::Bicubic, Interp::Bilinear] {
                let interpolation = ChartInterpolation { interp, surround, outside: Outside::Error };
                let job = Job { frame: &frame, lens: &lens, stages: ALL, interpolation, gain: 1.0 };
                let got = engine.remap(&job, &chart, rect);
                let expected = oracle::remap(&chart.0, &frame, &t, rect, interp == Interp::Bicubic, outside);
                if expected.data.iter().all(|v| *v == 0.0) {
                    assert!(got.iter().all(|v| *v == 0.0));
                    continue;
                }
                let (worst, l2) = errors(&got, &expected.data);
                assert!(
                    worst <= 2e-6 && l2 <= 1e-6,
                    "case {case}, film {film}, chart {}, scale {scale:?}, {surround:?}, {interp:?}: max {worst:.1e}, L2 {l2:.1e}",
                    chart.0.size
                );
            }
        }
    }
}

fn uniform_chart_gives_the_relative_illumination(engine: &dyn Engine) {
    let mut noise = Noise(5);
    let film = Size::new(141, 211);
    let frame = Frame::centred(film, film, 20.0);
    let lens = band(&mut noise, 1000, frame.farthest_mm(film.rect()));
    let chart = Chart(Image::new(film, |_, _| 1.0));
    let interpolation =
        ChartInterpolation { interp: Interp::Bicubic, surround: Surround::Edge, outside: Outside::Error };
    let job = Job { frame: &frame, lens: &lens, stages: FIRST_TWO, interpolation, gain: 1.0 };
    let got = engine.remap(&job, &chart, film.rect());
    let t =
        Tables { ideal: &lens.ideal_height_mm, real: &lens.image_height_mm, ri: &lens.relative_illumination };
    let expected = oracle::remap(&chart.0, &frame, &t, film.rect(), true, oracle::Outside::Edge);
    // R is at most 1: an error relative to the peak is at least the difference.
    let (worst, _) = errors(&got, &expected.data);
    assert!(worst <= 5e-7, "departs from R by {worst:.1e}");
}

fn identity_lens_returns_the_chart_bit_for_bit(engine: &dyn Engine) {
    let mut noise = Noise(9);
    for film in [Size::new(1, 1), Size::new(64, 65), Size::new(133, 517)] {
        let frame = Frame::centred(film, film, 1.7);
        let mut lens = band(&mut noise, 50, frame.farthest_mm(film.rect()) + 1.0);
        lens.ideal_height_mm = lens.image_height_mm.clone();
        lens.relative_illumination.fill(1.0);
        let chart = noise_chart(&mut noise, film);
        let interpolation = ChartInterpolation {
            interp: Interp::Bicubic,
            surround: Surround::Black,
            outside: Outside::Error,
        };
        let job = Job { frame: &frame, lens: &lens, stages: FIRST_TWO, interpolation, gain: 1.0 };
        let got = engine.remap(&job, &chart, film.rect());
        assert_eq!(got.len(), chart.0.data.len());
        assert!(got.iter().zip(&chart.0.data).all(|(g, c)| *g == *c as f32), "film {film}");
    }
}

fn pixels_do_not_depend_on_the_tiles(engine: &dyn Engine) {
    let mut noise = Noise(13);
    let film = Size::new(200, 700);
    for scale in [(1.0, 1.0), (0.37, 0.6)] {
        let frame = Frame { scale, ..Frame::centred(film, Size::new(300, 400), 2.0) };
        let lens = band(&mut noise, 300, frame.farthest_mm(film.rect()));
        let chart = noise_chart(&mut noise, frame.chart);
        let interpolation = ChartInterpolation {
            interp: Interp::Bicubic,
            surround: Surround::Mirror,
            outside: Outside::Error,
        };
        let job = Job { frame: &frame, lens: &lens, stages: FIRST_TWO, interpolation, gain: 1.0 };
        let full = engine.remap(&job, &chart, film.rect());
        for part in film.rect().tiles(37, 129) {
            let got = engine.remap(&job, &chart, part);
            for (i, v) in got.iter().enumerate() {
                let (y, x) = (part.y as usize + i / part.width, part.x as usize + i % part.width);
                assert_eq!(v.to_bits(), full[y * film.width + x].to_bits());
            }
        }
    }
}

fn last_table_values_apply_beyond_the_tables(engine: &dyn Engine) {
    let mut noise = Noise(1);
    let film = Size::new(100, 100);
    let frame = Frame::centred(film, film, 2.0);
    let band = band(&mut noise, 20, frame.farthest_mm(film.rect()) * 0.9);
    let chart = Chart(Image::new(film, |_, _| 1.0));
    let interpolation =
        ChartInterpolation { interp: Interp::Bicubic, surround: Surround::Edge, outside: Outside::Clamp };
    let job = Job { frame: &frame, lens: &band, stages: FIRST_TWO, interpolation, gain: 1.0 };
    let got = engine.remap(&job, &chart, film.rect());
    assert!((f64::from(got[0]) - band.relative_illumination[19]).abs() < 1e-6);
}

/// A chart of column (or row) numbers minus `zero`: its interpolation is the coordinate.
struct Ramp {
    size: Size,
    zero: i64,
    rows: bool,
}

impl ChartSource for Ramp {
    fn size(&self) -> Size {
        self.size
    }
    fn read(&self, _band: usize, rect: Rect, out: &mut [f32]) -> Result<(), SourceSinkError> {
        for (i, v) in out.iter_mut().enumerate() {
            let at =
                if self.rows { rect.y + (i / rect.width) as i64 } else { rect.x + (i % rect.width) as i64 };
            *v = (at - self.zero) as f32;
        }
        Ok(())
    }
}

/// Anywhere on a film of 14,141² px, for any lens: within 1e-5 px (required: 1e-4), mostly errors of the ramp's f32 sums.
fn coordinates_equal_the_exact_map(engine: &dyn Engine) {
    let mut noise = Noise(17);
    let (film, chart) = (Size::new(14_141, 14_141), Size::new(40_000, 40_000));
    for case in 0..400 {
        let mut frame = Frame::centred(film, chart, noise.between(0.7, 6.0));
        if case % 2 == 1 {
            frame.scale = (noise.between(1.0, 2.5), noise.between(1.0, 2.5));
            frame.axis_px = (noise.between(-2000.0, 9000.0), noise.between(-2000.0, 9000.0));
            frame.center_mm = (noise.between(-1.0, 1.0), noise.between(-1.0, 1.0));
        }
        let rect = Rect::new(noise.below(14_100) as i64, noise.below(14_080) as i64, 9, 50);
        let last = frame.farthest_mm(film.rect()) + 1e-9;
        // As dense as lens packs, coarser and denser.
        let points = [100, 1000, 8000][case % 3];
        let lens = match case % 4 {
            0 => band(&mut noise, points, last),
            _ => {
                let real = (0..points).map(|i| last * i as f64 / (points - 1) as f64).collect();
                oracle::lens_band(real, 1.0, noise.between(-0.05, 0.05))
            }
        };
        let interpolation = ChartInterpolation {
            interp: Interp::Bilinear,
            surround: Surround::Edge,
            outside: Outside::Error,
        };
        let stages = FIRST_TWO.without(Stage::Ri);
        let job = Job { frame: &frame, lens: &lens, stages, interpolation, gain: 1.0 };
        for rows in [false, true] {
            let exact = |i: usize| {
                let (y, x) = (rect.y + (i / rect.width) as i64, rect.x + (i % rect.width) as i64);
                let (dy, dx) = (y as f64 - frame.axis_px.0, x as f64 - frame.axis_px.1);
                let r = dy.hypot(dx) * frame.pitch_mm();
                let real = &lens.image_height_mm;
                let k = real.partition_point(|&x| x <= r).clamp(1, real.len() - 1);
                let u = (r - real[k - 1]) / (real[k] - real[k - 1]);
                let h =
                    lens.ideal_height_mm[k - 1] + u * (lens.ideal_height_mm[k] - lens.ideal_height_mm[k - 1]);
                let (d, scale, center) = match rows {
                    true => (dy, frame.scale.0, frame.center_mm.0),
                    false => (dx, frame.scale.1, frame.center_mm.1),
                };
                39_999.0 / 2.0 + (d * h / r - center / frame.pitch_mm()) / scale
            };
            let zero = exact(0) as i64;
            let ramp = Ramp { size: chart, zero, rows };
            let got = engine.remap(&job, &ramp, rect);
            for (i, v) in got.iter().enumerate() {
                let off = f64::from(*v) + zero as f64 - exact(i);
                assert!(off.abs() <= 1e-5, "case {case}, {rect}, rows {rows}, pixel {i}: {off:.1e} px");
            }
        }
    }
}

/// White noise, the sharpest chart, anywhere on a film of 14,141² px, for tables with few and many knots.
fn white_noise_far_from_the_axis_equals_the_f64_model(engine: &dyn Engine) {
    let mut noise = Noise(33);
    let film = Size::new(14_141, 14_141);
    let chart = noise_chart(&mut noise, Size::new(160, 330));
    for case in 0..24 {
        let mut frame = Frame::centred(film, chart.0.size, 2.0);
        frame.scale = [(1.0, 1.0), (1.0, 1.0), (1.7, 1.3)][case % 3];
        let rect = Rect::new(noise.below(14_000) as i64, noise.below(13_800) as i64, 70, 170);
        let last = frame.farthest_mm(film.rect().grown(30)) + 1e-9;
        let points = [1000, 300, 4000][case % 3];
        let real = (0..points).map(|i| last * i as f64 / (points - 1) as f64).collect();
        let lens = oracle::lens_band(real, 1.0, noise.between(-0.05, 0.05));
        let t = Tables {
            ideal: &lens.ideal_height_mm,
            real: &lens.image_height_mm,
            ri: &lens.relative_illumination,
        };
        // The chart is centred on the field point of the rectangle's middle.
        let (dy, dx) = (rect.y as f64 + 35.0 - frame.axis_px.0, rect.x as f64 + 85.0 - frame.axis_px.1);
        let r = dy.hypot(dx) * frame.pitch_mm();
        let k = lens.image_height_mm.partition_point(|&x| x <= r).clamp(1, points - 1);
        let magnification = lens.ideal_height_mm[k] / lens.image_height_mm[k];
        frame.center_mm = (dy * magnification * frame.pitch_mm(), dx * magnification * frame.pitch_mm());
        let interpolation = ChartInterpolation {
            interp: Interp::Bicubic,
            surround: Surround::Mirror,
            outside: Outside::Error,
        };
        let job = Job { frame: &frame, lens: &lens, stages: FIRST_TWO, interpolation, gain: 1.0 };
        let got = engine.remap(&job, &chart, rect);
        let expected = oracle::remap(&chart.0, &frame, &t, rect, true, oracle::Outside::Mirror);
        let (worst, l2) = errors(&got, &expected.data);
        assert!(worst <= 2e-6 && l2 <= 1e-6, "case {case}, {rect}: max {worst:.1e}, L2 {l2:.1e}");
    }
}

/// A lens whose map folds within a few pixels: distant chart cells for neighbouring pixels, table steps shorter than a pixel.
fn strongly_bent_map_equals_the_f64_model(engine: &dyn Engine) {
    let mut noise = Noise(21);
    let (film, chart) = (Size::new(90, 301), Size::new(120, 260));
    let frame = Frame::centred(film, chart, 2.0);
    let mut lens = band(&mut noise, 900, frame.farthest_mm(film.rect()) + 1e-9);
    for (h, r) in lens.ideal_height_mm.iter_mut().zip(&lens.image_height_mm) {
        *h = r * (1.0 + 0.2 * (r * 90.0).sin());
    }
    let chart = noise_chart(&mut noise, chart);
    let t =
        Tables { ideal: &lens.ideal_height_mm, real: &lens.image_height_mm, ri: &lens.relative_illumination };
    for interp in [Interp::Bicubic, Interp::Bilinear] {
        let interpolation =
            ChartInterpolation { interp, surround: Surround::Mirror, outside: Outside::Error };
        let job = Job { frame: &frame, lens: &lens, stages: FIRST_TWO, interpolation, gain: 1.0 };
        let got = engine.remap(&job, &chart, film.rect());
        let expected = oracle::remap(
            &chart.0,
            &frame,
            &t,
            film.rect(),
            interp == Interp::Bicubic,
            oracle::Outside::Mirror,
        );
        let (worst, _) = errors(&got, &expected.data);
        assert!(worst <= 2e-6, "{interp:?}: max {worst:.1e}");
        for part in film.rect().tiles(13, 37) {
            let tiled = engine.remap(&job, &chart, part);
            for (i, v) in tiled.iter().enumerate() {
                let (y, x) = (part.y as usize + i / part.width, part.x as usize + i % part.width);
                assert_eq!(v.to_bits(), got[y * film.width + x].to_bits());
            }
        }
    }
}
