//! Film-pixel kernels of a built lens at any place, seen in any turned frame, with exact rotation.

use std::collections::BTreeMap;

use rayon::prelude::*;

use super::super::error::SkewError;
use super::functions::Functions;
use crate::design::psf::PsfGrid;
use crate::design::tables::kernels::Kernels;

/// A kernel: of the place at a height, mm, and an azimuth, rad, rotated by an angle, rad, from the frame that is turned by the azimuth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct View {
    pub(super) place: (f64, f64),
    pub(super) rotation_rad: f64,
}

impl View {
    /// The kernel of a place in the frame that is turned by its azimuth.
    pub(super) fn own(place: (f64, f64)) -> Self {
        Self { place, rotation_rad: 0.0 }
    }

    fn key(&self) -> [u64; 3] {
        [self.place.0, self.place.1, self.rotation_rad].map(f64::to_bits)
    }

    fn of_key([height, azimuth, rotation]: [u64; 3]) -> Self {
        let [height, azimuth, rotation_rad] = [height, azimuth, rotation].map(f64::from_bits);
        Self { place: (height, azimuth), rotation_rad }
    }
}

/// Film-pixel kernels, each computed once.
pub(super) struct Views<'a> {
    kernels: Kernels<'a>,
    computed: BTreeMap<[u64; 3], Vec<f32>>,
}

impl<'a> Views<'a> {
    /// Kernels of `size` film pixels from PSFs on `grid`.
    pub(super) fn new(grid: &'a PsfGrid, size: usize, film_pitch_um: f64) -> Self {
        Self { kernels: Kernels::new(grid, size, film_pitch_um), computed: BTreeMap::new() }
    }

    /// Computes those of `requested` that are missing; their number.
    pub(super) fn fill(
        &mut self,
        functions: &mut Functions<'_>,
        requested: &[View],
    ) -> Result<usize, SkewError> {
        functions.prepare(requested.iter().map(|view| view.place))?;
        let mut missing: Vec<[u64; 3]> = requested.iter().map(View::key).collect();
        missing.sort_unstable();
        missing.dedup();
        missing.retain(|k| !self.computed.contains_key(k));
        let count = missing.len();
        let functions = &*functions;
        let of_places: Vec<&[[u64; 3]]> = missing.chunk_by(|a, b| a[..2] == b[..2]).collect();
        let computed: Vec<_> = of_places
            .into_par_iter()
            .map_init(Default::default, |buffers, of_place| {
                let rotations = of_place.iter().map(|k| View::of_key(*k).rotation_rad);
                self.kernels.compute(functions.at(View::of_key(of_place[0]).place), rotations, buffers)
            })
            .collect();
        self.computed.extend(missing.into_iter().zip(computed.into_iter().flatten()));
        Ok(count)
    }

    /// The kernel of sum 1, which has been computed.
    pub(super) fn at(&self, view: &View) -> &[f32] {
        &self.computed[&view.key()]
    }
}
