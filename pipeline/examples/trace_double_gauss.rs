//! Times the trace of the built-in lens: `trace_double_gauss adaptive|fixed [wavelengths from:to:step]`.
use std::time::Instant;

use lenscube_pipeline::design::trace::{Azimuths, PsfHeights, TracedBand};
use lenscube_pipeline::design::{System, TraceOptions, trace_lens};

fn main() {
    let args: Vec<String> = std::env::args().collect();
    let system = System::double_gauss_28();
    let waves: Vec<u32> =
        args.get(2).map_or(vec![400, 700, 10], |a| a.split(':').map(|v| v.parse().unwrap()).collect());
    let waves = (waves[0]..=waves[1]).step_by(waves[2] as usize).map(f64::from).collect();
    let mut options = TraceOptions::new(waves, 20.5);
    if args.get(1).is_some_and(|a| a == "fixed") {
        options.heights = PsfHeights::Given((0..22).map(|i| 20.5 * f64::from(i) / 21.0).collect());
        options.azimuths = Azimuths::Given(72);
        options.max_window_px = 101;
    }
    let start = Instant::now();
    let mut last = Instant::now();
    let (mut bytes, mut psfs) = (0, 0);
    let sink = |_: usize, band: TracedBand| -> Result<(), String> {
        let t = &band.tables;
        t.check().map_err(|e| e.to_string())?;
        let nodes: usize = t.azimuth_count.iter().sum();
        let r = band.report;
        bytes += band.psf.samples.len() * 4;
        psfs += r.psfs;
        println!(
            "{} nm: {:.2} s, {} px = {} x {:.4} um, {} heights, {nodes} nodes (J {:?}..{}), L1 {:?}, energy {:.5}, {} PSFs, {:.1} MB",
            r.wavelength_nm,
            last.elapsed().as_secs_f64(),
            r.window_px,
            t.psf_size,
            t.psf_pitch_um,
            t.psf_height_mm.len(),
            t.azimuth_count.get(1),
            t.azimuth_count[t.azimuth_count.len() - 1],
            r.psf_error.map(|e| e.worst),
            r.min_energy,
            r.psfs,
            band.psf.samples.len() as f64 * 4e-6,
        );
        last = Instant::now();
        Ok(())
    };
    trace_lens(&system, &options, &mut |_| (), sink).unwrap();
    println!(
        "{:.2} s in all, {psfs} PSFs, {:.1} MB of samples",
        start.elapsed().as_secs_f64(),
        bytes as f64 * 1e-6
    );
}
