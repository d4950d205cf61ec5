//! `lenscube sensor validate`: EMVA 1288 on the sensor itself, against its description.

use super::open::open_sensor;
use super::show::{FIGURES, bench, write};
use crate::args::{SensorValidateArgs, check_directory};
use crate::failure::code;
use crate::outputs::check_absent_in;
use crate::progress::{log_line, print};
use anyhow::{Context, Result};
use formats::picture::plot::{Axis, Plot, Series};
use formats::picture::style::Colour;
use pipeline::sensor::emva::{Bench, DITHERED_DN, FRAME, Measured, SPATIAL_FRAMES, Stated};
use std::fmt::Write as _;
use std::path::Path;

/// Files of a report, beside [`FIGURES`].
pub const FILES: [&str; 7] = [
    "photon-transfer.csv",
    "figures.csv",
    "photon-transfer.png",
    "dsnu-histogram.png",
    "dsnu-map.png",
    "prnu-histogram.png",
    "prnu-map.png",
];

/// A measured figure and the stated one.
struct Row {
    name: &'static str,
    measured: f64,
    stated: f64,
    /// Largest difference; `None`: not judged.
    tolerance: Option<f64>,
}

impl Row {
    fn is_within(&self) -> bool {
        self.tolerance.is_none_or(|t| (self.measured - self.stated).abs() <= t)
    }
}

/// Runs the command; the exit code.
pub fn command(args: &SensorValidateArgs) -> Result<u8> {
    if let Some(directory) = &args.out {
        check_absent_in(directory, FILES.iter().chain(&FIGURES), args.overwrite)?;
    }
    let file = open_sensor(&args.sensor, &args.set)?;
    let sensor = file.sensor(2.0);
    let bench = bench(&sensor, args.seed, args.die);
    log_line(format!(
        "{}: 50 exposures of 2 frames, 32 frames in the dark and at half saturation, 512 x 512 px",
        sensor.name
    ));
    let (measured, stated) = (bench.measure(), bench.stated());
    let rows = rows(&bench, &measured, &stated);
    print(format!("{:<22} {:>14} {:>14} {:>12}", "EMVA 1288", "measured", "stated", "tolerance"));
    for row in &rows {
        let tolerance = row.tolerance.map_or("not judged".into(), |t| format!("{t:.3e}"));
        let mark = if row.is_within() { "" } else { "  OUTSIDE" };
        print(format!(
            "{:<22} {:>14.6} {:>14.6} {:>12}{mark}",
            row.name, row.measured, row.stated, tolerance
        ));
    }
    if let Some(directory) = &args.out {
        report(directory, &bench, &measured, &rows)?;
    }
    let outside: Vec<&str> = rows.iter().filter(|r| !r.is_within()).map(|r| r.name).collect();
    if outside.is_empty() {
        return Ok(0);
    }
    log_line(format!("outside their tolerances: {}", outside.join(", ")));
    Ok(if args.require { code::WRONG } else { 0 })
}

fn rows(bench: &Bench<'_>, m: &Measured, s: &Stated) -> Vec<Row> {
    let dithered = s.dark_noise_e * s.dn_per_e >= DITHERED_DN;
    let share = |percent: f64, of: f64| Some(percent / 100.0 * of);
    let row = |name, measured, stated, tolerance| Row { name, measured, stated, tolerance };
    let slope = if dithered { 0.5 } else { 1.0 };
    vec![
        row("K (DN/e-)", m.dn_per_e, s.dn_per_e, share(slope, s.dn_per_e)),
        row("QE (e-/photon)", m.quantum_efficiency, s.quantum_efficiency, share(slope, s.quantum_efficiency)),
        row(
            "dark noise (e-)",
            m.dark_noise_e,
            s.dark_noise_e,
            share(1.0, s.dark_noise_e).filter(|_| dithered),
        ),
        row(
            "saturation (photons)",
            m.saturation_photons,
            s.saturation_e / s.quantum_efficiency,
            Some(bench.saturation_tolerance_photons()),
        ),
        // Offsets of neighbouring columns that are alike differ from die to die as a whole.
        row(
            "DSNU (e-)",
            m.dsnu_e,
            s.dsnu_e,
            share(3.0, s.dsnu_e)
                .map(|t| t + 4.0 * s.dsnu_deviation_e)
                .filter(|_| s.dsnu_e * s.dn_per_e >= 0.3),
        ),
        row("PRNU", m.prnu, s.prnu, share(1.0, s.prnu).filter(|_| s.prnu > 0.0)),
    ]
}

/// The figures, the measured points and the table.
fn report(directory: &Path, bench: &Bench<'_>, m: &Measured, rows: &[Row]) -> Result<()> {
    check_directory(directory)?;
    std::fs::create_dir_all(directory).with_context(|| format!("creating {}", directory.display()))?;
    let s = bench.sensor;
    let mut csv = "photons,mean_dn,variance_dn2\n".to_owned();
    for p in [&m.dark].into_iter().chain(&m.points) {
        let _ = writeln!(csv, "{},{},{}", p.photons, p.mean_dn, p.variance_dn2);
    }
    let mut table = "figure,measured,stated,tolerance\n".to_owned();
    for r in rows {
        let _ = writeln!(
            table,
            "\"{}\",{},{},{}",
            r.name,
            r.measured,
            r.stated,
            r.tolerance.map_or(String::new(), |t| t.to_string())
        );
    }
    for (name, text) in [("photon-transfer.csv", csv), ("figures.csv", table)] {
        formats::durable::AtomicFile::with_text(&directory.join(name), &text)?.finish()?;
    }
    // Saturated pixels have no variance: NaN leaves a gap.
    let log = |v: f64| if v > 0.0 { v.log10() } else { f64::NAN };
    let points = m.points.iter().map(|p| (log(p.mean_dn - m.dark.mean_dn), log(p.variance_dn2)));
    let stated = bench.stated();
    let full_dn = log(stated.saturation_e * stated.dn_per_e);
    let mut plot = Plot::new(
        format!("{}: photon transfer curve", s.name),
        // A little beyond saturation, so that its line is seen.
        Axis::new("log10 of the mean above the dark (DN)", 0.0, full_dn + 0.1),
        Axis::new("log10 of the temporal variance (DN²)", 0.0, 1.0),
    );
    // From 1 DN on: dark noise dominates there.
    let means: Vec<f64> = (0..=80).map(|i| 10f64.powf(full_dn * f64::from(i) / 80.0)).collect();
    let regime = |variance: &dyn Fn(f64) -> f64| {
        means.iter().map(|v| (log(*v), log(variance(*v)))).collect::<Vec<_>>()
    };
    let by_formula = regime(&|v| m.dark.variance_dn2 + stated.dn_per_e * v);
    plot.series = vec![
        Series::distinct("measured", points.collect(), 0).marked(0),
        Series::distinct("by formula", by_formula, 1).dashed(1),
        Series::distinct("dark noise", regime(&|_| m.dark.variance_dn2), 2).dashed(2),
        Series::distinct("shot noise", regime(&|v| stated.dn_per_e * v), 3).dashed(2),
        Series::distinct("PRNU (spatial)", regime(&|v| (stated.prnu * v).powi(2)), 4).dashed(2),
        Series::line(
            "saturation",
            vec![(full_dn, log(m.dark.variance_dn2)), (full_dn, log(stated.dn_per_e) + full_dn)],
            Colour::Muted,
        ),
    ];
    write(&directory.join("photon-transfer.png"), plot)?;
    super::show::plots(s, directory)?;
    for (name, title, frame) in
        [("dsnu", "dark", &m.dark_mean_frame), ("prnu", "half saturation", &m.half_mean_frame)]
    {
        let counts = histogram(frame);
        let ends = (counts[0].0, counts[counts.len() - 1].0);
        let mut plot = Plot::new(
            format!("{}: pixels of the mean frame, {title}", s.name),
            Axis::new("mean (DN)", ends.0, ends.1),
            Axis::new("pixels", 0.0, 1.0),
        );
        plot.series = vec![Series::distinct("pixels", counts, 0)];
        write(&directory.join(format!("{name}-histogram.png")), plot)?;
        super::figures::map(&directory.join(format!("{name}-map.png")), title, frame, FRAME)?;
    }
    Ok(())
}

/// Counts of bins from the minimum to the maximum; their width is a multiple of the steps of a mean of frames.
fn histogram(values: &[f64]) -> Vec<(f64, f64)> {
    const BINS: f64 = 64.0;
    let step = 1.0 / f64::from(SPATIAL_FRAMES);
    let (low, high) =
        values.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(*v), b.max(*v)));
    let width = ((high - low) / BINS / step).ceil().max(1.0) * step;
    let mut counts = vec![0.0; ((high - low) / width + 0.5) as usize + 1];
    let last = counts.len() - 1;
    for v in values {
        counts[(((v - low) / width + 1e-6) as usize).min(last)] += 1.0;
    }
    counts.iter().enumerate().map(|(i, n)| (low + (i as f64 + 0.5) * width, *n)).collect()
}
