//! `lenscube lens psf`: the PSF of a design at a point of the film, as an array with its sections.
//!
//! ```text
//! point sample  v = p² P(x, y)              P: light per area of the film over all light of the field point, p: pitch
//! pixel         v = ∫∫ P dx dy over p × p
//! light: v      sum: v / Σ v      peak: v / max v      strehl: v / v₀, v₀ the point sample at the peak of the same pupil without aberrations
//! line spread   Σ v over the columns (along y) or rows (along x) of the window
//! ```
//! Rows run towards +y of the film, columns towards +x; the chief ray is in the middle of the middle sample. Pixels are integrals of samples at 0.9 of
//! the Nyquist pitch ([`film_pixel`](pipeline::design::film_pixel)).

use crate::args::{Normalise, PsfArgs};
use crate::design;
use crate::failure::usage;
use crate::outputs::check_absent;
use crate::progress::{log_line, print, short_number};
use anyhow::{Context, Result};
use formats::durable::{AtomicFile, finish_together};
use formats::export::flat::npy_file;
use pipeline::design::System;
use pipeline::design::film_pixel::FilmPixels;
use pipeline::design::psf::{PsfGrid, PsfScratch, PupilFunction};
use pipeline::design::ray::Tracer;
use serde_json::{Value, json};

/// Default pitch over the Nyquist pitch.
const DEFAULT_PITCH: f64 = 0.5;
/// Pitch over the Nyquist pitch of the samples that pixels are integrated from.
const FINE: f64 = 0.9;
/// Samples beyond the outermost pixel that its integral needs.
const MARGIN: usize = 24;
/// Maximum of those samples a side.
const MAX_SAMPLES: usize = 4097;

/// A PSF and what its values are.
struct Psf {
    size: usize,
    pitch_um: f64,
    values: Vec<f64>,
    nyquist_um: f64,
    /// Share of the light in the window.
    energy: f64,
    /// Strehl ratio at the chief ray.
    strehl: f64,
}

/// Runs the command.
pub fn command(args: &PsfArgs) -> Result<()> {
    if !design::is_design(&args.design) {
        return Err(usage(format!(
            "`{}` is not a design; the PSFs of a lens pack are arrays of its store, and `lenscube lens show` has their figures",
            args.design
        )));
    }
    for path in [&args.out, &args.sections].into_iter().flatten() {
        check_absent(path, args.overwrite)?;
    }
    let is_csv = match args.out.as_deref().map(|p| p.extension().and_then(|e| e.to_str())) {
        None | Some(Some("npy")) => false,
        Some(Some("csv")) => true,
        Some(_) => return Err(usage("OUT must end in .npy or .csv")),
    };
    if args.sections.as_deref().is_some_and(|p| p.extension().is_none_or(|e| e != "csv")) {
        return Err(usage("--sections must end in .csv"));
    }
    let system = design::open(&args.design, &args.parameters)?;
    system.notes.iter().for_each(|note| log_line(format!("note: {note}")));
    let nm = args.wavelength.unwrap_or(system.primary_um() * 1e3);
    let psf = compute(&system, nm, args).with_context(|| format!("PSF of {} at {nm} nm", args.design))?;
    let mut files = Vec::new();
    if let Some(path) = &args.out {
        files.push(match is_csv {
            true => AtomicFile::with_text(path, &psf.csv())?,
            false => npy_file(path, &[psf.size, psf.size], psf.values.iter().map(|v| *v as f32))?,
        });
    }
    if let Some(path) = &args.sections {
        files.push(AtomicFile::with_text(path, &psf.sections_csv())?);
    }
    finish_together(files)?;
    match args.json {
        true => print(serde_json::to_string_pretty(&psf.json(nm, args))?),
        false => print(psf.text(&system.name, nm, args).trim_end()),
    }
    let written = [&args.out, &args.sections]
        .into_iter()
        .flatten()
        .map(|p: &std::path::PathBuf| p.display().to_string());
    let written: Vec<String> = written.collect();
    if !written.is_empty() {
        log_line(format!("wrote {}", written.join(", ")));
    }
    Ok(())
}

fn compute(system: &System, nm: f64, args: &PsfArgs) -> Result<Psf> {
    let tracer = Tracer::new(system, nm / 1e3)?;
    let (x, y) = args.at;
    let tan = tracer.field_of_height(x.hypot(y))?;
    let function = PupilFunction::trace(&tracer, tan)?;
    let nyquist_um = function.nyquist_um();
    let pitch_um = args.pitch_um.unwrap_or(DEFAULT_PITCH * nyquist_um);
    let azimuth_rad = y.atan2(x);
    let sampled = |half: usize, sample_um: f64| match 2 * half + 1 {
        n if n > MAX_SAMPLES => Err(usage(format!(
            "{} values of {pitch_um} µm a side need {n} samples of {sample_um:.3} µm, more than {MAX_SAMPLES}; give a smaller --size or \
             --pitch-um",
            args.size
        ))),
        _ => Ok(PsfGrid::new(half, sample_um).psf(&function, azimuth_rad, &mut PsfScratch::default())),
    };
    let fine_um = FINE * nyquist_um;
    let mut values: Vec<f64> = match args.integrate {
        false => {
            // Samples are finer than Nyquist; of a coarser pitch those between are left out.
            let step = (pitch_um / fine_um).ceil().max(1.0);
            let (half, step) = (args.size / 2 * step as usize, step as usize);
            let all = sampled(half, pitch_um / step as f64)?;
            let side = |n: usize| (0..n).step_by(step);
            let picked = side(2 * half + 1).flat_map(|y| side(2 * half + 1).map(move |x| (y, x)));
            picked.map(|(y, x)| all[y * (2 * half + 1) + x] * (step * step) as f64).collect()
        }
        true => {
            let half = (0.5 * pitch_um * args.size as f64 / fine_um).ceil() as usize + MARGIN;
            FilmPixels::new(2 * half + 1, fine_um, args.size, pitch_um).integrate(&sampled(half, fine_um)?)
        }
    };
    let strehl = sampled(1, fine_um)?[4] / function.ideal_peak(fine_um);
    let energy: f64 = values.iter().sum();
    let scale = match args.normalise {
        Normalise::Light => 1.0,
        Normalise::Sum => 1.0 / energy,
        Normalise::Peak => 1.0 / values.iter().copied().fold(0.0, f64::max),
        Normalise::Strehl => 1.0 / function.ideal_peak(pitch_um),
    };
    values.iter_mut().for_each(|v| *v *= scale);
    Ok(Psf { size: args.size, pitch_um, values, nyquist_um, energy, strehl })
}

impl Psf {
    fn at_um(&self, i: usize) -> f64 {
        (i as f64 - (self.size / 2) as f64) * self.pitch_um
    }

    /// Position, section and line spread function along x, then along y.
    fn sections(&self) -> Vec<[f64; 5]> {
        let (n, middle) = (self.size, self.size / 2);
        let sum = |at: &dyn Fn(usize) -> usize| (0..n).map(|k| self.values[at(k)]).sum::<f64>();
        (0..n)
            .map(|i| {
                let (along_x, along_y) = (self.values[middle * n + i], self.values[i * n + middle]);
                [self.at_um(i), along_x, along_y, sum(&|k| k * n + i), sum(&|k| i * n + k)]
            })
            .collect()
    }

    /// Centroid from the chief ray, µm.
    fn centroid_um(&self) -> [f64; 2] {
        let total: f64 = self.values.iter().sum();
        let mean = |at: &dyn Fn(usize) -> usize| {
            self.values.iter().enumerate().map(|(i, v)| v * self.at_um(at(i))).sum::<f64>() / total
        };
        [mean(&|i| i % self.size), mean(&|i| i / self.size)]
    }

    fn csv(&self) -> String {
        let row = |(i, v): (usize, &f64)| {
            format!("{:.6},{:.6},{v:e}\n", self.at_um(i % self.size), self.at_um(i / self.size))
        };
        std::iter::once("x_um,y_um,psf\n".to_owned()).chain(self.values.iter().enumerate().map(row)).collect()
    }

    fn sections_csv(&self) -> String {
        let row =
            |[at, x, y, line_x, line_y]: [f64; 5]| format!("{at:.6},{x:e},{y:e},{line_x:e},{line_y:e}\n");
        let head = "position_um,section_along_x,section_along_y,line_spread_along_x,line_spread_along_y\n"
            .to_owned();
        std::iter::once(head).chain(self.sections().into_iter().map(row)).collect()
    }

    fn json(&self, nm: f64, args: &PsfArgs) -> Value {
        let sections = self.sections();
        let column = |i: usize| sections.iter().map(|row| row[i]).collect::<Vec<_>>();
        json!({
            "x_mm": args.at.0,
            "y_mm": args.at.1,
            "wavelength_nm": nm,
            "size": self.size,
            "pitch_um": self.pitch_um,
            "nyquist_pitch_um": self.nyquist_um,
            "value_is": if args.integrate { "integrated over the pixel" } else { "point sample" },
            "normalisation": args.normalise.name(),
            "light_in_window": self.energy,
            "strehl": self.strehl,
            "centroid_x_um": self.centroid_um()[0],
            "centroid_y_um": self.centroid_um()[1],
            "sections": {
                "position_um": column(0),
                "section_along_x": column(1),
                "section_along_y": column(2),
                "line_spread_along_x": column(3),
                "line_spread_along_y": column(4),
            },
        })
    }

    fn text(&self, name: &str, nm: f64, args: &PsfArgs) -> String {
        let kind = if args.integrate { "pixels" } else { "point samples" };
        let [x, y] = self.centroid_um();
        format!(
            "{name}: PSF at ({}, {}) mm, {} nm\n{n} x {n} {kind} of {:.4} µm (Nyquist pitch {:.4} µm), normalised by {}\n\
             light in the window {:.3} %, Strehl ratio {:.4}, centroid ({x:.3}, {y:.3}) µm from the chief ray\n",
            args.at.0,
            args.at.1,
            short_number(nm),
            self.pitch_um,
            self.nyquist_um,
            args.normalise.name(),
            100.0 * self.energy,
            self.strehl,
            n = self.size,
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sections_of_a_point_are_its_row_and_column() {
        let mut values = vec![0.0; 25];
        values[2 * 5 + 3] = 0.5;
        values[12] = 0.25;
        let psf = Psf { size: 5, pitch_um: 2.0, values, nyquist_um: 1.0, energy: 0.75, strehl: 1.0 };
        let sections = psf.sections();
        assert_eq!(sections[3], [2.0, 0.5, 0.0, 0.5, 0.0]);
        assert_eq!(sections[2], [0.0, 0.25, 0.25, 0.25, 0.75]);
        assert!((psf.centroid_um()[0] - 4.0 / 3.0).abs() < 1e-12 && psf.centroid_um()[1] == 0.0);
        assert!(psf.csv().lines().nth(14).unwrap().starts_with("2.000000,0.000000,5e-1"));
        assert_eq!(psf.sections_csv().lines().count(), 6);
    }
}
