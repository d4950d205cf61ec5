//! Pixels whose samples all see the same triangles in the same order: their surfaces are found once, and a sheet is one triangle with all
//! samples. Most pixels are of this kind; the sheets are those of [`super::pixel`].

use super::renderer::{Output, Pass, Pixel, Renderer, store};
use super::settings::MAX_SHEETS;
use crate::scene::shading::SampleHit;
use crate::scene::visibility::raster::RowHits;
use crate::scene::visibility::surfaces::{Sample, hit, surfaces};
use crate::scene::visibility::tile::TileScene;

/// Sheets of such a pixel: layer of the hits, and sum of the vergences.
#[derive(Clone, Copy, Default)]
struct Layers {
    of: [(usize, f64); MAX_SHEETS],
    sheets: usize,
}

impl Renderer<'_> {
    /// Makes the sheets of pixel `at` of the tile; false, with nothing written, if it is not of this kind. `only_first`: the hits are the nearest of
    /// each sample, which are surfaces.
    #[inline]
    pub(super) fn make_uniform(
        &self,
        scene: &mut TileScene,
        hits: &RowHits,
        column: usize,
        pixel: &mut Pixel,
        (at, pass, only_first): (usize, Pass, bool),
        output: &mut Output,
    ) -> bool {
        let samples = self.places.len();
        // A power of two: a product with it has the bits of the quotient.
        let share = 1.0 / samples as f64;
        if !hits.are_equal(samples, column) {
            return false;
        }
        pixel.layers.clear();
        if only_first {
            // The nearest hit is a surface.
            pixel.layers.push(0);
        } else {
            let (x, y) = scene.direction(0, column);
            let sample = Sample { sample: 0, samples, x, y, nearest: self.nearest };
            let mut layer = 0;
            surfaces(scene.solids(), hits.of(0, column), sample, self.shader, |_, number| {
                // Surfaces are hits in their order.
                while hits.hit(0, column, layer).1.number() != number {
                    layer += 1;
                }
                pixel.layers.push(layer);
            });
        }
        let sheets = if pass == Pass::Front { 1 } else { self.settings.sheets };
        let Some(layers) = self.layers(hits, column, &pixel.layers, sheets) else { return false };
        let first = usize::from(pass == Pass::Hidden);
        for (q, &(layer, sum)) in layers.of[..layers.sheets].iter().enumerate() {
            let t = scene.triangle(hits.hit(0, column, layer).1.number());
            if q > 0 {
                output.counts.hidden_samples += samples as u64;
                output.counts.hidden_back_samples +=
                    if t.solid == u32::MAX && !t.is_front { samples as u64 } else { 0 };
            }
            let Some(to) = q.checked_sub(first).and_then(|q| output.sheets.get_mut(q)) else { continue };
            pixel.hits.clear();
            for i in 0..samples {
                let (x, y) = scene.direction(i, column);
                let sample = Sample { sample: i, samples, x, y, nearest: self.nearest };
                pixel.hits.push(hit(&t.edges, hits.hit(i, column, layer).0, sample));
            }
            pixel.sums.clear();
            pixel.sums.resize(self.shader.bases(), 0.0);
            self.shader.add_weights(t.triangle, &pixel.hits, &mut pixel.sums);
            store(to, at, (sum * share, 1.0), &pixel.sums, |sum| sum * share);
            if q == 0 {
                output.vergence[at] = (sum * share) as f32;
                self.count_near(&pixel.hits, t.triangle, output);
            }
        }
        true
    }

    /// Layers that are sheets, of the layers of surfaces; `None` if the samples differ.
    #[inline]
    fn layers(&self, hits: &RowHits, column: usize, surfaces: &[usize], sheets: usize) -> Option<Layers> {
        let (samples, gap) = (self.places.len(), self.settings.gap_dioptre);
        let mut layers = Layers::default();
        let mut rest = surfaces;
        while let (Some((&layer, behind)), true) = (rest.split_first(), layers.sheets < sheets) {
            let (mut near, mut far, mut sum) = (f64::NEG_INFINITY, f64::INFINITY, 0.0);
            for i in 0..samples {
                let v = hits.hit(i, column, layer).0;
                near = if v > near { v } else { near };
                far = if v < far { v } else { far };
                sum += v;
            }
            if near - far > gap {
                return None;
            }
            layers.of[layers.sheets] = (layer, sum);
            layers.sheets += 1;
            rest = behind;
            // Surfaces up to the gap behind are of this sheet.
            while let (Some((&other, behind)), true) = (rest.split_first(), layers.sheets < sheets) {
                let is_near = |i: usize| hits.hit(i, column, layer).0 - hits.hit(i, column, other).0 <= gap;
                let count = (0..samples).filter(|&i| is_near(i)).count();
                if count == 0 {
                    break;
                }
                if count < samples {
                    return None;
                }
                rest = behind;
            }
        }
        Some(layers)
    }

    /// Counts the samples of one triangle that are too near.
    #[inline]
    fn count_near(&self, hits: &[SampleHit], triangle: u32, output: &mut Output) {
        let nearest = hits.iter().fold(0.0, |v: f64, hit| v.max(hit.vergence));
        if nearest * self.settings.near_m > 1.0 {
            let is_near = |hit: &&SampleHit| hit.vergence * self.settings.near_m > 1.0;
            output.counts.near_samples += hits.iter().filter(is_near).count() as u64;
        }
        output.counts.find_nearest(nearest, triangle);
    }
}
