//! A chart and a film of a lens in memory: the film, and its transpose.

use crate::oracle::{self, Noise};
use lenscube_pipeline::adjoint::{AdjointError, chart_of_film};
use lenscube_pipeline::band::{BandPlan, BandStages, Options};
use lenscube_pipeline::buffer::ShardPixels;
use lenscube_pipeline::executor::{BandWork, Work, run};
use lenscube_pipeline::field::Outside;
use lenscube_pipeline::flow::{ChartSource, FilmSink, SourceSinkError};
use lenscube_pipeline::geometry::{Frame, Rect, Size};
use lenscube_pipeline::layer::{BinGrid, Layer, Taps};
use lenscube_pipeline::lens::middle::Middle;
use lenscube_pipeline::lens::planar::{PlanarMap, PsfPlaces};
use lenscube_pipeline::lens::tail::{BandTail, ORDERS, TERMS};
use lenscube_pipeline::lens::{Lens, LensBand, LensError, PsfSample, PsfStack};
use lenscube_pipeline::psf::kernel::on_demand::PsfSource;
use lenscube_pipeline::psf::spectra::SpectrumCache;
use lenscube_pipeline::simd::Simd;
use lenscube_pipeline::stage::Stages;
use lenscube_pipeline::stages::StageCompute;
use lenscube_pipeline::tails::{ChartCells, TAIL_MARGIN_BINS, TailKernels};
use lenscube_pipeline::tiling::{FilmRegion, ShardId};
use std::ops::Range;
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Mutex};

/// A lens of one band and its PSFs.
pub struct Lenses {
    pub lens: Lens,
    pub stack: PsfStack,
}

/// A film of a lens.
pub struct Problem {
    pub frame: Frame,
    pub lens: Lens,
    pub stack: PsfStack,
    pub options: Options,
    pub gain: f64,
    /// Whether the film has the tails of the PSFs.
    pub tails: bool,
    /// Whether PSFs are read on demand.
    pub on_demand: bool,
    pub spectra_bytes: usize,
}

/// `count` random windows of `n` × `n`, each of sum 1.
fn random_stack(noise: &mut Noise, n: usize, count: usize) -> PsfStack {
    let mut samples = Vec::new();
    for _ in 0..count {
        let window: Vec<f64> = (0..n * n).map(|_| noise.next()).collect();
        let sum: f64 = window.iter().sum();
        samples.extend(window.iter().map(|v| (v / sum) as f32));
    }
    PsfStack { size: n, pitch_um: 2.0, sample: PsfSample::Integrated, samples }
}

impl Lenses {
    /// Rotationally symmetric, for windows of `n` px on the film of `frame`.
    pub fn random(noise: &mut Noise, frame: &Frame, n: usize) -> Self {
        let last = frame.farthest_mm(frame.film.rect().grown(n / 2)) + 1e-9;
        let real: Vec<f64> = (0..300).map(|k| last * f64::from(k) / 299.0).collect();
        let height_mm: Vec<f64> = [0.0, 0.21, 0.33, 0.71, 1.0].iter().map(|h| h * last).collect();
        let band = LensBand {
            psf_height_mm: height_mm,
            azimuth_count: vec![1, 4, 8, 12, 12],
            psf_size: n,
            psf_energy: vec![1.0; 5],
            ..oracle::lens_band(real, 1.0, noise.between(-0.05, 0.05))
        };
        Self { lens: oracle::lens("random", vec![band]), stack: random_stack(noise, n, 5) }
    }

    /// As [`Lenses::random`], with tails beyond windows of `n` px that hold most of the light.
    pub fn with_tails(noise: &mut Noise, frame: &Frame, n: usize) -> Self {
        let mut lenses = Self::random(noise, frame, n);
        let band = &mut lenses.lens.bands[0];
        let inner_mm = (n / 2) as f64 * frame.pitch_mm();
        let coefficients = (0..5).map(|k| {
            let mut c = [[0.0; TERMS]; ORDERS];
            c[0] = [5e-4 * (1.0 + 0.1 * f64::from(k)), 1e-4 * inner_mm.powi(2)];
            c[1] = [2e-5 * f64::from(k), 0.0];
            c[2] = [-3e-5, 1e-5 * inner_mm.powi(2)].map(|v| v * f64::from(k));
            c
        });
        let (height_mm, coefficients) = (band.psf_height_mm.clone(), coefficients.collect());
        band.tail = Some(BandTail { inner_mm, height_mm, coefficients, middle: None });
        band.psf_energy = vec![0.9; 5];
        lenses
    }

    /// As [`Lenses::with_tails`], whose windows of 71 px hold a core, and bins a middle part.
    pub fn with_middle(noise: &mut Noise, frame: &Frame) -> Self {
        let mut lenses = Self::with_tails(noise, frame, 71);
        let tail = lenses.lens.bands[0].tail.as_mut().expect("made with tails");
        let size = 31;
        tail.inner_mm = 80.0 * frame.pitch_mm();
        // A tenth of the light at most.
        let count = size * size;
        let samples = (0..5 * count).map(|_| 0.1 * noise.next() as f32 / count as f32).collect();
        tail.middle = Some(Middle { size, pitch_mm: 2.0 * tail.inner_mm / size as f64, samples });
        lenses
    }

    /// With PSFs of several azimuths a height.
    pub fn with_azimuths(noise: &mut Noise, frame: &Frame) -> Self {
        let Self { mut lens, .. } = Self::random(noise, frame, 11);
        let azimuth_samples = vec![1, 6, 5, 1, 8];
        let stack = random_stack(noise, 11, 21);
        lens.bands[0] = not_symmetric(noise, frame, &lens.bands[0], PsfPlaces::Polar { azimuth_samples });
        lens.bands[0].psf_energy = vec![1.0; 21];
        Self { lens, stack }
    }

    /// With PSFs on 5 columns and 4 rows, which do not reach the border of the film.
    pub fn cartesian(noise: &mut Noise, frame: &Frame) -> Self {
        let Self { mut lens, .. } = Self::random(noise, frame, 11);
        let at = |i: usize, n: usize, count: usize, axis: f64| {
            ((0.1 + 0.8 * i as f64 / (count - 1) as f64) * n as f64 - axis) * frame.pitch_mm()
        };
        let x_mm = (0..5).map(|i| at(i, frame.film.width, 5, frame.axis_px.1)).collect();
        let y_mm = (0..4).map(|i| at(i, frame.film.height, 4, frame.axis_px.0)).collect();
        lens.bands[0] = not_symmetric(noise, frame, &lens.bands[0], PsfPlaces::Cartesian { x_mm, y_mm });
        lens.bands[0].psf_energy = vec![1.0; 20];
        (lens.bands[0].psf_height_mm, lens.bands[0].azimuth_count) = (Vec::new(), Vec::new());
        Self { lens, stack: random_stack(noise, 11, 20) }
    }
}

/// `band` with PSFs at `psfs` and a map that is sheared, bent, and rough by up to a pixel.
fn not_symmetric(noise: &mut Noise, frame: &Frame, band: &LensBand, psfs: PsfPlaces) -> LensBand {
    let last = frame.farthest_mm(frame.film.rect().grown(6)) + 1e-9;
    let nodes: Vec<f64> = (0..12).map(|i| last * (f64::from(i) / 5.5 - 1.0)).collect();
    let places = || nodes.iter().flat_map(|y| nodes.iter().map(move |x| (*x, *y)));
    let mut off = |v: f64| v + noise.between(-1e-3, 1e-3);
    let map = PlanarMap {
        ideal_x_mm: places().map(|(x, y)| off(x * (1.0 + 0.02 * (x - y) / last) + 0.03 * y)).collect(),
        ideal_y_mm: places().map(|(x, y)| off(y * (1.0 - 0.03 * x * x / last / last) - 0.02 * x)).collect(),
        relative_illumination: places()
            .map(|(x, y)| 1.0 - 0.1 * (x * x + 2.0 * y * y) / last / last)
            .collect(),
        x_mm: nodes.clone(),
        y_mm: nodes.clone(),
    };
    let mut band = band.clone().with_map(map);
    band.planar.as_mut().unwrap().psfs = psfs;
    band
}

struct Chart<'a>(Size, &'a [f32]);

impl ChartSource for Chart<'_> {
    fn size(&self) -> Size {
        self.0
    }
    fn read(&self, _: usize, rect: Rect, out: &mut [f32]) -> Result<(), SourceSinkError> {
        for (y, to) in (rect.y as usize..).zip(out.chunks_exact_mut(rect.width)) {
            to.copy_from_slice(&self.1[y * self.0.width + rect.x as usize..][..rect.width]);
        }
        Ok(())
    }
}

/// The rows of a film of one shard.
struct Film(Mutex<Vec<f32>>);

impl FilmSink for Film {
    type Encoded = Vec<f32>;
    fn encode(&self, _: ShardId, rect: Rect, pixels: &ShardPixels) -> Result<Vec<f32>, SourceSinkError> {
        Ok((0..rect.height).flat_map(|y| pixels.row(y)).copied().collect())
    }
    fn commit(&self, pixels: Vec<f32>) -> Result<u64, SourceSinkError> {
        *self.0.lock().unwrap() = pixels;
        Ok(0)
    }
}

impl Problem {
    pub fn new(Lenses { lens, stack }: Lenses, frame: Frame, stages: Stages, simd: Simd) -> Self {
        let mut options = oracle::options(stages, simd);
        options.interpolation.outside = Outside::Clamp;
        Self {
            frame,
            lens,
            stack,
            options,
            gain: 1.0,
            tails: false,
            on_demand: false,
            spectra_bytes: 64 << 20,
        }
    }

    pub fn plan(&self) -> BandPlan {
        let mut plan = BandPlan::new(&self.frame, &self.lens, 550.0, &self.options).unwrap();
        if self.tails {
            plan.add_tail(&self.frame, &self.options);
            assert!(plan.tail.is_some());
        }
        plan
    }

    /// The layer of the tails on the film of `chart`.
    fn tail_layer(&self, plan: &BandPlan, chart: &Chart<'_>) -> Option<Layer> {
        let (tail, frame, options) = (plan.tail.as_ref()?, &self.frame, &self.options);
        let (sides, surround) = (tail.cells_px(frame), options.interpolation.surround);
        let cancel = AtomicBool::new(false);
        let cells = ChartCells::read((chart, 0), sides, surround, options.simd, 2, &cancel).unwrap();
        let values = tail.layer(
            &TailKernels::new(tail, options.simd),
            frame,
            &plan.lens,
            options,
            (cells, self.gain),
            2,
        );
        let bins = BinGrid::new(frame.film, tail.bin_px(), TAIL_MARGIN_BINS);
        Some(Layer::new(bins, Taps::Lagrange, values))
    }

    fn stages(&self, plan: &BandPlan) -> BandStages {
        if self.on_demand {
            let (psfs, grid) = (self.stack.clone(), plan.grid.clone().unwrap());
            let reader = move |_: usize, sets: Range<usize>| {
                let rows = sets.flat_map(|set| grid.psf_rows(set));
                Ok(rows.flat_map(|row| psfs.window(row)).copied().collect::<Vec<f32>>())
            };
            let sample = self.stack.sample;
            let source = PsfSource::new(Arc::new(reader), 2);
            return plan.stages_on_demand(0, &self.frame, sample, &self.options, self.gain, &source);
        }
        let stack = |_| Ok::<_, LensError>(self.stack.clone());
        plan.stages(0, &self.frame, &self.options, self.gain, stack).unwrap()
    }

    /// A x.
    pub fn film(&self, chart: &[f32]) -> Vec<f32> {
        let (plan, size) = (self.plan(), self.frame.film);
        let shards = [ShardId { position: 0, region: 0, row: 0, col: 0 }].into();
        let cancel = AtomicBool::new(false);
        let work = Work {
            film: size,
            regions: &[FilmRegion { rect: size.rect(), shard: size }],
            bands: vec![BandWork { chart_band: 0, tiling: plan.tiling, shards }],
            threads: 2,
            max_encoded_shards: 1,
            gpus: &[],
            cancel: &cancel,
        };
        let chart = Chart(self.frame.chart, chart);
        let tail = self.tail_layer(&plan, &chart);
        let prepare = |_| Ok(BandStages { layers: tail.clone().into_iter().collect(), ..self.stages(&plan) });
        let film = Film(Mutex::default());
        let compute = StageCompute::new(self.frame, self.spectra_bytes, &prepare);
        run(&work, &chart, &film, &compute, &()).unwrap();
        film.0.into_inner().unwrap()
    }

    /// Aᵀ y.
    pub fn chart(&self, film: &[f32], threads: usize) -> Vec<f32> {
        self.try_chart(film, threads, false, |_| ()).unwrap()
    }

    /// Aᵀ y, stages changed by `change`; `cancelled` before it begins.
    pub fn try_chart(
        &self,
        film: &[f32],
        threads: usize,
        cancelled: bool,
        change: impl FnOnce(&mut BandStages),
    ) -> Result<Vec<f32>, AdjointError> {
        let plan = self.plan();
        let mut stages = self.stages(&plan);
        change(&mut stages);
        let spectra = SpectrumCache::new(self.spectra_bytes);
        let mut chart = vec![f32::NAN; self.frame.chart.pixels()];
        let cancel = AtomicBool::new(cancelled);
        chart_of_film(&self.frame, &plan, &stages, &spectra, film, &mut chart, threads, &cancel)?;
        Ok(chart)
    }
}
