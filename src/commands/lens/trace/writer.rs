//! Writes the PSFs of a band while the next one is traced.
//!
//! Each file of a pack is flushed to the disk before the next one is written. At most two bands are in memory.

use crate::args::Store;
use formats::lens::{LensPackError, LensPackWriter};
use pipeline::design::trace::TracedBand;
use std::panic::resume_unwind;
use std::sync::mpsc::sync_channel;
use std::thread;

/// The thread that writes has stopped; its error is that of [`write_beside`].
#[derive(Debug, thiserror::Error)]
#[error("the lens pack was not written")]
pub struct Stopped;

/// Runs `trace` with a function that writes the PSFs of a band to `pack`, or their pupil functions, the same of all bands; what `trace` returns, and
/// the pack.
///
/// # Errors
/// The first error of writing.
pub fn write_beside<T>(
    mut pack: LensPackWriter,
    trace: impl FnOnce(&dyn Fn(usize, TracedBand, Store) -> Result<(), Stopped>) -> T,
) -> Result<(T, LensPackWriter), LensPackError> {
    thread::scope(|scope| {
        let (sender, bands) = sync_channel(0);
        let writer = scope.spawn(move || {
            for (index, TracedBand { psf, pupils, .. }, stored) in bands {
                match stored {
                    Store::Psfs => pack.psf(index, &psf)?,
                    Store::Pupils => pack.pupils(index, &pupils)?,
                }
            }
            Ok(pack)
        });
        let traced = trace(&|index, band, stored| sender.send((index, band, stored)).map_err(|_| Stopped));
        drop(sender);
        let pack = writer.join().unwrap_or_else(|panic| resume_unwind(panic))?;
        Ok((traced, pack))
    })
}
