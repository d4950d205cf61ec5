//! The lens of a run: a pack as it stands, or a design traced for the job's own wavelengths.
//!
//! A design is traced band by band: each band's tables and PSFs depend on the design, its wavelength, and how far the film reaches,
//! never on the job's other bands; so bands traced together, apart or long ago ([`super::cache`]) are the same. Every wavelength
//! is traced, none interpolated. Its digest is that of the recipes and of the bands' numbers: a host whose C library made other
//! bits of a recipe (`pipeline::real`) has another lens.
//! *Reach*: the film's corner and the PSF's margin, rounded up to a few hundred steps a decade so that films of about one size
//! share their bands; a band whose window turns out wider reaches further. Kernels keep their tolerance on pixels of the
//! film's own pitch, of 2 µm where that is coarser: larger pixels only average over more.

use super::cache::{self, Cache};
use crate::args::DesignArgs;
use crate::design::{self, DesignFile};
use crate::open;
use crate::progress::{say, tracing_bar};
use crate::trace::attributes;
use anyhow::{Context, Result};
use formats::lens::{LensPack, LensPackError};
use pipeline::band::{BandPlan, Choice, Options};
use pipeline::design::trace::{Azimuths, LensTrace, PsfHeights, TraceOptions, with_threads};
use pipeline::design::{DesignError, System};
use pipeline::field::Outside;
use pipeline::geometry::Frame;
use pipeline::lens::{Lens, LensBand, LensError, PsfStack};
use std::time::Instant;

/// Reach beyond the film's corner at the first attempt, mm: half a window of 177 pixels of 2 µm, along the diagonal.
const MARGIN_MM: f64 = 0.25;
/// The built-in lens reaches the corner of the 14141² px film of 2 µm, and smaller films share its bands.
const BUILTIN_REACH_MM: f64 = 20.5;
/// Coarsest film pitch that kernels are chosen for, µm.
const COARSEST_UM: f64 = 2.0;

/// What `--lens` names.
pub enum Named {
    /// A lens pack.
    Pack(Box<LensPack>),
    /// A design, its name, and the file that it was read from.
    Design(Box<System>, String, Option<DesignFile>),
}

impl Named {
    /// Opens a design, a pack, or a lens inside the program.
    pub fn open(name: &str) -> Result<Self> {
        if design::is_design(name) {
            let hint = "a design with other glasses, focus or object: make its pack by `lenscube lens trace`";
            let (system, file) = design::open_file(name, &DesignArgs::default()).context(hint)?;
            return Ok(Self::Design(Box::new(system), name.to_owned(), file));
        }
        Ok(Self::Pack(Box::new(open::lens(name)?)))
    }

    /// Ideal height on the film over object height, and its object's distance; none for an object at infinity.
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

/// A lens ready for a job.
pub enum Source {
    /// A pack.
    Pack(Box<LensPack>),
    /// Traced bands.
    Traced(Box<Traced>),
}

/// A design traced at some wavelengths, ascending.
pub struct Traced {
    lens: Lens,
    packs: Vec<LensPack>,
    /// Per band, the digest of all that it follows from, and of its numbers.
    recipes: Vec<String>,
    digest: String,
    notes: Vec<String>,
    /// The file of the design, unless it is built in.
    file: Option<DesignFile>,
    _kept: Cache,
}

impl Source {
    /// Makes `named` ready for bands at `wavelengths_nm` on the film of `frame`: traces what is not in the cache.
    pub fn new(
        named: Named,
        frame: &Frame,
        wavelengths_nm: &[f64],
        options: &Options,
        threads: usize,
    ) -> Result<Self> {
        match named {
            Named::Pack(pack) => Ok(Self::Pack(pack)),
            Named::Design(system, name, file) => {
                let traced = traced(&system, &name, frame, wavelengths_nm, options, threads);
                let traced = traced.with_context(|| format!("tracing {name}"))?;
                Ok(Self::Traced(Box::new(Traced { file, ..traced })))
            }
        }
    }

    /// The tables.
    pub fn lens(&self) -> &Lens {
        match self {
            Self::Pack(pack) => pack.lens(),
            Self::Traced(traced) => &traced.lens,
        }
    }

    /// The pack, if it is one.
    pub fn pack(&self) -> Option<&LensPack> {
        match self {
            Self::Pack(pack) => Some(pack),
            Self::Traced(_) => None,
        }
    }

    /// The PSFs of band `band` of [`Source::lens`].
    ///
    /// # Errors
    /// As [`LensPack::psf`].
    pub fn psf(&self, band: usize) -> Result<PsfStack, LensPackError> {
        match self {
            Self::Pack(pack) => pack.psf(band),
            Self::Traced(traced) => traced.packs[band].psf(0),
        }
    }

    /// What makes it this lens and no other.
    ///
    /// # Errors
    /// As [`LensPack::digest`].
    pub fn digest(&self) -> Result<&str, LensPackError> {
        match self {
            Self::Pack(pack) => pack.digest(),
            Self::Traced(traced) => Ok(&traced.digest),
        }
    }

    /// What makes the tables and PSFs of one band these and no others, whatever the lens's other bands: of a design the
    /// band's recipe and numbers, of a pack the digest of the bands that it is made from.
    ///
    /// # Errors
    /// As [`LensPack::psf`].
    pub fn band_digest(&self, choice: Choice) -> Result<String, LensPackError> {
        let of = |band: usize| match self {
            Self::Pack(pack) => pack.band_digest(band),
            Self::Traced(traced) => Ok(traced.recipes[band].clone()),
        };
        let first = of(choice.first)?;
        Ok(match choice.second {
            None => first,
            Some((second, _)) => format!("{first}+{}", of(second)?),
        })
    }

    /// Checks that the pack, or the design's file, is still what it was when the job began.
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

    /// Bytes that reading the PSFs of a band of [`Source::lens`] takes beside the samples.
    pub fn psf_reading_bytes(&self, band: usize) -> usize {
        match self {
            Self::Pack(pack) => pack.psf_reading_bytes(band),
            Self::Traced(traced) => traced.packs[band].psf_reading_bytes(0),
        }
    }

    /// Bytes that reading the PSFs of any one band takes: its digest reads all of them, one after the other.
    pub fn largest_reading_bytes(&self) -> usize {
        let of = |(b, band): (usize, &LensBand)| {
            4 * band.psf_height_mm.len() * band.psf_size * band.psf_size + self.psf_reading_bytes(b)
        };
        self.lens().bands.iter().enumerate().map(of).max().unwrap_or(0)
    }

    /// What its user should know.
    pub fn notes(&self) -> &[String] {
        match self {
            Self::Pack(pack) => pack.notes(),
            Self::Traced(traced) => &traced.notes,
        }
    }
}

/// `mm` rounded up to 5 in its third digit: 20.35 to 20.5, 3.02 to 3.05.
fn rounded_up(mm: f64) -> f64 {
    let step = 5.0 * 10f64.powi(pipeline::real::log10(mm).floor() as i32 - 2);
    // Counted in whole steps, so that the same film always asks for the same bits.
    (mm / step - 1e-9).ceil() * step
}

fn traced(
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
    let mut bands =
        Bands { system, name, cache: Cache::open()?, threads, bar: tracing_bar(nm.len()), fresh: 0 };
    let (mut lens, mut packs, mut recipes) = (None::<Lens>, Vec::new(), Vec::new());
    for &nm in &nm {
        let (recipe, pack) = bands.reaching(nm, frame, options)?;
        recipes.push(format!("{recipe}-{}", pack.band_digest(0)?));
        let merged = lens.get_or_insert_with(|| Lens { bands: Vec::new(), ..pack.lens().clone() });
        merged.name.clone_from(&system.name);
        merged.bands.extend(pack.lens().bands.iter().cloned());
        packs.push(pack);
        bands.bar.inc(1);
    }
    bands.bar.finish_and_clear();
    let mut notes: Vec<String> = system.notes.clone();
    if bands.fresh > 0 {
        notes.push(format!(
            "{} of {} bands traced in {:.1} s and kept in {}",
            bands.fresh,
            nm.len(),
            start.elapsed().as_secs_f64(),
            bands.cache.dir().display()
        ));
    }
    let lens = lens.context("the chart has no band")?;
    let digest = blake3::hash(recipes.concat().as_bytes()).to_hex().to_string();
    Ok(Traced { lens, packs, recipes, digest, notes, file: None, _kept: bands.cache })
}

/// What makes bands.
struct Bands<'a> {
    system: &'a System,
    name: &'a str,
    cache: Cache,
    threads: usize,
    bar: indicatif::ProgressBar,
    /// Bands that were not in the cache.
    fresh: usize,
}

impl Bands<'_> {
    /// The band at `nm`, reaching as far as the film and its own window ask.
    fn reaching(&mut self, nm: f64, frame: &Frame, options: &Options) -> Result<(String, LensPack)> {
        let least = if self.name == design::BUILTIN { BUILTIN_REACH_MM } else { 0.0 };
        let mut reach_mm = rounded_up(frame.farthest_mm(frame.film.rect()) + MARGIN_MM).max(least);
        loop {
            let mut wanted = self::wanted(nm, reach_mm, frame, options);
            let (recipe, pack) = match self.band(&wanted) {
                Err(e) if options.reading.outside == Outside::Clamp => {
                    // As far as the lens goes; the film goes on with the last values.
                    let Some(DesignError::Height { reached_mm, .. }) = e.downcast_ref() else {
                        return Err(e);
                    };
                    wanted = self::wanted(nm, 0.99 * reached_mm, frame, options);
                    self.band(&wanted)?
                }
                made => made?,
            };
            match BandPlan::new(frame, pack.lens(), nm, options) {
                Err(LensError::Outside { needed_mm, .. }) if rounded_up(needed_mm) > reach_mm => {
                    reach_mm = rounded_up(needed_mm);
                }
                // Any other fault is told with the job's plans.
                _ => return Ok((recipe, pack)),
            }
        }
    }

    /// A band from the cache, or traced.
    fn band(&mut self, options: &TraceOptions) -> Result<(String, LensPack)> {
        let recipe = cache::recipe(self.system, options);
        if let Some(pack) = self.cache.find(&recipe, options.wavelengths_nm[0]) {
            return Ok((recipe, pack));
        }
        if self.fresh == 0 {
            say(format!("tracing {}: bands that are not in {}", self.name, self.cache.dir().display()));
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
        let words = attributes(self.name, &DesignArgs::default(), options, &[band.report]);
        self.fresh += 1;
        let pack = self.cache.keep(&recipe, &lens, &words, &band)?;
        Ok((recipe, pack))
    }
}

/// What to trace for a job: without its PSF stage two small windows stand for all.
fn wanted(nm: f64, reach_mm: f64, frame: &Frame, options: &Options) -> TraceOptions {
    let mut wanted = TraceOptions::new(vec![nm], reach_mm);
    wanted.film_pitch_um = frame.pitch_um.min(COARSEST_UM);
    if !options.stages.svpsf {
        wanted.heights = PsfHeights::Given(vec![0.0, reach_mm]);
        wanted.azimuths = Azimuths::Given(4);
        wanted.window_px = Some(3);
    }
    wanted
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reaches_are_rounded_up_to_few() {
        for (mm, up) in
            [(20.35, 20.5), (20.5, 20.5), (3.02, 3.05), (0.9701, 0.975), (99.7, 100.0), (100.0, 100.0)]
        {
            assert!((rounded_up(mm) - up).abs() < 1e-9, "{mm}: {}", rounded_up(mm));
        }
    }
}
