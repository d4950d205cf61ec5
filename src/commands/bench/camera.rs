//! Sensor and development, in memory: one tile of a raw on one thread.

use super::Bench;
use anyhow::Result;
use formats::developed::{Developed, write_png};
use formats::export::ExportError;
use formats::sensor::SensorFile;
use pipeline::colour::Illuminant;
use pipeline::develop::{ColourMatrix, Demosaic, Development, Quantizer, Recipe, Shading, Tone};
use pipeline::geometry::{Rect, Size};
use pipeline::sensor::noise::Exposer;
use pipeline::sensor::{Exposure, NoiseSet};
use std::time::Instant;

/// Side of the tile, px.
const SIDE: usize = 1024;
/// The sensor.
const SENSOR: &str = "example-2um";

pub(super) fn measure(bench: &mut Bench<'_>) -> Result<()> {
    let sensor = SensorFile::open(SENSOR, &[])?.sensor(2.0);
    let size = Size::new(SIDE, SIDE);
    // A slope from the dark to saturation, where all branches of the noise are in use.
    let full = sensor.saturation_e(1.0) / 0.01;
    let signal: Vec<f32> =
        (0..size.pixels()).map(|k| (full * (k % SIDE) as f64 / SIDE as f64) as f32).collect();
    let exposure = Exposure {
        seconds: 0.01,
        gain: 1.0,
        scale: 1.0,
        seed: 1,
        die: 1,
        frame: 0,
        noise: NoiseSet::ALL,
        temperature_c: None,
        flicker: None,
    };
    let exposer = Exposer::new(&sensor, &exposure);
    let mut raw = vec![0; size.pixels()];
    let mpx = size.pixels() as f64 * 1e-6;
    let rate = bench.median(|| {
        let start = Instant::now();
        exposer.expose(&signal, size.rect(), &mut raw);
        Ok(mpx / start.elapsed().as_secs_f64())
    })?;
    bench.add_number("sensor_mpx_s", rate, "Mpx/s", "sensor: all noises of a signal, one thread");
    let raw: Vec<f32> = raw.iter().map(|v| f32::from(*v)).collect();
    let recipe = Recipe {
        size,
        pattern: sensor.pattern.clone(),
        plane_of: sensor.plane_of_channels(),
        black_white_dn: (sensor.adc.black_dn, sensor.white_dn(1.0)),
        limit: 1.0,
        gains: sensor.white_gains(Illuminant::D65),
        bin: false,
        demosaic: Demosaic::Malvar,
        matrix: ColourMatrix::fitted(&sensor, Illuminant::D65)?.rows,
        exposure: 1.0,
    };
    let development = Development::new(recipe, (0, 0))?;
    let quantizer = Quantizer::new(Tone::Srgb, 8);
    let develop = |part: Rect| -> Vec<u16> {
        let needs = development.needs(part);
        let rows = &raw[needs.y as usize * SIDE..needs.bottom() as usize * SIDE];
        quantizer.codes(&development.develop(rows, Shading::None, part))
    };
    let rate = bench.median(|| {
        let start = Instant::now();
        (0..SIDE as i64).step_by(64).for_each(|y| drop(develop(Rect::new(y, 0, 64, SIDE))));
        Ok(mpx / start.elapsed().as_secs_f64())
    })?;
    bench.add_number("develop_mpx_s", rate, "Mpx/s", "development to 8 bits (Malvar), one thread");
    let path = bench.scratch.0.join("picture.png");
    let picture = Developed {
        path: &path,
        size,
        channels: 3,
        depth: 8,
        linear: false,
        comment: "",
        rows: 64,
        threads: bench.threads,
    };
    let rate = bench.median(|| {
        let start = Instant::now();
        write_png(&picture, &|_, _| (), |rows| {
            Ok::<_, ExportError>(develop(Rect::new(rows.start as i64, 0, rows.len(), SIDE)))
        })?;
        Ok(mpx / start.elapsed().as_secs_f64())
    })?;
    bench.add_number("develop_png_mpx_s", rate, "Mpx/s", "  to PNG, all threads");
    Ok(())
}
