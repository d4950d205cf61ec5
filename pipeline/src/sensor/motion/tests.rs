use super::*;
use std::f64::consts::PI;

const SIZE: Size = Size::new(80, 700);
const PITCH_UM: f64 = 2.0;
const AXIS_PX: (f64, f64) = (39.5, 349.5);

/// A film of one band by a formula of (row, column).
struct Formula<F>(F);

impl<F: Fn(f64, f64) -> f64 + Sync> ChartSource for Formula<F> {
    fn size(&self) -> Size {
        SIZE
    }

    fn read(&self, _: usize, rect: Rect, out: &mut [f32]) -> Result<(), SourceSinkError> {
        for (k, v) in out.iter_mut().enumerate() {
            let (y, x) = (rect.y + (k / rect.width) as i64, rect.x + (k % rect.width) as i64);
            *v = (self.0)(y as f64, x as f64) as f32;
        }
        Ok(())
    }
}

fn pose(time_s: f64, x_px: f64, y_px: f64, rotation_rad: f64) -> Pose {
    Pose { time_s, x_um: x_px * PITCH_UM, y_um: y_px * PITCH_UM, rotation_rad }
}

fn motion(poses: Vec<Pose>, exposure_s: f64, row_time_s: f64) -> Motion {
    let times = RowTimes { row_time_s, exposure_s, rows: 40, first_px: 0.0, row_px: 2.0 };
    Motion::new(poses, times, (SIZE, PITCH_UM, AXIS_PX))
}

fn read(motion: &Motion, film: &dyn ChartSource, rect: Rect) -> Vec<f32> {
    let mut out = vec![0.0; rect.size().pixels()];
    motion.film(film).read(0, rect, &mut out).unwrap();
    out
}

fn pattern(y: f64, x: f64) -> f64 {
    2.0 + (2.0 * PI * x / 23.0).cos() + 0.5 * (2.0 * PI * y / 17.0).sin()
}

#[test]
fn a_camera_at_rest_sees_the_film_and_a_shifted_one_the_shifted_film() {
    let film = Formula(pattern);
    let still = motion(vec![pose(0.0, 0.0, 0.0, 0.0)], 0.01, 1e-4);
    assert_eq!(still.steps(), 1);
    let whole = SIZE.rect();
    assert_eq!(read(&still, &film, whole), {
        let mut own = vec![0.0; SIZE.pixels()];
        film.read(0, whole, &mut own).unwrap();
        own
    });
    let shifted = motion(vec![pose(-1.0, 5.0, -3.0, 0.0), pose(2.0, 5.0, -3.0, 0.0)], 0.01, 0.0);
    let inner = Rect::new(20, 100, 30, 300);
    for (k, v) in read(&shifted, &film, inner).iter().enumerate() {
        let (y, x) = (20 + k / 300, 100 + k % 300);
        assert!((f64::from(*v) - pattern(y as f64 + 3.0, x as f64 - 5.0)).abs() < 1e-5);
    }
}

/// A pattern of ν cycles a pixel that moves by D has the contrast sinc(νD).
#[test]
fn contrast_of_a_moving_pattern_is_that_of_its_path() {
    for (period_px, path_px) in [(23.0, 9.0), (12.0, 7.3), (8.0, 3.1)] {
        let film = Formula(|_, x: f64| 1.0 + 0.5 * (2.0 * PI * x / period_px).cos());
        let moving = motion(vec![pose(0.0, 0.0, 0.0, 0.0), pose(0.02, path_px, 0.0, 0.0)], 0.02, 0.0);
        let line = read(&moving, &film, Rect::new(30, 60, 1, 552));
        let (mut re, mut im) = (0.0, 0.0);
        for (k, v) in line.iter().enumerate() {
            let phase = 2.0 * PI * (60 + k) as f64 / period_px;
            re += (f64::from(*v) - 1.0) * phase.cos();
            im += (f64::from(*v) - 1.0) * phase.sin();
        }
        let contrast = 2.0 * re.hypot(im) / 552.0 / 0.5;
        let x = PI * path_px / period_px;
        let expected = x.sin() / x;
        assert!((contrast - expected).abs() < 0.015, "{period_px} px: {contrast}, expected {expected}");
        assert!((im.atan2(re) - x).abs() < 0.01, "the middle of the path");
    }
}

/// Rows of a rolling shutter see the picture where it is at their time.
#[test]
fn rows_are_shifted_by_their_time() {
    let film = Formula(pattern);
    // 40 rows of two film pixels each, 1 ms apart; 200 px/s to the right.
    let moving = motion(vec![pose(0.0, 0.0, 0.0, 0.0), pose(0.1, 20.0, 0.0, 0.0)], 1e-5, 1e-3);
    for row in [10, 31, 60] {
        let line = read(&moving, &film, Rect::new(row, 100, 1, 400));
        let moved_px = 200.0 * 1e-3 * (row / 2) as f64;
        for (k, v) in line.iter().enumerate() {
            let expected = pattern(row as f64, 100.0 + k as f64 - moved_px);
            assert!((f64::from(*v) - expected).abs() < 5e-3, "{row} {k}: {v} {expected}");
        }
    }
}

#[test]
fn a_rotated_camera_sees_the_rotated_film() {
    let film = Formula(pattern);
    let rotated = motion(vec![pose(0.0, 2.0, 0.0, 0.03)], 0.01, 0.0);
    let (sin, cos) = (0.03f64.sin(), 0.03f64.cos());
    let rect = Rect::new(30, 200, 20, 300);
    for (k, v) in read(&rotated, &film, rect).iter().enumerate() {
        let (y, x) = ((30 + k / 300) as f64 - AXIS_PX.0, (200 + k % 300) as f64 - AXIS_PX.1);
        let expected = pattern(cos * y - sin * x + AXIS_PX.0, sin * y + cos * x - 2.0 + AXIS_PX.1);
        assert!((f64::from(*v) - expected).abs() < 0.02, "{k}: {v} {expected}");
    }
}

#[test]
fn parts_have_the_bits_of_the_whole_and_light_is_kept() {
    let blob = |y: f64, x: f64| {
        let (y, x) = (y - 40.0, x - 300.0);
        (-(y * y + x * x) / 30.0).exp()
    };
    let film = Formula(blob);
    let poses = vec![pose(0.0, 0.0, 0.0, 0.0), pose(0.01, 6.0, 2.0, 0.002), pose(0.02, 9.0, -4.0, -0.001)];
    let moving = motion(poses, 0.02, 1e-5);
    let whole = read(&moving, &film, SIZE.rect());
    let part = Rect::new(33, 290, 9, 250);
    let expected: Vec<f32> =
        (0..part.size().pixels()).map(|k| whole[(33 + k / 250) * SIZE.width + 290 + k % 250]).collect();
    assert_eq!(read(&moving, &film, part), expected);
    let sum = |all: &[f32]| all.iter().map(|v| f64::from(*v)).sum::<f64>();
    let still = motion(vec![Pose::default()], 0.02, 0.0);
    assert!((sum(&whole) / sum(&read(&still, &film, SIZE.rect())) - 1.0).abs() < 2e-3);
}
