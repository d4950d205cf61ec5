//! The light of a block of bins, shared out among its kernels: times c_mj(h) cos mθ and c_mj(h) sin mθ ([`super::harmonics`]).
//!
//! Weights in f64, by plain code compiled for the instructions of an engine, none of which fuses its products: the same bits with any.

use super::harmonics::{KERNELS, Kernel, NEGLIGIBLE, kernels};
use super::plan::TailPlan;
use crate::lens::tail::{ORDERS, TERMS};
use crate::psf::polar::BlockPlace;
use crate::psf::simd::images::ImageSize;
use crate::simd::lanes::{Dispatch, Lanes, MAX_LANES, SimdOp};
use std::ops::Range;

/// The weighted light of a block: one image of each kernel that is not left out.
#[derive(Default)]
pub(super) struct BlockWeights {
    /// Indices of the kernels, ascending.
    pub(super) kernels: Vec<usize>,
    /// Their images one after the other.
    pub(super) values: Vec<f32>,
    row: RowOfBins,
}

/// The images of a block of bins: complete registers.
pub(super) fn image_size(rows: usize, cols: usize) -> ImageSize {
    ImageSize { rows, cols, stride: cols.next_multiple_of(MAX_LANES) }
}

impl BlockWeights {
    /// The images of the bins at `place` of `level`, whose kernels have the `peaks`, of the size `size`: weights times `light`, an image too.
    pub(super) fn of_block<V: Lanes>(
        &mut self,
        dispatch: Dispatch<V>,
        plan: &TailPlan,
        (level, peaks): (usize, &[f64]),
        (place, size): (&BlockPlace, ImageSize),
        light: &[f32],
    ) {
        let values = size.values();
        // All values are written below.
        self.values.resize(KERNELS * values, 0.0);
        let mut largest = [0.0_f64; KERNELS];
        dispatch.run(WeighRows {
            plan,
            // c_mj by height.
            by_height: std::array::from_fn(|k| {
                plan.coefficients().map(|c| c[k / TERMS][k % TERMS]).collect()
            }),
            factors: kernels().zip(peaks).map(|(k, peak)| (k, peak * TailPlan::factor(level, k.j))).collect(),
            first: (place.dy_px, place.dx_px),
            bin_px: plan.bins(level).bin_px as f64,
            size,
            light,
            row: &mut self.row,
            values: &mut self.values,
            largest: &mut largest,
        });
        self.kernels.clear();
        self.kernels.extend((0..KERNELS).filter(|k| largest[*k] > NEGLIGIBLE * largest[0]));
        for (to, from) in self.kernels.iter().enumerate().filter(|(to, from)| to != *from) {
            self.values.copy_within(from * values..(from + 1) * values, to * values);
        }
        self.values.truncate(self.kernels.len() * values);
    }
}

/// The images of all kernels, row by row.
struct WeighRows<'a> {
    plan: &'a TailPlan,
    by_height: [Vec<f64>; ORDERS * TERMS],
    /// Of each kernel.
    factors: Vec<(Kernel, f64)>,
    /// The first bin, in bins from the axis.
    first: (f64, f64),
    bin_px: f64,
    size: ImageSize,
    light: &'a [f32],
    row: &'a mut RowOfBins,
    values: &'a mut [f32],
    /// Largest weights.
    largest: &'a mut [f64; KERNELS],
}

impl<V: Lanes> SimdOp<V> for WeighRows<'_> {
    #[inline(always)]
    fn run(self) {
        let Self { size: ImageSize { cols, stride, .. }, row: bins, .. } = self;
        for (row, light) in self.light.chunks_exact(stride).enumerate() {
            bins.set(self.plan, self.bin_px, (self.first.0 + row as f64, self.first.1), cols);
            let images = self.values.chunks_exact_mut(self.size.values());
            for ((image, (kernel, factor)), largest) in images.zip(&self.factors).zip(&mut *self.largest) {
                bins.turn_to(kernel.m, &self.by_height);
                let (to, beyond) = image[row * stride..][..stride].split_at_mut(cols);
                beyond.fill(0.0);
                *largest = largest.max(bins.weigh(kernel, *factor, &light[..cols], to));
            }
        }
    }
}

/// c_mj cos mθ and c_mj sin mθ at the bins of a row.
#[derive(Default)]
struct RowOfBins {
    /// Bins with the same height below them, and its index.
    runs: Vec<(usize, Range<usize>)>,
    /// Share of the height above.
    share: Vec<f64>,
    /// cos θ and sin θ.
    first: [Vec<f64>; 2],
    /// Those of mθ, and c_mj of all j, for the order m.
    turned: [Vec<f64>; 2],
    coefficients: [Vec<f64>; TERMS],
    m: usize,
}

impl RowOfBins {
    /// Sets `columns` bins of `bin_px` film pixels from (y, x) bins from the axis on.
    #[inline(always)]
    fn set(&mut self, plan: &TailPlan, bin_px: f64, (y, x): (f64, f64), columns: usize) {
        let Self { runs, share, first: [cosines, sines], .. } = self;
        [&mut *share, &mut *cosines, &mut *sines].into_iter().for_each(|v| v.resize(columns, 0.0));
        for (column, ((radius, cos), sin)) in share.iter_mut().zip(cosines).zip(sines).enumerate() {
            // A conversion of i32 is vectorised.
            let x = x + f64::from(column as i32);
            let r = (y * y + x * x).sqrt();
            (*sin, *cos) = if r > 0.0 { (y / r, x / r) } else { (0.0, 1.0) };
            *radius = r * bin_px;
        }
        runs.clear();
        let mut below = 0;
        for (column, radius) in share.iter().enumerate() {
            below = plan.below(*radius, below);
            match runs.last_mut() {
                Some((of_run, bins)) if *of_run == below => bins.end = column + 1,
                _ => runs.push((below, column..column + 1)),
            }
        }
        for (below, bins) in runs {
            plan.shares(*below, &mut share[bins.clone()]);
        }
        self.m = ORDERS;
    }

    /// Sets the order `m`, 0 first and then not below that of before: (cos + i sin)^m, and c_mj of the values `by_height`.
    #[inline(always)]
    fn turn_to(&mut self, m: usize, by_height: &[Vec<f64>]) {
        if self.m == m {
            return;
        }
        let [re, im] = &mut self.turned;
        if m == 0 {
            re.clear();
            re.resize(self.share.len(), 1.0);
            im.clear();
            im.resize(self.share.len(), 0.0);
        } else {
            let [cosines, sines] = &self.first;
            for ((re, im), (cos, sin)) in re.iter_mut().zip(im).zip(cosines.iter().zip(sines)) {
                (*re, *im) = (*re * cos - *im * sin, *re * sin + *im * cos);
            }
        }
        for (to, values) in self.coefficients.iter_mut().zip(&by_height[m * TERMS..]) {
            to.resize(self.share.len(), 0.0);
            for (below, bins) in &self.runs {
                let (a, b) = (values[*below], values[below + 1]);
                let places = to[bins.clone()].iter_mut().zip(&self.share[bins.clone()]);
                places.for_each(|(to, t)| *to = a + t * (b - a));
            }
        }
        self.m = m;
    }

    /// The coefficients times the cosine or sine of `kernel`, times `factor`, times `light`; the largest magnitude without it.
    #[inline(always)]
    fn weigh(&self, kernel: &Kernel, factor: f64, light: &[f32], to: &mut [f32]) -> f64 {
        const SIDE_BY_SIDE: usize = 8;
        let mut largest = [0.0_f64; SIDE_BY_SIDE];
        let (c, turned) = (&self.coefficients[kernel.j], &self.turned[usize::from(kernel.odd)]);
        let weigh = |c: &f64, turned: &f64, light: &f32, to: &mut f32, largest: &mut f64| {
            let weight = c * turned * factor;
            *to = weight as f32 * light;
            *largest = if weight.abs() > *largest { weight.abs() } else { *largest };
        };
        let (to, to_rest) = to.as_chunks_mut::<SIDE_BY_SIDE>();
        let (light, light_rest) = light.as_chunks::<SIDE_BY_SIDE>();
        let (c, c_rest) = c.as_chunks::<SIDE_BY_SIDE>();
        let (turned, turned_rest) = turned.as_chunks::<SIDE_BY_SIDE>();
        for (((to, light), c), turned) in to.iter_mut().zip(light).zip(c).zip(turned) {
            for i in 0..SIDE_BY_SIDE {
                weigh(&c[i], &turned[i], &light[i], &mut to[i], &mut largest[i]);
            }
        }
        let rest = to_rest.iter_mut().zip(light_rest).zip(c_rest).zip(turned_rest);
        for ((((to, light), c), turned), largest) in rest.zip(&mut largest) {
            weigh(c, turned, light, to, largest);
        }
        largest.into_iter().fold(0.0, f64::max)
    }
}
