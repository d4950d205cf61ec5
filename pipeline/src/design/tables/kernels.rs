//! Film-pixel kernels of one band at any height and azimuth, with exact rotation.
//!
//! Kernels are compared in the core of their windows ([`super::window`]). The core of a fast lens with wide aberrations is wide: most kernels are then compared
//! in the inner part of the core, which has a quarter to three quarters of its side, and some in all of it, whose errors are larger: errors
//! of the others are those of the inner part times that ratio, linear between the heights where it is known.

use std::collections::BTreeMap;

use rayon::prelude::*;

use super::window::{core_samples, wide_core_samples};
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

/// Side of the core from which on its inner part is compared, samples, and the largest part of the side that pays.
const WIDE_CORE: usize = 301;
const INNER_SIDE: f64 = 0.75;

/// A window in which kernels are compared.
#[derive(Debug)]
pub(in crate::design) struct Core {
    pub(in crate::design) px: usize,
    pub(super) grid: PsfGrid,
    is_wide: bool,
}

impl Core {
    /// That of `px` film pixels, of PSFs whose samples in a pack have `pitch_um`.
    pub(super) fn new(px: usize, film_pitch_um: f64, pitch_um: f64) -> Self {
        let (half, coarse_um) = core_samples(px, film_pitch_um, pitch_um);
        match 2 * half + 1 >= WIDE_CORE {
            true => Self::wide(px, film_pitch_um, pitch_um),
            false => Self { px, grid: PsfGrid::for_comparison(half, coarse_um, 1.0), is_wide: false },
        }
    }

    fn wide(px: usize, film_pitch_um: f64, pitch_um: f64) -> Self {
        let (half, coarse_um) = wide_core_samples(px, film_pitch_um, pitch_um);
        Self { px, grid: PsfGrid::for_comparison(half, coarse_um, 1.0), is_wide: true }
    }

    /// Its inner part of `px` film pixels, if comparing there pays.
    pub(super) fn inner(&self, px: usize, film_pitch_um: f64, pitch_um: f64) -> Option<Self> {
        let pays = self.is_wide && px as f64 <= INNER_SIDE * self.px as f64;
        pays.then(|| Self::wide(px, film_pitch_um, pitch_um))
    }
}

/// Kernels of a band whose differences choose its nodes.
pub(super) struct Compared<'a> {
    /// In the inner part of the core, if there is one, else in the core.
    pub(super) most: Kernels<'a>,
    /// In the core, if there is an inner part.
    pub(super) some: Option<Kernels<'a>>,
}

impl<'a> Compared<'a> {
    /// Kernels of `core` and of its `inner` part.
    pub(super) fn new(core: &'a Core, inner: Option<&'a Core>, film_pitch_um: f64) -> Self {
        let kernels = |core: &'a Core| Kernels::new(&core.grid, core.px, film_pitch_um);
        match inner {
            None => Self { most: kernels(core), some: None },
            Some(inner) => Self { most: kernels(inner), some: Some(kernels(core)) },
        }
    }

    /// Whether there is an inner part that is as wide as other cores that have one.
    pub(super) fn is_wide(&self) -> bool {
        self.some.is_some() && self.most.grid.size() >= WIDE_CORE
    }

    /// Samples of the PSFs of the core.
    pub(super) fn grid(&self) -> &PsfGrid {
        self.some.as_ref().unwrap_or(&self.most).grid
    }
}

impl<'a> Kernels<'a> {
    /// Kernels of `size` film pixels from PSFs on `grid`.
    pub(crate) fn new(grid: &'a PsfGrid, size: usize, film_pitch_um: f64) -> Self {
        let film = FilmPixels::new(grid.size(), grid.pitch_um(), size, film_pitch_um);
        Self { grid, film, size, computed: BTreeMap::new() }
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
        let pupils = &*pupils;
        let of_heights: Vec<&[Key]> = missing.chunk_by(|a, b| a.0 == b.0).collect();
        let computed: Vec<Vec<Vec<f32>>> = of_heights
            .into_par_iter()
            .map_init(Default::default, |buffers, of_height| {
                let azimuths = of_height.iter().map(|k| f64::from_bits(k.1));
                self.compute(pupils.at(f64::from_bits(of_height[0].0)), azimuths, buffers)
            })
            .collect();
        let count = missing.len();
        self.computed.extend(missing.into_iter().zip(computed.into_iter().flatten()));
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

    /// The kernels of sum 1 of `pupil`, rotated by each of `azimuths` [rad].
    pub(in crate::design) fn compute(
        &self,
        pupil: &PupilFunction,
        azimuths: impl Iterator<Item = f64>,
        buffers: &mut (PsfScratch, Vec<f32>),
    ) -> Vec<Vec<f32>> {
        let mut kernels = Vec::new();
        self.grid.rotations(pupil, azimuths, buffers, |psf| kernels.push(self.film.kernel(psf)));
        kernels
    }

    /// Mean of a kernel rotated by +azimuth and by −azimuth, which is its mirror image.
    pub(crate) fn mean_with_mirror(&self, rotated: &[f32]) -> Vec<f32> {
        let n = self.size;
        (0..n * n).map(|i| 0.5 * (rotated[i] + rotated[(n - 1 - i / n) * n + i % n])).collect()
    }
}

/// Mean of two kernels.
pub(crate) fn mean(a: &[f32], b: &[f32]) -> Vec<f32> {
    a.iter().zip(b).map(|(a, b)| 0.5 * (a + b)).collect()
}
