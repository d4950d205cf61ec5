//! `lenscube device`: the devices of this machine, and the comparison of a GPU's films with the CPU's.
//!
//! The check computes regions of the film of the built-in lens tables at the centre, the edge and the corner on the CPU and on the GPU.
//! Their largest difference is compared with [`TOLERANCE`] of the peak, the bound of every engine against the float64 model. The
//! verdict is stored in the user's cache for this card (by its UUID), driver and program; `--device auto` reports a GPU without one, and does
//! not use a GPU that has failed.

use crate::args::engine::Engine;
use crate::args::{CoatingsArg, Device, DeviceArgs, DeviceCommand, EngineArg};
use crate::commands::validate::FilmMaker;
use crate::failure::{code, usage};
use crate::machine::device::driver;
use crate::machine::device::verdict::{Verdict, store, verdict};
use crate::machine::threads;
use crate::progress::{log_line, print};
use anyhow::{Context, Result};
use formats::durable::{create_directories, temp_name};
use formats::group::GroupError;
use pipeline::cuda::{self, DeviceInfo};
use pipeline::geometry::Rect;
use pipeline::simd::{Isa, Simd};
use pipeline::stage::Stage;
use std::path::Path;

/// Largest difference of the films, as a share of the peak.
const TOLERANCE: f64 = 2e-6;
/// Lens of the check: tables, so that nothing is traced.
const LENS: &str = "double-gauss-28-npz";
/// Chart of the check: the paper's film, three bands.
const CHART: &str = "gen:composite?size=14141&wavelengths=400,550,700&noise=0.01";
/// Film regions, x, y and side in px, with their names.
const REGIONS: [(&str, i64, i64, usize); 3] =
    [("centre", 6980, 7010, 300), ("edge", 13_841, 7000, 300), ("corner", 13_841, 13_841, 300)];
/// Stages of the compared films, with their names.
const STAGES: [(&str, &[Stage]); 2] =
    [("ri,distortion", Stage::REMAP), ("ri,distortion,svpsf", Stage::REMAP_AND_PSF)];

pub fn command(args: &DeviceArgs) -> Result<u8> {
    match &args.command {
        DeviceCommand::List => {
            list();
            Ok(0)
        }
        DeviceCommand::Check { device } => check(device),
    }
}

fn list() {
    let isas = [Isa::Avx512, Isa::Avx2, Isa::Portable];
    let names: Vec<&str> = isas.into_iter().filter(|i| Simd::require(*i).is_ok()).map(Isa::name).collect();
    print(format!("cpu      {} threads; engines: {}", threads(None), names.join(", ")));
    match cuda::devices() {
        Err(error) => print(format!("no GPU   {error}")),
        Ok(devices) => devices.iter().for_each(|info| {
            let DeviceInfo { index, name, memory_bytes, multiprocessors, .. } = info;
            let engine = Engine::Cuda(info.compute_capability);
            let verdict = match verdict(info) {
                Verdict::Passed => "equal to the CPU within the tolerance",
                Verdict::Failed => "DIFFERENT from the CPU",
                Verdict::Unknown => "not compared with the CPU: run `lenscube device check`",
            };
            print(format!(
                "cuda:{index}   {name}, {:.0} GB, {multiprocessors} multiprocessors, {}, engine {engine}; {verdict}",
                *memory_bytes as f64 * 1e-9,
                driver::description(info),
            ));
        }),
    }
}

fn check(device: &Device) -> Result<u8> {
    let devices = match device {
        Device::Cpu => return Err(usage("--device cpu: expected a GPU: auto, cuda or cuda:0,2")),
        Device::Auto => cuda::devices(),
        Device::Cuda(list) if list.is_empty() => cuda::devices(),
        Device::Cuda(list) => cuda::listed_devices(list),
    };
    let devices = devices.map_err(|e| usage(format!("--device {device}: {e}")))?;
    let dir = std::env::temp_dir().join(temp_name());
    create_directories(&dir, false).with_context(|| format!("creating {}", dir.display()))?;
    let checked = devices.iter().map(|info| check_one(info, &dir)).collect::<Result<Vec<_>>>();
    let removed = std::fs::remove_dir_all(&dir);
    let passed = checked?.into_iter().all(|passed| passed);
    removed.with_context(|| format!("removing {}", dir.display()))?;
    Ok(if passed { 0 } else { code::WRONG })
}

/// Compares the films of one GPU; whether they agree.
fn check_one(info: &DeviceInfo, dir: &Path) -> Result<bool> {
    let rects = REGIONS.map(|(_, x, y, side)| Rect::new(y, x, side, side));
    let film = |device: Device, stages: &[Stage]| {
        let maker = FilmMaker {
            lens: LENS.into(),
            coatings: CoatingsArg::Ideal,
            dir: dir.to_path_buf(),
            full: false,
            bands: 3,
            threads: threads(None),
            memory: None,
            device,
            engine: EngineArg::Auto,
        };
        maker.simulate(CHART, stages, &rects)
    };
    let mut worst = 0.0f64;
    for (names, stages) in STAGES {
        let of_cpu = film(Device::Cpu, stages)?;
        let of_gpu = match film(Device::Cuda(vec![info.index]), stages) {
            Err(error) if is_not_finite(&error) => {
                print(format!("cuda:{} {names:<20} {error:#}", info.index));
                worst = f64::INFINITY;
                continue;
            }
            film => film?,
        };
        for (region, (name, ..)) in REGIONS.iter().enumerate() {
            let difference = largest_difference(&of_cpu, &of_gpu, region);
            worst = worst.max(difference);
            print(format!(
                "cuda:{} {names:<20} {name:<7} largest difference from the CPU {difference:.2e} of the peak",
                info.index
            ));
        }
    }
    // Also false for NaN.
    let passed = worst <= TOLERANCE;
    print(format!(
        "cuda:{} ({}): {} (tolerance {TOLERANCE:.0e})",
        info.index,
        info.name,
        if passed { "passed" } else { "FAILED: use --device cpu, and report this with the driver's version" }
    ));
    if let Err(error) = store(info, worst, passed) {
        log_line(format!("note: the result cannot be stored: {error:#}"));
    }
    Ok(passed)
}

/// Whether the film has a value that cannot be stored: the chart has none, and the CPU has computed the same film.
fn is_not_finite(error: &anyhow::Error) -> bool {
    error.chain().any(|e| matches!(e.downcast_ref(), Some(GroupError::NotFinite { .. })))
}

/// The largest difference in a region over all bands, as a share of the band's largest value; infinite for NaN.
fn largest_difference(a: &[Vec<Vec<f32>>], b: &[Vec<Vec<f32>>], region: usize) -> f64 {
    let band = |(a, b): (&Vec<Vec<f32>>, &Vec<Vec<f32>>)| {
        let (a, b) = (&a[region], &b[region]);
        let peak = a.iter().fold(0f32, |m, v| m.max(v.abs()));
        let differences = a.iter().zip(b).map(|(a, b)| f64::from((a - b).abs() / peak));
        differences.fold(0.0, |m: f64, d| if d.is_nan() { f64::INFINITY } else { m.max(d) })
    };
    if a.len() != b.len() || a.is_empty() {
        return f64::INFINITY;
    }
    a.iter().zip(b).map(band).fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn difference_is_relative_to_the_peak_and_infinite_for_nan() {
        let film = |v: [f32; 2]| vec![vec![v.to_vec()]];
        assert_eq!(largest_difference(&film([2.0, -4.0]), &film([2.0, -3.0]), 0), 0.25);
        assert_eq!(largest_difference(&film([2.0, 4.0]), &film([f32::NAN, 4.0]), 0), f64::INFINITY);
        assert_eq!(largest_difference(&film([0.0, 0.0]), &film([0.0, 0.0]), 0), f64::INFINITY);
    }
}
