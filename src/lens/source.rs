//! Lens of a run: a pack, or a design traced at the wavelengths of the job.
//!
//! A design is traced band by band. Tables and PSFs of a band depend on the design, the wavelength and the reach, never on the other
//! bands of the job, so bands traced in one run, in several runs or cached ([`super::cache`]) are equal. Every wavelength is traced,
//! none interpolated. The digest of the lens covers the recipes and the values of the bands: the digest
//! therefore also covers the rounding of the computation.
//!
//! *Reach*: height of the film's corner plus the margin of the PSF, rounded up to 180 steps per decade so that films of similar
//! size share their bands; it is increased if the window of a band is wider. Kernels meet their tolerance on pixels of the
//! film's pitch, or of 2 µm if that pitch is coarser: larger pixels only average over more.

use super::cache::{self, Cache};
use crate::args::DesignArgs;
use crate::design::{self, DesignFile};
use crate::open;
use crate::progress::{jsonl, log_line, tracing_bar};
use crate::trace::attributes;
use anyhow::{Context, Result};
use formats::lens::{LensPack, LensPackError};
use pipeline::band::{BandPlan, LensBands, Options};
use pipeline::design::trace::{Azimuths, LensTrace, MAX_NODES, PsfHeights, TraceOptions, with_threads};
use pipeline::design::{DesignError, System};
use pipeline::field::Outside;
use pipeline::geometry::Frame;
use pipeline::lens::{Lens, LensBand, LensError, PsfStack};
use std::time::Instant;

/// Reach beyond the film's corner at the first attempt, mm: half a window of 177 pixels of 2 µm, along the diagonal.
const MARGIN_MM: f64 = 0.25;
/// Minimum reach of the built-in lens, mm: the corner of the film of 14141² px of 2 µm. Smaller films share its bands.
const BUILTIN_REACH_MM: f64 = 20.5;
/// Maximum film pitch that kernels are chosen for, µm.
const MAX_PITCH_UM: f64 = 2.0;

/// Lens that `--lens` names, before tracing.
pub enum UntracedLens {
    /// Tables and PSFs in a file, or built in.
    Pack(Box<LensPack>),
    /// A design, its name, and its file unless it is built in.
    Design(Box<System>, String, Option<DesignFile>),
}

impl UntracedLens {
    /// Opens a design, a pack, or a built-in lens.
    pub fn open(name: &str) -> Result<Self> {
        if design::is_design(name) {
            let hint =
                "for other glasses, focus or object distance create a lens pack with `lenscube lens trace`";
            let (system, file) = design::open_file(name, &DesignArgs::default()).context(hint)?;
            return Ok(Self::Design(Box::new(system), name.to_owned(), file));
        }
        Ok(Self::Pack(Box::new(open::lens(name)?)))
    }

    /// Magnification (ideal height on the film over object height) and object distance in mm; none for an object at infinity.
    pub fn conjugate(&self) -> Result<Option<(f64, f64)>> {
        let (magnification, distance) = match self {
            Self::Pack(pack) => (pack.lens().magnification, pack.lens().object_distance_mm),
            Self::Design(system, ..) => {
                let options = TraceOptions::new(Vec::from([system.primary_um() * 1e3]), 1e-3);
                let header = LensTrace::new(system, &options)?.header();
                (header.magnification, header.object_distance_mm)
            }
        };
        Ok(distance.map(|d| (magnification, d)))
    }
}

/// Lens of a job.
pub enum JobLens {
    /// A lens pack with its bands.
    Pack(Box<LensPack>),
    /// A design, traced at the wavelengths of the job.
    Traced(Box<Traced>),
}

/// Design traced at the wavelengths of a job, ascending.
pub struct Traced {
    lens: Lens,
    packs: Vec<LensPack>,
    /// Per band, the digests of its inputs and of its values.
    recipes: Vec<String>,
    digest: String,
    notes: Vec<String>,
    /// File of the design, unless it is built in.
    file: Option<DesignFile>,
    /// Keeps a temporary cache until the packs are closed.
    _cache: Cache,
}

impl JobLens {
    /// Lens for bands at `wavelengths_nm` on the film of `frame`; traces the bands that are not in the cache.
    pub fn new(
        input: UntracedLens,
        frame: &Frame,
        wavelengths_nm: &[f64],
        options: &Options,
        threads: usize,
    ) -> Result<Self> {
        match input {
            UntracedLens::Pack(pack) => Ok(Self::Pack(pack)),
            UntracedLens::Design(system, name, file) => {
                let traced = trace(&system, &name, frame, wavelengths_nm, options, threads);
                let traced = traced.with_context(|| format!("tracing {name}"))?;
                Ok(Self::Traced(Box::new(Traced { file, ..traced })))
            }
        }
    }

    pub fn lens(&self) -> &Lens {
        match self {
            Self::Pack(pack) => pack.lens(),
            Self::Traced(traced) => &traced.lens,
        }
    }

    /// The lens pack; none for a design.
    pub fn pack(&self) -> Option<&LensPack> {
        match self {
            Self::Pack(pack) => Some(pack),
            Self::Traced(_) => None,
        }
    }

    /// PSFs of band `band` of [`JobLens::lens`].
    ///
    /// # Errors
    /// As [`LensPack::psf`].
    pub fn psf(&self, band: usize) -> Result<PsfStack, LensPackError> {
        match self {
            Self::Pack(pack) => pack.psf(band),
            Self::Traced(traced) => traced.packs[band].psf(0),
        }
    }

    /// Digest of the lens.
    ///
    /// # Errors
    /// As [`LensPack::digest`].
    pub fn digest(&self) -> Result<&str, LensPackError> {
        match self {
            Self::Pack(pack) => pack.digest(),
            Self::Traced(traced) => Ok(&traced.digest),
        }
    }

    /// Digest of the tables and PSFs of one band, independent of the other bands: of a design its recipe and values, of a pack
    /// the bands that it is interpolated from.
    ///
    /// # Errors
    /// As [`LensPack::psf`].
    pub fn band_digest(&self, choice: LensBands) -> Result<String, LensPackError> {
        let digest = |band: usize| match self {
            Self::Pack(pack) => pack.band_digest(band),
            Self::Traced(traced) => Ok(traced.recipes[band].clone()),
        };
        let first = digest(choice.first)?;
        Ok(match choice.second {
            None => first,
            Some((second, _)) => format!("{first}+{}", digest(second)?),
        })
    }

    /// Checks that the pack, or the design's file, has not changed since it was opened.
    ///
    /// # Errors
    /// It changed.
    pub fn check_unchanged(&self) -> Result<()> {
        match self {
            Self::Pack(pack) => Ok(pack.check_unchanged()?),
            Self::Traced(traced) => {
                traced.packs.iter().try_for_each(LensPack::check_unchanged)?;
                traced.file.as_ref().map_or(Ok(()), DesignFile::check_unchanged)
            }
        }
    }

    /// Bytes that reading the PSFs of a band of [`JobLens::lens`] needs in addition to the samples.
    pub fn psf_reading_bytes(&self, band: usize) -> usize {
        match self {
            Self::Pack(pack) => pack.psf_reading_bytes(band),
            Self::Traced(traced) => traced.packs[band].psf_reading_bytes(0),
        }
    }

    /// Maximum over the bands of the bytes that reading the PSFs of a band needs; the digest reads all bands in sequence.
    pub fn max_reading_bytes(&self) -> usize {
        let bytes = |(b, band): (usize, &LensBand)| {
            4 * band.psf_height_mm.len() * band.psf_size * band.psf_size + self.psf_reading_bytes(b)
        };
        self.lens().bands.iter().enumerate().map(bytes).max().unwrap_or(0)
    }

    /// Notes for the user.
    pub fn notes(&self) -> &[String] {
        match self {
            Self::Pack(pack) => pack.notes(),
            Self::Traced(traced) => &traced.notes,
        }
    }
}

/// `mm` rounded up to a multiple of 5 in its third digit: 20.35 to 20.5, 3.02 to 3.05.
fn rounded_up(mm: f64) -> f64 {
    let step = 5.0 * 10f64.powi(pipeline::real::log10(mm).floor() as i32 - 2);
    // A multiple of the step, so that equal films have bitwise equal reaches.
    (mm / step - 1e-9).ceil() * step
}

fn trace(
    system: &System,
    name: &str,
    frame: &Frame,
    wavelengths_nm: &[f64],
    options: &Options,
    threads: usize,
) -> Result<Traced> {
    let mut nm = wavelengths_nm.to_vec();
    nm.sort_by(f64::total_cmp);
    nm.dedup();
    let start = Instant::now();
    let mut tracer =
        BandTracer { system, name, cache: Cache::open()?, threads, bar: tracing_bar(nm.len()), traced: 0 };
    let (mut lens, mut packs, mut recipes) = (None::<Lens>, Vec::new(), Vec::new());
    let mut coarsest = (0.0, 0.0);
    let bands = nm.len();
    for (done, &nm) in nm.iter().enumerate() {
        let (recipe, pack) = tracer.covering_film(nm, frame, options)?;
        coarsest = if kernel_error(&pack) > coarsest.0 { (kernel_error(&pack), nm) } else { coarsest };
        let values = cache::values(&pack).map_or_else(|| pack.band_digest(0), |v| Ok(v.to_owned()))?;
        recipes.push(format!("{recipe}-{values}"));
        let merged = lens.get_or_insert_with(|| Lens { bands: Vec::new(), ..pack.lens().clone() });
        merged.name.clone_from(&system.name);
        merged.bands.extend(pack.lens().bands.iter().cloned());
        packs.push(pack);
        tracer.bar.inc(1);
        jsonl::traced(done + 1, bands);
    }
    tracer.bar.finish_and_clear();
    let mut notes: Vec<String> = system.notes.clone();
    if tracer.traced > 0 {
        notes.push(format!(
            "{} of {} bands traced in {:.1} s and stored in {}",
            tracer.traced,
            nm.len(),
            start.elapsed().as_secs_f64(),
            tracer.cache.dir().display()
        ));
    }
    let tolerance = TraceOptions::new(Vec::new(), 0.0).psf_tolerance;
    if coarsest.0 > tolerance {
        notes.push(format!(
            "kernels between PSF nodes have errors up to {:.1} % (at {} nm) instead of {:.0} %, because a band has at most {MAX_NODES} nodes; \
             `lenscube lens trace --max-nodes` makes a finer lens pack",
            100.0 * coarsest.0,
            coarsest.1,
            100.0 * tolerance
        ));
    }
    let lens = lens.context("the chart has no band")?;
    let digest = blake3::hash(recipes.concat().as_bytes()).to_hex().to_string();
    Ok(Traced { lens, packs, recipes, digest, notes, file: None, _cache: tracer.cache })
}

/// Maximum L1 error of kernels between the nodes of a traced band; 0 if it was not determined.
fn kernel_error(pack: &LensPack) -> f64 {
    let achieved = pack.attributes().psf_tolerance.as_ref();
    achieved.and_then(|t| t["bands"][0]["kernel_l1"].as_f64()).unwrap_or(0.0)
}

/// Traces bands, or reads them from the cache.
struct BandTracer<'a> {
    system: &'a System,
    name: &'a str,
    cache: Cache,
    threads: usize,
    bar: indicatif::ProgressBar,
    /// Number of bands that were not in the cache.
    traced: usize,
}

impl BandTracer<'_> {
    /// Band at `nm` with a reach that covers the film and the band's window.
    fn covering_film(&mut self, nm: f64, frame: &Frame, options: &Options) -> Result<(String, LensPack)> {
        let min_mm = if self.name == design::BUILTIN { BUILTIN_REACH_MM } else { 0.0 };
        let mut reach_mm = rounded_up(frame.farthest_mm(frame.film.rect()) + MARGIN_MM).max(min_mm);
        loop {
            let (recipe, pack) = match self.band(&trace_options(nm, reach_mm, frame, options)) {
                Err(e) if options.interpolation.outside == Outside::Clamp => {
                    // Trace up to the lens's own limit; beyond it the film uses the last values.
                    let Some(DesignError::Height { reached_mm, .. }) = e.downcast_ref() else {
                        return Err(e);
                    };
                    self.band(&trace_options(nm, 0.99 * reached_mm, frame, options))?
                }
                band => band?,
            };
            match BandPlan::new(frame, pack.lens(), nm, options) {
                Err(LensError::Outside { needed_mm, .. }) if rounded_up(needed_mm) > reach_mm => {
                    reach_mm = rounded_up(needed_mm);
                }
                // Other errors are reported when the job plans its bands.
                _ => return Ok((recipe, pack)),
            }
        }
    }

    /// Band from the cache, or traced and stored there.
    fn band(&mut self, options: &TraceOptions) -> Result<(String, LensPack)> {
        let recipe = cache::recipe(self.system, options);
        if let Some(pack) = self.cache.find(&recipe, options.wavelengths_nm[0]) {
            return Ok((recipe, pack));
        }
        if self.traced == 0 {
            log_line(format!(
                "tracing the bands of {} that are not in {}",
                self.name,
                self.cache.dir().display()
            ));
        }
        let bar = &self.bar;
        let (header, band) = with_threads(self.threads, || {
            let trace = LensTrace::new(self.system, options)?;
            let nm = options.wavelengths_nm[0];
            let band =
                trace.band(0, &mut |p| bar.set_message(format!("{nm} nm: {} ({} PSFs)", p.step, p.psfs)))?;
            Ok::<_, DesignError>((trace.header(), band))
        })?;
        let lens = Lens { bands: vec![band.tables.clone()], ..header };
        let attributes = attributes(self.name, &DesignArgs::default(), options, &[band.report]);
        self.traced += 1;
        let pack = self.cache.insert(&recipe, &lens, &attributes, &band)?;
        Ok((recipe, pack))
    }
}

/// Trace options of a job. Without the PSF stage only two PSFs of a minimum window are traced.
fn trace_options(nm: f64, reach_mm: f64, frame: &Frame, options: &Options) -> TraceOptions {
    let mut trace = TraceOptions::new(vec![nm], reach_mm);
    trace.film_pitch_um = frame.pitch_um.min(MAX_PITCH_UM);
    if !options.stages.svpsf {
        trace.heights = PsfHeights::Given(vec![0.0, reach_mm]);
        trace.azimuths = Azimuths::Given(4);
        trace.window_px = Some(3);
    }
    trace
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reach_is_rounded_up_to_5_in_the_third_digit() {
        for (mm, up) in
            [(20.35, 20.5), (20.5, 20.5), (3.02, 3.05), (0.9701, 0.975), (99.7, 100.0), (100.0, 100.0)]
        {
            assert!((rounded_up(mm) - up).abs() < 1e-9, "{mm}: {}", rounded_up(mm));
        }
    }
}
