//! Pupil functions of a built lens at polar places of the film, in the frames turned by their azimuths.

use std::collections::BTreeMap;

use rayon::prelude::*;

use super::super::error::SkewError;
use super::super::pupil::turned_pupil_function;
use super::super::trace::SkewTracer;
use super::smooth::{Row, Smooth};
use crate::design::pupil::function::PupilFunction;

/// Height [mm] and azimuth [rad] of a place, as bits, which are ordered.
type Key = (u64, u64);

fn key((height_mm, azimuth_rad): (f64, f64)) -> Key {
    (height_mm.to_bits(), azimuth_rad.to_bits())
}

/// Pupil functions by place: height, mm, and azimuth from +X towards +Y (down), rad.
pub(super) struct Functions<'a> {
    tracer: &'a SkewTracer<'a>,
    /// Interpolation between traced places; none: each is traced.
    smooth: Option<Smooth>,
    known: BTreeMap<Key, PupilFunction>,
}

impl<'a> Functions<'a> {
    /// Of places up to the height `last_mm`.
    pub(super) fn new(tracer: &'a SkewTracer<'a>, last_mm: f64) -> Self {
        Self { tracer, smooth: Smooth::new(tracer, last_mm), known: BTreeMap::new() }
    }

    /// Makes those of `places` available.
    pub(super) fn prepare(&mut self, places: impl Iterator<Item = (f64, f64)>) -> Result<(), SkewError> {
        let mut missing: Vec<Key> = places.map(key).filter(|k| !self.known.contains_key(k)).collect();
        missing.sort_unstable();
        missing.dedup();
        let found = match &self.smooth {
            Some(smooth) => interpolated(smooth, missing),
            None => missing
                .into_par_iter()
                .map(|k| Ok((k, self.trace((f64::from_bits(k.0), f64::from_bits(k.1)))?)))
                .collect::<Result<Vec<_>, SkewError>>()?,
        };
        self.known.extend(found);
        Ok(())
    }

    fn trace(&self, place: (f64, f64)) -> Result<PupilFunction, SkewError> {
        turned_pupil_function(self.tracer, place, self.nearby(place.0))
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

/// The functions of ascending `places`.
fn interpolated(smooth: &Smooth, places: Vec<Key>) -> Vec<(Key, PupilFunction)> {
    let mut heights: Vec<u64> = places.iter().map(|k| k.0).collect();
    heights.dedup();
    let rows: Vec<Row<'_>> = heights.par_iter().map(|h| smooth.row(f64::from_bits(*h))).collect();
    let function = |k: Key| {
        let row = &rows[rows.partition_point(|row| row.height_mm().to_bits() < k.0)];
        (k, row.function(f64::from_bits(k.1)))
    };
    places.into_par_iter().map(function).collect()
}
