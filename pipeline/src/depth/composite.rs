//! Slabs of a tile to its film, the nearest first.
//!
//! With a ∗ the spatially variant sum of [`crate::psf`] with the kernels P_d of depth node d, and the planes a, c, m of [`super::scene`], t = m/a:
//!
//! ```text
//! b_s     = min(1, Σ_{k<s} a_k + uncovered)                               covered behind the slab
//! e_d     = 1 ∗ P_d                                                       1 − div(centroid of the PSFs)
//! light_s = ((1 − t) c) ∗ P_s + (t c) ∗ P_s+1
//! w_s     = (((1 − t) a) ∗ P_s)/e_s + ((t a) ∗ P_s+1)/e_s+1               share of the pupil that the slab covers
//! near_s  = slabs j > s that are not apart from s                         the same surface further on, as far as one can know
//! o_s     = max(0, 1 − a_s − Σ_near a_j)                                  neither the slab nor that surface
//! f_s     = min(b_s, o_s),   K = f_s ∗ P,   M = (o_s − f_s) ∗ P           of it known and missing behind the slab; P of its wider node
//! U_s     = max(w_s + min(2 K, max(0, 1 − w_s − Σ_near w_j) K/(K + M)), 10⁻³)     share of the pupil of which anything is known
//! film    = Σ_s T_s light_s/U_s,   T_s = Π_{j>s} (1 − w_j/U_j)            T: share of light that passes the slabs in front
//! ```
//! A ray that has passed slab s + 1 of a surface meets slab s of it: there U_s = 1 − w_s+1 and the two lights add, whatever is hidden behind.
//! Surfaces apart cover the pupil independently: U_s = 1. Where nothing else is known in reach K = 0 and U_s = w_s: what is known stands for all.
//! Light and shares are convolved separately, so the film is exact where one of two surfaces is in focus or the rear one is uniform; else a product of
//! means stands for the mean of a product over the pupil, which [`super::pieces`] corrects.
//! A tile with one slab that covers it completely has K = 0, so film = light/w, and w = 1 where t is constant. Where distances vary within the slab w is not
//! 1: 0.94 to 1.04 for stripes at both ends of a wide slab.
//! Executable form in f64: tests/golden/depth/depth_reference.py. "Over" with normalised alpha: Ikoma et al., "Depth from defocus with learned optics",
//! ICCP 2021.

mod convolve;

use super::counts::Counts;
use super::pieces::cell::{CellScratch, Correction};
use super::pieces::correction::may_need;
use super::pieces::edges::Edges;
use super::pieces::layer::{FLOOR, Layer};
use super::pieces::shape::Shape;
use super::planes::{Planes, SlabPlanes};
use super::slabs::Slabs;
use super::wanted::Wanted;
use crate::buffer::TileBuffer;
use crate::buffer::resize_exact;
use crate::geometry::{Frame, Rect};
use crate::psf::spectra::SpectrumCache;
use crate::psf::{BandPsf, PsfScratch};
use std::collections::BTreeMap;

/// K + M below this is rounding.
const NOTHING: f32 = 1e-9;

/// Buffers of one worker.
#[derive(Debug, Default)]
pub(super) struct CompositeScratch {
    psf: PsfScratch,
    source: Vec<f32>,
    scattered: TileBuffer,
    /// e of the nodes in use, and its blocks that have been added.
    ones: BTreeMap<usize, (Vec<f32>, Vec<bool>)>,
    /// Where the present slab is needed.
    wanted: Wanted,
    /// w of the slabs composited so far, by slab.
    shares: BTreeMap<usize, Vec<f32>>,
    /// Shares of all slabs behind the present one.
    behind: Vec<f32>,
    light: Vec<f32>,
    known: Vec<f32>,
    missing: Vec<f32>,
    opened: Vec<f32>,
    passing: Vec<f32>,
    free: Vec<Vec<f32>>,
    /// Whether the tile may need the correction of surfaces out of focus, and what that needs of the slabs composited so far.
    is_corrected: bool,
    edges: Edges,
    layers: Vec<Layer>,
    doubt: Vec<f32>,
    cell: CellScratch,
    counts: Counts,
}

/// What composites the tiles of one band.
pub(super) struct Composite<'a> {
    pub(super) frame: &'a Frame,
    pub(super) slabs: &'a Slabs,
    /// PSF stage of every node of the slabs that occur.
    pub(super) psfs: &'a [Option<BandPsf>],
    pub(super) spectra: &'a SpectrumCache,
    /// Shape of the pupil, for the correction of surfaces that are both out of focus; `None`: no correction.
    pub(super) shape: Option<&'a Shape>,
    /// Pixels around a tile that its planes have.
    pub(super) margin: usize,
}

impl Composite<'_> {
    /// The film of `tile` from `planes`, whose rectangle contains the tile grown by half the widest window, into `film` (row-major), and of it the invented
    /// light into `invented`: empty if there is none.
    pub(super) fn tile(
        &self,
        tile: Rect,
        planes: &Planes,
        film: &mut [f32],
        invented: &mut Vec<f32>,
        s: &mut CompositeScratch,
    ) {
        let n = tile.size().pixels();
        film.fill(0.0);
        invented.clear();
        s.counts = Counts { tiles: 1, slabs: planes.slabs.len() as u64, ..Counts::default() };
        s.psf.transforms = (0, 0);
        if planes.slabs.iter().any(|slab| !slab.invented.is_empty()) {
            invented.resize(n, 0.0);
        }
        s.reset(n, planes);
        if let [only] = &planes.slabs[..]
            && only.a.len() == planes.uncovered.len()
            && only.a.iter().all(|a| *a == 1.0)
        {
            self.light(only, &only.c, planes, tile, film, s);
            if only.m.iter().all(|m| *m == only.m[0]) {
                s.counts.blocks_of_one = self.blocks(only.slab, tile);
                return;
            }
            s.counts.blocks_of_several = self.blocks(only.slab, tile);
            let mut share = s.buffer(n);
            self.share(only, planes, tile, &mut share, s);
            film.iter_mut().zip(&share).for_each(|(film, w)| *film /= w.max(FLOOR));
            s.free.push(share);
            return;
        }
        s.passing.fill(1.0);
        s.is_corrected = self.shape.is_some() && may_need(self.slabs, planes);
        s.free.extend(s.layers.drain(..).filter_map(|layer| layer.gain));
        if s.is_corrected {
            s.edges.find(self.slabs, planes);
            s.is_corrected = !s.edges.is_empty();
        }
        if s.is_corrected {
            s.doubt.clear();
            s.doubt.resize(n, 0.0);
        }
        for (at, slab) in planes.slabs.iter().enumerate().rev() {
            s.counts.blocks_of_several += self.blocks(slab.slab, tile);
            slab.part_of(&mut s.behind).iter_mut().zip(&slab.a).for_each(|(behind, a)| *behind -= a);
            if self.slab(tile, planes, at, (film, invented), s) == 0.0 {
                break; // nothing behind is visible
            }
        }
        if let Some(shape) = self.shape.filter(|_| s.is_corrected) {
            let (frame, slabs, margin) = (self.frame, self.slabs, self.margin);
            let CompositeScratch { edges, layers, doubt, passing, cell, .. } = s;
            Correction { frame, slabs, shape, margin }.add(
                tile,
                (planes, edges),
                (layers, doubt, passing),
                film,
                cell,
            );
        }
    }

    fn psf(&self, node: usize) -> &BandPsf {
        self.psfs[node].as_ref().expect("a scene has surfaces in occupied slabs only")
    }

    /// FFT blocks of `tile` with the kernels of the wider node of slab `slab`.
    fn blocks(&self, slab: usize, tile: Rect) -> u64 {
        let psf = self.psf(self.slabs.wide(slab));
        let (rect, side) = (tile.grown(psf.margin()), psf.blocks().block);
        (rect.height.div_ceil(side) * rect.width.div_ceil(side)) as u64
    }

    /// Adds one slab to the film and its invented part; the largest T that remains.
    fn slab(
        &self,
        tile: Rect,
        planes: &Planes,
        at: usize,
        (film, invented): (&mut [f32], &mut [f32]),
        s: &mut CompositeScratch,
    ) -> f32 {
        let (slab, n) = (&planes.slabs[at], tile.size().pixels());
        let (low, high) = self.slabs.nodes(slab.slab);
        s.retire_ones(&[low, high]);
        let margin = self.psf(low).margin().max(self.psf(high).margin());
        let mut wanted = std::mem::take(&mut s.wanted);
        let rows = slab.rows_of(planes.rect.expect("computed before"));
        wanted.set(tile, &s.passing, rows, &slab.a, margin);
        s.wanted = wanted;
        let mut share = s.buffer(n);
        self.share(slab, planes, tile, &mut share, s);
        let mut light = std::mem::take(&mut s.light);
        self.light(slab, &slab.c, planes, tile, &mut light, s);
        let mut light_invented = s.buffer(n);
        if !slab.invented.is_empty() {
            self.light(slab, &slab.invented, planes, tile, &mut light_invented, s);
        }
        let near: Vec<usize> = (at + 1..planes.slabs.len())
            .take_while(|&j| !self.slabs.apart(slab.slab, planes.slabs[j].slab))
            .collect();
        // Slabs farther away have no other ones near them.
        let last = near.last().map_or(0, |&j| planes.slabs[j].slab);
        let retired = s.shares.split_off(&(last + 1));
        s.free.extend(retired.into_values());
        self.known_and_missing(slab, &near, planes, tile, s);
        let mut rest_of_pupil = s.buffer(n);
        rest_of_pupil.iter_mut().zip(&share).for_each(|(rest, w)| *rest = 1.0 - w);
        for w in near.iter().filter_map(|&j| s.shares.get(&planes.slabs[j].slab)) {
            rest_of_pupil.iter_mut().zip(w).for_each(|(rest, w)| *rest -= w);
        }
        // Of the pupil behind the slabs near this one, over what is known of it.
        let corrected = if s.is_corrected { n } else { 0 };
        let (mut gain, mut visible) = (s.buffer(corrected), s.buffer(corrected));
        gain.fill(1.0);
        visible.fill(0.0);
        let mut most = 0f32;
        for i in (0..n).filter(|&i| s.wanted.pixel(i)) {
            let (w, k, missing) = (share[i], s.known[i], s.missing[i]);
            let sum = k + missing;
            let known = if sum > NOTHING { k / sum } else { 0.0 };
            let rest = (2.0 * k).min(rest_of_pupil[i].max(0.0) * known).max(0.0);
            let u = (w + rest).max(FLOOR);
            film[i] += s.passing[i] * (light[i] / u);
            if !slab.invented.is_empty() {
                invented[i] += s.passing[i] * (light_invented[i] / u);
            }
            if let Some(gain) = gain.get_mut(i) {
                *gain = ((rest_of_pupil[i] + w).max(FLOOR) / u).max(1.0);
                visible[i] = s.passing[i] * w;
            }
            s.passing[i] *= 1.0 - w / u;
        }
        for (i, w) in share.iter_mut().enumerate() {
            // Where the slab is not needed its share is not complete.
            *w *= f32::from(u8::from(s.wanted.pixel(i)));
            most = most.max(s.passing[i].abs());
        }
        if s.is_corrected {
            s.layers.push(Layer::new(at, tile, &share, &visible, gain, &mut s.doubt));
        }
        s.light = light;
        s.free.extend([rest_of_pupil, light_invented, visible]);
        s.shares.insert(slab.slab, share);
        most
    }

    /// light_s of the light plane `c`.
    fn light(
        &self,
        slab: &SlabPlanes,
        c: &[f32],
        planes: &Planes,
        tile: Rect,
        to: &mut [f32],
        s: &mut CompositeScratch,
    ) {
        let (low, high) = self.slabs.nodes(slab.slab);
        let t = |i: usize| slab.position(i);
        to.fill(0.0);
        self.add_convolved(low, planes, tile, |i| slab.at(c, i) * (1.0 - t(i)), to, s);
        if high != low {
            self.add_convolved(high, planes, tile, |i| slab.at(c, i) * t(i), to, s);
        }
    }

    /// w_s.
    fn share(
        &self,
        slab: &SlabPlanes,
        planes: &Planes,
        tile: Rect,
        to: &mut [f32],
        s: &mut CompositeScratch,
    ) {
        let (low, high) = self.slabs.nodes(slab.slab);
        to.fill(0.0);
        for (node, of_high) in [(low, false), (high, true)] {
            if of_high && high == low {
                continue;
            }
            let part = |i: usize| {
                let m = slab.at(&slab.m, i);
                if of_high { m } else { slab.at(&slab.a, i) - m }
            };
            if (slab.first..slab.first + slab.a.len()).all(|i| part(i) == 0.0) {
                continue;
            }
            self.ones(node, planes, tile, s);
            if !self.spread(node, planes, tile, part, s) {
                continue;
            }
            let ones = s.ones.remove(&node).expect("computed above");
            self.add_scattered(node, tile, s, to, |to, v, i| {
                // Where the slab is not needed e may be 0.
                if s.wanted.pixel(i) {
                    *to += v / ones.0[i];
                }
            });
            s.ones.insert(node, ones);
        }
    }

    /// Computes e of `node` where it is needed, unless it is there.
    fn ones(&self, node: usize, planes: &Planes, tile: Rect, s: &mut CompositeScratch) {
        let (mut ones, mut done) = s.ones.remove(&node).unwrap_or_else(|| {
            let mut ones = s.buffer(tile.size().pixels());
            ones.fill(0.0);
            (ones, Vec::new())
        });
        let mut at = 0;
        let add = |is_wanted: bool| {
            done.resize(done.len().max(at + 1), false);
            let add = is_wanted && !done[at];
            done[at] |= add;
            at += 1;
            add
        };
        if self.spread_blocks(node, planes, tile, |_| 1.0, s, add) {
            self.add_scattered(node, tile, s, &mut ones, |to, v, _| *to += v);
        }
        s.ones.insert(node, (ones, done));
    }

    /// K and M of a slab, with the slabs `near` it.
    fn known_and_missing(
        &self,
        slab: &SlabPlanes,
        near: &[usize],
        planes: &Planes,
        tile: Rect,
        s: &mut CompositeScratch,
    ) {
        let node = self.slabs.wide(slab.slab);
        let mut opened = std::mem::take(&mut s.opened);
        opened.fill(1.0);
        for slab in std::iter::once(slab).chain(near.iter().map(|&j| &planes.slabs[j])) {
            slab.part_of(&mut opened).iter_mut().zip(&slab.a).for_each(|(o, a)| *o -= a);
        }
        opened.iter_mut().for_each(|o| *o = o.max(0.0));
        let behind = std::mem::take(&mut s.behind);
        let known_of = |i: usize| behind[i].clamp(0.0, 1.0).min(opened[i]);
        let (mut known, mut missing) = (std::mem::take(&mut s.known), std::mem::take(&mut s.missing));
        known.fill(0.0);
        missing.fill(0.0);
        self.add_convolved(node, planes, tile, known_of, &mut known, s);
        self.add_convolved(node, planes, tile, |i| opened[i] - known_of(i), &mut missing, s);
        (s.known, s.missing, s.behind, s.opened) = (known, missing, behind, opened);
    }
}

impl CompositeScratch {
    /// Counts of the tile that was composited last.
    pub(super) fn counts(&self) -> Counts {
        let (forward, inverse) = self.psf.transforms;
        Counts { forward, inverse, ..self.counts }
    }

    /// Buffers for a tile of `n` pixels.
    fn reset(&mut self, n: usize, planes: &Planes) {
        self.wanted.everywhere();
        let used = std::mem::take(&mut self.ones).into_values().map(|(ones, _)| ones);
        self.free.extend(used.chain(std::mem::take(&mut self.shares).into_values()));
        for plane in [&mut self.light, &mut self.known, &mut self.missing, &mut self.passing] {
            resize_exact(plane, n);
        }
        resize_exact(&mut self.opened, planes.uncovered.len());
        resize_exact(&mut self.behind, planes.uncovered.len());
        self.behind.copy_from_slice(&planes.uncovered);
        for slab in &planes.slabs {
            slab.part_of(&mut self.behind).iter_mut().zip(&slab.a).for_each(|(sum, a)| *sum += a);
        }
    }

    /// A buffer of `n` values.
    fn buffer(&mut self, n: usize) -> Vec<f32> {
        let mut buffer = self.free.pop().unwrap_or_default();
        resize_exact(&mut buffer, n);
        buffer
    }

    /// Keeps e of `nodes` only.
    fn retire_ones(&mut self, nodes: &[usize]) {
        let (keep, retired) =
            std::mem::take(&mut self.ones).into_iter().partition(|(node, _)| nodes.contains(node));
        self.ones = keep;
        let retired: BTreeMap<usize, (Vec<f32>, Vec<bool>)> = retired;
        self.free.extend(retired.into_values().map(|(ones, _)| ones));
    }
}
