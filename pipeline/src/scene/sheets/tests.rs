//! Closed forms and invariants of visibility and sheets.

mod closed_forms;
mod film;
mod invariance;
mod limits;
mod rays;
mod rule;

use super::*;
use crate::scene::frame::{Frame, pattern};
use crate::scene::mesh::tests::{OPTIONS, Shape, flipped, icosphere, material, mesh, part, wall};
use crate::scene::mesh::{Mesh, MeshOptions};
use crate::scene::shading::{SampleHit, Shader};
use crate::scene::visibility::Engine;
use crate::scene::visibility::surfaces::surfaces;
use crate::scene::visibility::triangle::{Edges, along};

/// 1 mrad a pixel.
const FRAME: Frame = Frame::centred(64, 64, 0.05, 50.0);

/// Weight 1 of the basis of the part.
struct OfPart<'a>(&'a Mesh);

impl Shader for OfPart<'_> {
    fn bases(&self) -> usize {
        3
    }
    fn is_opaque(&self, _: u32) -> bool {
        true
    }
    fn exists(&self, _: u32, _: &SampleHit, _: usize) -> bool {
        true
    }
    fn add_weights(&self, triangle: u32, hits: &[SampleHit], sums: &mut [f64]) {
        sums[self.0.part_of(triangle).0 % 3] += hits.len() as f64;
    }
}

fn settings(samples: usize, sheets: usize) -> Settings {
    Settings { samples, sheets, gap_dioptre: 0.01, near_m: 0.0, is_near_cut: false, background: None }
}

fn render(mesh: &Mesh, frame: Frame, settings: Settings, tile: usize) -> (Front, Vec<Sheet>) {
    let shader = OfPart(mesh);
    let renderer = Renderer::new(mesh, frame, &shader, settings, Engine::detect()).unwrap();
    renderer.all(tile, &mut renderer.worker())
}

/// All hits of a ray among `triangles`, sorted, from the definition.
fn hits_of_ray(mesh: &Mesh, triangles: impl Iterator<Item = u32>, x: f64, y: f64) -> Vec<(f64, u32)> {
    let mut hits = Vec::new();
    for t in triangles.filter(|&t| !mesh.is_degenerate(t)) {
        let Some(e) = Edges::new(mesh.corners(t)) else { continue };
        let positive = [0, 1, 2].map(|k| along(&e.n[k], x, y) >= e.least[k]);
        let vergence = along(&e.plane, x, y) / e.offset;
        if (positive == [true; 3] || positive == [false; 3]) && vergence > 0.0 && vergence.is_finite() {
            hits.push((vergence, t));
        }
    }
    hits.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    hits
}

/// Numbers in 0…1 (xorshift64*).
struct Random(u64);

impl Random {
    fn next(&mut self) -> f64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        (self.0.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 11) as f64 / (1u64 << 53) as f64
    }

    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.next()
    }
}
