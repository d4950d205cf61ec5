//! Ghosts of a job: the operators of its bands, traced when the first layer needs one.

use crate::args::{CoatingsArg, GHOST_RINGS, RunArgs};
use crate::design;
use crate::failure::usage;
use crate::job::lens::UntracedLens;
use crate::progress::{log_line, number};
use anyhow::Result;
use pipeline::design::ghost::operator::{
    BandGhosts, GhostOptions, geometry_nm, ghost_memory_bytes, ghost_seconds, trace_ghosts,
};
use pipeline::design::ghost::path::ghost_paths;
use pipeline::design::ghost::rings::RingOperator;
use pipeline::design::trace::with_threads;
use pipeline::design::{DesignError, System};
use pipeline::geometry::{Frame, Rect};
use serde_json::{Value, json};
use std::sync::Mutex;

/// Rings below which the disc of a ghost is blurred.
const SHARP_RINGS: f64 = 2.0;
/// Least share of all ghosts that such a ghost has to be worth a note.
const NOTED: f64 = 0.01;

/// Ghosts of a lens on the film of a job.
pub struct JobGhosts {
    system: System,
    options: GhostOptions,
    /// Wavelengths of the job, nm.
    wavelengths_nm: Vec<f64>,
    threads: usize,
    /// Bands that are traced and not yet used.
    traced: Mutex<Vec<BandGhosts>>,
}

/// The design of `lens` for ghosts, and how they are computed; none without them.
fn asked<'l>(
    args: &RunArgs,
    lens: &'l UntracedLens,
    frame: &Frame,
) -> Result<Option<(&'l System, GhostOptions)>> {
    let given = &args.veil.ghosts;
    if !given.is_on() {
        return Ok(None);
    }
    let UntracedLens::Design(design) = lens else {
        return Err(usage(format!(
            "--ghosts on: expected a design; lens `{}` is a lens pack, which has no surfaces to reflect light",
            args.lens
        )));
    };
    if args.tracing.coatings == CoatingsArg::Ideal {
        return Err(usage(
            "--ghosts on: a lens with ideal coatings has no ghosts; choose its coatings (--coatings none, mgf2, design or a file)",
        ));
    }
    let film_reflectance = given.sensor_reflectance.as_ref().map(design::reflectance).transpose()?;
    let film = Rect::new(0, 0, frame.film.height, frame.film.width);
    let options = GhostOptions {
        corner_mm: frame.farthest_mm(film) + 0.5 * frame.pitch_mm(),
        rings: given.ghost_rings.unwrap_or(GHOST_RINGS),
        film_reflectance: film_reflectance.unwrap_or_default(),
    };
    Ok(Some((&design.system, options)))
}

/// What ghosts add to the identity of a job: the design with its clear radii, which the tables of the lens do not hold.
pub fn identity(args: &RunArgs, lens: &UntracedLens, frame: &Frame) -> Result<Option<Value>> {
    let of = |(system, options): (&System, GhostOptions)| {
        json!({
            "design": blake3::hash(system.identity().as_bytes()).to_hex().to_string(),
            "rings": options.rings,
            "sensor_reflectance": options.film_reflectance.0,
        })
    };
    Ok(asked(args, lens, frame)?.map(of))
}

impl JobGhosts {
    /// Those of `args`; none without them.
    ///
    /// # Errors
    /// Usage: a lens without surfaces that reflect. A reflectance of the film that cannot be read or has not all wavelengths.
    pub fn new(
        args: &RunArgs,
        lens: &UntracedLens,
        frame: &Frame,
        wavelengths_nm: &[f64],
        threads: usize,
    ) -> Result<Option<Self>> {
        let Some((system, options)) = asked(args, lens, frame)? else { return Ok(None) };
        for nm in wavelengths_nm {
            options.film_reflectance.at(*nm)?;
        }
        let (_, left_out) = ghost_paths(system, !options.film_reflectance.is_zero());
        if left_out > 0 {
            log_line(format!("note: {left_out} ghosts between whose reflections a mirror lies are left out"));
        }
        Ok(Some(Self {
            system: system.clone(),
            options,
            wavelengths_nm: wavelengths_nm.to_vec(),
            threads,
            traced: Mutex::default(),
        }))
    }

    /// Description in the film.
    pub fn part(&self) -> Value {
        json!({ "rings": self.options.rings, "sensor_reflectance": self.options.film_reflectance.0 })
    }

    /// Bytes while they are traced.
    pub fn making_bytes(&self) -> usize {
        ghost_memory_bytes(&self.system, &self.options, self.wavelengths_nm.len(), self.threads)
    }

    /// Core seconds of tracing a band.
    pub fn making_s(&self) -> f64 {
        ghost_seconds(&self.system, &self.options, &self.wavelengths_nm) / self.wavelengths_nm.len() as f64
    }

    /// The operator of the band at `nm`. Bands that share its rays are traced with it.
    ///
    /// # Errors
    /// A wavelength outside the tables of a glass or a coating.
    pub fn operator(&self, nm: f64) -> Result<RingOperator, DesignError> {
        let mut traced = self.traced.lock().expect("no panic while held");
        if let Some(k) = traced.iter().position(|band| band.wavelength_nm == nm) {
            return Ok(traced.swap_remove(k).operator);
        }
        let mut together: Vec<f64> = self
            .wavelengths_nm
            .iter()
            .copied()
            .filter(|other| geometry_nm(*other) == geometry_nm(nm))
            .collect();
        together.sort_by(f64::total_cmp);
        together.dedup();
        let bands = with_threads(self.threads, || trace_ghosts(&self.system, &together, &self.options))?;
        *traced = bands;
        let k = traced.iter().position(|band| band.wavelength_nm == nm).unwrap_or(0);
        let band = traced.swap_remove(k);
        self.note_small(&band);
        Ok(band.operator)
    }

    /// A note of ghosts that the rings blur.
    fn note_small(&self, band: &BandGhosts) {
        let all: f64 = band.paths.iter().map(|p| p.axis.share).sum();
        let ring_mm = band.operator.sizes.ring_mm;
        let is_small = |rings: f64, share: f64| rings < SHARP_RINGS && share > NOTED * all;
        for path in &band.paths {
            let rings = path.axis.diameter_mm() / ring_mm;
            if is_small(rings, path.axis.share) {
                log_line(format!(
                    "note: ghost {}-{} at {} nm: {:.2} mm on the axis, {rings:.1} rings: that of a lamp smaller than a ring is blurred to {SHARP_RINGS} rings; --ghost-rings makes them finer",
                    path.path.first + 1,
                    path.path.second + 1,
                    number(band.wavelength_nm),
                    path.axis.diameter_mm(),
                ));
            }
        }
    }
}
