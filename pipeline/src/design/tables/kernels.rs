//! Film-pixel kernels of one band at any height and azimuth, with exact rotation.

use std::collections::BTreeMap;

use rayon::prelude::*;

use crate::design::prescription::error::DesignError;
use crate::design::psf::film_pixel::FilmPixels;
use crate::design::psf::{PsfGrid, PsfScratch, PupilFunction};
use crate::design::pupil::pupils::Pupils;

/// Height [mm] and azimuth [rad] of a kernel, as bits.
type Key = (u64, u64);

fn key(height: f64, azimuth: f64) -> Key {
    (height.to_bits(), azimuth.to_bits())
}

/// Film-pixel kernels, each computed once.
pub(crate) struct Kernels<'a> {
    grid: &'a PsfGrid,
    film: FilmPixels,
    size: usize,
    computed: BTreeMap<Key, Vec<f32>>,
}

impl<'a> Kernels<'a> {
    /// Kernels of `size` film pixels from PSFs on `grid`.
    pub(crate) fn new(grid: &'a PsfGrid, size: usize, film_pitch_um: f64) -> Self {
        let film = FilmPixels::new(grid.size(), grid.pitch_um(), size, film_pitch_um);
        Self { grid, film, size, computed: BTreeMap::new() }
    }

    /// Samples of the PSFs.
    pub(crate) fn grid(&self) -> &PsfGrid {
        self.grid
    }

    /// Computes those of `requested` (height, azimuth) that are missing; their number.
    pub(crate) fn fill(
        &mut self,
        pupils: &mut Pupils<'_>,
        requested: &[(f64, f64)],
    ) -> Result<usize, DesignError> {
        pupils.prepare(requested.iter().map(|(height, _)| *height))?;
        let mut missing: Vec<Key> = requested.iter().map(|(h, a)| key(*h, *a)).collect();
        missing.sort_unstable();
        missing.dedup();
        missing.retain(|k| !self.computed.contains_key(k));
        let count = missing.len();
        let pupils = &*pupils;
        let computed: Vec<(Key, Vec<f32>)> = missing
            .into_par_iter()
            .map_init(Default::default, |scratch, k| {
                let (height, azimuth) = (f64::from_bits(k.0), f64::from_bits(k.1));
                (k, self.compute(pupils.at(height), azimuth, scratch))
            })
            .collect();
        self.computed.extend(computed);
        Ok(count)
    }

    /// Whether the kernel at `height` [mm] and `azimuth` [rad] has been computed.
    pub(crate) fn has(&self, height: f64, azimuth: f64) -> bool {
        self.computed.contains_key(&key(height, azimuth))
    }

    /// Number of computed kernels.
    pub(crate) fn len(&self) -> usize {
        self.computed.len()
    }

    /// Removes all.
    pub(crate) fn clear(&mut self) {
        self.computed.clear();
    }

    /// The kernel of sum 1 at `height` [mm] and `azimuth` [rad], which has been computed.
    pub(crate) fn at(&self, height: f64, azimuth: f64) -> &[f32] {
        &self.computed[&key(height, azimuth)]
    }

    /// The kernel of sum 1 of `pupil`, rotated by `azimuth` [rad].
    pub(in crate::design) fn compute(
        &self,
        pupil: &PupilFunction,
        azimuth: f64,
        (scratch, psf): &mut (PsfScratch, Vec<f32>),
    ) -> Vec<f32> {
        self.grid.psf_into(pupil, azimuth, scratch, psf);
        let kernel = self.film.integrate(psf);
        let sum: f64 = kernel.iter().sum();
        kernel.iter().map(|v| (v / sum) as f32).collect()
    }

    /// Mean of a kernel rotated by +azimuth and by −azimuth, which is its mirror image.
    pub(crate) fn mean_with_mirror(&self, rotated: &[f32]) -> Vec<f32> {
        let n = self.size;
        (0..n * n).map(|i| 0.5 * (rotated[i] + rotated[(n - 1 - i / n) * n + i % n])).collect()
    }
}

/// Sum of the absolute differences.
pub(crate) fn l1(a: &[f32], b: &[f32]) -> f64 {
    a.iter().zip(b).map(|(a, b)| f64::from((a - b).abs())).sum()
}

/// Mean of two kernels.
pub(crate) fn mean(a: &[f32], b: &[f32]) -> Vec<f32> {
    a.iter().zip(b).map(|(a, b)| 0.5 * (a + b)).collect()
}
