//! The library without the command: one bright pixel as the chart, through the built-in lens at 550 nm, to a film in memory.
use lenscube_pipeline::band::{BandPlan, Options, PsfBetween};
use lenscube_pipeline::buffer::ShardPixels;
use lenscube_pipeline::design::{System, TraceOptions, trace_lens};
use lenscube_pipeline::executor::{BandWork, Work, run};
use lenscube_pipeline::field::Outside;
use lenscube_pipeline::flow::{ChartSource, FilmSink, SourceSinkError};
use lenscube_pipeline::geometry::{Frame, Rect, Size};
use lenscube_pipeline::lens::LensError;
use lenscube_pipeline::remap::ChartInterpolation;
use lenscube_pipeline::resample::{Interp, Surround};
use lenscube_pipeline::simd::Simd;
use lenscube_pipeline::stages::StageCompute;
use lenscube_pipeline::stages::default_stages;
use lenscube_pipeline::tiling::{FilmRegion, ShardId};
use std::sync::{Mutex, atomic::AtomicBool};

const SIDE: Size = Size::new(101, 101);

/// The chart: 1 in the middle pixel, 0 elsewhere.
struct Point;
impl ChartSource for Point {
    fn size(&self) -> Size {
        SIDE
    }
    fn read(&self, _band: usize, rect: Rect, out: &mut [f32]) -> Result<(), SourceSinkError> {
        let at = |i: usize| (rect.y + (i / rect.width) as i64, rect.x + (i % rect.width) as i64);
        out.iter_mut().enumerate().for_each(|(i, v)| *v = f32::from(at(i) == (50, 50)));
        Ok(())
    }
}

/// The film: the rows of its only shard.
struct Film(Mutex<Vec<Vec<f32>>>);
impl FilmSink for Film {
    type Encoded = Vec<Vec<f32>>;
    fn encode(&self, _: ShardId, rect: Rect, px: &ShardPixels) -> Result<Self::Encoded, SourceSinkError> {
        Ok((0..rect.height).map(|y| px.row(y).to_vec()).collect())
    }
    fn commit(&self, rows: Self::Encoded) -> Result<u64, SourceSinkError> {
        *self.0.lock().unwrap() = rows;
        Ok(0)
    }
}

fn main() -> Result<(), SourceSinkError> {
    // The lens: tables and PSFs at one wavelength, up to 0.3 mm from the axis.
    let (nm, mut psfs) = (550.0, vec![]);
    let lens =
        trace_lens(&System::double_gauss_28(), &TraceOptions::new(vec![nm], 0.3), &mut |_| (), |_, band| {
            psfs.push(band.psf);
            Ok::<(), String>(())
        })?;

    // The job: a film of the chart's size in pixels of 2 µm, in one shard.
    let frame = Frame::centred(SIDE, Point.size(), 2.0);
    let (interp, surround, outside) = (Interp::Bicubic, Surround::Black, Outside::Error);
    let options = Options {
        stages: default_stages(),
        interpolation: ChartInterpolation { interp, surround, outside },
        azimuths: None,
        psf_window: None,
        between: PsfBetween::Error,
        simd: Simd::detect(),
    };
    let plan = BandPlan::new(&frame, &lens, nm, &options)?;
    let shards = [ShardId { position: 0, region: 0, row: 0, col: 0 }].into();
    let work = Work {
        film: SIDE,
        regions: &[FilmRegion { rect: SIDE.rect(), shard: SIDE }],
        bands: vec![BandWork { chart_band: 0, tiling: plan.tiling, shards }],
        threads: 2,
        max_encoded_shards: 1,
        gpus: &[],
        cancel: &AtomicBool::new(false),
    };
    let prepare = |position| {
        Ok(plan.stages(position, &frame, &options, 1.0, |band| Ok::<_, LensError>(psfs[band].clone()))?)
    };
    let film = Film(Mutex::default());
    run(&work, &Point, &film, &StageCompute::new(frame, 1 << 20, &prepare), &())?;

    let rows = film.0.into_inner()?;
    let light: f32 = rows.iter().flatten().sum();
    let share = rows[50][50] / light;
    println!("{share:.3} of the light of a pixel stays in the pixel");
    assert!((share - 0.0518).abs() < 1e-4, "the lens is far from diffraction-limited: {share}");
    assert!((light - 1.0).abs() < 1e-3, "near the axis no light is lost: {light}");
    Ok(())
}
