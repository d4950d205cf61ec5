//! Jobs in memory: a random lens and chart, a sink that holds the film, and a chart that cannot be read everywhere.
#![allow(dead_code, reason = "each test binary uses its part")]

use std::collections::BTreeSet;
use std::sync::Mutex;
use std::sync::atomic::AtomicBool;

use lenscube_pipeline::band::{BandPlan, Options};
use lenscube_pipeline::buffer::ShardPixels;
use lenscube_pipeline::cuda::memory::DeviceQueue;
use lenscube_pipeline::executor::{BandWork, Progress, RunError, Summary, Work, run};
use lenscube_pipeline::flow::{ChartSource, FilmSink, SourceSinkError};
use lenscube_pipeline::geometry::{Frame, Rect, Size};
use lenscube_pipeline::lens::{Lens, LensBand, LensError, PsfSample, PsfStack};
use lenscube_pipeline::simd::Simd;
use lenscube_pipeline::stages::StageCompute;
use lenscube_pipeline::stages::default_stages;
use lenscube_pipeline::tiling::{FilmRegion, ShardId};

use crate::oracle::{self, Grid, Image, Noise, Tables};

pub struct Chart(pub Vec<Image>);

impl ChartSource for Chart {
    fn size(&self) -> Size {
        self.0[0].size
    }
    fn read(&self, band: usize, rect: Rect, out: &mut [f32]) -> Result<(), SourceSinkError> {
        let image = &self.0[band];
        for (i, v) in out.iter_mut().enumerate() {
            *v = image.at(rect.y as usize + i / rect.width, rect.x as usize + i % rect.width) as f32;
        }
        Ok(())
    }
}

/// Films by window and band; a shard that is committed twice is an error.
pub struct Sink {
    pub regions: Vec<FilmRegion>,
    pub films: Mutex<Vec<Vec<Vec<f32>>>>,
    pub committed: Mutex<BTreeSet<ShardId>>,
}

impl Sink {
    pub fn new(regions: &[FilmRegion], bands: usize) -> Self {
        let film = |w: &FilmRegion| vec![vec![f32::NAN; w.rect.size().pixels()]; bands];
        Self {
            regions: regions.to_vec(),
            films: Mutex::new(regions.iter().map(film).collect()),
            committed: Mutex::default(),
        }
    }
}

impl FilmSink for Sink {
    type Encoded = (ShardId, Rect, Vec<f32>);
    fn encode(
        &self,
        id: ShardId,
        rect: Rect,
        pixels: &ShardPixels,
    ) -> Result<Self::Encoded, SourceSinkError> {
        assert_eq!(self.regions[id.region].shard_rect(id.row, id.col), rect);
        assert_eq!(pixels.size(), rect.size());
        Ok((id, rect, (0..rect.height).flat_map(|y| pixels.row(y)).copied().collect()))
    }
    fn commit(&self, (id, rect, pixels): Self::Encoded) -> Result<u64, SourceSinkError> {
        assert!(self.committed.lock().unwrap().insert(id), "{id:?} committed twice");
        let window = self.regions[id.region].rect;
        let film = &mut self.films.lock().unwrap()[id.region][id.position];
        for (i, v) in pixels.iter().enumerate() {
            let y = rect.y - window.y + (i / rect.width) as i64;
            let x = rect.x - window.x + (i % rect.width) as i64;
            film[y as usize * window.width + x as usize] = *v;
        }
        Ok(4 * pixels.len() as u64)
    }
}

pub struct Case {
    pub frame: Frame,
    pub lens: Lens,
    pub stacks: Vec<PsfStack>,
    pub chart: Chart,
    pub options: Options,
}

pub fn case(simd: Simd, noise: &mut Noise, film: Size, chart: Size, windows: &[usize]) -> Case {
    let mut frame = Frame::centred(film, chart, 2.0);
    frame.axis_px.0 += noise.between(-20.0, 20.0);
    frame.axis_px.1 += noise.between(-20.0, 20.0);
    frame.scale = (noise.between(0.97, 1.3), noise.between(0.7, 1.3));
    frame.center_mm = (noise.between(-0.02, 0.02), noise.between(-0.02, 0.02));
    let (mut bands, mut stacks) = (Vec::new(), Vec::new());
    for (i, &n) in windows.iter().enumerate() {
        let last = frame.farthest_mm(film.rect().grown(n / 2)) + 1e-9;
        let m = 300;
        let real: Vec<f64> = (0..m).map(|k| last * f64::from(k) / f64::from(m - 1)).collect();
        let bend = noise.between(-0.03, 0.03);
        let heights: Vec<f64> = [0.0, 0.21, 0.33, 0.71, 1.0].iter().map(|h| h * last).collect();
        let mut samples = Vec::new();
        for _ in 0..heights.len() {
            let w: Vec<f64> = (0..n * n).map(|_| noise.next()).collect();
            let sum: f64 = w.iter().sum();
            samples.extend(w.iter().map(|v| (v / sum) as f32));
        }
        stacks.push(PsfStack { size: n, pitch_um: 2.0, sample: PsfSample::Integrated, samples });
        bands.push(LensBand {
            ideal_height_mm: real.iter().map(|r| r * (1.0 + bend * (r / last).powi(2))).collect(),
            relative_illumination: real.iter().map(|r| 1.0 - 0.3 * (r / last).powi(2)).collect(),
            psf_height_mm: heights,
            azimuth_count: vec![1, 4, 4, 4, 4],
            psf_size: n,
            psf_energy: vec![1.0; 5],
            ..LensBand::ideal(450.0 + 50.0 * i as f64, real)
        });
    }
    let images = windows.iter().map(|_| {
        let data = (0..chart.pixels()).map(|_| f64::from(noise.next() as f32)).collect();
        Image { size: chart, data }
    });
    let chart = Chart(images.collect());
    let lens = oracle::lens("random", bands);
    let options = oracle::options(default_stages(), simd);
    Case { frame, lens, stacks, chart, options }
}

impl Case {
    pub fn plans(&self) -> Vec<BandPlan> {
        let plan =
            |b: &LensBand| BandPlan::new(&self.frame, &self.lens, b.wavelength_nm, &self.options).unwrap();
        self.lens.bands.iter().map(plan).collect()
    }

    pub fn run(
        &self,
        regions: &[FilmRegion],
        threads: usize,
        spectra_bytes: usize,
    ) -> (Vec<Vec<Vec<f32>>>, Summary) {
        let sink = Sink::new(regions, self.lens.bands.len());
        let summary = self.run_into(regions, threads, spectra_bytes, &self.chart, &sink, &()).unwrap();
        assert!(!summary.interrupted);
        (sink.films.into_inner().unwrap(), summary)
    }

    pub fn run_into(
        &self,
        regions: &[FilmRegion],
        threads: usize,
        spectra_bytes: usize,
        chart: &dyn ChartSource,
        sink: &Sink,
        progress: &dyn Progress,
    ) -> Result<Summary, RunError> {
        self.run_plans(&self.plans(), regions, (threads, &[]), spectra_bytes, chart, sink, progress)
    }

    /// Runs `plans`, which hold the tiles of `gpus`, if there are any.
    #[allow(clippy::too_many_arguments, reason = "as `run`")]
    pub fn run_plans(
        &self,
        plans: &[BandPlan],
        regions: &[FilmRegion],
        (threads, gpus): (usize, &[DeviceQueue]),
        spectra_bytes: usize,
        chart: &dyn ChartSource,
        sink: &Sink,
        progress: &dyn Progress,
    ) -> Result<Summary, RunError> {
        let every = |position: usize| {
            regions.iter().enumerate().flat_map(move |(window, w)| {
                let (rows, cols) = w.count();
                (0..rows).flat_map(move |row| {
                    (0..cols).map(move |col| ShardId { position, region: window, row, col })
                })
            })
        };
        let cancel = AtomicBool::new(false);
        let work = Work {
            film: self.frame.film,
            regions,
            bands: (0..plans.len())
                .map(|i| BandWork { chart_band: i, tiling: plans[i].tiling, shards: every(i).collect() })
                .collect(),
            threads,
            max_encoded_shards: 2,
            gpus,
            cancel: &cancel,
        };
        let prepare = |i: usize| {
            plans[i]
                .stages(i, &self.frame, &self.options, 1.0, |b| Ok::<_, LensError>(self.stacks[b].clone()))
                .map_err(SourceSinkError::from)
        };
        run(&work, chart, sink, &StageCompute::new(self.frame, spectra_bytes, &prepare), progress)
    }

    pub fn full_film(&self, shard: usize) -> Vec<FilmRegion> {
        vec![FilmRegion { rect: self.frame.film.rect(), shard: Size::new(shard, 3 * shard / 2) }]
    }

    pub fn oracle(&self, band: usize) -> Image {
        let b = &self.lens.bands[band];
        let stack = &self.stacks[band];
        let t = Tables { ideal: &b.ideal_height_mm, real: &b.image_height_mm, ri: &b.relative_illumination };
        let grown = self.frame.film.rect().grown(b.psf_size / 2);
        let remap = oracle::remap(&self.chart.0[band], &self.frame, &t, grown, true, oracle::Outside::Edge);
        let base: Vec<Vec<f64>> =
            (0..stack.heights()).map(|k| stack.window(k).iter().map(|&v| f64::from(v)).collect()).collect();
        let grid = Grid::quarter_turns(b.psf_size, &b.psf_height_mm, &base);
        oracle::svpsf(&remap, (grown.y, grown.x), &self.frame, &grid, self.frame.film.rect())
    }
}

/// A chart with a rectangle of one band that cannot be read.
pub struct Unreadable<'a>(pub &'a Chart, pub usize, pub Rect);

impl ChartSource for Unreadable<'_> {
    fn size(&self) -> Size {
        self.0.size()
    }
    fn read(&self, band: usize, rect: Rect, out: &mut [f32]) -> Result<(), SourceSinkError> {
        match band == self.1 && !rect.intersect(self.2).is_empty() {
            true => Err("cannot be read".into()),
            false => self.0.read(band, rect, out),
        }
    }
}

/// Continues after every error and records the shards lost by it.
#[derive(Default)]
pub struct LostShards(pub Mutex<BTreeSet<ShardId>>);

impl Progress for LostShards {
    fn continue_after(&self, error: &RunError) -> bool {
        let mut lost = self.0.lock().unwrap();
        match error {
            RunError::Read { shards, .. } => lost.extend(shards),
            RunError::Write { id, .. } => drop(lost.insert(*id)),
            other => panic!("{other}"),
        }
        true
    }
}
