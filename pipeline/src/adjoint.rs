//! The exact transpose of the film of one flat chart: from a film to the chart whose pixels gather what they contribute to.
//!
//! ```text
//! film = A chart,       chart = Aᵀ film:    ⟨A x, y⟩ = ⟨x, Aᵀ y⟩  for every chart x and film y
//! Aᵀ   = remapᵀ · PSFᵀ  [+ tailsᵀ]
//! PSFᵀ    remapped(y, x) = Σ_node w_node(y, x) · Σ_{v, u} film(v, u) · kernel_node(v − y, u − x)      on the film grown by the margin; film 0 beyond its border
//! remapᵀ  chart(i, j)    = Σ_(Y, X) gain · R(r) · Σ w(row − k) · w(column − l) · remapped(Y, X)       over the taps (k, l) that chart pixel (i, j) stands for
//! ```
//! A is the linear map of [`StageCompute`](crate::stages::StageCompute): for a solver, or for derivatives of a function of the film by the chart's pixels.
//!
//! Conventions: film and chart row-major, in f32, of the sizes of the [`Frame`]. Weights, kernels, chart coordinates and gains are those of the film on the same engine; only the order
//! of sums differs, so |⟨A x, y⟩ − ⟨x, Aᵀ y⟩| ≤ 1e-6 |A x| |y|, by the rounding of the transforms (about 1e-7). A chart pixel that its surroundings repeat has the sum of all its
//! copies; black surroundings have none.
//!
//! The PSF's transpose ([`crate::psf`]) has one forward transform a block and one inverse transform a node, where the film has one forward transform a node and one inverse transform
//! a block, and takes as long with SIMD; portable up to 1.8 times as long, near the axis. The remap's transpose ([`crate::remap`]) scatters.
//!
//! Tails on the film ([`BandPlan::add_tail`]) are part of A, with the layer that [`crate::tails`] computes of the chart: their transpose goes through the same bins, kernels and
//! cells in the opposite direction, each step the transpose of a step of theirs.
//!
//! The bits do not depend on the number of threads: each pixel of the remapped image is written once, and parts of the chart are added in the order of the parts
//! (`in_order`). In memory: the film, the remapped image, the chart, and buffers of each thread.
//!
//! Left out: surfaces at several distances, which hide each other (not linear); layers of scatter, veiling glare and ghosts; GPUs; film pixels that [`StageCompute`](crate::stages::StageCompute)
//! sets to 0 below 1e-30, where A is not linear.

mod in_order;
mod remapped;

use crate::band::{BandPlan, BandStages};
use crate::geometry::{Frame, Rect, Size};
use crate::parts::for_each_part;
use crate::psf::kernel::on_demand::PsfReadError;
use crate::psf::spectra::SpectrumCache;
use crate::remap::{ChartPart, Remap, RemapScratch};
use crate::tails::TailKernels;
use in_order::InOrder;
use remapped::remapped_of_film;
use std::borrow::Cow;
use std::sync::atomic::{AtomicBool, Ordering};

/// A transpose that cannot be computed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum AdjointError {
    /// Surfaces at several distances.
    #[error("the film of surfaces at several distances is not linear in the chart: it has no transpose")]
    Depth,
    /// Layers of scatter, veiling glare or ghosts.
    #[error(
        "the transpose of {count} layers of scatter, veiling glare or ghosts is not implemented: omit the stage `veil`"
    )]
    Layers {
        /// Number of layers.
        count: usize,
    },
    /// An array of another size.
    #[error("the {array} has {found} pixels, {size} are needed")]
    Length {
        /// Film or chart.
        array: &'static str,
        /// Its pixels.
        found: usize,
        /// Size of the frame.
        size: Size,
    },
    /// A PSF that is read on demand could not be read.
    #[error(transparent)]
    Psf(#[from] PsfReadError),
    /// Cancelled.
    #[error("stopped before the transpose was complete")]
    Stopped,
}

/// What films of the same stages, and their transposes, share.
#[derive(Clone, Copy, Debug)]
pub struct Kept<'a> {
    /// Spectra of kernels.
    pub spectra: &'a SpectrumCache,
    /// Kernels of tails; made anew without them.
    pub tails: Option<&'a TailKernels>,
}

impl<'a> From<&'a SpectrumCache> for Kept<'a> {
    fn from(spectra: &'a SpectrumCache) -> Self {
        Self { spectra, tails: None }
    }
}

/// Aᵀ of one band: the chart of `film`, row-major of the frame's film, into `chart`, row-major of the frame's chart, which is overwritten. `plan` is the band's plan, `stages` are
/// what [`BandPlan::stages`] or [`BandPlan::stages_on_demand`] made of it, and `kept` is a cache of spectra that films of the same stages may share, or with the kernels of tails ([`Kept`]). `cancel` stops it; the chart is then not complete.
///
/// ```
/// # use lenscube_pipeline::lens::{Lens, LensBand, LensError, PsfSample, PsfStack};
/// # let heights = vec![0.0, 1.0];
/// # let band = LensBand {
/// #     psf_height_mm: heights.clone(), azimuth_count: vec![1, 4], psf_size: 3, psf_energy: vec![1.0; 2], ..LensBand::ideal(550.0, heights)
/// # };
/// # let lens = Lens {
/// #     name: "shift".into(), distortion_focal_length_mm: 50.0, effective_focal_length_mm: 50.0, f_number: 2.8, primary_wavelength_nm: 550.0,
/// #     object_distance_mm: None, magnification: 0.0, psf_sample: PsfSample::Integrated, bands: vec![band], depth: None,
/// # };
/// # use lenscube_pipeline::{field::Outside, remap::ChartInterpolation, resample::{Interp, Surround}, simd::Simd};
/// # use lenscube_pipeline::band::{Options, PsfBetween};
/// # let options = Options {
/// #     stages: lenscube_pipeline::stages::default_stages(),
/// #     interpolation: ChartInterpolation { interp: Interp::Bicubic, surround: Surround::Black, outside: Outside::Error },
/// #     azimuths: None, psf_window: None, between: PsfBetween::Error, simd: Simd::detect(),
/// # };
/// use lenscube_pipeline::adjoint::chart_of_film;
/// use lenscube_pipeline::band::BandPlan;
/// use lenscube_pipeline::geometry::{Frame, Size};
/// use lenscube_pipeline::psf::spectra::SpectrumCache;
/// use std::sync::atomic::AtomicBool;
///
/// // A lens without distortion, whose PSFs have all light one pixel farther from the axis (+x at azimuth 0).
/// let size = Size::new(21, 21);
/// let frame = Frame::centred(size, size, 2.0);
/// let plan = BandPlan::new(&frame, &lens, 550.0, &options)?;
/// let psf = [0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0];
/// let stack = PsfStack { size: 3, pitch_um: 2.0, sample: PsfSample::Integrated, samples: psf.repeat(2) };
/// let stages = plan.stages(0, &frame, &options, 1.0, |_| Ok::<_, LensError>(stack.clone()))?;
///
/// // Film pixel (10, 18) has the light of chart pixel (10, 17).
/// let mut film = vec![0.0; 21 * 21];
/// film[10 * 21 + 18] = 1.0;
/// let (mut chart, spectra, cancel) = (vec![0.0; 21 * 21], SpectrumCache::new(1 << 20), AtomicBool::new(false));
/// chart_of_film(&frame, &plan, &stages, &spectra, &film, &mut chart, 1, &cancel).unwrap();
/// assert!(chart[10 * 21 + 17] > 0.98);
/// # Ok::<(), LensError>(())
/// ```
///
/// # Errors
/// [`AdjointError`]: a depth stage, layers, arrays of other sizes, a PSF that cannot be read, cancelled.
#[allow(clippy::too_many_arguments, reason = "as of the film: what is computed, and how")]
pub fn chart_of_film<'a>(
    frame: &Frame,
    plan: &BandPlan,
    stages: &BandStages,
    kept: impl Into<Kept<'a>>,
    film: &[f32],
    chart: &mut [f32],
    threads: usize,
    cancel: &AtomicBool,
) -> Result<(), AdjointError> {
    if plan.depth.is_some() || stages.depth.is_some() {
        return Err(AdjointError::Depth);
    }
    if !stages.layers.is_empty() {
        return Err(AdjointError::Layers { count: stages.layers.len() });
    }
    let Kept { spectra, tails } = kept.into();
    check_length("film", film.len(), frame.film)?;
    check_length("chart", chart.len(), frame.chart)?;
    chart.fill(0.0);
    let (rect, remapped) = match &stages.psf {
        None => (frame.film.rect(), Cow::Borrowed(film)),
        Some(psf) => {
            let remapped = remapped_of_film(frame, psf, spectra, film, threads, cancel)?;
            (frame.film.rect().grown(psf.margin()), Cow::Owned(remapped))
        }
    };
    add_remapped(&stages.remap, (rect, &remapped), chart, threads, cancel)?;
    if let Some(tail) = &plan.tail {
        check_cancelled(cancel)?;
        let own;
        let kernels = match tails {
            Some(kernels) => kernels,
            None => {
                own = TailKernels::new(tail, stages.remap.simd());
                &own
            }
        };
        tail.add_transposed(kernels, frame, &stages.remap, film, chart, threads);
    }
    Ok(())
}

fn check_length(array: &'static str, found: usize, size: Size) -> Result<(), AdjointError> {
    match found == size.pixels() {
        true => Ok(()),
        false => Err(AdjointError::Length { array, found, size }),
    }
}

/// An error once `cancel` is set.
fn check_cancelled(cancel: &AtomicBool) -> Result<(), AdjointError> {
    match cancel.load(Ordering::Relaxed) {
        true => Err(AdjointError::Stopped),
        false => Ok(()),
    }
}

/// Adds the transpose of the remap stage of the remapped image, pixels of a film rectangle (row-major), to `chart`.
fn add_remapped(
    remap: &Remap,
    (rect, remapped): (Rect, &[f32]),
    chart: &mut [f32],
    threads: usize,
    cancel: &AtomicBool,
) -> Result<(), AdjointError> {
    let sum = InOrder::new(chart, |chart: &mut &mut [f32], part: &ChartPart| remap.add_part(part, chart));
    for_each_part(
        threads,
        remap.parts(rect).enumerate(),
        || (RemapScratch::default(), ChartPart::default()),
        |(scratch, to), (index, part)| {
            check_cancelled(cancel)?;
            let first = (part.y - rect.y) as usize * rect.width + (part.x - rect.x) as usize;
            remap.scatter(part, (&remapped[first..], rect.width), to, scratch);
            *to = sum.add(index, std::mem::take(to));
            Ok(())
        },
    )
}
