//! Tracing of a design at the wavelengths of a job.
//!
//! A design is traced band by band. Tables and PSFs of a band depend on the design, the wavelength and the reach, never on the other
//! bands of the job, so bands traced in one run, in several runs or cached ([`crate::job::lens::cache`]) are equal. Every wavelength is traced,
//! none interpolated. The digest of the lens covers the recipes and the values of the bands: the digest
//! therefore also covers the rounding of the computation.
//!
//! How far a band is traced belongs to the lens ([`super::reach`]). PSFs are point samples, so one band serves films of any pitch; kernels
//! meet their tolerance on pixels of the trace pitch ([`super::tracing_job`]). Wavelengths are rounded to 10⁻⁶ nm.

use super::attributes::attributes;
use super::blur::{check_blur, margin_mm};
use super::energy::{self, MissedEnergy};
use super::planar::PlanarLens;
use super::reach::{BandReach, Reach};
use super::traced::Traced;
use super::tracing_job::{TracingJob, WIDER, trace_options};
use crate::args::{DesignArgs, TracingArgs};
use crate::design;
use crate::failure::{usage, without_flags};
use crate::job::lens::cache::failures::KnownFailure;
use crate::job::lens::cache::{self, Cache};
use crate::job::lens::samples::design_reach_mm;
use crate::progress::{TracingBar, jsonl, log_line};
use anyhow::{Context, Result};
use formats::lens::{LensPack, band_digest};
use pipeline::design::ray::Tracer;
use pipeline::design::trace::{
    BandReport, ESF_SHARE, LensTrace, MAX_NODES, Progress, SharedNodes, TraceOptions, with_threads,
};
use pipeline::design::{DesignError, System};
use pipeline::field::Outside;
use pipeline::geometry::Frame;
use pipeline::lens::{Lens, LensError};
use std::collections::BTreeSet;
use std::sync::{Arc, Mutex};
use std::time::Instant;

/// Side of a PSF window, pixels of the trace pitch, from which a note is printed before tracing.
const WIDE_WINDOW_PX: usize = 201;
/// Maximum of the PSFs of a band in the cache, bytes uncompressed; of larger ones their pupil functions are stored.
const MAX_PSF_BYTES: usize = 32_000_000;
/// Margin about the corner of the film of a design without symmetry that is tried first, mm: half a window of 70 pixels of 2 µm, along the diagonal.
const FIRST_MARGIN_MM: f64 = 0.1;
/// Height of the film's corner over that of the outermost field point, from which a note is printed.
const BEYOND_FIELD: f64 = 1.05;

/// `nm` rounded to 10⁻⁶ nm: 400.00000000000006 is 400.
fn rounded_nm(nm: f64) -> f64 {
    (nm * 1e6).round() / 1e6
}

/// Prints a note, once of each lens, if the film lies beyond the design's field, before anything is traced.
fn note_field(system: &System, name: &str, frame: &Frame) -> Result<()> {
    static NOTED: Mutex<BTreeSet<String>> = Mutex::new(BTreeSet::new());
    let (corner_mm, field_mm) = (frame.farthest_mm(frame.film.rect()), design_reach_mm(system)?);
    let is_beyond = field_mm > 0.0 && corner_mm > BEYOND_FIELD * field_mm;
    if is_beyond && NOTED.lock().expect("no panic while held").insert(name.to_owned()) {
        log_line(format!(
            "note: the film's corner at {corner_mm:.2} mm from the axis lies beyond the outermost field point of {name} at \
             {field_mm:.2} mm, where the design does not define the image; `--film-size` makes the film smaller"
        ));
    }
    Ok(())
}

/// Prints a note if PSFs are very wide, before they are traced.
fn note_focus(job: &TracingJob<'_>, options: &TraceOptions) -> Result<()> {
    let name = job.name;
    let estimate = LensTrace::new(job.system, options)?.estimate(0)?;
    let in_focus = match job.tracing {
        Some(_) => "`--image-plane paraxial` (or rms) moves it there".to_owned(),
        None => format!(
            "`lenscube lens trace {name} FOCUSED.lens.zarr --image-plane paraxial` (or rms) makes a lens pack in focus for --lens"
        ),
    };
    if options.window_px.is_none() && estimate.window_px >= WIDE_WINDOW_PX {
        log_line(format!(
            "note: PSFs of {name} are about {:.2} mm wide on this film ({} pixels of {} µm), which takes long to trace and to convolve; if \
             the film is out of focus, {in_focus}",
            1e-3 * estimate.window_px as f64 * options.film_pitch_um,
            estimate.window_px,
            options.film_pitch_um,
        ));
    }
    Ok(())
}

/// Traces the bands of `job` at `wavelengths_nm`, or reads them from the cache.
pub(super) fn trace(job: &TracingJob<'_>, wavelengths_nm: &[f64], threads: usize) -> Result<Traced> {
    let (system, name) = (job.system, job.name);
    let is_asymmetric_design = job.asymmetric.is_some_and(|lens| lens.design().is_some());
    if let Some(lens) = job.asymmetric
        && job.tracing.is_some_and(|tracing| tracing.reach_mm.is_some())
    {
        return Err(usage(format!(
            "--reach-mm: expected a lens with rotational symmetry; {} has none and is traced over each film",
            lens.named(name)
        )));
    }
    if !is_asymmetric_design {
        note_field(system, name, job.frame)?;
    }
    let at_primary = trace_options(system.primary_um() * 1e3, 1.0, job);
    if let Some(depth) = &job.depth {
        check_blur(job, depth, &at_primary)?;
    }
    let reach = match is_asymmetric_design {
        true => None,
        false => Some(Reach::new(job, margin_mm(job, &at_primary)?)?),
    };
    let mut nm: Vec<f64> = wavelengths_nm.iter().copied().map(rounded_nm).collect();
    nm.sort_by(f64::total_cmp);
    nm.dedup();
    let start = Instant::now();
    let mut tracer = BandTracer {
        job: *job,
        reach,
        cache: Cache::open()?,
        shared: SharedNodes::default(),
        planar: job.asymmetric.map(|lens| PlanarLens::new(job, lens, threads)).transpose()?,
        threads,
        bar: TracingBar::new(nm.len()),
        traced: 0,
        is_announced: false,
        is_forecast: false,
        has_other_reach: false,
        is_for_one_film: false,
    };
    let (mut lens, mut packs, mut recipes) = (None::<Lens>, Vec::new(), Vec::new());
    let mut darkest = None::<(MissedEnergy, f64)>;
    // The largest errors between PSF nodes, of kernels and of edges, and their wavelengths.
    let mut coarsest = [(0.0, 0.0); 2];
    let bands = nm.len();
    for (done, &nm) in nm.iter().enumerate() {
        let before = tracer.traced;
        let (recipe, pack) = tracer.covering_film(nm)?;
        // With another reach at the second attempt it is still one band.
        tracer.traced = tracer.traced.min(before + 1);
        for (largest, error) in coarsest.iter_mut().zip(node_errors(&pack)) {
            if error > largest.0 {
                *largest = (error, nm);
            }
        }
        if let Some(missed) = missed_energy(&trace_options(nm, 1.0, job), &pack)
            && darkest.is_none_or(|(worst, _)| missed.least < worst.least)
        {
            darkest = Some((missed, nm));
        }
        let values = cache::values(&pack).map_or_else(|| pack.band_digest(0), |v| Ok(v.to_owned()))?;
        recipes.push(format!("{recipe}-{values}"));
        let merged = lens.get_or_insert_with(|| Lens { bands: Vec::new(), ..pack.lens().clone() });
        merged.name.clone_from(&system.name);
        merged.bands.extend(pack.lens().bands.iter().cloned());
        if let (Some(all), Some(depth), true) = (&mut merged.depth, &pack.lens().depth, done > 0) {
            all.bands.extend(depth.bands.iter().cloned());
        }
        packs.push(Arc::new(pack));
        tracer.bar.band_done();
        jsonl::traced(done + 1, bands);
    }
    tracer.bar.finish();
    let (mut notes, mut details) = (Vec::new(), Vec::new());
    notes.extend(tracer.planar.iter().flat_map(PlanarLens::notes).cloned());
    if design::is_builtin(name) { &mut details } else { &mut notes }.extend(system.notes.iter().cloned());
    if tracer.traced > 0 {
        details.push(format!(
            "{} of {} bands traced in {:.1} s and stored in {}",
            tracer.traced,
            nm.len(),
            start.elapsed().as_secs_f64(),
            tracer.cache.dir().display()
        ));
    }
    details.extend(job.bands.map(|bands| bands.described(&nm)).transpose()?);
    let TraceOptions { psf_tolerance, excess, .. } = TraceOptions::new(Vec::new(), 0.0);
    let percent = |share: f64| format!("{:.2} %", 100.0 * share);
    let allowed = [("kernels", excess * psf_tolerance), ("edges", ESF_SHARE * psf_tolerance)];
    for ((what, tolerance), (error, nm)) in allowed.into_iter().zip(coarsest) {
        if error > tolerance && percent(error) != percent(tolerance) {
            notes.push(format!(
                "{what} between PSF nodes have errors up to {} (at {nm} nm) instead of {}, limited by the samples, traced PSFs and nodes (at most {MAX_NODES}) of a band; \
                 `lenscube lens trace --max-nodes` makes a finer lens pack",
                percent(error),
                percent(tolerance)
            ));
        }
    }
    if let Some((missed, nm)) = darkest {
        let windows = format!(
            "PSF windows contain at least {} of the light (at {nm} nm) instead of {}",
            energy::percent(missed.least),
            energy::percent(missed.requested)
        );
        let limit = match missed.is_widest {
            true => "as wide as they may be (--max-window-px)",
            false => {
                "limited by the samples of a PSF; `lenscube lens trace --max-nodes` makes a lens pack with more"
            }
        };
        let is_asked = job.tracing.is_some_and(|tracing| tracing.energy.is_some());
        if is_asked { &mut notes } else { &mut details }.push(format!("{windows}, {limit}"));
    }
    let lens = lens.context("the chart has no band")?;
    let digest = blake3::hash(recipes.concat().as_bytes()).to_hex().to_string();
    let ideal_light = design::note_on_ideal(system, wavelengths_nm);
    Ok(Traced {
        lens,
        packs,
        recipes,
        digest,
        notes,
        details,
        ideal_light,
        file: None,
        drawn: None,
        is_for_one_film: tracer.is_for_one_film,
        _cache: tracer.cache,
    })
}

/// Maximum errors between the nodes of a traced band, L1 of kernels and of edges; 0 if they were not determined.
fn node_errors(pack: &LensPack) -> [f64; 2] {
    let achieved = pack.attributes().psf_tolerance.as_ref();
    ["kernel_l1", "kernel_edge"]
        .map(|name| achieved.and_then(|t| t["bands"][0][name].as_f64()).unwrap_or(0.0))
}

/// The window of a traced band or of its depth nodes with the least light, if that is less than `options` request.
fn missed_energy(options: &TraceOptions, pack: &LensPack) -> Option<MissedEnergy> {
    if options.window_px.is_some() {
        return None;
    }
    let lens = pack.lens();
    let of_bands = lens.bands.iter().map(|b| (&b.psf_energy, b.psf_size as f64 * b.psf_pitch_um));
    let nodes = lens.depth.iter().flat_map(|depth| &depth.bands).flat_map(|band| &band.nodes);
    let of_nodes = nodes.map(|n| (&n.psf_energy, n.psf_size as f64 * n.psf_pitch_um));
    let missed = of_bands.chain(of_nodes).filter_map(|(energy, side_um)| {
        let least = energy.iter().copied().fold(1.0, f64::min);
        MissedEnergy::new(options, least, (side_um / options.film_pitch_um).round() as usize)
    });
    missed.min_by(|a, b| a.least.total_cmp(&b.least))
}

/// An error of tracing `name` in a command without flags of tracing.
pub fn without_tracing_flags(name: &str, error: anyhow::Error) -> anyhow::Error {
    without_flags(&TracingArgs::FLAGS, error, || {
        format!("`lenscube lens trace {name} PACK` has it, and makes a lens pack for this command")
    })
}

/// Traces bands, or reads them from the cache.
pub(super) struct BandTracer<'a> {
    pub(super) job: TracingJob<'a>,
    /// Steps of its reach; none of a design without symmetry, which is traced over each film.
    reach: Option<Reach<'a>>,
    pub(super) cache: Cache,
    pub(super) shared: SharedNodes,
    /// The lens without rotational symmetry, if it has none.
    pub(super) planar: Option<PlanarLens<'a>>,
    pub(super) threads: usize,
    pub(super) bar: TracingBar,
    /// Number of bands that were not in the cache.
    pub(super) traced: usize,
    /// Whether tracing was announced.
    pub(super) is_announced: bool,
    /// Whether the estimate of its depth nodes was passed on.
    pub(super) is_forecast: bool,
    /// Whether another reach is tried if the lens cannot be traced up to this one.
    has_other_reach: bool,
    /// Whether a band reaches farther than its step because the film needs that.
    is_for_one_film: bool,
}

impl BandTracer<'_> {
    /// Band at `nm` whose reach covers the film and the band's window.
    fn covering_film(&mut self, nm: f64) -> Result<(String, LensPack)> {
        let job = self.job;
        let corner_mm = job.farthest_mm();
        let Some(steps) = &self.reach else { return self.over_film(nm, corner_mm) };
        let chief_rays = Tracer::new(job.system, nm / 1e3)?;
        let reaches = steps.of(&chief_rays, corner_mm);
        let (last, others) = reaches.split_last().context("a band has a reach")?;
        self.has_other_reach = true;
        for reach in others {
            match self.covering_window(nm, &chief_rays, *reach) {
                Err(e) if is_of_lens(&e) => (),
                found => return found,
            }
        }
        self.has_other_reach = false;
        let covering = self.covering_window(nm, &chief_rays, *last);
        let is_clamped = job.options.interpolation.outside == Outside::Clamp;
        covering.map_err(|e| match e.downcast_ref() {
            Some(DesignError::Ray { .. } | DesignError::Unresolved { .. }) if !is_clamped => e.context(format!(
                "the film with half a PSF window reaches {:.4} mm from the axis and beyond, where the lens cannot be traced; make the film smaller (--film-size), or \
                 take the last values there (`lenscube run --outside clamp`)",
                corner_mm
            )),
            _ => e,
        })
    }

    /// Band of a design without symmetry at `nm`, over the film and half its window.
    fn over_film(&mut self, nm: f64, corner_mm: f64) -> Result<(String, LensPack)> {
        let job = self.job;
        let mut margin_mm = FIRST_MARGIN_MM;
        loop {
            let (recipe, pack) =
                self.band(&trace_options(nm, BandReach::up_to(corner_mm + margin_mm).reach_mm, &job))?;
            match job.plan(pack.lens(), nm) {
                Err(LensError::OutsideMap { .. }) if margin_mm < corner_mm + FIRST_MARGIN_MM => {
                    let band = &pack.lens().bands[0];
                    let half_mm = 0.5e-3 * band.psf_size as f64 * band.psf_pitch_um;
                    margin_mm = (WIDER * std::f64::consts::SQRT_2 * half_mm).max(1.5 * margin_mm);
                }
                // Other errors are reported when the job plans its bands.
                _ => return Ok((recipe, pack)),
            }
        }
    }

    /// Band at `nm` up to `reach`, or up to the wider reach that its window needs.
    fn covering_window(
        &mut self,
        nm: f64,
        chief_rays: &Tracer<'_>,
        mut reach: BandReach,
    ) -> Result<(String, LensPack)> {
        let job = self.job;
        loop {
            let (recipe, pack) = match self.band(&trace_options(nm, reach.reach_mm, &job)) {
                Err(e) if job.options.interpolation.outside == Outside::Clamp => {
                    // Trace up to the lens's own limit; beyond it the film uses the last values.
                    let Some(DesignError::Height { reached_mm, .. }) = e.downcast_ref() else {
                        return Err(e);
                    };
                    self.band(&trace_options(nm, 0.99 * reached_mm, &job))?
                }
                band => band?,
            };
            let steps = self.reach.as_ref();
            let wider = steps.and_then(|steps| steps.wider(chief_rays, reach, &pack)).or_else(|| {
                let wider_mm = job.wider_for_film(pack.lens(), nm, reach.reach_mm);
                self.is_for_one_film |= wider_mm.is_some();
                wider_mm.map(BandReach::up_to)
            });
            match wider {
                Some(wider) if wider.reach_mm > reach.reach_mm => reach = wider,
                _ => return Ok((recipe, pack)),
            }
        }
    }

    /// Band from the cache, or traced and stored there.
    fn band(&mut self, options: &TraceOptions) -> Result<(String, LensPack)> {
        let TracingJob { system, name, depth, .. } = self.job;
        let nm = options.wavelengths_nm[0];
        let parameters = self.job.tracing.map_or_else(DesignArgs::default, |tracing| tracing.design(&[]));
        let with = |reports: &[BandReport]| attributes(name, &parameters, options, reports);
        if let Some(depth) = &depth {
            return self.depth_band(options, depth, &with);
        }
        if self.planar.is_some() {
            return self.planar_band(options, &with);
        }
        let range = self.job.bands.map(|bands| bands.of(nm)).transpose()?;
        let tails = self.job.has_tails();
        let recipe = cache::recipe(system, options, range, None, tails);
        if let Some(pack) = self.cache.find(&recipe, nm) {
            return Ok((recipe, pack));
        }
        if self.has_other_reach
            && let Some(failure) = self.cache.find_failure(&recipe)
        {
            return Err(failure.into());
        }
        if !self.is_announced {
            // A lens that cannot be traced so far is not announced.
            note_focus(&self.job, options)?;
            self.announce();
        }
        self.traced += 1;
        let (bar, threads, shared) = (&self.bar, self.threads, &mut self.shared);
        let mut progress = |p: Progress| bar.step(format!("{nm} nm: {} ({} PSFs)", p.step, p.psfs));
        let (header, band) = with_threads(threads, || {
            let trace = LensTrace::new(system, options)?;
            let trace = trace.over(range).with_tails(tails).with_psfs_up_to(MAX_PSF_BYTES);
            let band = trace.band_sharing(0, shared, &mut progress)?;
            Ok::<_, DesignError>((trace.header(), band))
        })
        .inspect_err(|error| self.cache.remember(&recipe, error))?;
        let lens = Lens { bands: vec![band.tables.clone()], ..header };
        let stores_pupils = band.psf.samples.is_empty();
        let values = (!stores_pupils).then(|| band_digest(&lens, 0, &band.psf));
        let pack = self.cache.insert(&recipe, &mut |pack| {
            match stores_pupils {
                true => pack.pupils(0, &band.pupils)?,
                false => pack.psf(0, &band.psf)?,
            }
            Ok((lens.clone(), with(&[band.report]), values.clone()))
        })?;
        Ok((recipe, pack))
    }

    /// Prints once that bands are traced.
    pub(super) fn announce(&mut self) {
        if !std::mem::replace(&mut self.is_announced, true) {
            let (name, dir) = (self.job.name, self.cache.dir().display());
            log_line(format!("tracing the bands of {name} that are not in {dir}"));
        }
    }
}

/// Whether an error is one of the lens, not of writing.
fn is_of_lens(error: &anyhow::Error) -> bool {
    error.is::<KnownFailure>() || error.downcast_ref().is_some_and(|e| !matches!(e, DesignError::Sink { .. }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nearby_wavelengths_share_their_band() {
        assert_eq!(rounded_nm(400.000_000_000_000_06), 400.0);
        assert_eq!(rounded_nm(550.123_456_4), 550.123_456);
    }
}
