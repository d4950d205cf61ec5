//! Chart to film in memory through the GPU queues: a chart larger than planned, and the spectra that several GPUs build.

mod emulated_cuda;
mod flow_case;
mod oracle;

use emulated_cuda::Case;
use flow_case::{Case as FlowCase, Sink, case};
use lenscube_pipeline::band::BandPlan;
use lenscube_pipeline::cuda::Device;
use lenscube_pipeline::cuda::memory::{BandNeeds, DeviceQueue, MAX_TILES};
use lenscube_pipeline::executor::Summary;
use lenscube_pipeline::geometry::Size;
use lenscube_pipeline::psf::cuda::{PsfOnDevice, gpu_blocks};
use lenscube_pipeline::remap::Remap;
use lenscube_pipeline::simd::Simd;
use lenscube_pipeline::stages::cuda::band_needs;
use lenscube_pipeline::tiling::Tiling;
use oracle::Noise;
use std::process::ExitCode;

/// A film by window and band.
type Films = Vec<Vec<Vec<f32>>>;

/// A job on GPUs.
struct Job {
    case: FlowCase,
    plans: Vec<BandPlan>,
    shard: usize,
}

impl Job {
    /// Bands of these windows on a film of 1000 x 90 px.
    fn new(windows: &[usize], shard: usize) -> Self {
        let case = case(Simd::PORTABLE, &mut Noise(3), Size::new(1000, 90), Size::new(1010, 96), windows);
        let mut plans = case.plans();
        for plan in &mut plans {
            plan.blocks = plan.blocks.as_ref().map(gpu_blocks);
            plan.tiling = Tiling::new(case.frame.film, plan.blocks.as_ref());
        }
        Self { case, plans, shard }
    }

    /// Memory needs of all bands.
    fn needs(&self) -> BandNeeds {
        let options = &self.case.options;
        let of_band = |plan: &BandPlan| {
            let (stages, interpolation) = (options.stages, options.interpolation);
            let remap = Remap::new(&self.case.frame, &plan.lens, stages, interpolation, 1.0, options.simd);
            let (blocks, grid) = (plan.blocks.as_ref().unwrap(), plan.grid.as_ref().unwrap());
            let psf = (
                PsfOnDevice::min_bytes(blocks, grid, plan.tiling.tile()),
                PsfOnDevice::max_bytes(blocks, grid, plan.tiling.tile(), MAX_TILES),
            );
            let (rows, columns) = plan.tiling.count();
            let tiles: Vec<_> = (0..rows).flat_map(|i| (0..columns).map(move |j| (i, j))).collect();
            band_needs(&remap, &plan.tiling, tiles.iter(), self.case.frame.film.width, Some(psf))
        };
        self.plans.iter().map(of_band).fold(BandNeeds::default(), BandNeeds::max)
    }

    /// A queue on GPU `index` in at most `device_bytes`.
    fn queue(index: usize, needs: BandNeeds, device_bytes: usize) -> DeviceQueue {
        let device = Device::open(index).unwrap();
        DeviceQueue { device, device_bytes, host_bytes: 1 << 30, needs }
    }

    fn run(&self, queues: &[DeviceQueue]) -> (Films, Summary) {
        let regions = self.case.full_film(self.shard);
        let sink = Sink::new(&regions, self.plans.len());
        let chart = &self.case.chart;
        let summary = self.case.run_plans(&self.plans, &regions, (2, queues), 1 << 20, chart, &sink, &());
        (sink.films.into_inner().unwrap(), summary.unwrap())
    }
}

fn assert_same_bits(a: &Films, b: &Films) {
    let bits =
        |films: &Films| -> Vec<u32> { films.iter().flatten().flatten().map(|v| v.to_bits()).collect() };
    assert!(bits(a) == bits(b), "other bits");
}

/// The queue is planned for the chart under the first tile only. It begins again for a larger one: before any batch, and while batches of
/// one tile are on the device.
fn chart_larger_than_planned_begins_another_session() {
    let job = Job::new(&[9, 21], 128);
    let needs = job.needs();
    let (expected, whole) = job.run(&[Job::queue(0, needs, 1 << 30)]);
    assert!(expected.iter().flatten().flatten().all(|v| v.is_finite()));
    let first = {
        let (plan, options) = (&job.plans[0], &job.case.options);
        let (stages, interpolation) = (options.stages, options.interpolation);
        let remap = Remap::new(&job.case.frame, &plan.lens, stages, interpolation, 1.0, options.simd);
        remap.upload_rect(plan.tiling.rect((0, 0))).size().pixels()
    };
    assert!(first < needs.chart_px, "a later tile needs more");
    let least = needs.plan(1, 1).unwrap_err().device_bytes;
    for (chart_px, bytes) in [(1, 1 << 30), (first, 1 << 30), (first, least)] {
        let queue = Job::queue(0, BandNeeds { chart_px, ..needs }, bytes);
        let (films, summary) = job.run(&[queue]);
        assert_same_bits(&films, &expected);
        let gpu = &summary.gpus[0];
        assert!(gpu.removed.is_none() && gpu.tiles >= whole.gpus[0].tiles, "{gpu:?}");
    }
}

/// GPU 1 is slow.
fn bands_dealt_whole_have_every_spectrum_built_once() {
    let spectra = |summary: &Summary| summary.gpus.iter().map(|gpu| gpu.spectra).sum::<u64>();
    let run = |windows: &[usize], indices: &[usize]| {
        let job = Job::new(windows, 64);
        let needs = job.needs();
        let queues: Vec<_> = indices.iter().map(|&index| Job::queue(index, needs, 1 << 30)).collect();
        let (films, summary) = job.run(&queues);
        (films, spectra(&summary), summary)
    };
    let (_, of_band, _) = run(&[9], &[0]);
    assert!(of_band > 4);
    let (films, alone, _) = run(&[9; 6], &[0]);
    assert_eq!(alone, 6 * of_band);
    let (same_films, both, summary) = run(&[9; 6], &[0, 1]);
    assert_same_bits(&films, &same_films);
    assert!(summary.gpus.iter().all(|gpu| gpu.spectra > 0), "both take part");
    // The last band alone is divided: at most all of its spectra are built by both.
    assert!(
        (alone..=alone + of_band).contains(&both),
        "{both} spectra, {alone} of one GPU, {of_band} of a band"
    );
}

fn main() -> ExitCode {
    let two: &[(&str, &str)] = &[("DEVICES", "2"), ("DELAY_US", "0,3000")];
    let late: &[(&str, &str)] = &[("STREAMS", "deferred")];
    let larger = chart_larger_than_planned_begins_another_session;
    emulated_cuda::run(vec![
        Case::emulated("chart_larger_than_planned_begins_another_session", &[], larger),
        Case::emulated("chart_larger_than_planned_begins_another_session::deferred", late, larger),
        Case::device("chart_larger_than_planned_begins_another_session", larger),
        Case::emulated(
            "bands_dealt_whole_have_every_spectrum_built_once",
            two,
            bands_dealt_whole_have_every_spectrum_built_once,
        ),
    ])
}
