//! Bands of a lens without rotational symmetry: traced over the film, or read from the cache.

use super::built::map_range;
use super::cache;
use super::tracing::BandTracer;
use anyhow::Result;
use formats::lens::{LensPack, PackAttributes, band_digest};
use pipeline::design::trace::{BandReport, Progress, TraceOptions, with_threads};
use pipeline::geometry::Frame;
use pipeline::lens::Lens;

/// Maximum of the PSFs of a band in the cache, bytes uncompressed; of larger ones their pupil functions are stored.
const MAX_PSF_BYTES: usize = 64_000_000;

/// Half the sides of the film of `frame` about the axis, mm.
fn half_mm(frame: &Frame) -> [f64; 2] {
    let film = frame.film.rect();
    let half = |first: i64, end: i64, axis_px: f64| {
        let farthest = (first as f64 - axis_px).abs().max(((end - 1) as f64 - axis_px).abs());
        farthest * frame.pitch_mm()
    };
    [half(film.x, film.right(), frame.axis_px.1), half(film.y, film.bottom(), frame.axis_px.0)]
}

impl BandTracer<'_> {
    /// Band of a lens without rotational symmetry from the cache, or traced and stored there.
    pub(super) fn planar_band(
        &mut self,
        options: &TraceOptions,
        with: &dyn Fn(&[BandReport]) -> PackAttributes,
    ) -> Result<(String, LensPack)> {
        let nm = options.wavelengths_nm[0];
        let range = map_range(half_mm(self.job.frame), options.max_height_mm);
        let planar = self.planar.as_mut().expect("called for lenses without symmetry");
        let recipe = cache::planar_recipe(planar.lens(), options, &range);
        if let Some(pack) = self.cache.find(&recipe, nm) {
            return Ok((recipe, pack));
        }
        if !self.is_announced {
            self.announce();
        }
        self.traced += 1;
        let planar = self.planar.as_mut().expect("as above");
        let bar = &self.bar;
        let mut progress = |p: Progress| bar.step(format!("{nm} nm: {} ({} PSFs)", p.step, p.psfs));
        let (header, band) = with_threads(self.threads, || planar.trace(options, range, &mut progress))?;
        let lens = Lens { bands: vec![band.tables.clone()], ..header };
        let values = band_digest(&lens, 0, &band.psf);
        let stores_pupils = size_of_val(&band.psf.samples[..]) > MAX_PSF_BYTES;
        let attributes = planar.record(with(&[band.report]));
        let pack = self.cache.insert(&recipe, &mut |pack| {
            match stores_pupils {
                true => pack.pupils(0, &band.pupils)?,
                false => pack.psf(0, &band.psf)?,
            }
            Ok((lens.clone(), attributes.clone(), Some(values.clone())))
        })?;
        Ok((recipe, pack))
    }
}
