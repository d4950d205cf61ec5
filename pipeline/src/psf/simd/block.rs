//! One block of the remapped image to panels of columns and back.
//!
//! A *panel* is as many columns as there are lanes. A packed panel is stored row by row as `[pixels][r][θ]` (the coordinates of
//! [`crate::psf::polar`]; x and y of a Cartesian grid of nodes), from which any node's weights follow. Transformed along y it has F/2 elements; transposed, it is spread
//! over F/2/LANES groups of F elements, one element being one column of LANES spectral rows.
//!
//! *Right-angle transform along y.* A real signal x of F rows becomes F/2 complex ones:
//! ```text
//! z_y = (x_y + i·x_{y+F/2})·ω^y,  ω = exp(iπ/F)    →    Z_k = Σ_y x_y exp(−2πi·y·(2k − 1/2)/F)
//! ```
//! F/2 spectral rows, all treated alike. Products are skew-circular convolutions, equal to linear ones because
//! F ≥ block + window − 1. Inverse: x_y + i·x_{y+F/2} = z_y·ω̄^y.
//! Source: Martucci, IEEE Trans. Signal Processing 42 (1994) 1038 (skew-circular convolution).

use super::complex::Complex;
use crate::psf::block_view::BlockView;
use crate::psf::grid::NodeWeight;
use crate::psf::kernel::NEGLIGIBLE_SAMPLE;
use crate::psf::polar::{ATAN, BlockPlace, SECANT};
use crate::psf::portable::NEGLIGIBLE_PIXEL;
use crate::real;
use crate::simd::lanes::{Lanes, SimdOp};
use bytemuck::cast_slice_mut;
use std::f32::consts::TAU;

/// LANES pixels of one row and their polar coordinates relative to the block's centre: [pixels, r, θ].
pub(super) type Pixels<V> = [V; 3];

/// Extent of a panel: whether any pixel is not 0, and the range of its pixels in r and θ.
#[derive(Clone, Copy, Debug)]
pub(super) struct PanelExtent {
    pub(super) nonzero: bool,
    pub(super) r: (f32, f32),
    pub(super) theta: (f32, f32),
}

impl PanelExtent {
    /// Whether a node's weight may be above 0 at a pixel that is not 0.
    pub(super) fn touches(&self, weight: &NodeWeight, wraps: bool) -> bool {
        let reach = 1.0 / weight.per_rad; // infinite for the axis node
        self.nonzero
            && self.r.1 * weight.rise + weight.rise_at > 0.0
            && self.r.0 * weight.fall + weight.fall_at > 0.0
            && (wraps
                || (self.theta.0 - weight.azimuth_rad < reach && weight.azimuth_rad - self.theta.1 < reach))
    }
}

/// Packs the pixels of a block with their coordinates, which are computed as in [`BlockPlace::polar`] or [`BlockPlace::cartesian`];
/// pixels that would become denormal are set to 0.
pub(super) struct Pack<'a, V> {
    pub(super) block: &'a BlockView<'a>,
    /// Rows of a full block, and of a panel in `to`.
    pub(super) rows: usize,
    pub(super) to: &'a mut [Pixels<V>],
    pub(super) extents: &'a mut [PanelExtent],
    pub(super) coordinates: Coordinates<'a>,
}

/// Coordinates of the pixels of a block.
#[derive(Clone, Copy)]
pub(super) enum Coordinates<'a> {
    /// r and θ, of a block near the axis.
    Given(&'a [f32], &'a [f32]),
    /// r and θ of a block far from the axis, computed in registers.
    FarPolar,
    /// x and y.
    Cartesian,
}

impl<V: Lanes> SimdOp<V> for Pack<'_, V> {
    #[inline(always)]
    fn run(self) {
        let place = &self.block.place;
        let far = FarPolar::new(place);
        let tiny = V::splat(NEGLIGIBLE_PIXEL);
        let panels = self.to.chunks_exact_mut(self.rows).zip(self.extents.iter_mut());
        for (panel, (to, extent)) in panels.enumerate() {
            let first = panel * V::LANES;
            let lanes = (place.cols - first).min(V::LANES);
            let mut peak = V::splat(0.0);
            let (mut r, mut theta) = (Range::empty(), Range::empty());
            let dx = far.dx(first, place.cols);
            let across = far.columns(dx);
            let mut dy = V::splat(-far.half.0);
            for (y, to) in to[..place.rows].iter_mut().enumerate() {
                let row = &self.block.pixels[y * self.block.stride + first..];
                let pixels = load::<V>(row, lanes).zero_below(tiny);
                V::prefetch(row, 2 * V::LANES - 1); // the next panel; rows are too far apart for the hardware prefetcher
                let at = match self.coordinates {
                    Coordinates::Given(r, theta) => {
                        let at = y * place.cols + first;
                        (load::<V>(&r[at..], lanes), load::<V>(&theta[at..], lanes))
                    }
                    Coordinates::FarPolar => far.at(dy, across),
                    Coordinates::Cartesian => (dx, dy),
                };
                *to = [pixels, at.0, at.1];
                dy = dy + V::splat(1.0);
                peak = peak.max(pixels.abs());
                r = r.with(at.0);
                theta = theta.with(at.1);
            }
            *extent = PanelExtent {
                nonzero: peak.reduce_max() > 0.0,
                r: r.over_lanes(),
                theta: theta.over_lanes(),
            };
        }
    }
}

/// The first `lanes` values, then zeros.
#[inline(always)]
fn load<V: Lanes>(from: &[f32], lanes: usize) -> V {
    match lanes == V::LANES {
        true => V::load(from),
        false => V::load_first(from, lanes),
    }
}

/// Minimum and maximum of each lane.
#[derive(Clone, Copy)]
struct Range<V>(V, V);

impl<V: Lanes> Range<V> {
    #[inline(always)]
    fn empty() -> Self {
        Self(V::splat(f32::INFINITY), V::splat(f32::NEG_INFINITY))
    }

    #[inline(always)]
    fn with(self, v: V) -> Self {
        Self(self.0.min(v), self.1.max(v))
    }

    #[inline(always)]
    fn over_lanes(self) -> (f32, f32) {
        (self.0.reduce_min(), self.1.reduce_max())
    }
}

/// Polar coordinates far from the axis: r − rc and θ − θc of [`crate::psf::polar`].
#[derive(Clone, Copy)]
struct FarPolar<V> {
    cos: V,
    sin: V,
    radius: V,
    half: (f32, f32),
}

impl<V: Lanes> FarPolar<V> {
    #[inline(always)]
    fn new(place: &BlockPlace) -> Self {
        let (hy, hx, radius, azimuth, _) = place.centre();
        let (sin, cos) = real::sin_cos(azimuth);
        Self {
            cos: V::splat(cos as f32),
            sin: V::splat(sin as f32),
            radius: V::splat(radius as f32),
            half: (hy as f32, hx as f32),
        }
    }

    /// Distance of the columns from `first` on from the block's centre, px; lanes past the last repeat it.
    #[inline(always)]
    fn dx(&self, first: usize, cols: usize) -> V {
        let column = (V::iota() + V::splat(first as f32)).min(V::splat((cols - 1) as f32));
        column - V::splat(self.half.1)
    }

    /// Components along and across the ray of the columns at `dx`.
    #[inline(always)]
    fn columns(&self, dx: V) -> (V, V) {
        (dx * self.cos, dx * self.sin)
    }

    /// r and θ in the row `dy` below the block's centre.
    #[inline(always)]
    fn at(&self, dy: V, columns: (V, V)) -> (V, V) {
        let along = dy.mul_add(self.sin, columns.0);
        let across = dy.mul_sub(self.cos, columns.1);
        let t = across / (self.radius + along);
        let t2 = t * t;
        (along + across * t * polynomial(&SECANT, t2), t * polynomial(&ATAN, t2))
    }
}

/// Σ coefficients[i]·x^i by Horner's rule.
#[inline(always)]
fn polynomial<V: Lanes, const N: usize>(coefficients: &[f32; N], x: V) -> V {
    let mut sum = V::splat(coefficients[N - 1]);
    for i in (0..N - 1).rev() {
        sum = sum.mul_add(x, V::splat(coefficients[i]));
    }
    sum
}

/// [`NodeWeight`] with its values in all lanes.
#[derive(Clone, Copy)]
pub(super) struct SplatWeight<V> {
    rise: V,
    rise_at: V,
    fall: V,
    fall_at: V,
    azimuth: V,
    per_rad: V,
}

impl<V: Lanes> SplatWeight<V> {
    #[inline(always)]
    pub(super) fn new(weight: &NodeWeight) -> Self {
        Self {
            rise: V::splat(weight.rise),
            rise_at: V::splat(weight.rise_at),
            fall: V::splat(weight.fall),
            fall_at: V::splat(weight.fall_at),
            azimuth: V::splat(weight.azimuth_rad),
            per_rad: V::splat(weight.per_rad),
        }
    }

    /// The weights at the pixels: [`NodeWeight::at`].
    #[inline(always)]
    pub(super) fn at<const WRAPS: bool>(&self, [_, r, theta]: &Pixels<V>) -> V {
        self.radial(*r) * self.around::<WRAPS>(*theta)
    }

    /// The factor that depends on r.
    #[inline(always)]
    fn radial(&self, r: V) -> V {
        let rise = r.mul_add(self.rise, self.rise_at);
        rise.min(r.mul_add(self.fall, self.fall_at)).max(V::splat(0.0))
    }

    /// The factor that depends on θ.
    #[inline(always)]
    fn around<const WRAPS: bool>(&self, theta: V) -> V {
        let mut d = (theta - self.azimuth).abs();
        if WRAPS {
            d = d.min(V::splat(TAU) - d);
        }
        d.neg_mul_add(self.per_rad, V::splat(1.0)).max(V::splat(0.0))
    }
}

/// Weights of all nodes of a height at the pixels of a packed panel: their factor that depends on r.
pub(super) struct RadialWeights<'a, V> {
    pub(super) weight: &'a NodeWeight,
    /// The rows of the block.
    pub(super) pixels: &'a [Pixels<V>],
    pub(super) to: &'a mut [V],
}

impl<V: Lanes> SimdOp<V> for RadialWeights<'_, V> {
    #[inline(always)]
    fn run(self) {
        let weight = SplatWeight::<V>::new(self.weight);
        for ([_, r, _], to) in self.pixels.iter().zip(self.to) {
            *to = weight.radial(*r);
        }
    }
}

/// One packed panel times a node's weights, as z_y.
pub(super) struct ApplyWeight<'a, V, const WRAPS: bool> {
    pub(super) weight: &'a NodeWeight,
    /// The rows of the block.
    pub(super) pixels: &'a [Pixels<V>],
    /// Of each row, from [`RadialWeights`].
    pub(super) radial: &'a [V],
    pub(super) omega: &'a [[f32; 2]],
    pub(super) panel: &'a mut [Complex<V>],
}

impl<V: Lanes, const WRAPS: bool> SimdOp<V> for ApplyWeight<'_, V, WRAPS> {
    #[inline(always)]
    fn run(self) {
        let weight = SplatWeight::<V>::new(self.weight);
        let weighted =
            |[pixels, _, theta]: &Pixels<V>, radial: V| *pixels * (radial * weight.around::<WRAPS>(*theta));
        let half = self.panel.len();
        let omega = &self.omega[..half];
        let rows = self.pixels.len().min(half);
        let (upper, lower) = self.pixels.split_at(rows);
        let (radial, radial_of_lower) = self.radial[..self.pixels.len()].split_at(rows);
        let both = lower.len().min(rows);
        for y in 0..both {
            let (a, b) = (weighted(&upper[y], radial[y]), weighted(&lower[y], radial_of_lower[y]));
            self.panel[y] = Complex { re: a, im: b }.times(omega[y]);
        }
        for y in both..rows {
            let (a, w) = (weighted(&upper[y], radial[y]), omega[y]);
            self.panel[y] = Complex { re: a * V::splat(w[0]), im: a * V::splat(w[1]) };
        }
        cast_slice_mut::<_, f32>(&mut self.panel[upper.len()..]).fill(0.0);
    }
}

/// Columns of a kernel as z_y, scaled by `norm`. Windows are at most F/2 rows high, so z is real before the product with ω^y.
pub(super) struct KernelColumns<'a, V> {
    pub(super) kernel: &'a [f32],
    pub(super) window: usize,
    pub(super) first_column: usize,
    pub(super) norm: f32,
    pub(super) omega: &'a [[f32; 2]],
    pub(super) panel: &'a mut [Complex<V>],
}

impl<V: Lanes> SimdOp<V> for KernelColumns<'_, V> {
    #[inline(always)]
    fn run(self) {
        let lanes = (self.window - self.first_column).min(V::LANES);
        let (rows, limit) = (self.kernel.chunks_exact(self.window), V::splat(NEGLIGIBLE_SAMPLE));
        for ((row, z), w) in rows.zip(self.panel.iter_mut()).zip(self.omega) {
            let v = load::<V>(&row[self.first_column..], lanes).zero_below(limit);
            *z = Complex { re: v * V::splat(self.norm * w[0]), im: v * V::splat(self.norm * w[1]) };
        }
        cast_slice_mut::<_, f32>(&mut self.panel[self.window..]).fill(0.0);
    }
}

/// A panel of an image as z_y.
pub(super) struct ImageColumns<'a, V> {
    /// From the panel's first column on, rows `stride` apart.
    pub(super) image: &'a [f32],
    pub(super) stride: usize,
    pub(super) rows: usize,
    pub(super) omega: &'a [[f32; 2]],
    pub(super) panel: &'a mut [Complex<V>],
}

impl<V: Lanes> SimdOp<V> for ImageColumns<'_, V> {
    #[inline(always)]
    fn run(self) {
        let half = self.panel.len();
        for (y, (z, w)) in self.panel.iter_mut().zip(self.omega).enumerate() {
            let (mut re, mut im) = (V::splat(0.0), V::splat(0.0));
            if y < self.rows {
                re = V::load(&self.image[y * self.stride..]);
            }
            if y + half < self.rows {
                im = V::load(&self.image[(y + half) * self.stride..]);
            }
            *z = Complex { re, im }.times(*w);
        }
    }
}

/// Transposes a transformed panel into its columns of every group.
pub(super) struct ToGroups<'a, V> {
    pub(super) panel: &'a [Complex<V>],
    pub(super) groups: &'a mut [Complex<V>],
    /// Columns of a group.
    pub(super) stride: usize,
    pub(super) first_column: usize,
}

impl<V: Lanes> SimdOp<V> for ToGroups<'_, V> {
    #[inline(always)]
    fn run(self) {
        let rows = self.panel.chunks_exact(V::LANES);
        for (rows, group) in rows.zip(self.groups.chunks_exact_mut(self.stride)) {
            Complex::transpose(rows, &mut group[self.first_column..][..V::LANES]);
        }
    }
}

/// The inverse of [`ToGroups`].
pub(super) struct FromGroups<'a, V> {
    pub(super) groups: &'a [Complex<V>],
    pub(super) panel: &'a mut [Complex<V>],
    pub(super) fft: usize,
    pub(super) first_column: usize,
}

impl<V: Lanes> SimdOp<V> for FromGroups<'_, V> {
    #[inline(always)]
    fn run(self) {
        let rows = self.panel.chunks_exact_mut(V::LANES);
        for (rows, group) in rows.zip(self.groups.chunks_exact(self.fft)) {
            Complex::transpose(&group[self.first_column..][..V::LANES], rows);
        }
    }
}

/// Zeros the columns of a panel in every group of `stride` columns.
pub(super) fn clear_columns<V: Lanes>(groups: &mut [Complex<V>], stride: usize, first_column: usize) {
    for group in groups.chunks_exact_mut(stride) {
        cast_slice_mut::<_, f32>(&mut group[first_column..][..V::LANES]).fill(0.0);
    }
}

/// Adds one panel after its inverse transform to `out` (rows `stride` apart): `rows` rows of LANES values.
pub(super) struct AddTo<'a, V> {
    pub(super) panel: &'a [Complex<V>],
    pub(super) omega: &'a [[f32; 2]],
    pub(super) out: &'a mut [f32],
    pub(super) stride: usize,
    pub(super) rows: usize,
}

impl<V: Lanes> SimdOp<V> for AddTo<'_, V> {
    #[inline(always)]
    fn run(self) {
        let half = self.panel.len();
        for (y, (z, w)) in self.panel.iter().zip(self.omega).enumerate().take(self.rows) {
            let x = z.times_conjugate(*w);
            let row = &mut self.out[y * self.stride..];
            (V::load(row) + x.re).store(row);
            if y + half < self.rows {
                let row = &mut self.out[(y + half) * self.stride..];
                (V::load(row) + x.im).store(row);
            }
        }
    }
}
