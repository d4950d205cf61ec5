//! The convolutions of the levels of a band's tails.
//!
//! The kernel between two bins is b_l² T_l. That of a node at the azimuth θ is
//!
//! ```text
//! Σ_j 4^{(2 − q)(l − 1)} Σ_m c_mj (C_mj cos mθ + S_mj sin mθ)       C_mj, S_mj: b² [B_mj(r; R_l) − B_mj(r; R_{l+1})] times cos mφ, sin mφ at the bins of
//!                                                                   level 1; level 0 has its own and no factor
//! ```
//! and its spectrum the sum over j of spectra that all levels from 1 on share.
//!
//! By the transforms of the SIMD engines of the PSF stage, on registers that round products: the bits do not depend on the instructions. Nor on the
//! threads: a thread convolves a row of blocks, and no film row has light of more than two of these.

use super::OUT_MARGIN;
use super::levels::out_size;
use super::plan::TailPlan;
use crate::buffer::AlignedBuf;
use crate::geometry::{Frame, Rect, Size};
use crate::layer::BinGrid;
use crate::lens::tail::{Coefficients, ORDERS, TERMS};
use crate::parts::for_each_part;
use crate::psf::blocks::Blocks;
use crate::psf::grid::{Node, NodeGrid};
use crate::psf::polar::BlockPlace;
use crate::psf::simd::{Columns, Scratch};
use crate::psf::spectra::SpectrumCache;
use crate::psf::{BlockView, Spectra};
use crate::real;
use crate::simd::lanes::{Lanes, MAX_LANES};
#[cfg(target_arch = "x86_64")]
use crate::simd::{Avx2, Avx512, Unfused};
use crate::simd::{Isa, Plain, Simd};
use std::cell::RefCell;
use std::convert::Infallible;
use std::ops::Range;
use std::sync::{Arc, Mutex, OnceLock};

/// Images C_mj and S_mj of the kernels, by power law.
pub(super) struct Harmonics(pub(super) [Vec<[Vec<f64>; 2]>; TERMS]);

impl Harmonics {
    pub(super) fn new(plan: &TailPlan, level: usize) -> Self {
        let half = plan.half() as i64;
        Self(std::array::from_fn(|j| {
            let of = |m: usize| {
                let places = (-half..=half).flat_map(|y| (-half..=half).map(move |x| (y, x)));
                let (mut even, mut odd): (Vec<f64>, Vec<f64>) =
                    places.map(|(y, x)| plan.kernel_at(level, (y, x), m, j)).unzip();
                // A harmonic has no light; its sum over square bins has, of m = 4.
                if m > 0 {
                    let centre = even.len() / 2;
                    for all in [&mut even, &mut odd] {
                        all[centre] -= all.iter().sum::<f64>();
                    }
                }
                [even, odd]
            };
            (0..ORDERS).map(of).collect()
        }))
    }

    /// The power laws `terms` of the kernel of coefficients `c` at azimuth `theta`.
    fn kernel(&self, c: &Coefficients, terms: Range<usize>, theta: f64) -> Vec<f32> {
        let mut sum = vec![0.0; self.0[0][0][0].len()];
        for (j, (m, [even, odd])) in terms.flat_map(|j| self.0[j].iter().enumerate().map(move |of| (j, of))) {
            let (sin, cos) = real::sin_cos(m as f64 * theta);
            let (a, b) = (c[m][j] * cos, c[m][j] * sin);
            for ((to, even), odd) in sum.iter_mut().zip(even).zip(odd) {
                *to += a * even + b * odd;
            }
        }
        sum.into_iter().map(|v| v as f32).collect()
    }
}

/// The kernels of a band's tails, and how they are convolved. They depend on the lens, the pitch and the size of the film, not on its place in the field.
pub(super) trait ConvolveLevels: Send + Sync {
    /// T_l ∗ `lights[l]` of all levels l, each on the film's bins of its level and [`OUT_MARGIN`] around.
    fn levels(&self, frame: &Frame, lights: Vec<Vec<f32>>, threads: usize) -> Vec<Vec<f32>>;

    /// The transpose of [`ConvolveLevels::levels`]: the light of each level, of its result.
    fn lights(&self, frame: &Frame, results: Vec<Vec<f32>>, threads: usize) -> Vec<Vec<f32>>;
}

/// The kernels of `plan`, whose spectra are kept in `cache` for further films, if there is one.
pub(super) fn kernels(plan: &TailPlan, simd: Simd, cache: Option<KeptSpectra>) -> Box<dyn ConvolveLevels> {
    match simd.isa() {
        #[cfg(target_arch = "x86_64")]
        Isa::Avx512 => Box::new(Engine::<Unfused<Avx512>>::new(plan, simd, cache)),
        #[cfg(target_arch = "x86_64")]
        Isa::Avx2 => Box::new(Engine::<Unfused<Avx2>>::new(plan, simd, cache)),
        _ => Box::new(Engine::<Plain>::new(plan, simd, cache)),
    }
}

/// The engine of a band's tails.
pub(super) struct Engine<V: Lanes> {
    pub(super) plan: TailPlan,
    /// Of levels 0 and 1.
    harmonics: [Harmonics; 2],
    pub(super) blocks: Blocks,
    pub(super) columns: Columns<V>,
    cache: Option<KeptSpectra>,
}

/// A cache of spectra, and what the first of the levels is called in it, which the others follow.
pub(super) type KeptSpectra = (Arc<SpectrumCache>, usize);

/// Spectra of the nodes at level 1, one of each power law, made when a level needs them.
pub(super) type TermSpectra = Vec<OnceLock<[AlignedBuf; TERMS]>>;

/// Spectra of one level, for one thread.
pub(super) struct LevelSpectra<'a, V: Lanes> {
    pub(super) engine: &'a Engine<V>,
    pub(super) grid: &'a NodeGrid,
    pub(super) level: usize,
    pub(super) terms: &'a TermSpectra,
    /// Those of this level, if there is no cache.
    pub(super) made: &'a [OnceLock<Arc<AlignedBuf>>],
    pub(super) scratch: RefCell<Scratch>,
}

impl<V: Lanes> LevelSpectra<'_, V> {
    /// The spectrum of `node`, in `buffer`.
    fn of_node(&self, node: Node, buffer: AlignedBuf) -> AlignedBuf {
        match self.level {
            0 => self.spectrum(node, 0..TERMS, buffer),
            _ => self.of_terms(node, buffer),
        }
    }

    /// The spectrum of the power laws `terms` of `node`, at level 0 or 1.
    fn spectrum(&self, node: Node, terms: Range<usize>, buffer: AlignedBuf) -> AlignedBuf {
        let c = &self.engine.plan.coefficients[node.k];
        let kernel = self.engine.harmonics[self.level.min(1)].kernel(c, terms, self.grid.azimuth_rad(node));
        self.engine.columns.spectrum(&kernel, &mut self.scratch.borrow_mut(), buffer)
    }

    /// The spectrum of `node` at a level from 1 on, from those of its power laws.
    fn of_terms(&self, node: Node, mut sum: AlignedBuf) -> AlignedBuf {
        let of_term = |j: usize| self.spectrum(node, j..j + 1, AlignedBuf::default());
        let parts = self.terms[self.grid.id(node)].get_or_init(|| std::array::from_fn(of_term));
        let factors: [f32; TERMS] = std::array::from_fn(|j| TailPlan::factor(self.level, j) as f32);
        sum.reset(parts[0].len());
        for (i, to) in sum.iter_mut().enumerate() {
            *to = factors[0] * parts[0][i] + factors[1] * parts[1][i];
        }
        sum
    }
}

impl<V: Lanes> Spectra for LevelSpectra<'_, V> {
    fn get(&self, node: Node) -> Arc<AlignedBuf> {
        let id = self.grid.id(node);
        match &self.engine.cache {
            Some((cache, first)) => {
                let bytes = self.engine.blocks.spectrum_bytes();
                cache.get((first + self.level, id), bytes, |buffer| self.of_node(node, buffer))
            }
            None => {
                let made = || Arc::new(self.of_node(node, AlignedBuf::default()));
                Arc::clone(self.made[id].get_or_init(made))
            }
        }
    }
}

impl<V: Lanes> Engine<V> {
    pub(super) fn new(plan: &TailPlan, simd: Simd, cache: Option<KeptSpectra>) -> Self {
        let blocks = plan.blocks();
        // Rows of blocks then overlap their neighbours alone.
        assert!(blocks.block >= 2 * plan.half(), "{blocks:?}");
        Self {
            plan: plan.clone(),
            cache,
            harmonics: [0, 1].map(|level| Harmonics::new(plan, level)),
            columns: Columns::new(&blocks, simd),
            blocks,
        }
    }

    /// T_l ∗ `light` on the film's bins of `level` and [`OUT_MARGIN`] around.
    /// Whether spectra are kept in a cache.
    pub(super) fn has_cache(&self) -> bool {
        self.cache.is_some()
    }

    fn convolve(
        &self,
        frame: &Frame,
        level: usize,
        terms: &TermSpectra,
        light: &[f32],
        threads: usize,
    ) -> Vec<f32> {
        let plan = &self.plan;
        let bins = plan.bins(level);
        let (Size { height: rows, width: columns }, half) = (bins.size(), plan.half());
        let grid = plan.grid(level);
        let made = unset(if self.has_cache() { 0 } else { grid.len() });
        let stride = row_stride(columns, half);
        let sum = Mutex::new(crate::buffer::zeros(stride * (rows + 2 * half)));
        let done: Result<(), Infallible> = for_each_part(
            threads,
            (0..rows).step_by(self.blocks.block),
            || {
                let scratch = RefCell::new(self.columns.scratch());
                let spectra = LevelSpectra { engine: self, grid: &grid, level, terms, made: &made, scratch };
                (spectra, self.columns.scratch(), Vec::new())
            },
            |(spectra, scratch, out), top| {
                let height = self.blocks.block.min(rows - top);
                out.clear();
                out.resize(stride * (height + 2 * half), 0.0);
                for block in
                    Rect::new(top as i64, 0, height, columns).tiles(self.blocks.block, self.blocks.block)
                {
                    let x = block.x as usize;
                    let lines = light.chunks(columns).skip(top).take(height);
                    if lines.clone().all(|row| row[x..x + block.width].iter().all(|v| *v == 0.0)) {
                        continue;
                    }
                    let place = place(frame, &bins, block);
                    let view = BlockView { pixels: &light[top * columns + x..], stride: columns, place };
                    self.columns.scatter(&view, &grid, spectra, &mut out[x..], stride, scratch);
                }
                let mut sum = sum.lock().expect("no panic while held");
                sum[top * stride..].iter_mut().zip(&*out).for_each(|(to, v)| *to += v);
                Ok(())
            },
        );
        let Ok(()) = done;
        // The first value is `half` bins before the first bin of the grid.
        let first = half + bins.margin - OUT_MARGIN;
        let Size { height: out_rows, width: out_columns } = out_size(&bins);
        let sum = sum.into_inner().expect("no panic while held");
        let lines = sum.chunks_exact(stride).skip(first).take(out_rows);
        lines.flat_map(|line| &line[first..first + out_columns]).copied().collect()
    }
}

impl<V: Lanes> ConvolveLevels for Engine<V> {
    fn levels(&self, frame: &Frame, lights: Vec<Vec<f32>>, threads: usize) -> Vec<Vec<f32>> {
        let terms = unset(self.plan.grid(1).len());
        let of_level =
            |(level, light): (usize, Vec<f32>)| self.convolve(frame, level, &terms, &light, threads);
        lights.into_iter().enumerate().map(of_level).collect()
    }

    fn lights(&self, frame: &Frame, results: Vec<Vec<f32>>, threads: usize) -> Vec<Vec<f32>> {
        let terms = unset(self.plan.grid(1).len());
        let of_level =
            |(level, result): (usize, Vec<f32>)| self.correlate(frame, level, &terms, &result, threads);
        results.into_iter().enumerate().map(of_level).collect()
    }
}

/// A block of `bins`, in bins from the axis.
pub(super) fn place(frame: &Frame, bins: &BinGrid, block: Rect) -> BlockPlace {
    let axis = |px: f64| (px + 0.5) / bins.bin_px as f64 - 0.5;
    BlockPlace {
        dy_px: (block.y - bins.margin as i64) as f64 - axis(frame.axis_px.0),
        dx_px: (block.x - bins.margin as i64) as f64 - axis(frame.axis_px.1),
        rows: block.height,
        cols: block.width,
    }
}

/// Values of a row of the sum of a level of `columns` bins and kernels of `half` bins a side: its results, and what an engine adds beyond.
pub(super) fn row_stride(columns: usize, half: usize) -> usize {
    columns + 2 * half + MAX_LANES
}

pub(super) fn unset<T>(count: usize) -> Vec<OnceLock<T>> {
    std::iter::repeat_with(OnceLock::new).take(count).collect()
}
