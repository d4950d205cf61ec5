//! Which hits of a sample are surfaces.
//!
//! A pupil sees around the rim of an object what lies behind the object, never its inside. So a hit is a surface if every solid has been
//! crossed an even number of times before it. From a camera outside a solid is crossed an even number of times in all, from inside an odd
//! number; in a sample where that is wrong (rounding at a corner) it is not solid. A camera inside sees the first crossing only: the inside of
//! the solid is where it looks, and what lies behind the crossing does not exist.
//! Not solid: the back of a one-sided material does not exist, nor a hit at which the shader has no surface (alpha).
//! A hit nearer than the limit, if there is one, is no surface, but it crosses its solid.

use super::raster::{Label, TileTriangle};
use super::triangle::Edges;
use crate::scene::mesh::{Mesh, NOT_SOLID};
use crate::scene::shading::{SampleHit, Shader};

/// The solids of a tile, numbered by their first triangle in it.
#[derive(Default)]
pub(crate) struct TileSolids {
    /// (number in the mesh, number in the tile), sorted.
    numbers: Vec<(u32, u32)>,
    /// Last solid found, as solids are contiguous in most files.
    last: Option<(u32, u32)>,
    around_camera: Vec<bool>,
    /// Bits ([`Label::solid_bit`]) of those that contain the camera.
    around_bits: u64,
    /// Whether a solid has no bit, or a triangle has alpha.
    is_general: bool,
    /// Whether the number of crossings is odd: in all, and so far.
    odd: Vec<bool>,
    is_inside: Vec<bool>,
}

impl TileSolids {
    /// Removes all.
    pub(crate) fn clear(&mut self) {
        self.numbers.clear();
        self.last = None;
        self.around_camera.clear();
        self.around_bits = 0;
        self.is_general = false;
        self.odd.clear();
        self.is_inside.clear();
    }

    /// Whether the tile has none.
    pub(crate) fn is_empty(&self) -> bool {
        self.numbers.is_empty()
    }

    /// Says that a triangle of the tile has alpha.
    pub(crate) fn add_alpha(&mut self) {
        self.is_general = true;
    }

    /// Whether in a sample with hits of these labels all solids are solid, and neither alpha nor the number of solids make a difference.
    #[inline(always)]
    pub(crate) fn are_solid(&self, labels: impl Iterator<Item = Label>) -> bool {
        let (mut odd, mut crossed) = (0, 0);
        for label in labels {
            odd ^= label.solid_bit();
            crossed |= label.solid_bit();
        }
        !self.is_general && (odd ^ self.around_bits) & crossed == 0
    }

    /// Number in the tile of the solid of a triangle; `u32::MAX` if it has none.
    pub(crate) fn number(&mut self, mesh: &Mesh, triangle: u32) -> u32 {
        let solid = mesh.solid(triangle);
        if solid == NOT_SOLID {
            return u32::MAX;
        }
        if let Some((_, number)) = self.last.filter(|last| last.0 == solid) {
            return number;
        }
        let number = match self.numbers.binary_search_by_key(&solid, |n| n.0) {
            Ok(at) => self.numbers[at].1,
            Err(at) => {
                let number = self.numbers.len() as u32;
                self.numbers.insert(at, (solid, number));
                let is_around = mesh.is_around_camera(solid);
                self.around_camera.push(is_around);
                self.is_general |= number >= Label::LAST;
                self.around_bits |= if is_around { Label::new(0, number).solid_bit() } else { 0 };
                self.odd.push(false);
                self.is_inside.push(false);
                number
            }
        };
        self.last = Some((solid, number));
        number
    }
}

/// A sample of a pixel.
#[derive(Clone, Copy)]
pub(crate) struct Sample {
    /// Its number in the pixel, and the number of samples.
    pub(crate) sample: usize,
    /// Samples of a pixel.
    pub(crate) samples: usize,
    /// Direction.
    pub(crate) x: f64,
    /// Its y.
    pub(crate) y: f64,
    /// Hits of a larger vergence are no surfaces, 1/m.
    pub(crate) nearest: f64,
}

/// Calls `found` with the vergence and number in the tile of each surface, the nearest first.
#[inline(always)]
pub(crate) fn surfaces(
    (solids, triangles): (&mut TileSolids, &[TileTriangle]),
    hits: impl Iterator<Item = (f64, Label)> + Clone,
    sample: Sample,
    shader: &dyn Shader,
    mut found: impl FnMut(f64, u32),
) {
    if solids.are_solid(hits.clone().map(|(_, label)| label)) {
        let mut inside = 0;
        for (vergence, label) in hits {
            if inside == 0 && vergence <= sample.nearest {
                found(vergence, label.number());
            }
            inside ^= label.solid_bit();
        }
        return;
    }
    general((solids, triangles), hits, sample, shader, found);
}

/// [`surfaces`] with alpha, any number of solids, and solids that are not solid in the sample.
#[cold]
fn general(
    (solids, triangles): (&mut TileSolids, &[TileTriangle]),
    hits: impl Iterator<Item = (f64, Label)> + Clone,
    sample: Sample,
    shader: &dyn Shader,
    mut found: impl FnMut(f64, u32),
) {
    let crossings =
        || hits.clone().map(|(_, label)| triangles[label.number() as usize].solid).filter(|&s| s != u32::MAX);
    crossings().for_each(|solid| solids.odd[solid as usize] ^= true);
    let mut inside = 0;
    for (vergence, label) in hits.clone() {
        let t = &triangles[label.number() as usize];
        let solid = t.solid as usize;
        let is_solid = t.solid != u32::MAX && solids.odd[solid] == solids.around_camera[solid];
        let is_visible = inside == 0 && vergence <= sample.nearest;
        if is_solid {
            solids.is_inside[solid] ^= true;
            inside = if solids.is_inside[solid] { inside + 1 } else { inside - 1 };
        } else if t.is_one_sided && !t.is_front {
            continue;
        }
        if is_visible
            && (!t.has_alpha || shader.exists(t.triangle, &hit(&t.edges, vergence, sample), sample.samples))
        {
            found(vergence, label.number());
        }
    }
    crossings().for_each(|solid| {
        solids.odd[solid as usize] = false;
        solids.is_inside[solid as usize] = false;
    });
}

/// A hit as shaders see it.
#[inline]
pub(crate) fn hit(edges: &Edges, vergence: f64, sample: Sample) -> SampleHit {
    SampleHit {
        sample: sample.sample as u32,
        x: sample.x,
        y: sample.y,
        vergence,
        barycentric: edges.barycentric(sample.x, sample.y),
    }
}
