//! Chart to film in memory through the executor: compared with the f64 model, and the same bits for any way of running it.
//! Each case runs once per instruction set; sets that the machine lacks are reported as ignored.

mod oracle;

use lenscube_pipeline::band::{BandPlan, Options, PsfBetween};
use lenscube_pipeline::buffer::ShardPixels;
use lenscube_pipeline::executor::Progress;
use lenscube_pipeline::executor::{BandWork, RunError, Summary, Work, run};
use lenscube_pipeline::field::Outside;
use lenscube_pipeline::flow::{ChartSource, FilmSink, SourceSinkError};
use lenscube_pipeline::geometry::{Frame, Rect, Size};
use lenscube_pipeline::lens::{Lens, LensBand, LensError, PsfSample, PsfStack};
use lenscube_pipeline::plan::{FilmRegion, ShardId};
use lenscube_pipeline::remap::{ChartInterpolation, Stages};
use lenscube_pipeline::resample::{Interp, Surround};
use lenscube_pipeline::simd::Simd;
use lenscube_pipeline::stages::StageCompute;
use oracle::{Grid, Image, Noise, Tables, errors};
use std::collections::BTreeSet;
use std::process::ExitCode;
use std::sync::Mutex;
use std::sync::atomic::AtomicBool;

struct Chart(Vec<Image>);

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
struct Sink {
    regions: Vec<FilmRegion>,
    films: Mutex<Vec<Vec<Vec<f32>>>>,
    committed: Mutex<BTreeSet<ShardId>>,
}

impl Sink {
    fn new(regions: &[FilmRegion], bands: usize) -> Self {
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
        let film = &mut self.films.lock().unwrap()[id.region][id.band];
        for (i, v) in pixels.iter().enumerate() {
            let y = rect.y - window.y + (i / rect.width) as i64;
            let x = rect.x - window.x + (i % rect.width) as i64;
            film[y as usize * window.width + x as usize] = *v;
        }
        Ok(4 * pixels.len() as u64)
    }
}

struct Case {
    frame: Frame,
    lens: Lens,
    stacks: Vec<PsfStack>,
    chart: Chart,
    options: Options,
}

fn case(simd: Simd, noise: &mut Noise, film: Size, chart: Size, windows: &[usize]) -> Case {
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
            wavelength_nm: 450.0 + 50.0 * i as f64,
            ideal_height_mm: real.iter().map(|r| r * (1.0 + bend * (r / last).powi(2))).collect(),
            relative_illumination: real.iter().map(|r| 1.0 - 0.3 * (r / last).powi(2)).collect(),
            image_height_mm: real,
            psf_height_mm: heights,
            azimuth_count: vec![1, 4, 4, 4, 4],
            psf_size: n,
            psf_pitch_um: 2.0,
            psf_energy: vec![1.0; 5],
            solid_angle_sr: 0.1,
            transmission: 1.0,
        });
    }
    let images = windows.iter().map(|_| {
        let data = (0..chart.pixels()).map(|_| f64::from(noise.next() as f32)).collect();
        Image { size: chart, data }
    });
    let chart = Chart(images.collect());
    let lens = Lens {
        name: "random".into(),
        distortion_focal_length_mm: 50.0,
        effective_focal_length_mm: 50.0,
        f_number: 2.0,
        primary_wavelength_nm: 550.0,
        object_distance_mm: None,
        magnification: 0.0,
        psf_sample: PsfSample::Integrated,
        bands,
    };
    let options = Options {
        stages: Stages { ri: true, distortion: true, svpsf: true },
        interpolation: ChartInterpolation {
            interp: Interp::Bicubic,
            surround: Surround::Edge,
            outside: Outside::Error,
        },
        azimuths: None,
        psf_window: None,
        between: PsfBetween::Error,
        simd,
    };
    Case { frame, lens, stacks, chart, options }
}

impl Case {
    fn plans(&self) -> Vec<BandPlan> {
        let plan =
            |b: &LensBand| BandPlan::new(&self.frame, &self.lens, b.wavelength_nm, &self.options).unwrap();
        self.lens.bands.iter().map(plan).collect()
    }

    fn run(
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

    fn run_into(
        &self,
        regions: &[FilmRegion],
        threads: usize,
        spectra_bytes: usize,
        chart: &dyn ChartSource,
        sink: &Sink,
        progress: &dyn Progress,
    ) -> Result<Summary, RunError> {
        let plans = self.plans();
        let every = |band: usize| {
            regions.iter().enumerate().flat_map(move |(window, w)| {
                let (rows, cols) = w.count();
                (0..rows)
                    .flat_map(move |row| (0..cols).map(move |col| ShardId { band, region: window, row, col }))
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
            gpus: &[],
            cancel: &cancel,
        };
        let prepare = |i: usize| {
            plans[i]
                .stages(i, &self.frame, &self.options, 1.0, |b| Ok::<_, LensError>(self.stacks[b].clone()))
                .map_err(SourceSinkError::from)
        };
        run(&work, chart, sink, &StageCompute::new(self.frame, spectra_bytes, &prepare), progress)
    }

    fn full_film(&self, shard: usize) -> Vec<FilmRegion> {
        vec![FilmRegion { rect: self.frame.film.rect(), shard: Size::new(shard, 3 * shard / 2) }]
    }

    fn oracle(&self, band: usize) -> Image {
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

fn film_equals_the_f64_model_in_every_band(simd: Simd) {
    let mut noise = Noise(21);
    for (film, chart, windows) in [
        (Size::new(301, 277), Size::new(310, 290), vec![9, 21, 5]),
        (Size::new(37, 1100), Size::new(30, 900), vec![15]),
        (Size::new(3, 2), Size::new(50, 60), vec![31, 1]),
    ] {
        let case = case(simd, &mut noise, film, chart, &windows);
        let (films, _) = case.run(&case.full_film(128), 2, 1 << 20);
        for (band, got) in films[0].iter().enumerate() {
            let expected = case.oracle(band);
            let (worst, l2) = errors(got, &expected.data);
            assert!(worst <= 2e-6 && l2 <= 1e-6, "film {film}, band {band}: max {worst:.1e}, L2 {l2:.1e}");
        }
    }
}

fn same_bits_for_threads_memory_shards_and_regions(simd: Simd) {
    let mut noise = Noise(5);
    let case = case(simd, &mut noise, Size::new(700, 620), Size::new(720, 640), &[25, 7]);
    let (full, _) = case.run(&case.full_film(256), 1, 64 << 20);
    let same =
        |a: &[f32], b: &[f32]| a.len() == b.len() && a.iter().zip(b).all(|(a, b)| a.to_bits() == b.to_bits());
    for (threads, spectra, shard) in [(2, 64 << 20, 256), (5, 1, 256), (3, 1 << 20, 64), (2, 1 << 20, 2048)] {
        let (films, _) = case.run(&case.full_film(shard), threads, spectra);
        assert_eq!((films.len(), films[0].len()), (1, full[0].len()), "regions, bands");
        for (a, b) in full[0].iter().zip(&films[0]) {
            assert!(same(a, b), "{threads} threads, {spectra} bytes, shards of {shard}");
        }
    }
    let regions = [Rect::new(0, 0, 1, 1), Rect::new(411, 300, 200, 320), Rect::new(650, 5, 50, 77)];
    let regions: Vec<FilmRegion> =
        regions.iter().map(|&rect| FilmRegion { rect, shard: Size::new(64, 48) }).collect();
    let (films, _) = case.run(&regions, 2, 1 << 20);
    assert_eq!(films.len(), regions.len());
    for (region, film) in regions.iter().map(|r| r.rect).zip(&films) {
        assert_eq!(film.len(), full[0].len(), "bands of {region}");
        for (band, got) in film.iter().enumerate() {
            for (i, v) in got.iter().enumerate() {
                let (y, x) = (region.y as usize + i / region.width, region.x as usize + i % region.width);
                assert_eq!(v.to_bits(), full[0][band][y * 620 + x].to_bits(), "{region}, band {band}");
            }
        }
    }
    let (_, corner) = case.run(&regions[..1], 2, 1 << 20);
    assert!(corner.tiles == 2, "one tile of each band reaches the corner, {} were computed", corner.tiles);
}

fn point_keeps_its_sum_and_coma_points_outwards(simd: Simd) {
    let mut noise = Noise(2);
    let film = Size::new(241, 241);
    let mut case = case(simd, &mut noise, film, film, &[11]);
    case.frame = Frame::centred(film, film, 2.0);
    // A point with a tail three pixels farther out on +x.
    let mut tail = vec![0f32; 121];
    tail[5 * 11 + 5] = 0.6;
    tail[5 * 11 + 8] = 0.4;
    let mut on_axis = vec![0f32; 121];
    on_axis[5 * 11 + 5] = 1.0;
    case.stacks[0].samples = [on_axis, tail.clone(), tail.clone(), tail.clone(), tail].concat();
    case.options.stages = Stages { ri: false, distortion: false, svpsf: true };
    case.frame.scale = (1.0, 1.0);
    let last = case.frame.farthest_mm(film.rect().grown(5));
    case.lens.bands[0].psf_height_mm = vec![0.0, 0.05, 0.1, 0.2, last];
    for (y, x) in [(120, 220), (220, 120), (120, 20), (20, 120), (20, 20), (20, 220), (220, 20), (220, 220)] {
        case.chart.0[0] = Image::new(film, |row, col| f64::from(u8::from((row, col) == (y, x))));
        let (films, _) = case.run(&case.full_film(256), 1, 1 << 20);
        let got = &films[0][0];
        let sum: f64 = got.iter().map(|&v| f64::from(v)).sum();
        assert!((sum - 1.0).abs() < 1e-6, "sum of a point: {sum}");
        let mean = |axis: fn(usize) -> usize| -> f64 {
            got.iter().enumerate().map(|(i, v)| axis(i) as f64 * f64::from(*v)).sum()
        };
        let (dy, dx) = (mean(|i| i / 241) - y as f64, mean(|i| i % 241) - x as f64);
        let (oy, ox) = (y as f64 - 120.0, x as f64 - 120.0);
        let outwards = (dy * oy + dx * ox) / oy.hypot(ox);
        let across = (dy * ox - dx * oy) / oy.hypot(ox);
        assert!(outwards > 0.8 && across.abs() < 1e-3, "at {y},{x}: {outwards} out, {across} across");
    }
}

/// A uniform remapped image gives a film of 1 − div c to first order, with c the displacement of the PSF's centroid from the chief
/// ray. Here c = α·r outwards, so div c = 2α everywhere, up to the film's border; terms of α² (times r₁/r next to the axis, where
/// the PSF is interpolated with the axis node) stay below 5e-4.
fn uniform_chart_gives_one_minus_the_divergence_of_the_psf_centroid(simd: Simd) {
    const ALPHA: f64 = 0.004;
    let film = Size::new(150, 170);
    let mut noise = Noise(4);
    let mut case = case(simd, &mut noise, film, film, &[25]);
    case.frame = Frame::centred(film, film, 2.0);
    case.chart.0[0] = Image::new(film, |_, _| 1.0);
    case.options.stages = Stages { ri: false, distortion: false, svpsf: true };
    case.options.azimuths = Some(144);
    case.lens.psf_sample = PsfSample::Point;
    let n = 49;
    case.lens.bands[0].psf_size = n;
    case.lens.bands[0].psf_pitch_um = 1.0;
    let last = case.frame.farthest_mm(film.rect().grown(13));
    let heights: Vec<f64> = (0..5).map(|k| last * f64::from(k) / 4.0).collect();
    let samples = heights.iter().flat_map(|h| {
        // Samples of 1 µm: a Gaussian of 3 µm, centred at α·h on +x.
        let out = ALPHA * h * 1e3;
        let w = (0..n * n).map(|i| {
            let (y, x) = ((i / n) as f64 - 24.0, (i % n) as f64 - 24.0 - out);
            (-(x * x + y * y) / 18.0).exp()
        });
        let w: Vec<f64> = w.collect();
        let sum: f64 = w.iter().sum();
        w.into_iter().map(move |v| (v / sum) as f32)
    });
    case.stacks[0] =
        PsfStack { size: n, pitch_um: 1.0, sample: PsfSample::Point, samples: samples.collect() };
    case.lens.bands[0].psf_height_mm = heights;
    let (films, _) = case.run(&case.full_film(256), 2, 64 << 20);
    for (i, v) in films[0][0].iter().enumerate() {
        let (y, x) = (i / 170, i % 170);
        assert!((f64::from(*v) - (1.0 - 2.0 * ALPHA)).abs() < 5e-4, "{v} at {y},{x}");
    }
}

/// A chart with a rectangle of one band that cannot be read.
struct Unreadable<'a>(&'a Chart, usize, Rect);

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
struct LostShards(Mutex<BTreeSet<ShardId>>);

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

fn read_error_loses_exactly_the_dependent_shards(simd: Simd) {
    let mut noise = Noise(8);
    let case = case(simd, &mut noise, Size::new(700, 620), Size::new(720, 640), &[25, 7]);
    let regions = case.full_film(100);
    let (full, _) = case.run(&regions, 1, 64 << 20);
    let rect = Rect::new(300, 310, 4, 4);
    for threads in [1, 3] {
        let (sink, lost) = (Sink::new(&regions, 2), LostShards::default());
        case.run_into(&regions, threads, 1 << 20, &Unreadable(&case.chart, 1, rect), &sink, &lost).unwrap();
        let (committed, lost) = (sink.committed.into_inner().unwrap(), lost.0.into_inner().unwrap());
        assert!(!lost.is_empty() && lost.iter().all(|id| id.band == 1), "{lost:?}");
        assert!(committed.is_disjoint(&lost), "a shard with unreadable pixels was committed");
        assert_eq!(committed.len() + lost.len(), 2 * 7 * 5, "neither committed nor lost");
        assert!(lost.len() < 7 * 5, "one unreadable rectangle lost the complete band");
        let films = sink.films.into_inner().unwrap();
        for id in committed {
            let shard = regions[0].shard_rect(id.row, id.col);
            for (y, x) in
                (shard.y..shard.bottom()).flat_map(|y| (shard.x..shard.right()).map(move |x| (y, x)))
            {
                let at = y as usize * 620 + x as usize;
                assert_eq!(films[0][id.band][at].to_bits(), full[0][id.band][at].to_bits(), "{id:?}");
            }
        }
        let sink = Sink::new(&regions, 2);
        let chart = Unreadable(&case.chart, 1, rect);
        let error = case.run_into(&regions, threads, 1 << 20, &chart, &sink, &()).unwrap_err();
        assert_eq!((error.position(), error.cause().to_string().as_str()), (1, "cannot be read"));
    }
}

fn main() -> ExitCode {
    let checks: [(&str, oracle::Check); 5] = [
        ("film_equals_the_f64_model_in_every_band", film_equals_the_f64_model_in_every_band),
        ("same_bits_for_threads_memory_shards_and_regions", same_bits_for_threads_memory_shards_and_regions),
        ("point_keeps_its_sum_and_coma_points_outwards", point_keeps_its_sum_and_coma_points_outwards),
        (
            "uniform_chart_gives_one_minus_the_divergence_of_the_psf_centroid",
            uniform_chart_gives_one_minus_the_divergence_of_the_psf_centroid,
        ),
        ("read_error_loses_exactly_the_dependent_shards", read_error_loses_exactly_the_dependent_shards),
    ];
    oracle::on_every_isa(&checks)
}
