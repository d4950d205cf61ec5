//! Layers of points against the tail that defines them.

use super::*;
use crate::buffer::ShardPixels;
use crate::field::Outside;
use crate::flow::{ChartSource, SourceSinkError};
use crate::geometry::Rect;
use crate::layer::{BinGrid, Layer, Taps};
use crate::lens::tail::{BandTail, value};
use crate::options::PsfBetween;
use crate::remap::ChartInterpolation;
use crate::resample::Interp;
use crate::resample::Surround;
use crate::simd::Simd;
use crate::stage::Stages;
use std::sync::atomic::AtomicBool;

/// A chart with one bright pixel.
struct Point {
    size: Size,
    at: (i64, i64),
}

impl ChartSource for Point {
    fn size(&self) -> Size {
        self.size
    }
    fn read(&self, _: usize, rect: Rect, out: &mut [f32]) -> Result<(), SourceSinkError> {
        out.fill(0.0);
        if rect.contains(Rect::new(self.at.0, self.at.1, 1, 1)) {
            out[(self.at.0 - rect.y) as usize * rect.width + (self.at.1 - rect.x) as usize] = 1.0;
        }
        Ok(())
    }
}

const OPTIONS: Options = Options {
    stages: Stages::of(&[]),
    interpolation: ChartInterpolation {
        interp: Interp::Bicubic,
        surround: Surround::Black,
        outside: Outside::Clamp,
    },
    azimuths: None,
    psf_window: None,
    between: PsfBetween::Error,
    simd: Simd::PORTABLE,
};

/// On bins of 0.4 of the inner radius, and of 0.2: T on single pixels, and its mean over 32 x 32 px.
#[test]
fn a_point_anywhere_has_its_tail() {
    const PITCH_UM: f64 = 2.0;
    let pitch_mm = PITCH_UM * 1e-3;
    let size = Size::new(480, 480);
    let frame = Frame::centred(size, size, PITCH_UM);
    let height_mm = vec![0.0, 1.0];
    for (inner_px, of_pixels, of_means) in [(20.0, 6e-3, 0.035), (39.0, 1.2e-2, 0.005), (10.0, 6e-3, 0.025)] {
        let mut c = [[0.0; 2]; 5];
        c[0] = [5e-5, 1e-5 * (inner_px * pitch_mm).powi(2)];
        let inner_mm = inner_px * pitch_mm;
        let tail =
            BandTail { inner_mm, coefficients: vec![c; 2], height_mm: height_mm.clone(), middle: None };
        let band = LensBand {
            psf_height_mm: height_mm.clone(),
            azimuth_count: vec![1, 8],
            psf_size: 41,
            psf_energy: vec![0.99; 2],
            tail: Some(tail),
            cones: None,
            planar: None,
            ..LensBand::ideal(550.0, height_mm.clone())
        };
        let plan = TailPlan::new(&frame, &band).unwrap();
        let sides = plan.cells_px(&frame);
        let (mut worst_pixel, mut worst_mean) = (0.0_f64, 0.0_f64);
        for at in [(240, 241), (243, 244), (237, 240), (241, 246), (239, 239), (244, 251)] {
            let chart = Point { size, at };
            let stop = AtomicBool::new(false);
            let cells =
                ChartCells::read((&chart, 0), sides, Surround::Black, Simd::PORTABLE, 1, &stop).unwrap();
            let values =
                plan.layer(&TailKernels::new(&plan, OPTIONS.simd), &frame, &band, &OPTIONS, (cells, 1.0), 1);
            let bins = BinGrid::new(size, plan.bin_px(), TAIL_MARGIN_BINS);
            let mut pixels = ShardPixels::new(size);
            pixels.reach(size.height, || vec![0.0; size.pixels()]);
            Layer::new(bins, Taps::Lagrange, values).add(size.rect(), &mut pixels);
            let expected = |y: i64, x: i64| {
                let of = |d: i64| d as f64 * pitch_mm;
                value(&c, inner_mm, of(x - at.1), of(y - at.0)) * pitch_mm * pitch_mm
            };
            let found = |y: i64, x: i64| f64::from(pixels.row(y as usize)[x as usize]);
            for (sin, cos) in (0..24).map(|step| (f64::from(step) * 15f64.to_radians()).sin_cos()) {
                let place = |r: f64| (at.0 + (r * sin).round() as i64, at.1 + (r * cos).round() as i64);
                for share in [3.0, 3.3, 4.1] {
                    let (y, x) = place(share * inner_px);
                    worst_pixel = worst_pixel.max((found(y, x) / expected(y, x) - 1.0).abs());
                }
                for (y, x) in [30.0, 40.0, 50.0, 100.0].map(place) {
                    let pixels = || (y - 16..y + 16).flat_map(|y| (x - 16..x + 16).map(move |x| (y, x)));
                    let light: f64 = pixels().map(|(y, x)| expected(y, x)).sum();
                    let error: f64 = pixels().map(|(y, x)| found(y, x) - expected(y, x)).sum();
                    worst_mean = worst_mean.max((error / light).abs());
                }
            }
        }
        println!("{inner_px} px, bins of {}: {worst_pixel:.1e} {worst_mean:.1e}", plan.bin_px());
        assert!(worst_pixel < of_pixels && worst_mean < of_means, "{inner_px}: {worst_pixel} {worst_mean}");
    }
}

/// As the chart is read along rows, between places that are mapped.
#[test]
fn light_along_rows_is_that_of_places() {
    let (size, film) = (Size::new(300, 400), Size::new(260, 330));
    struct Wave(Size);
    impl ChartSource for Wave {
        fn size(&self) -> Size {
            self.0
        }
        fn read(&self, _: usize, rect: Rect, out: &mut [f32]) -> Result<(), SourceSinkError> {
            for (i, to) in out.iter_mut().enumerate() {
                let (y, x) = (rect.y + (i / rect.width) as i64, rect.x + (i % rect.width) as i64);
                *to = 1.0 + 0.5 * (y as f32 * 0.05).sin() * (x as f32 * 0.04).cos();
            }
            Ok(())
        }
    }
    let frame = Frame::centred(size, film, 2.0);
    let height_mm: Vec<f64> = (0..=20).map(|i| 0.03 * f64::from(i)).collect();
    let ideal = height_mm.iter().map(|h| h * (1.0 + 0.02 * h * h)).collect();
    let band = LensBand { ideal_height_mm: ideal, ..LensBand::ideal(550.0, height_mm) };
    let field = Field::new(&band, frame.pitch_mm(), true, true, 2.0);
    for surround in [Surround::Black, Surround::Edge, Surround::Mirror] {
        let stop = AtomicBool::new(false);
        let cells = ChartCells::read((&Wave(size), 0), (4, 4), surround, Simd::detect(), 1, &stop).unwrap();
        let light = RemappedLight { map: Map::new(&frame, &field), cells: &cells, simd: Simd::detect() };
        let mut row = vec![0f32; 150];
        for y in [-60.0, 3.25, 120.5, 300.0] {
            light.along(y, -70.5, 3.0, &mut row);
            for (i, found) in row.iter().enumerate() {
                let (row, column, gain) = light.map.at_place(y, -70.5 + 3.0 * i as f64);
                let expected = gain * cells.at(row, column);
                assert!(
                    (f64::from(*found) - expected).abs() < 2e-3,
                    "{surround:?} {y} {i}: {found} {expected}"
                );
            }
        }
    }
}
