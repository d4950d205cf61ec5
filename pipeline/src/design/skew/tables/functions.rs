//! Pupil functions of a built lens at polar places of the film, in the frames turned by their azimuths.

use std::collections::BTreeMap;

use rayon::prelude::*;

use super::super::error::SkewError;
use super::super::pupil::pupil_function;
use super::super::trace::SkewTracer;
use crate::design::pupil::function::PupilFunction;
use crate::real;

/// Height [mm] and azimuth [rad] of a place, as bits, which are ordered.
type Key = (u64, u64);

fn key((height_mm, azimuth_rad): (f64, f64)) -> Key {
    (height_mm.to_bits(), azimuth_rad.to_bits())
}

/// Pupil functions by place: height, mm, and azimuth from +X towards +Y (down), rad.
pub(super) struct Functions<'a> {
    tracer: &'a SkewTracer<'a>,
    known: BTreeMap<Key, PupilFunction>,
}

impl<'a> Functions<'a> {
    pub(super) fn new(tracer: &'a SkewTracer<'a>) -> Self {
        Self { tracer, known: BTreeMap::new() }
    }

    /// Makes those of `places` available.
    pub(super) fn prepare(&mut self, places: impl Iterator<Item = (f64, f64)>) -> Result<(), SkewError> {
        let mut missing: Vec<Key> = places.map(key).filter(|k| !self.known.contains_key(k)).collect();
        missing.sort_unstable();
        missing.dedup();
        let traced = missing
            .into_par_iter()
            .map(|k| Ok((k, self.trace((f64::from_bits(k.0), f64::from_bits(k.1)))?)))
            .collect::<Result<Vec<_>, SkewError>>()?;
        self.known.extend(traced);
        Ok(())
    }

    fn trace(&self, place: (f64, f64)) -> Result<PupilFunction, SkewError> {
        let (height_mm, azimuth_rad) = place;
        let (sin, cos) = real::sin_cos(azimuth_rad);
        let nearby = self.nearby(height_mm);
        let function = pupil_function(self.tracer, [height_mm * cos, height_mm * sin], nearby)?;
        Ok(function.turned(-azimuth_rad))
    }

    /// A function of the next lower height that is known, which needs no more rays than this one.
    fn nearby(&self, height_mm: f64) -> Option<&PupilFunction> {
        self.known.range(..=(height_mm.to_bits(), u64::MAX)).next_back().map(|(_, function)| function)
    }

    /// That of `place`, which was prepared.
    pub(super) fn at(&self, place: (f64, f64)) -> &PupilFunction {
        &self.known[&key(place)]
    }

    /// Those of `places`, which were prepared.
    pub(super) fn into_functions(mut self, places: &[(f64, f64)]) -> Vec<PupilFunction> {
        places.iter().filter_map(|place| self.known.remove(&key(*place))).collect()
    }
}
