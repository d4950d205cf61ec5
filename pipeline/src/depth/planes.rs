//! Planes of slabs on a film rectangle: share, light and position of every pixel.

use crate::geometry::Rect;
use crate::remap::resize_exact;

/// Planes of one slab, row-major.
#[derive(Debug, Default)]
pub(super) struct SlabPlanes {
    /// Index of the slab.
    pub(super) slab: usize,
    pub(super) a: Vec<f32>,
    pub(super) c: Vec<f32>,
    pub(super) m: Vec<f32>,
    /// The part of `c` that is invented ([`super::hidden`]); empty: none.
    pub(super) invented: Vec<f32>,
}

/// Planes of a film rectangle.
#[derive(Debug, Default)]
pub(super) struct Planes {
    pub(super) rect: Option<Rect>,
    /// The slabs with pixels in the rectangle, the farthest first.
    pub(super) slabs: Vec<SlabPlanes>,
    /// Share of each pixel that no sheet covers.
    pub(super) uncovered: Vec<f32>,
    pub(super) free: Vec<SlabPlanes>,
}

impl SlabPlanes {
    /// Of `n` pixels of slab `slab`, all 0, in the buffers `of`.
    pub(super) fn zeros(of: Option<Self>, slab: usize, n: usize) -> Self {
        let mut planes = of.unwrap_or_default();
        planes.slab = slab;
        for plane in [&mut planes.a, &mut planes.c, &mut planes.m] {
            resize_exact(plane, n);
            plane.fill(0.0);
        }
        planes.invented.clear();
        planes
    }

    pub(super) fn is_empty(&self) -> bool {
        self.a.iter().all(|a| *a == 0.0)
    }
}

impl Planes {
    /// Reduces all planes to `part` of their rectangle; slabs without pixels there are removed.
    pub(super) fn crop(&mut self, part: Rect) {
        let from = self.rect.replace(part).expect("computed before");
        let crop = |plane: &mut Vec<f32>| {
            for_each_row(from, part, |i, k, width| plane.copy_within(i..i + width, k));
            plane.truncate(part.size().pixels());
        };
        crop(&mut self.uncovered);
        for slab in &mut self.slabs {
            [&mut slab.a, &mut slab.c, &mut slab.m].into_iter().for_each(crop);
        }
        self.free.extend(self.slabs.extract_if(.., |slab| slab.is_empty()));
    }

    /// Adds the invented surfaces `added` of a slab.
    pub(super) fn add(&mut self, mut added: SlabPlanes) {
        let at = self.slabs.partition_point(|slab| slab.slab < added.slab);
        match self.slabs.get_mut(at).filter(|slab| slab.slab == added.slab) {
            Some(slab) => {
                let sum = |to: &mut [f32], from: &[f32]| to.iter_mut().zip(from).for_each(|(to, v)| *to += v);
                sum(&mut slab.a, &added.a);
                sum(&mut slab.c, &added.c);
                sum(&mut slab.m, &added.m);
                std::mem::swap(&mut slab.invented, &mut added.c);
                self.free.push(added);
            }
            None => {
                added.invented.extend_from_slice(&added.c);
                self.slabs.insert(at, added);
            }
        }
    }
}

/// Calls `each` with the index in `from` and in `part` of the first pixel of every row of `part`, which lies within `from`, and its width.
pub(super) fn for_each_row(from: Rect, part: Rect, mut each: impl FnMut(usize, usize, usize)) {
    let first = (part.y - from.y) as usize * from.width + (part.x - from.x) as usize;
    (0..part.height).for_each(|y| each(first + y * from.width, y * part.width, part.width));
}
