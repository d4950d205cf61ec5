use super::*;
use crate::geometry::Size;
use crate::sensor::noise::tests::example;
use crate::sensor::pixels::{Axis, Resample};

pub(crate) struct Film {
    size: Size,
    bands: Vec<Vec<f32>>,
}

impl Film {
    pub(crate) fn noise(size: Size, bands: usize) -> Self {
        let mut state = 1u64;
        let mut next = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 40) as f32 / (1u64 << 24) as f32
        };
        Self { size, bands: (0..bands).map(|_| (0..size.pixels()).map(|_| next()).collect()).collect() }
    }
}

impl ChartSource for Film {
    fn size(&self) -> Size {
        self.size
    }

    fn read(&self, band: usize, rect: Rect, out: &mut [f32]) -> Result<(), SourceSinkError> {
        for (i, line) in out.chunks_mut(rect.width).enumerate() {
            let from = (rect.y as usize + i) * self.size.width + rect.x as usize;
            line.copy_from_slice(&self.bands[band][from..from + rect.width]);
        }
        Ok(())
    }
}

fn axes(film: Size, sensor: Size, pitch_um: f64) -> (Axis, Axis) {
    let of = |film_px, sensor_px| Axis {
        film_px,
        film_pitch_um: 2.0,
        sensor_px,
        pitch_um,
        aperture_um: pitch_um,
        centre_um: 0.0,
    };
    (of(film.height, sensor.height).snapped(), of(film.width, sensor.width).snapped())
}

fn signal(
    film: &Film,
    (y, x): (Axis, Axis),
    window: Rect,
    block: (usize, usize),
    threads: usize,
) -> Vec<f32> {
    let sensor = example();
    let (wy, wx) = (window.y as usize..window.bottom() as usize, window.x as usize..window.right() as usize);
    let (rows, columns) = (y.taps(wy, Resample::Cubic).unwrap(), x.taps(wx, Resample::Cubic).unwrap());
    let weights: Vec<Vec<f64>> =
        (0..3).map(|c| (0..film.bands.len()).map(|b| (c * 5 + b + 1) as f64).collect()).collect();
    let planes = [BandWeights(weights, None)];
    let cancel = AtomicBool::new(false);
    let pass = Pass {
        film,
        bands: film.bands.len(),
        sensor: &sensor,
        rows: &rows,
        columns: &columns,
        window,
        planes: &planes,
        corrections: &[],
        block,
        bands_at_once: 1 + block.0 % 3,
        threads,
        cancel: &cancel,
    };
    let mut out = Vec::new();
    let mut deliver = |first: usize, planes: &[Vec<f32>]| {
        assert_eq!(first * window.width, out.len());
        out.extend(&planes[0]);
        Ok(())
    };
    assert!(pass.run(0..window.height, &mut deliver).unwrap());
    out
}

/// The sum of the definition.
fn by_definition(film: &Film, (y, x): (Axis, Axis), sensor_size: Size) -> Vec<f32> {
    let sensor = example();
    let taps = |axis: Axis, n| axis.taps(0..n, Resample::Cubic).unwrap();
    let (rows, columns) = (taps(y, sensor_size.height), taps(x, sensor_size.width));
    let pixel = |k: usize| {
        let (row, column) = (k / sensor_size.width, k % sensor_size.width);
        let channel = sensor.pattern.channel(row, column);
        let ((y0, wy), (x0, wx)) = (rows.of(row), columns.of(column));
        let mut total = 0.0;
        for (b, band) in film.bands.iter().enumerate() {
            let mut mean = 0.0;
            for (j, w) in wy.iter().enumerate() {
                for (i, v) in wx.iter().enumerate() {
                    mean += w * v * f64::from(band[(y0 + j) * film.size.width + x0 + i]);
                }
            }
            total += (channel * 5 + b + 1) as f64 * mean;
        }
        total as f32
    };
    (0..sensor_size.pixels()).map(pixel).collect()
}

#[test]
fn signal_is_the_sum_of_the_definition_whatever_the_blocks_and_threads() {
    let film = Film::noise(Size::new(83, 97), 3);
    for (pitch_um, sensor) in [
        (2.0, Size::new(83, 97)),
        (4.0, Size::new(41, 48)),
        (5.5, Size::new(30, 35)),
        (2.5, Size::new(66, 77)),
        (41.0, Size::new(4, 4)),
    ] {
        let axes = axes(film.size, sensor, pitch_um);
        let whole = sensor.rect();
        let expected = by_definition(&film, axes, sensor);
        let first = signal(&film, axes, whole, (512, 512), 1);
        for (got, expected) in std::iter::zip(&first, &expected) {
            assert!(
                (got.to_bits() as i64 - expected.to_bits() as i64).abs() <= 1,
                "{pitch_um}: {got} {expected}"
            );
        }
        for (block, threads) in [((16, 16), 3), ((1, 7), 2), ((83, 5), 4), ((10, 97), 1)] {
            assert!(signal(&film, axes, whole, block, threads) == first, "{pitch_um} {block:?}");
        }
        let window = Rect::new(1, 2, sensor.height - 2, sensor.width - 2);
        let part = signal(&film, axes, window, (16, 16), 2);
        for (i, line) in part.chunks(window.width).enumerate() {
            assert_eq!(line, &first[(i + 1) * sensor.width + 2..][..window.width], "{pitch_um}");
        }
    }
}
