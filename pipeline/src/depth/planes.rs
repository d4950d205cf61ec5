//! Planes of slabs on a film rectangle: share, light and position of every pixel.

use crate::buffer::resize_exact;
use crate::geometry::Rect;

/// Planes of one slab, row-major, from its first to its last row with pixels: a surface that runs through many slabs has few rows of each.
#[derive(Debug, Default)]
pub(super) struct SlabPlanes {
    /// Index of the slab.
    pub(super) slab: usize,
    /// Index of the first value in planes of the whole rectangle, that of the first pixel of a row.
    pub(super) first: usize,
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
    /// Buffers of the whole rectangle.
    pub(super) free: Vec<SlabPlanes>,
}

impl SlabPlanes {
    /// Of all `n` pixels of the rectangle, of slab `slab`, all 0, in the buffers `of`.
    pub(super) fn zeros(of: Option<Self>, slab: usize, n: usize) -> Self {
        let mut planes = of.unwrap_or_default();
        (planes.slab, planes.first) = (slab, 0);
        for plane in [&mut planes.a, &mut planes.c, &mut planes.m] {
            resize_exact(plane, n);
            plane.fill(0.0);
        }
        planes.invented.clear();
        planes
    }

    fn is_empty(&self) -> bool {
        self.a.iter().all(|a| *a == 0.0)
    }

    /// Its rows with pixels, of planes of `width` pixels a row; none if it has no pixel.
    pub(super) fn trimmed(&self, width: usize) -> Option<Self> {
        let is_present = |row: &[f32]| row.iter().any(|a| *a != 0.0);
        let first = self.a.chunks_exact(width).position(is_present)? * width;
        let last = self.a.chunks_exact(width).rposition(is_present)? * width;
        let part = |plane: &[f32]| plane[first..last + width].to_vec();
        let (a, c, m) = (part(&self.a), part(&self.c), part(&self.m));
        Some(Self { slab: self.slab, first: self.first + first, a, c, m, invented: Vec::new() })
    }

    /// Value of `plane`, one of its planes, at index `i` of the whole rectangle.
    pub(super) fn at(&self, plane: &[f32], i: usize) -> f32 {
        // Before the first value the difference wraps to beyond the last.
        plane.get(i.wrapping_sub(self.first)).copied().unwrap_or(0.0)
    }

    /// Position t of the surfaces at index `i` of the whole rectangle, 0 without.
    pub(super) fn position(&self, i: usize) -> f32 {
        let a = self.at(&self.a, i);
        if a > 0.0 { self.at(&self.m, i) / a } else { 0.0 }
    }

    /// The part of `all`, a plane of the whole rectangle, where its planes have values.
    pub(super) fn part_of<'a>(&self, all: &'a mut [f32]) -> &'a mut [f32] {
        &mut all[self.first..][..self.a.len()]
    }

    /// The rows of `rect` that it has.
    pub(super) fn rows_of(&self, rect: Rect) -> Rect {
        let (first, rows) = (self.first / rect.width, self.a.len() / rect.width);
        Rect::new(rect.y + first as i64, rect.x, rows, rect.width)
    }
}

impl Planes {
    /// Reduces all planes to `part` of their rectangle; slabs without pixels there are removed.
    pub(super) fn crop(&mut self, part: Rect) {
        let from = self.rect.replace(part).expect("computed before");
        let crop = |plane: &mut Vec<f32>, from: Rect, part: Rect| {
            for_each_row(from, part, |i, k, width| plane.copy_within(i..i + width, k));
            plane.truncate(part.size().pixels());
        };
        crop(&mut self.uncovered, from, part);
        for slab in &mut self.slabs {
            let rows = slab.rows_of(from);
            let kept = rows.intersect(part);
            if kept.is_empty() {
                slab.a.clear();
                continue;
            }
            slab.first = (kept.y - part.y) as usize * part.width;
            [&mut slab.a, &mut slab.c, &mut slab.m].into_iter().for_each(|plane| crop(plane, rows, kept));
        }
        self.slabs.retain(|slab| !slab.is_empty());
    }

    /// Adds the invented surfaces `added` of a slab, planes of the whole rectangle.
    pub(super) fn add(&mut self, mut added: SlabPlanes) {
        let at = self.slabs.partition_point(|slab| slab.slab < added.slab);
        added.invented.extend_from_slice(&added.c);
        match self.slabs.get_mut(at).filter(|slab| slab.slab == added.slab) {
            Some(slab) => {
                for (to, from) in [(&mut added.a, &slab.a), (&mut added.c, &slab.c), (&mut added.m, &slab.m)]
                {
                    to[slab.first..].iter_mut().zip(from).for_each(|(to, v)| *to += v);
                }
                *slab = added;
            }
            None => self.slabs.insert(at, added),
        }
    }
}

/// Calls `each` with the index in `from` and in `part` of the first pixel of every row of `part`, which lies within `from`, and its width.
pub(super) fn for_each_row(from: Rect, part: Rect, mut each: impl FnMut(usize, usize, usize)) {
    let first = (part.y - from.y) as usize * from.width + (part.x - from.x) as usize;
    (0..part.height).for_each(|y| each(first + y * from.width, y * part.width, part.width));
}

/// Copies the part `part` of `values`, a plane of `from`, to `to`.
pub(super) fn copy_part(from: Rect, part: Rect, values: &[f32], to: &mut [f32]) {
    for_each_row(from, part, |i, k, width| to[k..k + width].copy_from_slice(&values[i..i + width]));
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Slab 3 on a rectangle of 6 rows and 4 columns, with pixels in rows 2 to 4.
    fn planes() -> (Rect, Planes) {
        let rect = Rect::new(-2, 10, 6, 4);
        let mut whole = SlabPlanes::zeros(None, 3, 24);
        for i in [9, 14, 19] {
            (whole.a[i], whole.c[i], whole.m[i]) = (0.5, i as f32, 0.25);
        }
        let slabs = vec![whole.trimmed(4).unwrap()];
        (rect, Planes { rect: Some(rect), slabs, uncovered: vec![0.0; 24], free: Vec::new() })
    }

    #[test]
    fn rows_without_pixels_are_not_kept() {
        let (rect, mut planes) = planes();
        let slab = &planes.slabs[0];
        assert_eq!((slab.first, slab.a.len(), slab.rows_of(rect)), (8, 12, Rect::new(0, 10, 3, 4)));
        assert_eq!([7, 8, 9, 14, 20, 23].map(|i| slab.at(&slab.c, i)), [0.0, 0.0, 9.0, 14.0, 0.0, 0.0]);
        assert!(SlabPlanes::zeros(None, 1, 24).trimmed(4).is_none());
        planes.crop(Rect::new(1, 11, 3, 2));
        let slab = &planes.slabs[0];
        assert_eq!((slab.first, &slab.c[..]), (0, &[0.0, 14.0, 0.0, 0.0][..]));
        planes.crop(Rect::new(2, 11, 2, 2));
        assert!(planes.slabs.is_empty());
    }

    #[test]
    fn invented_surfaces_are_added_to_those_of_a_slab() {
        let (_, mut planes) = planes();
        let mut added = SlabPlanes::zeros(None, 3, 24);
        (added.a[0], added.c[0]) = (0.1, 2.0);
        (added.a[9], added.c[9]) = (0.2, 1.0);
        planes.add(added);
        let slab = &planes.slabs[0];
        assert_eq!((slab.first, planes.slabs.len()), (0, 1));
        assert_eq!([0, 9, 14].map(|i| slab.at(&slab.c, i)), [2.0, 10.0, 14.0]);
        assert_eq!([0, 9, 14].map(|i| slab.at(&slab.invented, i)), [2.0, 1.0, 0.0]);
    }
}
