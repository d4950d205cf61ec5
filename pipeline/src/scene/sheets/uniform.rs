//! Pixels whose samples all have the same surfaces in number, none of them far from those of the other samples: a sheet is one layer of hits, with all
//! samples. Most pixels are of this kind; the sheets are those of [`super::pixel`].

use super::renderer::{Output, Pass, Pixel, Renderer, store};
use super::tile::Sheet;
use crate::scene::visibility::raster::{Label, PixelLayer, RowHits};
use crate::scene::visibility::surfaces::{Sample, hit, surfaces};
use crate::scene::visibility::tile::{Kept, TileScene};

/// A layer of hits and its number.
pub(super) type NumberedLayer = (usize, PixelLayer);

/// The next surface of all samples.
enum Next {
    /// Each has one.
    Layer(NumberedLayer),
    /// None has one.
    End,
    /// Some have one.
    Partial,
}

/// A layer of the pixel at a column, whose groups have `least` to `most` layers.
#[inline(always)]
fn next_layer(hits: &RowHits, column: usize, layer: usize, (least, most): (usize, usize)) -> Next {
    if layer >= least {
        return if layer >= most { Next::End } else { Next::Partial };
    }
    let of = hits.layer(column, layer);
    match of.is_full() {
        true => Next::Layer((layer, of)),
        // Of one sample a pixel, a group has other pixels.
        false => {
            if of.near == 0.0 {
                Next::End
            } else {
                Next::Partial
            }
        }
    }
}

/// Pixels of a tile whose sheets are made.
#[derive(Clone, Copy)]
pub(super) struct Kind {
    /// Which sheets.
    pub(super) pass: Pass,
    /// Hits that are known; the nearest of each sample are surfaces.
    pub(super) kept: Kept,
}

impl Renderer<'_> {
    /// Makes the sheets of pixel `at` of the tile; false, with nothing written, if it is not of this kind.
    #[inline]
    pub(super) fn make_uniform(
        &self,
        scene: &mut TileScene,
        hits: &RowHits,
        (at, column): (usize, usize),
        pixel: &mut Pixel,
        kind: Kind,
        output: &mut Output,
    ) -> bool {
        let first = hits.layer(column, 0);
        if first.near == 0.0 {
            return self.settings.background.is_none();
        }
        let gap = self.settings.gap_dioptre;
        if kind.kept == Kept::Nearest {
            if !first.is_full() || first.near - first.far > gap {
                return false;
            }
            self.make_sheet(scene, hits, (at, column), (0, &first), pixel, &mut output.sheets[0]);
            self.add_front(scene, hits, column, (0, &first), at, output);
            return true;
        }
        let (least, most) = hits.depth(column);
        // One surface behind which there is none.
        if kind.pass == Pass::Hidden && most <= 1 && first.near - hits.farthest_first(column) <= gap {
            return true;
        }
        let sheets = if kind.pass == Pass::Front { 1 } else { self.settings.sheets };
        let is_listed = !scene.solids().0.is_empty();
        if is_listed && !self.find_layers(scene, hits, column, pixel, (least, most)) {
            return false;
        }
        if !self.find_sheets(hits, (column, (least, most)), is_listed, pixel, sheets) {
            return false;
        }
        let first = usize::from(kind.pass == Pass::Hidden);
        for q in 0..pixel.sheet_layers.len() {
            let (number, layer) = pixel.sheet_layers[q];
            let of = (number, &layer);
            if q > 0 {
                self.count_layer(scene, hits, column, of, output);
            }
            let Some(to) = q.checked_sub(first).and_then(|q| output.sheets.get_mut(q)) else { continue };
            self.make_sheet(scene, hits, (at, column), of, pixel, to);
            if q == 0 {
                self.add_front(scene, hits, column, of, at, output);
            }
        }
        true
    }

    /// The layers of a pixel and which of them are surfaces; false if that differs between samples.
    #[inline]
    fn find_layers(
        &self,
        scene: &mut TileScene,
        hits: &RowHits,
        column: usize,
        pixel: &mut Pixel,
        depth: (usize, usize),
    ) -> bool {
        pixel.layers.clear();
        let mut is_of_one_triangle = true;
        loop {
            match next_layer(hits, column, pixel.layers.len(), depth) {
                Next::Layer((_, layer)) if layer.is_of_one_solid_bit() => {
                    is_of_one_triangle &= layer.is_of_one_triangle();
                    pixel.layers.push(layer);
                }
                Next::End => break,
                Next::Layer(_) | Next::Partial => return false,
            }
        }
        let (solids, triangles) = scene.solids();
        if !is_of_one_triangle && !solids.are_solid(pixel.layers.iter().map(|layer| layer.label)) {
            return false;
        }
        pixel.surface_layers.clear();
        // Without alpha no direction is used.
        let sample = Sample { sample: 0, samples: self.places.len(), x: 0.0, y: 0.0, nearest: self.nearest };
        let first_hits = pixel.layers.iter().map(|layer| (layer.near, layer.label));
        let mut layer = 0;
        surfaces((solids, triangles), first_hits, sample, self.shader, |_, number| {
            // Surfaces are hits in their order.
            while pixel.layers[layer].label.number() != number {
                layer += 1;
            }
            pixel.surface_layers.push(layer);
        });
        true
    }

    /// Finds the layers that are sheets, of the layers of surfaces: those that are listed, or all; false if the samples differ.
    #[inline(always)]
    fn find_sheets(
        &self,
        hits: &RowHits,
        (column, depth): (usize, (usize, usize)),
        is_listed: bool,
        pixel: &mut Pixel,
        sheets: usize,
    ) -> bool {
        let (samples, gap) = (self.places.len(), self.settings.gap_dioptre);
        let Pixel { layers, surface_layers, sheet_layers, .. } = pixel;
        sheet_layers.clear();
        let surface = |k: usize| match (is_listed, surface_layers.get(k)) {
            (false, _) => next_layer(hits, column, k, depth),
            (true, Some(&layer)) => Next::Layer((layer, layers[layer])),
            (true, None) => Next::End,
        };
        let mut k = 0;
        let mut found = surface(0);
        loop {
            let (layer, of) = match found {
                Next::Layer(layer) => layer,
                Next::End => return true,
                Next::Partial => return false,
            };
            if of.near - of.far > gap {
                return false;
            }
            sheet_layers.push((layer, of));
            if sheet_layers.len() == sheets {
                return true;
            }
            // Surfaces up to the gap behind are of this sheet.
            loop {
                k += 1;
                found = surface(k);
                let Next::Layer((other, behind)) = found else { break };
                if of.far - behind.near > gap {
                    break;
                }
                let is_near =
                    |i: &usize| hits.hit(*i, column, layer).0 - hits.hit(*i, column, other).0 <= gap;
                match (0..samples).filter(is_near).count() {
                    0 => break,
                    n if n < samples => return false,
                    _ => {}
                }
            }
        }
    }

    /// Calls `found` with each triangle of a layer, in the order of their first samples, and its samples as bits.
    #[inline(always)]
    fn each_triangle(
        &self,
        hits: &RowHits,
        column: usize,
        (number, layer): (usize, &PixelLayer),
        mut found: impl FnMut(Label, u64),
    ) {
        let mut left = u64::MAX >> (64 - self.places.len());
        if layer.is_of_one_triangle() {
            found(layer.label, left);
            return;
        }
        while left != 0 {
            let label = hits.hit(left.trailing_zeros() as usize, column, number).1;
            let mut of_it = 0;
            for i in bits(left) {
                of_it |= u64::from(hits.hit(i, column, number).1 == label) << i;
            }
            found(label, of_it);
            left &= !of_it;
        }
    }

    /// Writes the sheet of a layer.
    #[inline(always)]
    fn make_sheet(
        &self,
        scene: &TileScene,
        hits: &RowHits,
        (at, column): (usize, usize),
        layer: (usize, &PixelLayer),
        pixel: &mut Pixel,
        to: &mut Sheet,
    ) {
        let samples = self.places.len();
        // A power of two: a product with it has the bits of the quotient.
        let share = 1.0 / samples as f64;
        let means = (layer.1.sum * share, 1.0);
        let even = scene.even_weights();
        if let (Some((_, of_pixel)), true) = (even, layer.1.is_of_one_triangle()) {
            let weights = &of_pixel[layer.1.label.number() as usize * self.bases..][..self.bases];
            store(to, at, means, weights.iter().copied());
            return;
        }
        let Pixel { hits: of_triangle, sums, .. } = pixel;
        sums.clear();
        sums.resize(self.bases, 0.0);
        match even {
            Some((weights, _)) => self.each_triangle(hits, column, layer, |label, of_it| {
                let count = f64::from(of_it.count_ones());
                let of_one = &weights[label.number() as usize * self.bases..][..self.bases];
                sums.iter_mut().zip(of_one).for_each(|(sum, w)| *sum += w * count);
            }),
            None => self.each_triangle(hits, column, layer, |label, of_it| {
                let t = scene.triangle(label.number());
                of_triangle.clear();
                of_triangle.extend(bits(of_it).map(|i| {
                    let (x, y) = scene.direction(i, column);
                    let sample = Sample { sample: i, samples, x, y, nearest: self.nearest };
                    hit(&t.edges, hits.hit(i, column, layer.0).0, sample)
                }));
                self.shader.add_weights(t.triangle, of_triangle, sums);
            }),
        }
        store(to, at, means, sums.iter().map(|sum| (sum * share) as f32));
    }

    /// Vergence and near samples of a layer that is sheet 0.
    #[inline(always)]
    fn add_front(
        &self,
        scene: &TileScene,
        hits: &RowHits,
        column: usize,
        (number, layer): (usize, &PixelLayer),
        at: usize,
        output: &mut Output,
    ) {
        let samples = self.places.len();
        output.vergence[at] = (layer.sum * (1.0 / samples as f64)) as f32;
        let is_near = |i: &usize| hits.hit(*i, column, number).0 * self.settings.near_m > 1.0;
        if layer.near * self.settings.near_m > 1.0 {
            output.counts.near_samples += (0..samples).filter(is_near).count() as u64;
        }
        if output.counts.nearest.is_some_and(|(v, _)| v > layer.near) {
            return;
        }
        for i in 0..samples {
            let (vergence, label) = hits.hit(i, column, number);
            if vergence == layer.near {
                output.counts.find_nearest(vergence, scene.triangle(label.number()).triangle);
            }
        }
    }

    /// Counts the samples of a hidden sheet.
    #[inline]
    fn count_layer(
        &self,
        scene: &TileScene,
        hits: &RowHits,
        column: usize,
        layer: (usize, &PixelLayer),
        output: &mut Output,
    ) {
        self.each_triangle(hits, column, layer, |label, of_it| {
            let t = scene.triangle(label.number());
            let count = u64::from(of_it.count_ones());
            output.counts.hidden_samples += count;
            output.counts.hidden_back_samples += if t.solid == u32::MAX && !t.is_front { count } else { 0 };
        });
    }
}

/// Numbers of the bits that are set.
fn bits(mut set: u64) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let first = set.trailing_zeros() as usize;
        set &= set.wrapping_sub(1);
        (first < 64).then_some(first)
    })
}
