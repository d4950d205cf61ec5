//! One band of a job: its lens tables, its partition, and its stages.
//!
//! At a wavelength of the lens a band uses that lens band's tables unchanged. Between two, heights and RI are interpolated linearly in λ at
//! equal IDEAL height; PSFs, node by node, only with [`PsfBetween::Interpolate`].

use crate::depth::DepthStage;
use crate::depth::plan::{DepthPlan, Surfaces};
use crate::field::{self, Outside};
use crate::geometry::{Frame, Rect};
use crate::layer::Layer;
use crate::lens::{Lens, LensBand, LensError, PsfSample, PsfStack, linear};
pub use crate::options::{Options, PsfBetween};
use crate::options::{PsfNodes, PsfTables};
use crate::psf::BandPsf;
use crate::psf::blocks::Blocks;
use crate::psf::coarse::KernelSamples;
use crate::psf::grid::NodeGrid;
use crate::psf::kernel::NodeKernels;
use crate::psf::kernel::on_demand::{KernelsOnDemand, PsfReader, PsfSource};
use crate::psf::memory;
use crate::remap::Remap;
use crate::stage::Stage;
use crate::tails::TailPlan;
use crate::tiling::Tiling;
use std::sync::Arc;

/// Wavelengths closer than this are the same, nm.
const SAME_NM: f64 = 1e-6;
/// Largest prepared PSFs of a band without rotational symmetry that are kept in memory, bytes: a sixteenth of 1 GiB, of which two bands are in
/// flight.
const MAX_IN_MEMORY: usize = 64 << 20;
/// Bound of the rounding of a pixel's distance from the axis in 32 bits ([`crate::psf::polar`]), px.
const ROUNDING_PX: f64 = 0.01;

/// The lens bands that a wavelength is interpolated from: `first` only, or both with the share of `second`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LensBands {
    /// Band index in the lens.
    pub first: usize,
    /// The next band's index and its share, if between two.
    pub second: Option<(usize, f64)>,
}

impl LensBands {
    /// The bands of `lens` for `wavelength_nm`.
    ///
    /// # Errors
    /// [`LensError::Wavelength`] outside the lens's wavelengths.
    pub fn new(lens: &Lens, wavelength_nm: f64) -> Result<Self, LensError> {
        let bands = &lens.bands;
        let nm = |i: usize| bands[i].wavelength_nm;
        if let Some(first) = (0..bands.len()).find(|&i| (nm(i) - wavelength_nm).abs() < SAME_NM) {
            return Ok(Self { first, second: None });
        }
        match (1..bands.len()).find(|&i| nm(i - 1) < wavelength_nm && wavelength_nm < nm(i)) {
            Some(i) => {
                let share = (wavelength_nm - nm(i - 1)) / (nm(i) - nm(i - 1));
                Ok(Self { first: i - 1, second: Some((i, share)) })
            }
            None => {
                Err(LensError::Wavelength { wavelength_nm, first_nm: nm(0), last_nm: nm(bands.len() - 1) })
            }
        }
    }
}

/// The plan of a band.
///
/// ```
/// # use lenscube_pipeline::lens::{Lens, LensBand, PsfSample};
/// # let heights = vec![0.0, 1.0];
/// # let band = LensBand {
/// #     wavelength_nm: 550.0, ideal_height_mm: heights.clone(), image_height_mm: heights.clone(), relative_illumination: vec![1.0, 0.9],
/// #     psf_height_mm: heights, azimuth_count: vec![1, 4], psf_size: 9, psf_pitch_um: 2.0, kernel_pitch_um: None, psf_energy: vec![1.0, 1.0],
/// #     solid_angle_sr: 0.1, transmission: 1.0,
/// #     tail: None, cones: None, planar: None,
/// # };
/// # let lens = Lens {
/// #     name: "ideal".into(), distortion_focal_length_mm: 50.0, effective_focal_length_mm: 50.0, f_number: 2.8, primary_wavelength_nm: 550.0,
/// #     object_distance_mm: None, magnification: 0.0, psf_sample: PsfSample::Integrated, bands: vec![band], depth: None,
/// # };
/// # use lenscube_pipeline::{field::Outside, remap::ChartInterpolation, resample::{Interp, Surround}, simd::Simd};
/// # use lenscube_pipeline::band::{Options, PsfBetween};
/// # let options = Options {
/// #     stages: lenscube_pipeline::stages::default_stages(),
/// #     interpolation: ChartInterpolation { interp: Interp::Bicubic, surround: Surround::Edge, outside: Outside::Error },
/// #     azimuths: None, psf_window: None, between: PsfBetween::Error, simd: Simd::detect(),
/// # };
/// use lenscube_pipeline::band::BandPlan;
/// use lenscube_pipeline::geometry::{Frame, Size};
///
/// // `lens` has PSFs of 9 x 9 samples of 2 µm at 550 nm, up to 1 mm from the axis; `options` enable all stages.
/// let size = Size::new(300, 300);
/// let plan = BandPlan::new(&Frame::centred(size, size, 2.0), &lens, 550.0, &options)?;
/// // The film and half a window around it is divided into tiles.
/// assert_eq!((plan.tiling.margin(), plan.tiling.grown().size()), (4, Size::new(308, 308)));
/// // A film of 2 mm would reach beyond the lens's tables.
/// let size = Size::new(1000, 1000);
/// assert!(BandPlan::new(&Frame::centred(size, size, 2.0), &lens, 550.0, &options).is_err());
/// # Ok::<(), lenscube_pipeline::lens::LensError>(())
/// ```
#[derive(Clone, Debug)]
pub struct BandPlan {
    /// The lens bands of its tables.
    pub lens_bands: LensBands,
    /// Its tables.
    pub lens: LensBand,
    /// Its node grid, if the PSF stage is enabled.
    pub grid: Option<NodeGrid>,
    /// Its FFT blocks, if the PSF stage is enabled.
    pub blocks: Option<Blocks>,
    /// The samples that its kernels are made from: of wide PSFs coarser than those of its tables.
    pub samples: KernelSamples,
    /// Its tiles.
    pub tiling: Tiling,
    /// The lens's depth node whose PSFs it uses, for a flat chart and a lens with depth nodes.
    pub node: Option<usize>,
    /// Its depth stage, which replaces the others, for surfaces at several distances.
    pub depth: Option<DepthPlan>,
    /// The tails of its PSFs, if they are on the film ([`BandPlan::add_tail`]).
    pub tail: Option<TailPlan>,
}

/// The stages of one band; copies share them.
#[derive(Clone, Debug)]
pub struct BandStages {
    /// Remap stage.
    pub remap: Arc<Remap>,
    /// PSF stage, if enabled.
    pub psf: Option<Arc<BandPsf>>,
    /// Depth stage, which replaces the others.
    pub depth: Option<Arc<DepthStage>>,
    /// Smooth light that is added to finished shards, in this order.
    pub layers: Vec<Layer>,
}

impl BandPlan {
    /// Plans the band at `wavelength_nm` and checks that the lens covers it.
    ///
    /// # Errors
    /// [`LensError`]: wavelength or film outside the lens, PSF between bands, PSF window larger than the largest FFT admits.
    pub fn new(frame: &Frame, lens: &Lens, wavelength_nm: f64, options: &Options) -> Result<Self, LensError> {
        let lens_bands = LensBands::new(lens, wavelength_nm)?;
        let tables = tables(lens, lens_bands, wavelength_nm, options)?;
        let (mut grid, mut blocks) = (None, None);
        if options.stages.has(Stage::Svpsf) {
            let psfs = PsfTables {
                wavelength_nm,
                window: "window",
                size: tables.psf_size,
                pitch_um: tables.psf_pitch_um,
                sample: lens.psf_sample,
                nodes: PsfNodes::of(&tables),
            };
            let (nodes, of_nodes) = options.partition(frame, &psfs)?;
            (grid, blocks) = (Some(nodes), Some(of_nodes));
        }
        let psfs = (tables.psf_count(), tables.psf_size, tables.psf_pitch_um);
        let samples = match tables.is_symmetric() {
            true => KernelSamples::of(psfs, frame.pitch_um, lens.psf_sample, tables.kernel_pitch_um),
            false => KernelSamples::all(psfs.1, psfs.2, frame.pitch_um),
        };
        let tiling = Tiling::new(frame.film, blocks.as_ref());
        check_covers(frame, &tables, &tiling, options)?;
        let (node, depth, tail) = (None, None, None);
        Ok(Self { lens_bands, lens: tables, grid, blocks, samples, tiling, node, depth, tail })
    }

    /// Puts the tails of its PSFs on the film, if the lens has them and the film has the PSF stage: kernels then keep their share of the light, and the rest is
    /// a layer.
    pub fn add_tail(&mut self, frame: &Frame, options: &Options) {
        let is_plain = self.grid.is_some() && options.psf_window.is_none();
        self.tail = if is_plain { TailPlan::new(frame, &self.lens) } else { None };
    }

    /// Plans the band at `wavelength_nm` for `surfaces`. A flat chart at a depth node of the lens is planned as by
    /// [`BandPlan::new`] with that node's tables; all else gets a depth stage, which gathers.
    ///
    /// # Errors
    /// As [`BandPlan::new`]; [`LensError::NoDepth`], [`LensError::Vergence`].
    pub fn with_depth(
        frame: &Frame,
        lens: &Lens,
        wavelength_nm: f64,
        options: &Options,
        surfaces: &Surfaces,
    ) -> Result<Self, LensError> {
        let depth = lens.depth.as_ref().ok_or(LensError::NoDepth)?;
        let lens_bands = LensBands::new(lens, wavelength_nm)?;
        if let Some((second, _)) = lens_bands.second {
            let (below_nm, above_nm) =
                (lens.bands[lens_bands.first].wavelength_nm, lens.bands[second].wavelength_nm);
            return Err(LensError::BetweenDepthBands { wavelength_nm, below_nm, above_nm });
        }
        let (tables, nodes) = (&lens.bands[lens_bands.first], &depth.bands[lens_bands.first]);
        let clamp = options.interpolation.outside == Outside::Clamp;
        if !clamp && !surfaces.lies_within(nodes) {
            let last = nodes.vergence[nodes.vergence.len() - 1];
            return Err(LensError::Vergence {
                wavelength_nm,
                nearest_m: 1.0 / surfaces.last,
                farthest_m: 1.0 / surfaces.first,
                lens_nearest_m: 1.0 / last,
                lens_farthest_m: 1.0 / nodes.vergence[0],
            });
        }
        if let Some(node) = surfaces.single_node(nodes) {
            let flat = Lens { bands: vec![nodes.at_node(tables, node)], depth: None, ..lens.clone() };
            return Ok(Self {
                lens_bands,
                node: Some(node),
                ..Self::new(frame, &flat, wavelength_nm, options)?
            });
        }
        let remap = Remap::new(frame, tables, options.stages, options.interpolation, 1.0, options.simd);
        let chart_rect = |film: Rect| remap.approx_chart_rect(frame.chart, film);
        let plan = DepthPlan::new(frame, lens, lens_bands.first, surfaces, options, chart_rect)?;
        let needed = frame.farthest_mm(frame.film.rect().grown(plan.margin()));
        let check =
            |table, last_mm: f64| options.interpolation.outside.check(table, wavelength_nm, needed, last_mm);
        for node in plan.used() {
            check("psf_height table", node.last_height_mm)?;
        }
        check("image_height table", tables.image_height_mm[tables.image_height_mm.len() - 1])?;
        let tiling = Tiling::new(frame.film, None);
        let lens = tables.clone();
        Ok(Self {
            lens_bands,
            samples: KernelSamples::all(lens.psf_size, lens.psf_pitch_um, frame.pitch_um),
            lens,
            grid: None,
            blocks: None,
            tiling,
            node: None,
            depth: Some(plan),
            tail: None,
        })
    }

    /// Bytes of its PSFs, ready for kernels.
    pub fn kernels_bytes(&self) -> usize {
        let psfs = self.lens.psf_count();
        self.blocks.map_or(0, |blocks| memory::kernels_bytes(&blocks, psfs, self.samples.size))
    }

    /// Whether its kernels are made from coarser samples than those of its tables.
    pub fn is_coarse(&self) -> bool {
        self.samples.size != self.lens.psf_size
    }

    /// Bytes of the PSFs that are read at a time, to be reduced by `readers` threads, or all of one band's; the samples that kernels are made from are among
    /// [`BandPlan::kernels_bytes`].
    pub fn reading_bytes(&self, readers: usize) -> usize {
        let psfs = if self.is_coarse() { readers } else { self.lens.psf_count() };
        4 * psfs * self.lens.psf_size.pow(2)
    }

    /// Whether its PSFs are read when a kernel needs them, those of a height at a time: those of a lens without rotational symmetry, if they are large.
    pub fn reads_on_demand(&self) -> bool {
        let is_plain = self.lens_bands.second.is_none() && self.tail.is_none();
        is_plain && !self.lens.is_symmetric() && self.kernels_bytes() > MAX_IN_MEMORY
    }

    /// Bytes of the most PSFs that are read together, those of a height or of a row, ready for kernels.
    pub fn largest_set_bytes(&self) -> usize {
        let Some((blocks, grid)) = self.blocks.as_ref().zip(self.grid.as_ref()) else { return 0 };
        let largest = match grid {
            NodeGrid::Polar(_) => (0..grid.psf_sets()).map(|set| grid.psf_rows(set).len()).max().unwrap_or(0),
            NodeGrid::Cartesian(nodes) => nodes.x().count(),
        };
        memory::kernels_bytes(blocks, largest, self.lens.psf_size)
    }

    /// Bytes of the kernels of all nodes, if its PSFs are [read on demand](BandPlan::reads_on_demand).
    pub fn kept_bytes(&self) -> usize {
        let parts = self.blocks.as_ref().zip(self.grid.as_ref()).filter(|_| self.reads_on_demand());
        parts.map_or(0, |(blocks, grid)| memory::all_kernels_bytes(blocks, grid))
    }

    /// As [`BandPlan::stages`], for a band that [reads on demand](BandPlan::reads_on_demand): `source` has the PSFs of a height.
    pub fn stages_on_demand(
        &self,
        position: usize,
        frame: &Frame,
        sample: PsfSample,
        options: &Options,
        gain: f64,
        source: &PsfSource,
    ) -> BandStages {
        let remap = Remap::new(frame, &self.lens, options.stages, options.interpolation, gain, options.simd);
        let psf = self.grid.as_ref().map(|grid| {
            let shape = (self.lens.psf_size, self.lens.psf_pitch_um, sample);
            let (window, simd) = (options.psf_window, options.simd);
            let kernels =
                KernelsOnDemand::new((source, 0), grid.psf_sets(), shape, frame.pitch_um, window, simd);
            BandPsf::on_demand(position, grid.clone(), kernels, simd)
        });
        BandStages { remap: Arc::new(remap), psf: psf.map(Arc::new), depth: None, layers: Vec::new() }
    }

    /// Number of the sets of PSFs, the first ones, that the film of `frame` and its margin need ([`NodeGrid::psf_sets`]): of a polar grid up to the
    /// height beyond their corners. 0 without PSF stage.
    pub fn psf_sets(&self, frame: &Frame) -> usize {
        let Some(grid) = &self.grid else { return 0 };
        let heights_px = match grid {
            NodeGrid::Cartesian(_) => return grid.len(),
            NodeGrid::Polar(nodes) => nodes.heights_px(),
        };
        let farthest_px = frame.farthest_mm(self.tiling.grown()) / frame.pitch_mm() + ROUNDING_PX;
        (heights_px.partition_point(|height| *height < farthest_px) + 1).min(heights_px.len())
    }

    /// The stages of this band, the `position`-th of the job. `stack` reads the PSFs of a lens band, at least those of the first
    /// [`BandPlan::psf_sets`], at its [samples](BandPlan::samples) ([`KernelSamples::read`]), only if the PSF stage is enabled; `gain` multiplies the
    /// remapped image (film units).
    ///
    /// # Errors
    /// Errors of `stack`.
    pub fn stages<E: From<LensError>>(
        &self,
        position: usize,
        frame: &Frame,
        options: &Options,
        gain: f64,
        mut stack: impl FnMut(usize) -> Result<PsfStack, E>,
    ) -> Result<BandStages, E> {
        let remap = Remap::new(frame, &self.lens, options.stages, options.interpolation, gain, options.simd);
        let psf = match &self.grid {
            None => None,
            Some(grid) => {
                let mut samples = stack(self.lens_bands.first)?;
                if let Some((second, share)) = self.lens_bands.second {
                    samples = interpolate_psfs(&samples, &stack(second)?, share);
                }
                let kernels = match &self.tail {
                    Some(tail) => tail.near_kernels(samples, &self.lens, options.simd),
                    None => NodeKernels::of(samples, frame.pitch_um, options.psf_window, options.simd),
                };
                Some(BandPsf::new(position, grid.clone(), kernels, options.simd))
            }
        };
        Ok(BandStages { remap: Arc::new(remap), psf: psf.map(Arc::new), depth: None, layers: Vec::new() })
    }

    /// The stages of this band of a flat chart with the PSF stage `psf`, one of a film of the same lens and pitch; `gain` as in [`BandPlan::stages`].
    pub fn stages_with_psf(
        &self,
        frame: &Frame,
        options: &Options,
        gain: f64,
        psf: Option<Arc<BandPsf>>,
    ) -> BandStages {
        let remap = Remap::new(frame, &self.lens, options.stages, options.interpolation, gain, options.simd);
        BandStages { remap: Arc::new(remap), psf, depth: None, layers: Vec::new() }
    }

    /// The depth stage of this band of `lens`, the `position`-th of the job. `reader` reads a PSF of a depth node when a kernel of it is needed;
    /// `gain` as in [`BandPlan::stages`].
    ///
    /// # Panics
    /// The band is not one of [`BandPlan::with_depth`] with a depth stage.
    pub fn depth_stages(
        &self,
        position: usize,
        frame: &Frame,
        lens: &Lens,
        options: &Options,
        gain: f64,
        reader: PsfReader,
    ) -> BandStages {
        let remap = Remap::new(frame, &self.lens, options.stages, options.interpolation, gain, options.simd);
        let band = self.lens_bands.first;
        let nodes = &lens.depth.as_ref().expect("planned with depth").bands[band];
        let plan = self.depth.as_ref().expect("planned with depth");
        let tables = (&lens.bands[band], nodes, lens.psf_sample);
        let depth = plan.stage(position, frame, tables, options, gain, reader);
        BandStages { remap: Arc::new(remap), psf: None, depth: Some(Arc::new(depth)), layers: Vec::new() }
    }
}

/// Checks that the tables of `band` cover the film and its margin.
fn check_covers(frame: &Frame, band: &LensBand, tiling: &Tiling, options: &Options) -> Result<(), LensError> {
    let (outside, stages) = (options.interpolation.outside, options.stages);
    let film = frame.film.rect().grown(tiling.margin());
    let needed = frame.farthest_mm(film);
    let check = |table, heights: &[f64]| match heights.last() {
        Some(last) => outside.check(table, band.wavelength_nm, needed, *last),
        // Columns and rows of PSFs, beyond which the outermost ones are used.
        None => Ok(()),
    };
    if stages.has(Stage::Svpsf) {
        check("psf_height table", &band.psf_height_mm)?;
    }
    if !(stages.has(Stage::Ri) || stages.has(Stage::Distortion)) {
        return Ok(());
    }
    match &band.planar {
        Some(planar) => field::planar::check_covers(&planar.map, band.wavelength_nm, frame, film, outside),
        None => check("image_height table", &band.image_height_mm),
    }
}

/// The tables at a wavelength: those of a lens band, or interpolated between two.
fn tables(
    lens: &Lens,
    lens_bands: LensBands,
    wavelength_nm: f64,
    options: &Options,
) -> Result<LensBand, LensError> {
    let first = &lens.bands[lens_bands.first];
    let Some((second, share)) = lens_bands.second else { return Ok(first.clone()) };
    let second = &lens.bands[second];
    let (below_nm, above_nm) = (first.wavelength_nm, second.wavelength_nm);
    if options.stages.has(Stage::Svpsf) {
        if options.between == PsfBetween::Error {
            return Err(LensError::BetweenBands { wavelength_nm, below_nm, above_nm });
        }
        let mismatch = |what| Err(LensError::Blend { below_nm, above_nm, what });
        match (first, second) {
            (a, b) if a.psf_height_mm.len() != b.psf_height_mm.len() => {
                return mismatch("numbers of PSF heights");
            }
            (a, b) if a.psf_pitch_um != b.psf_pitch_um => return mismatch("PSF pitches"),
            (a, b) if options.azimuths.is_none() && a.azimuth_count != b.azimuth_count => {
                return mismatch("azimuth counts");
            }
            (LensBand { planar: Some(a), .. }, LensBand { planar: Some(b), .. }) if a.psfs != b.psfs => {
                return mismatch("places of PSFs");
            }
            _ => (),
        }
    }
    let planar = match (&first.planar, &second.planar) {
        (None, None) => None,
        (Some(a), Some(b)) => match a.between(b, share) {
            Some(planar) => Some(planar),
            None => return Err(LensError::Blend { below_nm, above_nm, what: "places of the map" }),
        },
        _ => return Err(LensError::Blend { below_nm, above_nm, what: "kinds of tables" }),
    };
    let mix = |a: f64, b: f64| a + share * (b - a);
    let mix_all = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| mix(*a, *b)).collect::<Vec<_>>();
    // Without field points, those of a planar map, nothing is computed.
    let at_first = |table: &[f64]| -> Vec<f64> {
        let xs = &second.ideal_height_mm;
        first.ideal_height_mm.iter().map(|&h| linear(xs, table, h)).collect()
    };
    Ok(LensBand {
        wavelength_nm,
        ideal_height_mm: first.ideal_height_mm.clone(),
        image_height_mm: mix_all(&first.image_height_mm, &at_first(&second.image_height_mm)),
        relative_illumination: mix_all(
            &first.relative_illumination,
            &at_first(&second.relative_illumination),
        ),
        psf_height_mm: mix_all(&first.psf_height_mm, &second.psf_height_mm),
        azimuth_count: first.azimuth_count.clone(),
        psf_size: first.psf_size.max(second.psf_size),
        psf_pitch_um: first.psf_pitch_um,
        // What a band that states none loses by fewer samples is not known.
        kernel_pitch_um: first.kernel_pitch_um.zip(second.kernel_pitch_um).map(|(a, b)| a.min(b)),
        psf_energy: mix_all(&first.psf_energy, &second.psf_energy),
        solid_angle_sr: mix(first.solid_angle_sr, second.solid_angle_sr),
        transmission: mix(first.transmission, second.transmission),
        // Windows of two bands have no tail in common.
        tail: None,
        // Sensors read those of the lens's own bands.
        cones: None,
        planar,
    })
}

/// (1 − share)·a + share·b, the smaller window padded with zeros.
fn interpolate_psfs(a: &PsfStack, b: &PsfStack, share: f64) -> PsfStack {
    let n = a.size.max(b.size);
    let mut samples = vec![0f32; a.heights() * n * n];
    for (from, share) in [(a, 1.0 - share), (b, share)] {
        let edge = (n - from.size) / 2;
        for k in 0..from.heights() {
            for (y, row) in from.window(k).chunks_exact(from.size).enumerate() {
                let to = &mut samples[k * n * n + (y + edge) * n + edge..][..from.size];
                to.iter_mut().zip(row).for_each(|(t, f)| *t += share as f32 * f);
            }
        }
    }
    PsfStack { size: n, pitch_um: a.pitch_um, sample: a.sample, samples }
}
