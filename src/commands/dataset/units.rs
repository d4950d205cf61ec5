//! The units of a data set on all threads: samples in any order, a unit written when its last sample is made.

use super::sample::Maker;
use crate::args::Part;
use crate::progress::{counting, interrupt};
use anyhow::Result;
use formats::dataset::draw::Draw;
use formats::dataset::store::{DatasetStore, Sample};
use std::collections::HashMap;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};

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

/// A unit whose samples are being made.
struct Open {
    left: usize,
    samples: Vec<Option<Sample>>,
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
    let next = AtomicUsize::new(0);
    let (open, done, failed) = (Mutex::new(HashMap::new()), Mutex::new(Made::default()), Mutex::new(None));
    let work = || -> Result<()> {
        while let Some(&(unit, number)) = order.get(next.fetch_add(1, Relaxed)) {
            if cancel.load(Relaxed) || failed.lock().expect("no panic while held").is_some() {
                return Ok(());
            }
            let sample = maker.make(number, cancel)?;
            let range = store.spec().of_unit(unit);
            let mut units = open.lock().expect("no panic while held");
            let length = (range.end - range.start) as usize;
            let own: &mut Open =
                units.entry(unit).or_insert_with(|| Open { left: length, samples: vec![None; length] });
            own.samples[(number - range.start) as usize] = Some(sample);
            own.left -= 1;
            let is_complete = own.left == 0;
            let complete = if is_complete { units.remove(&unit) } else { None };
            drop(units);
            if let Some(Open { samples, .. }) = complete {
                let samples: Vec<Sample> = samples.into_iter().flatten().collect();
                let bytes: usize = samples.iter().flat_map(|s| &s.items).map(|item| item.bytes.len()).sum();
                let without = samples.iter().filter(|s| s.items.is_empty()).count();
                store.write_unit(unit, samples)?;
                let mut done = done.lock().expect("no panic while held");
                done.samples += length as u64;
                done.failed += without as u64;
                done.bytes += bytes as u64;
                progress(done.samples, order.len() as u64);
            }
        }
        Ok(())
    };
    let guarded = || {
        if let Err(error) = work() {
            failed.lock().expect("no panic while held").get_or_insert(error);
        }
    };
    std::thread::scope(|scope| (0..threads.min(order.len())).for_each(|_| drop(scope.spawn(guarded))));
    bar.finish_and_clear();
    match failed.into_inner().expect("no panic while held") {
        // An interrupted film is no failure.
        Some(error) if !cancel.load(Relaxed) => Err(error),
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
