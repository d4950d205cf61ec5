//! The units of a data set on all threads: samples in any order, a unit written when its last sample is made.

use super::coded;
use super::sample::Maker;
use crate::args::Part;
use crate::progress::{counting, interrupt};
use anyhow::Result;
use formats::dataset::draw::Draw;
use formats::dataset::store::{DatasetStore, Sample};
use formats::parallel;
use std::collections::HashMap;
use std::sync::Mutex;
use std::sync::atomic::Ordering::Relaxed;

/// What was made.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Made {
    /// Samples.
    pub samples: u64,
    /// Those of them without items.
    pub failed: u64,
    /// Bytes of their items.
    pub bytes: u64,
}

impl Made {
    fn add(&mut self, other: Self) {
        self.samples += other.samples;
        self.failed += other.failed;
        self.bytes += other.bytes;
    }
}

/// The missing units of `part`.
///
/// # Errors
/// The data set cannot be read.
pub fn missing(store: &DatasetStore, part: Option<Part>) -> Result<Vec<u64>> {
    let is_own = |unit: &u64| part.is_none_or(|part| unit % part.count == part.index);
    let units = (0..store.spec().units()).filter(is_own).map(|unit| Ok((unit, store.has(unit)?)));
    let all: Vec<(u64, bool)> = units.collect::<Result<_>>()?;
    Ok(all.into_iter().filter(|(_, has)| !has).map(|(unit, _)| unit).collect())
}

/// Makes `units`; what was made before an interruption.
///
/// # Errors
/// Of a lens or sensor; of a file.
pub fn make(maker: &Maker<'_>, store: &DatasetStore, units: &[u64], threads: usize) -> Result<Made> {
    let order = in_order(maker, store, units);
    let (bar, progress) = counting("making samples");
    let cancel = interrupt::cancel_flag();
    // Units whose samples are being made, and what was made.
    let open = Mutex::new(HashMap::<u64, Vec<Option<Sample>>>::new());
    let done = Mutex::new(Made::default());
    let work = |k: usize| -> Result<()> {
        if cancel.load(Relaxed) {
            return Ok(());
        }
        let (unit, number) = order[k];
        let sample = maker.make(number, cancel)?;
        let range = store.spec().of_unit(unit);
        let mut units = open.lock().expect("no panic while held");
        let own = units.entry(unit).or_insert_with(|| vec![None; (range.end - range.start) as usize]);
        own[(number - range.start) as usize] = Some(sample);
        if own.iter().any(Option::is_none) {
            return Ok(());
        }
        let samples: Vec<Sample> = units.remove(&unit).into_iter().flatten().flatten().collect();
        drop(units);
        let made = Made {
            samples: samples.len() as u64,
            failed: samples.iter().filter(|s| s.items.is_empty()).count() as u64,
            bytes: samples.iter().flat_map(|s| &s.items).map(|item| item.bytes.len() as u64).sum(),
        };
        store.write_unit(unit, samples).map_err(coded)?;
        done.lock().expect("no panic while held").add(made);
        Ok(())
    };
    let worked = parallel::for_each(threads.min(order.len()), order.len(), &progress, work);
    bar.finish_and_clear();
    match worked {
        // An interrupted film is no failure.
        Err(error) if !cancel.load(Relaxed) => Err(error),
        _ => Ok(done.into_inner().expect("no panic while held")),
    }
}

/// (unit, sample) of all units; in a unit by lens and distance in focus, so that few lenses are open at once.
fn in_order(maker: &Maker<'_>, store: &DatasetStore, units: &[u64]) -> Vec<(u64, u64)> {
    let key = |draw: &Draw| (draw.lens, draw.focus_m.map(f64::to_bits), draw.sample);
    let of_unit = |unit: &u64| {
        let mut draws: Vec<Draw> = store.spec().of_unit(*unit).map(|k| maker.draws.of(k)).collect();
        draws.sort_by_key(key);
        let unit = *unit;
        draws.into_iter().map(move |draw| (unit, draw.sample))
    };
    units.iter().flat_map(of_unit).collect()
}
