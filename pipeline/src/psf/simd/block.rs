//! One block of the remapped image to strips of columns in lanes and back.
//!
//! A *strip* is as many columns as there are lanes. Packed, a strip lies row by row as `[pixels][r][θ]` (the polar maps of
//! [`crate::psf::polar`]): all that a node needs to weigh it. Transformed, it is F/2 elements; turned, it lies as F/2/LANES
//! groups of F elements, an element then being one column of LANES spectral rows.
//!
//! *Right-angle transform along y.* A real signal x of F rows becomes F/2 complex ones:
//!     z_y = (x_y + i·x_{y+F/2})·ω^y,  ω = exp(iπ/F)    →    Z_k = Σ_y x_y exp(−2πi·y·(2k − 1/2)/F)
//! F/2 spectral rows and no special ones; products are convolutions whose wrapped part changes sign, of which there is
//! none, since F ≥ block + window − 1. Back: x_y + i·x_{y+F/2} = z_y·ω̄^y.
//! Source: Martucci, IEEE Trans. Signal Processing 42 (1994) 1038 (the skew-circular convolution it rests on).

use super::complex::Complex;
use crate::psf::BlockView;
use crate::psf::grid::Tent;
use crate::psf::kernel::DARK;
use crate::psf::polar::{ATAN, BlockPlace, SECANT};
use crate::psf::portable::TINY;
use crate::real;
use crate::simd::lanes::{Lanes, Work};
use bytemuck::cast_slice_mut;
use std::f32::consts::TAU;

/// LANES pixels of one row and where they lie, relative to the block's centre: [pixels, r, θ].
pub(super) type Pixels<V> = [V; 3];

/// What a strip holds: whether any light, and the reach of its pixels in r and θ.
#[derive(Clone, Copy, Debug)]
pub(super) struct Extent {
    pub(super) lit: bool,
    pub(super) r: (f32, f32),
    pub(super) theta: (f32, f32),
}

impl Extent {
    /// Whether a node's share may be above 0 in the strip.
    pub(super) fn meets(&self, tent: &Tent, around: bool) -> bool {
        let reach = 1.0 / tent.per_rad; // infinite for the axis node
        self.lit
            && self.r.1 * tent.rise + tent.rise_at > 0.0
            && self.r.0 * tent.fall + tent.fall_at > 0.0
            && (around
                || (self.theta.0 - tent.azimuth_rad < reach && tent.azimuth_rad - self.theta.1 < reach))
    }
}

/// Packs the pixels of a block, zeroing what would become denormal, and maps them far from the axis: as
/// [`BlockPlace::polar`] does, lane by lane.
pub(super) struct Pack<'a, V> {
    pub(super) block: &'a BlockView<'a>,
    /// Rows of a whole block: those of a strip in `to`.
    pub(super) rows: usize,
    pub(super) to: &'a mut [Pixels<V>],
    pub(super) extents: &'a mut [Extent],
    /// Polar maps of the block, already made: near the axis.
    pub(super) near: Option<(&'a [f32], &'a [f32])>,
}

impl<V: Lanes> Work<V> for Pack<'_, V> {
    #[inline(always)]
    fn run(self) {
        let place = &self.block.place;
        let far = FarMap::new(place);
        let tiny = V::splat(TINY);
        let strips = self.to.chunks_exact_mut(self.rows).zip(self.extents.iter_mut());
        for (strip, (to, extent)) in strips.enumerate() {
            let first = strip * V::LANES;
            let lanes = (place.cols - first).min(V::LANES);
            let mut light = V::splat(0.0);
            let (mut r, mut theta) = (Bounds::nothing(), Bounds::nothing());
            let across = far.columns(first, place.cols);
            let mut dy = V::splat(-far.half.0);
            for (y, to) in to[..place.rows].iter_mut().enumerate() {
                let row = &self.block.pixels[y * self.block.stride + first..];
                let pixels = load::<V>(row, lanes).zero_below(tiny);
                V::prefetch(row, 2 * V::LANES - 1); // the next strip's: rows are too far apart for the hardware
                let polar = match self.near {
                    Some((r, theta)) => {
                        let at = y * place.cols + first;
                        (load::<V>(&r[at..], lanes), load::<V>(&theta[at..], lanes))
                    }
                    None => far.at(dy, across),
                };
                *to = [pixels, polar.0, polar.1];
                dy = dy + V::splat(1.0);
                light = light.max(pixels.abs());
                r = r.with(polar.0);
                theta = theta.with(polar.1);
            }
            *extent = Extent { lit: light.greatest() > 0.0, r: r.ends(), theta: theta.ends() };
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

/// Least and greatest of each lane.
#[derive(Clone, Copy)]
struct Bounds<V>(V, V);

impl<V: Lanes> Bounds<V> {
    #[inline(always)]
    fn nothing() -> Self {
        Self(V::splat(f32::INFINITY), V::splat(f32::NEG_INFINITY))
    }

    #[inline(always)]
    fn with(self, v: V) -> Self {
        Self(self.0.min(v), self.1.max(v))
    }

    #[inline(always)]
    fn ends(self) -> (f32, f32) {
        (self.0.least(), self.1.greatest())
    }
}

/// The polar map far from the axis: r − rc and θ − θc of [`crate::psf::polar`].
#[derive(Clone, Copy)]
struct FarMap<V> {
    cos: V,
    sin: V,
    radius: V,
    half: (f32, f32),
}

impl<V: Lanes> FarMap<V> {
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

    /// Parts along and across the ray of the columns from `first` on; lanes past the last repeat it.
    #[inline(always)]
    fn columns(&self, first: usize, cols: usize) -> (V, V) {
        let column = (V::count() + V::splat(first as f32)).min(V::splat((cols - 1) as f32));
        let dx = column - V::splat(self.half.1);
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

/// By Horner's rule.
#[inline(always)]
fn polynomial<V: Lanes, const N: usize>(coefficients: &[f32; N], x: V) -> V {
    let mut sum = V::splat(coefficients[N - 1]);
    for i in (0..N - 1).rev() {
        sum = sum.mul_add(x, V::splat(coefficients[i]));
    }
    sum
}

/// A node's shares in lanes: [`Tent::share`].
#[derive(Clone, Copy)]
struct Shares<V> {
    rise: V,
    rise_at: V,
    fall: V,
    fall_at: V,
    azimuth: V,
    per_rad: V,
}

impl<V: Lanes> Shares<V> {
    #[inline(always)]
    fn new(tent: &Tent) -> Self {
        Self {
            rise: V::splat(tent.rise),
            rise_at: V::splat(tent.rise_at),
            fall: V::splat(tent.fall),
            fall_at: V::splat(tent.fall_at),
            azimuth: V::splat(tent.azimuth_rad),
            per_rad: V::splat(tent.per_rad),
        }
    }

    /// The node's share of the pixels' light.
    #[inline(always)]
    fn of<const AROUND: bool>(&self, [light, r, theta]: &Pixels<V>) -> V {
        let (zero, one) = (V::splat(0.0), V::splat(1.0));
        let rise = r.mul_add(self.rise, self.rise_at);
        let radial = rise.min(r.mul_add(self.fall, self.fall_at)).max(zero);
        let mut d = (*theta - self.azimuth).abs();
        if AROUND {
            d = d.min(V::splat(TAU) - d);
        }
        *light * (radial * d.neg_mul_add(self.per_rad, one).max(zero))
    }
}

/// A node's share of one packed strip as z_y.
pub(super) struct Weigh<'a, V, const AROUND: bool> {
    pub(super) tent: &'a Tent,
    /// The rows of the block.
    pub(super) pixels: &'a [Pixels<V>],
    pub(super) omega: &'a [[f32; 2]],
    pub(super) strip: &'a mut [Complex<V>],
}

impl<V: Lanes, const AROUND: bool> Work<V> for Weigh<'_, V, AROUND> {
    #[inline(always)]
    fn run(self) {
        let shares = Shares::<V>::new(self.tent);
        let half = self.strip.len();
        let omega = &self.omega[..half];
        let (upper, lower) = self.pixels.split_at(self.pixels.len().min(half));
        let both = lower.len().min(upper.len());
        for y in 0..both {
            let (a, b) = (shares.of::<AROUND>(&upper[y]), shares.of::<AROUND>(&lower[y]));
            self.strip[y] = Complex { re: a, im: b }.times(omega[y]);
        }
        for y in both..upper.len() {
            let (a, w) = (shares.of::<AROUND>(&upper[y]), omega[y]);
            self.strip[y] = Complex { re: a * V::splat(w[0]), im: a * V::splat(w[1]) };
        }
        cast_slice_mut::<_, f32>(&mut self.strip[upper.len()..]).fill(0.0);
    }
}

/// Columns of a kernel as z_y, scaled by `norm`. Windows are at most F/2 rows high, so z has no imaginary part before it is
/// turned by ω.
pub(super) struct KernelColumns<'a, V> {
    pub(super) kernel: &'a [f32],
    pub(super) window: usize,
    pub(super) first_column: usize,
    pub(super) norm: f32,
    pub(super) omega: &'a [[f32; 2]],
    pub(super) strip: &'a mut [Complex<V>],
}

impl<V: Lanes> Work<V> for KernelColumns<'_, V> {
    #[inline(always)]
    fn run(self) {
        let lanes = (self.window - self.first_column).min(V::LANES);
        let (rows, dark) = (self.kernel.chunks_exact(self.window), V::splat(DARK));
        for ((row, z), w) in rows.zip(self.strip.iter_mut()).zip(self.omega) {
            let v = load::<V>(&row[self.first_column..], lanes).zero_below(dark);
            *z = Complex { re: v * V::splat(self.norm * w[0]), im: v * V::splat(self.norm * w[1]) };
        }
        cast_slice_mut::<_, f32>(&mut self.strip[self.window..]).fill(0.0);
    }
}

/// A transformed strip to its columns in every group.
pub(super) struct ToGroups<'a, V> {
    pub(super) strip: &'a [Complex<V>],
    pub(super) groups: &'a mut [Complex<V>],
    pub(super) fft: usize,
    pub(super) first_column: usize,
}

impl<V: Lanes> Work<V> for ToGroups<'_, V> {
    #[inline(always)]
    fn run(self) {
        let rows = self.strip.chunks_exact(V::LANES);
        for (rows, group) in rows.zip(self.groups.chunks_exact_mut(self.fft)) {
            Complex::transpose(rows, &mut group[self.first_column..][..V::LANES]);
        }
    }
}

/// The reverse of [`ToGroups`].
pub(super) struct FromGroups<'a, V> {
    pub(super) groups: &'a [Complex<V>],
    pub(super) strip: &'a mut [Complex<V>],
    pub(super) fft: usize,
    pub(super) first_column: usize,
}

impl<V: Lanes> Work<V> for FromGroups<'_, V> {
    #[inline(always)]
    fn run(self) {
        let rows = self.strip.chunks_exact_mut(V::LANES);
        for (rows, group) in rows.zip(self.groups.chunks_exact(self.fft)) {
            Complex::transpose(&group[self.first_column..][..V::LANES], rows);
        }
    }
}

/// A strip of zeros in every group.
pub(super) fn clear_columns<V: Lanes>(groups: &mut [Complex<V>], fft: usize, first_column: usize) {
    for group in groups.chunks_exact_mut(fft) {
        cast_slice_mut::<_, f32>(&mut group[first_column..][..V::LANES]).fill(0.0);
    }
}

/// Adds one strip, transformed back, to `out` (rows `stride` apart): `rows` rows of LANES values.
pub(super) struct AddTo<'a, V> {
    pub(super) strip: &'a [Complex<V>],
    pub(super) omega: &'a [[f32; 2]],
    pub(super) out: &'a mut [f32],
    pub(super) stride: usize,
    pub(super) rows: usize,
}

impl<V: Lanes> Work<V> for AddTo<'_, V> {
    #[inline(always)]
    fn run(self) {
        let half = self.strip.len();
        for (y, (z, w)) in self.strip.iter().zip(self.omega).enumerate().take(self.rows) {
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
