//! Pupil functions and film-pixel kernels at places of the film, each computed once.

use std::collections::BTreeMap;

use rayon::prelude::*;

use super::super::error::SkewError;
use super::super::pupil::pupil_function;
use super::super::trace::SkewTracer;
use crate::design::psf::{PsfGrid, PupilFunction};
use crate::design::tables::kernels::Kernels;

/// X and Y of a place, mm, as bits.
type Key = [u64; 2];

fn key(place_mm: [f64; 2]) -> Key {
    // 0 and −0 are one place.
    place_mm.map(|v| (v + 0.0).to_bits())
}

/// Pupil functions and kernels by film place.
pub(super) struct PlaceKernels<'a> {
    tracer: &'a SkewTracer<'a>,
    /// That of the film's centre, whose grids the others begin with.
    centre: PupilFunction,
    functions: BTreeMap<Key, PupilFunction>,
    kernels: Option<Kernels<'a>>,
    computed: BTreeMap<Key, Vec<f32>>,
}

impl<'a> PlaceKernels<'a> {
    /// Without any place.
    ///
    /// # Errors
    /// No light at the film's centre.
    pub(super) fn new(tracer: &'a SkewTracer<'a>) -> Result<Self, SkewError> {
        let centre = pupil_function(tracer, [0.0; 2], None)?;
        Ok(Self { tracer, centre, functions: BTreeMap::new(), kernels: None, computed: BTreeMap::new() })
    }

    /// Makes kernels of `size` film pixels available, from PSFs on `grid`.
    pub(super) fn start(&mut self, grid: &'a PsfGrid, size: usize, film_pitch_um: f64) {
        self.kernels = Some(Kernels::new(grid, size, film_pitch_um));
    }

    /// Makes the pupil functions of `places` available.
    pub(super) fn prepare(&mut self, places: &[[f64; 2]]) -> Result<(), SkewError> {
        let mut missing: Vec<Key> =
            places.iter().map(|p| key(*p)).filter(|k| !self.functions.contains_key(k)).collect();
        missing.sort_unstable();
        missing.dedup();
        let (tracer, centre) = (self.tracer, &self.centre);
        let traced = missing
            .into_par_iter()
            .map(|k| Ok((k, pupil_function(tracer, k.map(f64::from_bits), Some(centre))?)))
            .collect::<Result<Vec<_>, SkewError>>()?;
        self.functions.extend(traced);
        Ok(())
    }

    /// The pupil function of a place, which was prepared.
    pub(super) fn function(&self, place_mm: [f64; 2]) -> &PupilFunction {
        &self.functions[&key(place_mm)]
    }

    /// Computes the kernels of those of `places` that are missing; their number.
    pub(super) fn fill(&mut self, places: &[[f64; 2]]) -> Result<usize, SkewError> {
        self.prepare(places)?;
        let mut missing: Vec<Key> =
            places.iter().map(|p| key(*p)).filter(|k| !self.computed.contains_key(k)).collect();
        missing.sort_unstable();
        missing.dedup();
        let count = missing.len();
        let (functions, kernels) = (&self.functions, self.kernels.as_ref().expect("kernels are started"));
        let computed: Vec<_> = missing
            .par_iter()
            .map_init(Default::default, |buffers, k| {
                kernels.compute(&functions[k], std::iter::once(0.0), buffers)
            })
            .collect();
        self.computed.extend(missing.into_iter().zip(computed.into_iter().flatten()));
        Ok(count)
    }

    /// The kernel of sum 1 of a place, which has been computed.
    pub(super) fn at(&self, place_mm: [f64; 2]) -> &[f32] {
        &self.computed[&key(place_mm)]
    }

    /// The pupil functions of `places`, in their order.
    pub(super) fn into_functions(mut self, places: &[[f64; 2]]) -> Result<Vec<PupilFunction>, SkewError> {
        self.computed.clear();
        self.prepare(places)?;
        Ok(places.iter().filter_map(|p| self.functions.remove(&key(*p))).collect())
    }
}
