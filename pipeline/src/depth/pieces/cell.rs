//! The correction of one cell of the film.

use super::disc::{Disc, DiscScratch};
use super::layer::{CELL_PX, FEW, FLOOR, Layer};
use super::shape::{PIECES, Pieces, Shape};
use super::slope::{Slope, slopes};
use crate::buffer::resize_exact;
use crate::depth::planes::{Planes, SlabPlanes, copy_part, for_each_row};
use crate::depth::slabs::Slabs;
use crate::geometry::{Frame, Rect};
use crate::simd::lanes::{Lanes, SimdOp};
use crate::simd::{Simd, UnfusedOp};

/// Positions in a slab that differ by less are one.
const ONE_POSITION: f32 = 1e-4;

/// Where the composite leaves this share of the light open, what lies there is no surface.
const OPEN: f32 = 0.05;

/// The correction of one band.
pub(in crate::depth) struct Correction<'a> {
    pub(in crate::depth) frame: &'a Frame,
    pub(in crate::depth) slabs: &'a Slabs,
    pub(in crate::depth) shape: &'a Shape,
    /// Pixels around a tile that its planes have.
    pub(in crate::depth) margin: usize,
}

/// Buffers of one worker.
#[derive(Debug, Default)]
pub(in crate::depth) struct CellScratch {
    /// Of every piece and, behind them, of the means: T and what the film receives.
    passing: Vec<f32>,
    light: Vec<f32>,
    /// Of the present slab: its share and light of every piece, then of the means.
    seen: Seen,
    /// Shares of the slabs in front that are not apart from it.
    near: Vec<(usize, Vec<f32>)>,
    free: Vec<Vec<f32>>,
    /// Sum of the shares in `near`.
    before: Vec<f32>,
    slope: Slope,
    filter: Filter,
}

/// Buffers of a plane in the mean over a disc.
#[derive(Debug, Default)]
struct Filter {
    source: Vec<f32>,
    mean: Vec<f32>,
    sums: DiscScratch,
}

/// Share and light of a slab by piece.
#[derive(Debug, Default)]
struct Seen {
    share: Vec<f32>,
    light: Vec<f32>,
}

/// Bytes of the buffers of a worker, for surfaces of up to `max_near` slabs, whose planes reach over `margin` pixels beyond a cell.
pub(in crate::depth) fn bytes(max_near: usize, margin: usize) -> usize {
    let (cell, read) = ((CELL_PX * CELL_PX) as usize, (CELL_PX as usize + 2 * margin).pow(2));
    4 * (PIECES + 1) * cell * (3 + max_near + 1) + 4 * 4 * cell + (4 + 4 + 8 + 8) * read
}

impl Correction<'_> {
    /// Adds the correction of `cell`, a part of `tile`, to the film of the tile; `layers` are those seen there.
    #[allow(clippy::too_many_arguments, reason = "inputs, output and scratch are independent")]
    pub(super) fn cell(
        &self,
        cell: Rect,
        tile: Rect,
        pieces: &Pieces,
        planes: &Planes,
        (layers, doubt, open): (&[&Layer], &[f32], &[f32]),
        film: &mut [f32],
        s: &mut CellScratch,
    ) {
        let n = cell.size().pixels();
        let all = (pieces.pieces.len() + 1) * n;
        for (plane, value) in [(&mut s.passing, 1.0), (&mut s.light, 0.0)] {
            resize_exact(plane, all);
            plane.fill(value);
        }
        s.free.extend(s.near.drain(..).map(|(_, share)| share));
        for (i, layer) in layers.iter().enumerate() {
            let slab = &planes.slabs[layer.plane];
            while s.near.first().is_some_and(|(near, _)| self.slabs.apart(slab.slab, *near)) {
                s.free.push(s.near.remove(0).1);
            }
            if !self.see(layer.plane, cell, pieces, planes, s) {
                continue;
            }
            resize_exact(&mut s.before, all);
            s.before.fill(0.0);
            for (_, share) in &s.near {
                s.before.iter_mut().zip(share).for_each(|(sum, a)| *sum += a);
            }
            let gain = layer.gain.as_ref().map(|gain| part_of_tile(gain, tile, cell));
            pass(n, gain.as_deref(), s);
            let next = layers.get(i + 1).map(|next| planes.slabs[next.plane].slab);
            if next.is_some_and(|next| !self.slabs.apart(next, slab.slab)) {
                let mut kept = s.free.pop().unwrap_or_default();
                std::mem::swap(&mut kept, &mut s.seen.share);
                s.near.push((slab.slab, kept));
            }
        }
        complete(n, &part_of_tile(open, tile, cell), &s.passing, &mut s.light);
        let (of_pieces, of_means) = s.light.split_at(all - n);
        let mut change: Vec<f32> = of_means.iter().map(|v| -v).collect();
        pieces.add_mean(of_pieces, &mut change);
        for_each_row(tile, cell, |i, k, width| {
            let doubt = &doubt[i..i + width];
            let change = change[k..k + width].iter().zip(doubt).map(|(v, doubt)| v * (1.0 - doubt).max(0.0));
            // The film does not become darker than black.
            std::iter::zip(&mut film[i..i + width], change)
                .for_each(|(film, v)| *film = (*film + v).max(film.min(0.0)));
        });
    }

    /// Share and light of the slab at `plane` as every piece sees it, and their means, into `seen`; whether it has pixels in reach.
    fn see(&self, plane: usize, cell: Rect, pieces: &Pieces, planes: &Planes, s: &mut CellScratch) -> bool {
        let slab = &planes.slabs[plane];
        let (low, high) = self.slabs.ends(slab.slab);
        let scale = self.slabs.blur_px(slab.slab) / pieces.blur_px.abs();
        let around = (pieces.farthest_px() * scale).ceil() as usize + 1;
        let area = cell.grown(around + Disc::new(pieces.radius_px * scale).reach());
        let Some((first, last)) = positions(slab, planes, area) else { return false };
        let (n, all) = (cell.size().pixels(), (pieces.pieces.len() + 1) * cell.size().pixels());
        for plane in [&mut s.seen.share, &mut s.seen.light] {
            resize_exact(plane, all);
            plane.fill(0.0);
        }
        let has_slope = slopes(self.slabs, planes, plane, area, &mut s.slope);
        let within = low + f64::from(first) * (high - low);
        let one: &dyn Fn(usize) -> f32 = &|_| 1.0;
        let two: [(f64, &dyn Fn(usize) -> f32); 2] =
            [(low, &|i| 1.0 - slab.position(i)), (high, &|i| slab.position(i))];
        let terms = if last - first < ONE_POSITION { &[(within, one)][..] } else { &two[..] };
        let view = |at: f64| self.view(self.slabs.blur_at(at), cell, area, pieces);
        let views: Vec<_> = terms.iter().map(|(at, part)| (view(*at), part)).collect();
        let CellScratch { seen, slope, filter, .. } = s;
        for (view, part) in &views {
            view.add(slab, planes, |_, i| part(i), |_| 1.0, seen, filter);
        }
        for plane in [&mut seen.share, &mut seen.light] {
            let (of_pieces, mean) = plane.split_at_mut(all - n);
            pieces.add_mean(of_pieces, mean);
        }
        if has_slope {
            for (view, part) in &views {
                let per_px = 1.0 / pieces.blur_px;
                view.add(slab, planes, |k, i| part(i) * slope.y[k], |d| (d.0 * per_px) as f32, seen, filter);
                view.add(slab, planes, |k, i| part(i) * slope.x[k], |d| (d.1 * per_px) as f32, seen, filter);
            }
            // What faces away from a piece it does not see.
            for (share, light) in std::iter::zip(&mut seen.share[..all - n], &mut seen.light) {
                if *share <= 0.0 {
                    (*share, *light) = (0.0, 0.0);
                }
            }
        }
        true
    }

    /// How `pieces` see what has blur radius `blur_px` in `area`, from `cell`.
    fn view<'a>(&self, blur_px: f64, cell: Rect, area: Rect, pieces: &'a Pieces) -> View<'a> {
        let scale = blur_px / pieces.blur_px;
        let disc = Disc::new(pieces.radius_px * scale.abs());
        let most_px = (self.margin as f64 - disc.reach() as f64 - 1.0).max(0.0);
        View { cell, area, pieces, scale, disc, most_px, simd: self.shape.simd }
    }
}

/// How pieces see a distance.
struct View<'a> {
    cell: Rect,
    area: Rect,
    pieces: &'a Pieces,
    /// ρ_s/ρ_w.
    scale: f64,
    disc: Disc,
    /// Offsets are not larger: the planes end there, px.
    most_px: f64,
    simd: Simd,
}

impl View<'_> {
    /// From a film point to what the piece with centroid `d` sees of it, (y, x) px.
    fn offset(&self, d: (f64, f64)) -> (f64, f64) {
        let of = |d: f64| (-self.scale * d).clamp(-self.most_px, self.most_px);
        (of(d.0), of(d.1))
    }

    /// Adds share and light of `slab`, times `weight` (by index in the area and in the planes) and the `factor` of a piece with a centroid, to `seen`.
    fn add(
        &self,
        slab: &SlabPlanes,
        planes: &Planes,
        weight: impl Fn(usize, usize) -> f32,
        factor: impl Fn((f64, f64)) -> f32,
        seen: &mut Seen,
        s: &mut Filter,
    ) {
        let (cell, area, from) = (self.cell, self.area, planes.rect.expect("computed before"));
        let width = area.width - 2 * self.disc.reach();
        let (y, x) = ((cell.y - area.y) as f64, (cell.x - area.x) as f64);
        let inside = (y - self.disc.reach() as f64, x - self.disc.reach() as f64);
        for (plane, to) in [(&slab.a, &mut seen.share), (&slab.c, &mut seen.light)] {
            s.source.clear();
            for y in area.y..area.bottom() {
                let row = (y.clamp(from.y, from.bottom() - 1) - from.y) as usize * from.width;
                for x in area.x..area.right() {
                    let i = row + (x.clamp(from.x, from.right() - 1) - from.x) as usize;
                    s.source.push(slab.at(plane, i) * weight(s.source.len(), i));
                }
            }
            self.disc.mean(&s.source, area.width, &mut s.mean, &mut s.sums, self.simd);
            for ((_, d), to) in self.pieces.pieces.iter().zip(to.chunks_exact_mut(cell.size().pixels())) {
                let (y, x) = self.offset(*d);
                let at = (inside.0 + y, inside.1 + x);
                AddLinear { from: &s.mean, stride: width, at, factor: factor(*d), width: cell.width, to }
                    .run_unfused(self.simd);
            }
        }
    }
}

/// Adds `factor` times `from`, rows of `stride` pixels, from (y, x) on, between pixels, to the rows of `width` pixels of `to`.
struct AddLinear<'a> {
    from: &'a [f32],
    stride: usize,
    at: (f64, f64),
    factor: f32,
    width: usize,
    to: &'a mut [f32],
}

impl<V: Lanes> SimdOp<V> for AddLinear<'_> {
    #[inline(always)]
    fn run(self) {
        let Self { from, stride, at: (y, x), factor, width, to } = self;
        let (row, column) = (y.floor() as usize, x.floor() as usize);
        let (fy, fx) = ((y - y.floor()) as f32, (x - x.floor()) as f32);
        let weights =
            [(1.0 - fy) * (1.0 - fx), (1.0 - fy) * fx, fy * (1.0 - fx), fy * fx].map(|w| w * factor);
        for (i, to) in to.chunks_exact_mut(width).enumerate() {
            let [upper, lower] = [0, 1].map(|k| &from[(row + i + k) * stride + column..][..width + 1]);
            for (j, to) in to.iter_mut().enumerate() {
                *to += weights[0] * upper[j]
                    + weights[1] * upper[j + 1]
                    + weights[2] * lower[j]
                    + weights[3] * lower[j + 1];
            }
        }
    }
}

/// First and last position in the slab of the pixels of `rect` that it has; `None`: none.
fn positions(slab: &SlabPlanes, planes: &Planes, rect: Rect) -> Option<(f32, f32)> {
    let from = planes.rect.expect("computed before");
    let part = rect.intersect(slab.rows_of(from));
    if part.is_empty() {
        return None;
    }
    let mut ends = (f32::INFINITY, f32::NEG_INFINITY);
    for_each_row(from, part, |first, _, width| {
        for i in (first..first + width).filter(|&i| slab.at(&slab.a, i) > 0.0) {
            let t = slab.position(i);
            ends = (ends.0.min(t), ends.1.max(t));
        }
    });
    (ends.0 <= ends.1).then_some(ends)
}

/// The pixels of `cell` of a plane of `tile`.
fn part_of_tile(plane: &[f32], tile: Rect, cell: Rect) -> Vec<f32> {
    let mut part = vec![0.0; cell.size().pixels()];
    copy_part(tile, cell, plane, &mut part);
    part
}

/// Makes what is known stand for all where `composite` leaves nothing `open`: a piece may look between two parts of a surface, where it is not known. A
/// piece that sees next to nothing gets the mean.
fn complete(n: usize, open: &[f32], passing: &[f32], light: &mut [f32]) {
    let (pieces, mean) = light.split_at_mut(light.len() - n);
    let (of_pieces, of_mean) = passing.split_at(pieces.len());
    let share = |i: usize| (1.0 - open[i] / OPEN).clamp(0.0, 1.0);
    for i in 0..n {
        mean[i] += share(i) * of_mean[i] * mean[i] / (1.0 - of_mean[i]).max(FEW);
    }
    for (light, passing) in std::iter::zip(pieces.chunks_exact_mut(n), of_pieces.chunks_exact(n)) {
        for i in 0..n {
            let seen = 1.0 - passing[i];
            light[i] += share(i) * passing[i] * (light[i] + FEW * mean[i]) / (seen + FEW);
        }
    }
}

/// Adds the light of the present slab that passes those in front, of each piece of `n` pixels and of the means.
fn pass(n: usize, gain: Option<&[f32]>, s: &mut CellScratch) {
    let seen = std::iter::zip(s.seen.share.chunks_exact(n), s.seen.light.chunks_exact(n));
    let film = std::iter::zip(s.passing.chunks_exact_mut(n), s.light.chunks_exact_mut(n));
    for (((passing, light), (share, c)), before) in film.zip(seen).zip(s.before.chunks_exact(n)) {
        for i in 0..n {
            let g = gain.map_or(1.0, |gain| gain[i]);
            let of_pupil = (1.0 - before[i]).max(share[i]).max(FLOOR);
            let part = passing[i] * g / of_pupil;
            // No more than what passes.
            let part = if part * share[i] > passing[i] { passing[i] / share[i] } else { part };
            light[i] += part * c[i];
            passing[i] = (passing[i] - part * share[i]).max(0.0);
        }
    }
}
