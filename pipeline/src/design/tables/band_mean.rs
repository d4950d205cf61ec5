//! A band of some width: tables and PSFs are means over wavelengths within it.
//!
//! ```text
//! film = ∫ film(λ) dλ / (to − from) = Σ_i w_i film(λ_i)      λ_i, w_i: Gauss-Legendre on [from, to];  the chart's value belongs to all of them
//! L_i(t) = G_i · (h_i h_i') / (h h')                          light of the field element at t = tan θ per area of the film at the band's own wavelength
//! G(t)   = Σ w_i L_i(t)                                       gives relative illumination and solid angle
//! P(X)   = Σ w_i L_i P_i(X − (h_i − h)) / G                   PSF about the chief ray of the band's own wavelength
//! ```
//! G_i irradiance per radiance (`pupil/illumination.rs`), h_i(t) the height of the chief ray at λ_i and h that at the band's own wavelength, on +x; P_i the
//! PSF at λ_i about its own chief ray, as shares of all its light. So the lateral colour within the band is part of the PSFs, and the distortion is that
//! of the band's own wavelength. A uniform chart gives Σ w_i G_i.
//! The PSF at another place is shifted exactly: U(X − d) has the wavelets c·exp(−i k L d).
//!
//! The pitch of the samples is that of the wavelength that needs the finest; the window has the largest one of the wavelengths, and twice the largest
//! shift. Heights and azimuths are chosen at the band's own wavelength: means over wavelengths are smoother.
//! Left out: a chart whose values change within the band; layers of light beside the image, which have the band's own wavelength.

use rayon::prelude::*;

use super::options::TraceOptions;
use super::window::window;
use crate::design::prescription::error::DesignError;
use crate::design::prescription::system::System;
use crate::design::psf::pupil_stack::normalise;
use crate::design::psf::{PsfGrid, PsfScratch, PupilFunction};
use crate::design::pupil::illumination::{irradiance_sr, irradiance_table};
use crate::design::pupil::pupils::Pupils;
use crate::design::pupil::quadrature::unit_interval;
use crate::design::rays::ray::Tracer;
use crate::lens::{PsfSample, PsfStack, linear};

/// The width of a band and the number of wavelengths that it is integrated with.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BandRange {
    /// Shorter end, nm.
    pub from_nm: f64,
    /// Longer end, nm.
    pub to_nm: f64,
    /// Number of wavelengths.
    pub samples: usize,
}

impl BandRange {
    /// Wavelengths in nm and their weights, whose sum is 1.
    pub fn wavelengths_nm(&self) -> Vec<(f64, f64)> {
        let at = |(x, w): &(f64, f64)| (self.from_nm + x * (self.to_nm - self.from_nm), *w);
        unit_interval(self.samples).iter().map(at).collect()
    }
}

/// The wavelengths of a band, each with a tracer.
pub(super) struct BandTracers<'a> {
    own: &'a Tracer<'a>,
    tracers: Vec<(f64, Tracer<'a>)>,
}

/// The light of a band at field points.
pub(super) struct BandLight {
    /// w_i L_i of each wavelength at each field point, sr.
    of_wavelengths: Vec<Vec<f64>>,
    /// Their sums, sr.
    pub(super) sum: Vec<f64>,
    /// Light of the axis over that without losses.
    pub(super) transmission: f64,
}

/// Sampling of the PSFs that holds those of all wavelengths.
pub(super) struct BandSampling {
    pub(super) pitch_um: f64,
    pub(super) window_px: usize,
}

impl<'a> BandTracers<'a> {
    /// Those of `range` for the band of `own`.
    ///
    /// # Errors
    /// A glass without an index at a wavelength.
    pub(super) fn new(
        system: &'a System,
        own: &'a Tracer<'a>,
        range: BandRange,
    ) -> Result<Self, DesignError> {
        let tracer = |(nm, weight): (f64, f64)| Ok((weight, Tracer::new(system, nm / 1e3)?));
        let tracers = range.wavelengths_nm().into_iter().map(tracer).collect::<Result<_, DesignError>>()?;
        Ok(Self { own, tracers })
    }

    /// Light at the field points `tans`, ascending from 0.
    ///
    /// # Errors
    /// A ray that does not reach the image; no light passes.
    pub(super) fn light(&self, tans: &[f64]) -> Result<BandLight, DesignError> {
        let area = |tracer: &Tracer<'_>, tan: f64| -> Result<f64, DesignError> {
            let (height, slope) = tracer.chief_height_and_slope(tan)?;
            Ok(if tan == 0.0 { slope * slope } else { height * slope })
        };
        let (mut of_wavelengths, mut bare) = (Vec::new(), 0.0);
        for (weight, tracer) in &self.tracers {
            let ratios: Vec<f64> = tans
                .par_iter()
                .map(|tan| Ok(area(tracer, *tan)? / area(self.own, *tan)?))
                .collect::<Result<_, DesignError>>()?;
            let light = irradiance_table(tracer, tans)?;
            if tracer.has_losses() {
                bare += weight * ratios[0] * irradiance_sr(&tracer.without_losses(), 0.0)?;
            } else {
                bare += weight * ratios[0] * light[0];
            }
            of_wavelengths.push(light.iter().zip(&ratios).map(|(g, r)| weight * g * r).collect::<Vec<_>>());
        }
        let sum: Vec<f64> = (0..tans.len()).map(|k| of_wavelengths.iter().map(|l| l[k]).sum()).collect();
        let transmission = super::dense::within_dark(self.own, (sum[0] / bare).min(1.0))?;
        Ok(BandLight { of_wavelengths, sum, transmission })
    }

    /// Heights of the chief rays of a wavelength, mm, for those at `heights_mm` of the band's own.
    fn heights_mm(&self, tracer: &Tracer<'_>, heights_mm: &[f64]) -> Result<Vec<f64>, DesignError> {
        let height = |h: &f64| match *h == 0.0 {
            true => Ok(0.0),
            false => tracer.chief_height_mm(self.own.field_of_height(*h)?),
        };
        heights_mm.par_iter().map(height).collect()
    }

    /// Pupil functions of a wavelength at the first heights of the band.
    fn pupils<'t>(
        &self,
        tracer: &'t Tracer<'t>,
        first_mm: &[f64],
    ) -> Result<(Vec<f64>, Pupils<'t>), DesignError> {
        let heights = self.heights_mm(tracer, first_mm)?;
        let pupils = Pupils::new(tracer, &heights)?;
        Ok((heights, pupils))
    }

    /// Pitch that resolves the PSFs of all wavelengths, at most `pitch_um`: pitch of the band's own, which divides the film's; and the window that holds them,
    /// film pixels, at least `own_px`.
    ///
    /// # Errors
    /// A ray that does not reach the image; a window larger than the maximum.
    pub(super) fn sampling(
        &self,
        options: &TraceOptions,
        first_mm: &[f64],
        own: BandSampling,
    ) -> Result<BandSampling, DesignError> {
        let BandSampling { mut pitch_um, mut window_px } = own;
        if options.psf_pitch_um.is_some() && options.window_px.is_some() {
            return Ok(BandSampling { pitch_um, window_px });
        }
        let all: Vec<_> =
            self.tracers.iter().map(|(_, tracer)| self.pupils(tracer, first_mm)).collect::<Result<_, _>>()?;
        if options.psf_pitch_um.is_none() {
            for (heights, pupils) in &all {
                let nyquist = heights.iter().map(|h| pupils.at(*h)).map(PupilFunction::nyquist_um);
                pitch_um =
                    pitch_um.min(super::sampled::pitch_below(options, nyquist.fold(f64::INFINITY, f64::min)));
            }
        }
        if options.window_px.is_some() {
            return Ok(BandSampling { pitch_um, window_px });
        }
        let mut shift_um = 0.0_f64;
        for ((_, tracer), (heights, pupils)) in self.tracers.iter().zip(&all) {
            let found = window(options, tracer, (heights, pupils), pitch_um)?;
            window_px = window_px.max(found.windows.px);
            shift_um =
                heights.iter().zip(first_mm).fold(shift_um, |most, (a, b)| most.max(1e3 * (a - b).abs()));
        }
        window_px += 2 * (shift_um / options.film_pitch_um).ceil() as usize;
        Ok(BandSampling { pitch_um, window_px: window_px.min(options.max_window_px) })
    }

    /// The PSFs on `grid` at `heights_mm` of the band's own chief rays, each of sum 1, and their shares of energy in the window. `real_mm`: heights of the field points
    /// of `light`.
    ///
    /// # Errors
    /// A ray that does not reach the image.
    pub(super) fn stack(
        &self,
        grid: &PsfGrid,
        (first_mm, heights_mm): (&[f64], &[f64]),
        (real_mm, light): (&[f64], &BandLight),
    ) -> Result<(PsfStack, Vec<f64>), DesignError> {
        let n = grid.size();
        let mut samples = vec![0.0_f32; n * n * heights_mm.len()];
        for ((_, tracer), own_light) in self.tracers.iter().zip(&light.of_wavelengths) {
            let (_, mut pupils) = self.pupils(tracer, first_mm)?;
            let chiefs_mm = self.heights_mm(tracer, heights_mm)?;
            pupils.prepare(chiefs_mm.iter().copied())?;
            samples
                .par_chunks_exact_mut(n * n)
                .zip(heights_mm)
                .zip(&chiefs_mm)
                .map_init(<(PsfScratch, Vec<f32>)>::default, |(scratch, psf), ((sum, height), chief)| {
                    let share = linear(real_mm, own_light, *height) / linear(real_mm, &light.sum, *height);
                    grid.shifted_into(pupils.at(*chief), 1e3 * (chief - height), scratch, psf);
                    sum.iter_mut().zip(&*psf).for_each(|(sum, v)| *sum += share as f32 * v);
                })
                .for_each(drop);
        }
        let energy = samples
            .par_chunks_exact_mut(n * n)
            .map_init(Vec::new, |mean: &mut Vec<f32>, out| {
                mean.clear();
                mean.extend_from_slice(out);
                normalise(mean, out)
            })
            .collect();
        Ok((PsfStack { size: n, pitch_um: grid.pitch_um(), sample: PsfSample::Point, samples }, energy))
    }
}
