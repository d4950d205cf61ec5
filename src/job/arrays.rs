//! Films of arrays in memory: a lens is opened once, and makes films of as many arrays as its process has, without a chart or a film in a store.
//!
//! A film is the one that `lenscube run` makes of the same chart with the same flags, bit for bit on the same engine: a job is resolved as there
//! ([`Job::of_arrays`]), the executor computes its tiles, and finished shards are copied to the caller's array. What depends on the lens and the pitch alone, kernels and
//! their spectra, is kept and shared by films at all places of the field; what depends on the film's place, tables and plans, is kept for the last
//! [`MAX_FILMS`] of them.
//!
//! GPUs are not used: a job of arrays computes on the CPU.

mod film;
mod flags;
mod placement;
mod points;
mod shared;

pub use film::ArrayFilm;
pub use flags::ArrayFlags;
pub use placement::Placement;

use super::Job;
use super::lens::UntracedLens;
use super::lens::known::KnownLenses;
use crate::args::RunArgs;
use crate::failure::usage;
use crate::machine::threads;
use anyhow::Result;
use formats::chart::ArrayChart;
use pipeline::design::trace::with_threads;
use pipeline::geometry::Size;
use points::{PointMap, reach_of};
use shared::SharedSets;
use std::sync::{Arc, Mutex};

/// Reach of a map over that of its points.
const FARTHER: f64 = 1.2;
/// Maps of points that are kept.
const MAX_MAPS: usize = 64;
/// Films whose tables and plans are kept.
const MAX_FILMS: usize = 32;

/// A lens for arrays in memory. Its functions may be called by several threads at once.
pub struct ArrayLens {
    flags: Vec<String>,
    is_symmetric_design: bool,
    /// How far the map of points reaches that all points have within `--reach-mm`, mm; 0 without that flag.
    map_reach_mm: f64,
    wavelengths_nm: Vec<f64>,
    known: Arc<KnownLenses>,
    films: Mutex<Vec<KnownFilm>>,
    shared: Mutex<SharedSets>,
    maps: Mutex<Vec<Arc<PointMap>>>,
}

/// A film, and what it was made of.
struct KnownFilm {
    chart: Size,
    flags: Vec<String>,
    film: Arc<ArrayFilm>,
}

impl ArrayLens {
    /// The lens that `flags` of `lenscube run` describe (`--lens`, `--focus-m`, …), at `wavelengths_nm`; without them at those of a lens pack. Nothing is traced yet.
    ///
    /// # Errors
    /// Usage: flags that do not apply to arrays; a design without wavelengths. The lens cannot be opened.
    pub fn open(flags: &[String], wavelengths_nm: Option<Vec<f64>>) -> Result<Self> {
        let args = ArrayFlags::parse(flags)?;
        let lens = UntracedLens::open_focused(&args.job.lens, &args.job.surfaces, &args.job.tracing)?
            .with_errors(&args.job.built)?;
        let is_symmetric_design = matches!(lens, UntracedLens::Design(_)) && lens.is_symmetric();
        let wavelengths_nm = match (wavelengths_nm, lens) {
            (Some(nm), _) if !nm.is_empty() && nm.iter().all(|nm| nm.is_finite() && *nm > 0.0) => nm,
            (Some(nm), _) => {
                return Err(usage(format!("wavelengths: expected one or more numbers in nm, found {nm:?}")));
            }
            (None, UntracedLens::Pack(pack)) => {
                pack.lens().bands.iter().map(|band| band.wavelength_nm).collect()
            }
            (None, UntracedLens::Design(design)) => {
                return Err(usage(format!(
                    "lens `{}` is a design, which is traced at the wavelengths of the bands: give them in nm",
                    design.name
                )));
            }
        };
        Ok(Self {
            flags: flags.to_vec(),
            is_symmetric_design,
            map_reach_mm: args.job.tracing.reach_mm.map_or(Ok(0.0), |mm| reach_of(&[[mm, 0.0]]))?,
            wavelengths_nm,
            known: Arc::default(),
            films: Mutex::default(),
            shared: Mutex::default(),
            maps: Mutex::default(),
        })
    }

    /// Whether it is a design that can be traced farther than a film needs (`--reach-mm`).
    pub fn is_symmetric_design(&self) -> bool {
        self.is_symmetric_design
    }

    /// Wavelengths of the bands of its arrays, nm.
    pub fn wavelengths_nm(&self) -> &[f64] {
        &self.wavelengths_nm
    }

    /// The film of arrays of `chart` px, with further `flags` of `lenscube run`: pitch, size, placement, stages. The lens is traced, unless its bands are known.
    ///
    /// # Errors
    /// Every error of `lenscube run` that can be found before its first pixel.
    pub fn film(&self, chart: Size, flags: &[String]) -> Result<Arc<ArrayFilm>> {
        if let Some(known) = self.known_film(chart, flags) {
            return Ok(known);
        }
        let all: Vec<String> = self.flags.iter().chain(flags).cloned().collect();
        let args = ArrayFlags::parse(&all)?.job;
        let film = on_own_threads(&args, || {
            let chart = ArrayChart::new(chart, self.wavelengths_nm.clone(), args.nan);
            let job = Job::of_arrays(&args, chart, &self.known)?;
            let shared = self.shared.lock().expect("no panic while held").of_job(&job)?;
            Ok(Arc::new(ArrayFilm::new(job, shared)?))
        })?;
        let forgotten = self.shared.lock().expect("no panic while held").trim(film.memory());
        let mut films = self.films.lock().expect("no panic while held");
        films.retain(|known| !forgotten.iter().any(|set| known.film.shares(set)));
        if films.len() == MAX_FILMS {
            films.remove(0);
        }
        films.push(KnownFilm { chart, flags: flags.to_vec(), film: Arc::clone(&film) });
        Ok(film)
    }

    /// Where on the film the points `chart_mm` of the chart land at `nm`, both (x, y) in mm from the axis, y down.
    ///
    /// # Errors
    /// Points beyond the field of the lens; a wavelength that a lens pack does not have.
    pub fn film_of_chart(&self, chart_mm: &[[f64; 2]], nm: f64) -> Result<Vec<[f64; 2]>> {
        let map = PointMap::covering(chart_mm, |reach_mm| self.map(nm, reach_mm))?;
        chart_mm.iter().map(|point| map.film_of_chart(*point)).collect()
    }

    /// The points of the chart that the film shows at `film_mm`; inverse of [`ArrayLens::film_of_chart`].
    ///
    /// # Errors
    /// As there.
    pub fn chart_of_film(&self, film_mm: &[[f64; 2]], nm: f64) -> Result<Vec<[f64; 2]>> {
        let map = self.map(nm, reach_of(film_mm)?)?;
        Ok(film_mm.iter().map(|point| map.chart_of_film(*point)).collect())
    }

    /// Relative illumination at `film_mm`.
    ///
    /// # Errors
    /// As [`ArrayLens::film_of_chart`].
    pub fn relative_illumination(&self, film_mm: &[[f64; 2]], nm: f64) -> Result<Vec<f64>> {
        let map = self.map(nm, reach_of(film_mm)?)?;
        Ok(film_mm.iter().map(|point| map.relative_illumination(*point)).collect())
    }

    /// The map at `nm` up to `reach_mm`: one that is known and reaches as far, or a new one. A lens with `--reach-mm` has one map for all points up to there, in any order.
    fn map(&self, nm: f64, reach_mm: f64) -> Result<Arc<PointMap>> {
        let is_within = reach_mm <= self.map_reach_mm;
        let (reach_mm, farther) = if is_within { (self.map_reach_mm, 1.0) } else { (reach_mm, FARTHER) };
        let serves = |map: &PointMap| match is_within {
            true => map.reach_mm == reach_mm,
            false => map.reach_mm >= reach_mm,
        };
        let known =
            |maps: &[Arc<PointMap>]| maps.iter().find(|map| map.nm == nm && serves(map)).map(Arc::clone);
        if let Some(map) = known(&self.maps.lock().expect("no panic while held")) {
            return Ok(map);
        }
        // Farther than needed where the lens can be traced so far, so that points a little farther off have the same map.
        let args = ArrayFlags::parse(&self.flags)?.job;
        let map = on_own_threads(&args, || {
            PointMap::new(&args, nm, farther * reach_mm).or_else(|_| PointMap::new(&args, nm, reach_mm))
        });
        let map = Arc::new(map?);
        let mut maps = self.maps.lock().expect("no panic while held");
        if maps.len() == MAX_MAPS {
            maps.remove(0);
        }
        maps.push(Arc::clone(&map));
        Ok(map)
    }

    /// The film, if it is one of the last: it is now the very last.
    pub fn known_film(&self, chart: Size, flags: &[String]) -> Option<Arc<ArrayFilm>> {
        let mut films = self.films.lock().expect("no panic while held");
        let at = films.iter().position(|known| known.chart == chart && known.flags == flags)?;
        let known = films.remove(at);
        let film = Arc::clone(&known.film);
        films.push(known);
        Some(film)
    }
}

/// Does `work` on threads that are made for it: those that all of a process share do not exist in a process that was forked from it.
fn on_own_threads<T: Send>(args: &RunArgs, work: impl FnOnce() -> Result<T> + Send) -> Result<T> {
    with_threads(threads(args.threads), work)
}
