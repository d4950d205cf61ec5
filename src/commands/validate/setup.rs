//! Setup of a validation: film geometry, lens of the simulated films, reference lens; paths between chart and film.

use super::edge_places::{angles, places};
use super::film_maker::{FilmMaker, RegionPixels, VeiledFilm};
use super::progress::Steps;
use super::reference::{ReferenceBand, ReferenceLens};
use crate::args::{CoatingsArg, ValidateArgs, VeilArgs};
use crate::design;
use crate::failure::usage;
use crate::job::default_options;
use crate::job::lens::{JobLens, UntracedLens};
use crate::machine::threads;
use anyhow::{Context, Result};
use formats::durable::{create_directories, sweep_entries};
use pipeline::geometry::{Frame, Rect, Size};
use pipeline::psf::kernel::film_window;
use pipeline::stage::Stage;
use pipeline::tails::TailPlan;

/// Built-in lenses of the paper's design, its film (side in px, pitch in µm) and its bands.
const PAPER_LENSES: [&str; 2] = ["double-gauss-28", "double-gauss-28-npz"];
const PAPER_FILM: (usize, f64) = (14141, 2.0);
const PAPER_BANDS: &str = "400:700:10";
/// Films of the uniform chart and of the points, without and with the PSF stage.
const FILMS: usize = 4;
/// Films of the section Light.
const LIGHT_FILMS: usize = 4;

/// Films to simulate and the lens to compare them with.
pub struct Setup {
    film_maker: FilmMaker,
    /// Steps: the films, then the comparisons of the bands.
    pub steps: Steps,
    /// Side of the film, px.
    pub size: usize,
    /// Film pixel pitch, µm.
    pub pitch_um: f64,
    /// Optical axis (row, column) in film pixels that the comparison assumes.
    pub axis_px: (f64, f64),
    pub wavelengths_nm: Vec<f64>,
    /// Side of the film kernels, px, by band.
    pub windows_px: Vec<usize>,
    /// Whether films have the tails of PSFs, by band.
    pub has_tails: Vec<bool>,
    /// Lens of the simulated films, traced where it is a design.
    pub source: JobLens,
    pub reference: ReferenceLens,
    /// Whether design, film and bands are those of the paper.
    pub of_paper: bool,
}

impl Setup {
    /// Opens both lenses; traces the bands of the films if their lens is a design.
    pub fn new(args: &ValidateArgs) -> Result<Self> {
        let mut wavelengths_nm = crate::commands::lens::trace::wavelengths(&args.wavelengths)?;
        if let Some(text) = &args.bands {
            let chosen = crate::job::chosen_bands(text, &wavelengths_nm)?;
            wavelengths_nm = chosen.into_iter().map(|b| wavelengths_nm[b]).collect();
        }
        let size = args.film_size as usize;
        let against = args.against.as_ref().unwrap_or(&args.lens);
        let is_of_paper = |name: &str| PAPER_LENSES.contains(&name);
        let of_paper = is_of_paper(&args.lens)
            && is_of_paper(against)
            && (size, args.film_pitch_um) == PAPER_FILM
            && wavelengths_nm == pipeline::wavelengths::parse(PAPER_BANDS).unwrap_or_default();
        let is_coated = args.coatings != CoatingsArg::Ideal;
        if is_coated && ![&args.lens, against].into_iter().any(|name| design::is_design(name)) {
            return Err(usage(format!(
                "--coatings is for designs; {against} is a lens pack, whose tables have their coating"
            )));
        }
        let reference = ReferenceLens::open(against, &args.coatings)?;
        // A missing band is reported before any film is simulated.
        for &nm in &wavelengths_nm {
            reference.band(nm)?;
        }
        let threads = threads(args.threads);
        let film = Size::new(size, size);
        let frame = Frame::centred(film, film, args.film_pitch_um);
        let options = default_options();
        let lens = UntracedLens::open_coated(&args.lens, &args.coatings)?;
        // Films have these coatings where their lens is a design.
        let coatings = match lens {
            UntracedLens::Design(_) => args.coatings.clone(),
            UntracedLens::Pack(_) => CoatingsArg::Ideal,
        };
        let source = JobLens::new(lens, &frame, &wavelengths_nm, &options, threads, None)?;
        let sample = source.lens().psf_sample;
        let window = |&nm: &f64| -> Result<usize> {
            let band = source.lens().bands.iter().find(|b| (b.wavelength_nm - nm).abs() < 1e-6);
            let band = band.with_context(|| format!("{} has no band at {nm} nm", args.lens))?;
            Ok(film_window(band.psf_size, band.psf_pitch_um, args.film_pitch_um, sample))
        };
        let windows_px = wavelengths_nm.iter().map(window).collect::<Result<_>>()?;
        let has_tails = wavelengths_nm.iter().map(|nm| {
            let bands = &source.lens().bands;
            bands.iter().any(|b| (b.wavelength_nm - nm).abs() < 1e-6 && TailPlan::new(&frame, b).is_some())
        });
        let has_tails = has_tails.collect();
        create_directories(&args.out, true)?;
        // Temporary films of a killed validation.
        sweep_entries(&args.out)?;
        let film_maker = FilmMaker {
            lens: args.lens.clone(),
            coatings,
            dir: args.out.clone(),
            full: args.full,
            bands: wavelengths_nm.len(),
            threads,
            memory: args.memory,
            device: args.device.clone(),
            engine: args.engine,
        };
        let films = FILMS + LIGHT_FILMS + angles(&places(size)).len();
        Ok(Self {
            film_maker,
            steps: Steps::new((films + wavelengths_nm.len()) as u64),
            size,
            pitch_um: args.film_pitch_um,
            axis_px: frame.axis_px,
            wavelengths_nm,
            windows_px,
            has_tails,
            source,
            reference,
            of_paper,
        })
    }

    /// Simulates the film of `chart` by `stages` and reads its regions `rects`.
    pub fn simulate(&self, chart: &str, stages: &[Stage], rects: &[Rect]) -> Result<RegionPixels> {
        let pixels = self.film_maker.simulate(chart, stages, rects)?;
        self.steps.step();
        Ok(pixels)
    }

    /// The band whose light is checked: the middle one.
    pub fn light_band(&self) -> usize {
        self.wavelengths_nm.len() / 2
    }

    /// Real image height of the film's corner, mm.
    pub fn corner_mm(&self) -> f64 {
        self.size as f64 * self.pitch_um * 1e-3 / std::f64::consts::SQRT_2
    }

    /// Simulates the film of [`Setup::light_band`] of `chart` by `stages` with `veil` and reads its regions `rects`.
    pub fn veiled(
        &self,
        chart: &str,
        stages: &[Stage],
        veil: VeilArgs,
        rects: &[Rect],
    ) -> Result<VeiledFilm> {
        let film = self.film_maker.veiled(chart, stages, (self.light_band(), veil), rects)?;
        self.steps.step();
        Ok(film)
    }

    /// Whether films are complete, instead of regions.
    pub fn full(&self) -> bool {
        self.film_maker.full
    }

    /// Generated chart for this film.
    pub fn chart(&self, kind: &str, settings: &str) -> String {
        format!(
            "gen:{kind}?size={}&pitch_um={}&wavelengths={}{settings}",
            self.size,
            self.pitch_um,
            pipeline::wavelengths::format(&self.wavelengths_nm)
        )
    }

    /// Centre (row, column) of film and chart in film pixels.
    pub fn chart_centre(&self) -> (f64, f64) {
        let middle = (self.size as f64 - 1.0) / 2.0;
        (middle, middle)
    }

    /// Film position (row, column) of the chief ray of a chart point (row, column; film pixels).
    pub fn film_position(&self, reference: &ReferenceBand<'_>, chart_px: (f64, f64)) -> Result<(f64, f64)> {
        let centre = self.chart_centre();
        let (dy, dx) = (chart_px.0 - centre.0, chart_px.1 - centre.1);
        let ideal_mm = dy.hypot(dx) * self.pitch_um * 1e-3;
        if ideal_mm == 0.0 {
            return Ok(self.axis_px);
        }
        let m = reference.real_mm(ideal_mm)? / ideal_mm;
        Ok((self.axis_px.0 + dy * m, self.axis_px.1 + dx * m))
    }

    /// Moments of the PSF about the chief ray inside the film kernel's window: the first radial moment in px, the second radial
    /// and tangential moments in px².
    pub fn psf_moments(
        &self,
        reference: &ReferenceBand<'_>,
        band: usize,
        r_px: f64,
        azimuth_rad: f64,
    ) -> Result<[f64; 3]> {
        let height_mm = r_px * self.pitch_um * 1e-3;
        let pixels = reference.pixels(height_mm, azimuth_rad, self.windows_px[band], self.pitch_um)?;
        let (sin, cos) = azimuth_rad.sin_cos();
        Ok(pixels.iter().fold([0.0; 3], |[c, out, across], ((y, x), p)| {
            let (u, v) = (x * cos + y * sin, y * cos - x * sin);
            [c + p * u, out + p * u * u, across + p * v * v]
        }))
    }
}
