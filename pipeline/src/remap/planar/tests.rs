//! Maps without rotational symmetry: every engine against the f64 map, bounds, and the film of a lens that has the symmetry.

mod bounds;
mod coordinates;
mod films;

use super::super::{ChartInterpolation, Remap};
use super::*;
use crate::field::Outside;
use crate::geometry::Size;
use crate::lens::LensBand;
use crate::lens::planar::PlanarMap;
use crate::resample::{Interp, Surround};
use crate::simd::{Isa, Simd};
use crate::stage::{Stage, Stages};

const PITCH_MM: f64 = 2e-3;
const FIRST_TWO: Stages = Stages::of(&[Stage::Ri, Stage::Distortion]);

/// Repeatable numbers between 0 and 1 (xorshift64*).
struct Noise(u64);

impl Noise {
    fn next(&mut self) -> f64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        (self.0.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 11) as f64 / (1u64 << 53) as f64
    }

    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.next()
    }
}

/// The map with `of`(X, Y) = ideal X, ideal Y, R on a grid about the axis: `cells` cells of `cell_px` film pixels down and
/// across.
fn map_of(cells: (usize, usize), cell_px: f64, mut of: impl FnMut(f64, f64) -> [f64; 3]) -> PlanarMap {
    let nodes = |cells: usize| -> Vec<f64> {
        (0..=cells).map(|i| (i as f64 - cells as f64 / 2.0) * cell_px * PITCH_MM).collect()
    };
    let (y_mm, x_mm) = (nodes(cells.0), nodes(cells.1));
    let all: Vec<[f64; 3]> =
        y_mm.iter().flat_map(|&y| x_mm.iter().map(move |&x| (x, y))).map(|(x, y)| of(x, y)).collect();
    let table = |k: usize| all.iter().map(|v| v[k]).collect();
    PlanarMap { ideal_x_mm: table(0), ideal_y_mm: table(1), relative_illumination: table(2), x_mm, y_mm }
}

/// A map of independent displacements of up to `amplitude` cells at each node, sheared and keystoned: as rough as a map can be.
fn rough(noise: &mut Noise, cells: (usize, usize), cell_px: f64, amplitude: f64) -> PlanarMap {
    let (shear, squeeze) = (noise.between(-0.05, 0.05), noise.between(0.7, 1.4));
    map_of(cells, cell_px, |x, y| {
        let mut off = || noise.between(-amplitude, amplitude) * cell_px * PITCH_MM;
        let (ideal_x, ideal_y) = (squeeze * x + shear * y + off(), y - 0.02 * x + off());
        [ideal_x, ideal_y, noise.between(0.8, 1.0)]
    })
}

fn interpolation(interp: Interp) -> ChartInterpolation {
    ChartInterpolation { interp, surround: Surround::Mirror, outside: Outside::Clamp }
}

/// The instruction sets of this processor.
fn available() -> impl Iterator<Item = Simd> {
    Isa::ALL.into_iter().filter_map(|isa| Simd::require(isa).ok())
}

/// Frames with any axis, centre and scale, about maps with cells from much narrower than a block to much wider.
fn for_each_rough_case(cases: usize, mut check: impl FnMut(&Frame, &PlanarMap, Rect)) {
    let mut noise = Noise(5);
    for case in 0..cases {
        let cell_px = [112.3, 35.0, 16.5, 15.2, 7.9, 900.0][case % 6];
        let cells = ((noise.between(4.0, 30.0)) as usize, (noise.between(4.0, 30.0)) as usize);
        let amplitude = [0.0, 0.002, 0.05][case % 3];
        let map = rough(&mut noise, cells, cell_px, amplitude);
        let mut frame = Frame::centred(Size::new(1000, 1000), Size::new(40_000, 40_000), 2.0);
        frame.axis_px = (noise.between(-300.0, 1300.0), noise.between(-300.0, 1300.0));
        if case % 2 == 1 {
            frame.scale = (noise.between(1.0, 2.5), noise.between(1.0, 2.5));
            frame.center_mm = (noise.between(-1.0, 1.0), noise.between(-1.0, 1.0));
        }
        // About a place of the map or an end of it.
        let place = |axis: f64, cells: usize, noise: &mut Noise| {
            (axis + noise.between(-0.55, 0.55) * cells as f64 * cell_px) as i64 - 60
        };
        let (y, x) =
            (place(frame.axis_px.0, cells.0, &mut noise), place(frame.axis_px.1, cells.1, &mut noise));
        check(&frame, &map, Rect::new(y, x, 13, 157));
    }
}

/// A band of a lens with `map`.
fn band_of(map: &PlanarMap) -> LensBand {
    LensBand::ideal(550.0, vec![0.0, 1.0]).with_map(map.clone())
}
