//! Cells against sums over all chart pixels in f64.

use super::super::axis::MARGIN;
use super::*;

/// A chart whose pixels are a function of their place.
struct Chart<F> {
    size: Size,
    pixel: F,
}

impl<F: Fn(i64, i64) -> f32 + Sync> ChartSource for Chart<F> {
    fn size(&self) -> Size {
        self.size
    }
    fn read(&self, _: usize, rect: Rect, out: &mut [f32]) -> Result<(), SourceSinkError> {
        assert!(self.size.rect().contains(rect) && rect.height <= BLOCK_PX && rect.width <= BLOCK_PX);
        for (y, row) in (rect.y..).zip(out.chunks_exact_mut(rect.width)) {
            (rect.x..).zip(row).for_each(|(x, to)| *to = (self.pixel)(y, x));
        }
        Ok(())
    }
}

fn noise(y: i64, x: i64) -> f32 {
    let mixed = ((y as u64) << 32 | x as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    (mixed >> 40) as f32 / (1 << 24) as f32
}

fn read(
    size: Size,
    pixel: impl Fn(i64, i64) -> f32 + Sync,
    side: (usize, usize),
    surround: Surround,
    threads: usize,
) -> ChartCells {
    let chart = Chart { size, pixel };
    let stop = AtomicBool::new(false);
    ChartCells::read((&chart, 0), side, surround, Simd::detect(), threads, &stop).unwrap()
}

#[test]
fn a_point_keeps_its_light_and_its_moments_up_to_the_third() {
    let size = Size::new(600, 530);
    for (side, (py, px)) in
        [((4, 4), (511, 77)), ((6, 5), (250, 3)), ((1, 1), (17, 400)), ((50, 70), (300, 200))]
    {
        let point = |y, x| if (y, x) == (py, px) { 2.5 } else { 0.0 };
        let cells = read(size, point, side, Surround::Black, 2);
        let (rows, columns) = (cells.grid.rows.cells(), cells.grid.columns.cells());
        let moment = |n: i32, m: i32| -> f64 {
            let place = |cell: usize, side: usize| (cell as f64 - MARGIN as f64 + 0.5) * side as f64 - 0.5;
            (0..rows * columns)
                .map(|i| {
                    let (y, x) =
                        (place(i / columns, side.0) - py as f64, place(i % columns, side.1) - px as f64);
                    f64::from(cells.values[i]) * (side.0 * side.1) as f64 * y.powi(n) * x.powi(m)
                })
                .sum()
        };
        assert!((moment(0, 0) - 2.5).abs() < 1e-6, "{side:?}: {}", moment(0, 0));
        let length = side.0.max(side.1) as f64;
        for (n, m) in [(1, 0), (0, 1), (2, 0), (1, 1), (0, 2), (3, 0), (2, 1), (0, 3)] {
            let unit = 2.5 * length.powi(n + m);
            assert!(moment(n, m).abs() < 2e-6 * unit, "{side:?} {n} {m}: {}", moment(n, m));
        }
    }
}

#[test]
fn an_even_chart_and_its_surroundings_are_even_and_black_ones_end_at_the_margin() {
    let size = Size::new(130, 83);
    for surround in [Surround::Edge, Surround::Mirror] {
        for side in [(4, 4), (3, 7), (1, 2)] {
            let cells = read(size, |_, _| 0.75, side, surround, 1);
            for (row, column) in [(0.0, 0.0), (-0.5, 82.5), (-300.0, 41.0), (129.9, 400.0), (64.3, 20.7)] {
                assert!((cells.at(row, column) - 0.75).abs() < 1e-6, "{side:?} {row} {column}");
            }
        }
    }
    let cells = read(size, |_, _| 0.75, (4, 4), Surround::Black, 1);
    assert!((cells.at(64.3, 40.7) - 0.75).abs() < 1e-6);
    assert_eq!([cells.at(-40.0, 41.0), cells.at(64.0, 120.0)], [0.0, 0.0]);
    let sum: f64 = cells.values.iter().map(|v| 16.0 * f64::from(*v)).sum();
    assert!((sum / (0.75 * size.pixels() as f64) - 1.0).abs() < 1e-6, "{sum}");
}

#[test]
fn places_side_by_side_have_the_light_of_each_place() {
    let size = Size::new(130, 83);
    let pixel = |y: i64, x: i64| ((y * 37 + x * 11) % 17) as f32;
    for surround in [Surround::Black, Surround::Edge, Surround::Mirror] {
        for side in [(4, 4), (3, 7), (1, 2)] {
            let cells = read(size, pixel, side, surround, 1);
            for (row, first, step) in
                [(-900.0, -900.0, 137.3), (-0.5, -12.0, 1.7), (64.3, 60.0, 5.1), (2e5, 81.75, 3e4)]
            {
                let mut out = [0f32; MAX_LANES];
                cells.along([[row, first, 2.0], [0.0, step, 0.0], [0.0; 3]], Simd::detect(), &mut out);
                for (i, found) in out.iter().enumerate() {
                    let expected = 2.0 * cells.at(row, first + i as f64 * step);
                    let error = (f64::from(*found) - expected).abs();
                    assert!(error < 1e-4, "{surround:?} {side:?} {row} {first} {i}: {found} {expected}");
                }
            }
        }
    }
}

#[test]
fn a_smooth_chart_is_read_between_cells_and_mirrored_ones_beyond() {
    let size = Size::new(512, 300);
    let wave = |y: f64, x: f64| 1.0 + 0.4 * (y / 40.0).sin() * (x / 55.0).cos();
    let cells = read(size, |y, x| wave(y as f64, x as f64) as f32, (4, 3), Surround::Mirror, 2);
    for (row, column) in [(100.25, 37.5), (17.0, 211.3), (400.1, 290.0)] {
        assert!((cells.at(row, column) - wave(row, column)).abs() < 2e-4, "{row} {column}");
    }
    // The mirror of pixel coordinates about −½ and n − ½.
    for (row, column) in [(8.25, 37.5), (100.0, 3.0)] {
        for (y, x) in
            [(-1.0 - row, column), (row, -1.0 - column), (1023.0 - row, column), (row, 599.0 - column)]
        {
            assert!((cells.at(y, x) - cells.at(row, column)).abs() < 1e-6, "{y} {x}");
        }
    }
}

#[test]
fn bits_do_not_depend_on_threads() {
    for (size, side) in [
        (Size::new(1700, 700), (4, 4)),
        (Size::new(1537, 300), (7, 3)),
        (Size::new(3, 2), (4, 4)),
        (Size::new(2100, 40), (90, 1)),
    ] {
        for surround in [Surround::Edge, Surround::Black, Surround::Mirror] {
            let one = read(size, noise, side, surround, 1);
            for threads in [2, 5] {
                assert_eq!(read(size, noise, side, surround, threads).values, one.values, "{size} {side:?}");
            }
        }
    }
}

#[test]
fn errors_and_a_stop_end_the_reading() {
    struct Damaged;
    impl ChartSource for Damaged {
        fn size(&self) -> Size {
            Size::new(1200, 40)
        }
        fn read(&self, _: usize, rect: Rect, _: &mut [f32]) -> Result<(), SourceSinkError> {
            if rect.y > 0 { Err("damaged".into()) } else { Ok(()) }
        }
    }
    let read = |stop| {
        let stop = AtomicBool::new(stop);
        ChartCells::read((&Damaged, 0), (4, 4), Surround::Edge, Simd::PORTABLE, 2, &stop)
    };
    assert_eq!(read(false).unwrap_err().to_string(), "damaged");
    assert!(read(true).unwrap_err().is::<Stopped>());
}
