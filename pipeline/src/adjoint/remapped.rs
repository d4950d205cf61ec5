//! The transpose of the PSF stage on a whole film: the remapped image on the film and its margin, block by block.

use super::{AdjointError, check_cancelled};
use crate::buffer::zeros;
use crate::geometry::Frame;
use crate::parts::for_each_part;
use crate::psf::BandPsf;
use crate::psf::gather::GatherScratch;
use crate::psf::spectra::SpectrumCache;
use std::sync::Mutex;
use std::sync::atomic::AtomicBool;

/// The transpose of `psf` of `film`, row-major on the film grown by the margin of `psf`.
pub(super) fn remapped_of_film(
    frame: &Frame,
    psf: &BandPsf,
    spectra: &SpectrumCache,
    film: &[f32],
    threads: usize,
    cancel: &AtomicBool,
) -> Result<Vec<f32>, AdjointError> {
    let grown = frame.film.rect().grown(psf.margin());
    let remapped = Mutex::new(zeros(grown.size().pixels()));
    for_each_part(threads, psf.film_blocks(frame), GatherScratch::default, |scratch, block| {
        check_cancelled(cancel)?;
        let (pixels, stride) = psf.gather(frame, block, film, spectra, scratch);
        psf.check_read()?;
        let first = (block.y - grown.y) as usize * grown.width + (block.x - grown.x) as usize;
        let mut remapped = remapped.lock().expect("no panic while held");
        for (to, from) in remapped[first..].chunks_mut(grown.width).zip(pixels.chunks(stride)) {
            to[..block.width].copy_from_slice(&from[..block.width]);
        }
        Ok::<_, AdjointError>(())
    })?;
    Ok(remapped.into_inner().expect("no panic while held"))
}
