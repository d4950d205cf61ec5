//! Remap stage on each instruction set compared with the f64 map; sets that the machine lacks are reported as ignored.

mod oracle;
mod remap_cases;

use lenscube_pipeline::band::BandPlan;
use lenscube_pipeline::field::Outside;
use lenscube_pipeline::flow::ChartSource;
use lenscube_pipeline::geometry::{Frame, Rect, Size};
use lenscube_pipeline::remap::{Remap, RemapScratch};
use lenscube_pipeline::simd::{Isa, Simd};
use libtest_mimic::{Arguments, Trial};
use oracle::Noise;
use remap_cases::{CHECKS, Engine, FIRST_TWO, Job, band};
use std::process::ExitCode;

impl Engine for Simd {
    fn remap(&self, job: &Job<'_>, chart: &dyn ChartSource, rect: Rect) -> Vec<f32> {
        let remap = Remap::new(job.frame, job.lens, job.stages, job.interpolation, job.gain, *self);
        let mut got = vec![0.0; rect.size().pixels()];
        remap.apply(chart, 0, rect, &mut got, &mut RemapScratch::default()).unwrap();
        got
    }
}

fn film_beyond_the_tables_is_an_error_or_clamped() {
    let mut noise = Noise(1);
    let film = Size::new(100, 100);
    let frame = Frame::centred(film, film, 2.0);
    let needed = frame.farthest_mm(film.rect());
    let band = band(&mut noise, 20, needed * 0.9);
    let lens = oracle::lens("short", vec![band.clone()]);
    let mut options = oracle::options(FIRST_TWO, Simd::PORTABLE);
    let error = BandPlan::new(&frame, &lens, 550.0, &options).unwrap_err().to_string();
    assert!(
        error.contains(&format!("{needed:.6}")) && error.contains(&format!("{:.6}", needed * 0.9)),
        "{error}"
    );
    options.interpolation.outside = Outside::Clamp;
    assert!(BandPlan::new(&frame, &lens, 550.0, &options).is_ok());
}

fn main() -> ExitCode {
    let mut trials = vec![Trial::test("film_beyond_the_tables_is_an_error_or_clamped", || {
        film_beyond_the_tables_is_an_error_or_clamped();
        Ok(())
    })];
    for isa in Isa::ALL {
        for (name, check) in CHECKS {
            let run = move || {
                check(&Simd::require(isa)?);
                Ok(())
            };
            let trial = Trial::test(format!("{}::{name}", isa.name()), run);
            trials.push(trial.with_ignored_flag(!isa.is_available()));
        }
    }
    libtest_mimic::run(&Arguments::from_args(), trials).exit_code()
}
