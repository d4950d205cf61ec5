//! Hits of the samples of a row of pixels of a tile, sorted.
//!
//! A row of samples is the sample i of the 64 pixels of the row: one y, and x ascending with the column. Four of them, a group, are evaluated
//! together. A group holds layers: layer 0 has the nearest hit of each of its samples, layer 1 the next. A hit is inserted by moving the
//! farther ones down; triangles come in ascending order, so a hit goes behind those of equal vergence.

use super::lanes::{LANES, Lanes};
use super::triangle::Edges;
use super::{MAX_HITS, TILE_PX};

/// Samples of a group.
pub(crate) const GROUP: usize = LANES;
/// Groups of a row of samples.
const GROUPS: usize = TILE_PX / GROUP;

/// A triangle in a tile.
#[derive(Clone, Copy, Debug)]
pub(crate) struct TileTriangle {
    /// Edge functions.
    pub(crate) edges: Edges,
    /// Number in the mesh.
    pub(crate) triangle: u32,
    /// Solid, by its number in the tile; `u32::MAX` if none.
    pub(crate) solid: u32,
    /// What hits have.
    pub(crate) label: Label,
    /// First row of the tile with hits, and one past the last.
    pub(crate) rows: (u8, u8),
    /// The same of groups of columns.
    pub(crate) groups: (u8, u8),
    /// Whether hits see the front.
    pub(crate) is_front: bool,
    /// Whether hits of the back are no surfaces unless the triangle is of a solid.
    pub(crate) is_one_sided: bool,
    /// Whether the shader decides if a hit exists.
    pub(crate) has_alpha: bool,
}

/// Number of a triangle in the tile, and its solid.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Label(u64);

impl Label {
    /// Of triangle `number`; `solid` is its number in the tile, `u32::MAX` if none.
    pub(crate) fn new(number: u32, solid: u32) -> Self {
        Self(u64::from(solid.min(Self::LAST)) << 32 | u64::from(number))
    }

    /// Solids from this one on have no bit, nor have triangles without a solid.
    pub(crate) const LAST: u32 = 63;

    /// Number of the triangle in the tile.
    #[inline(always)]
    pub(crate) fn number(self) -> u32 {
        self.0 as u32
    }

    /// The bit of its solid, 0 without.
    #[inline(always)]
    pub(crate) fn solid_bit(self) -> u64 {
        (1 << (self.0 >> 32)) & !(1 << Self::LAST)
    }
}

/// One layer of a group.
#[derive(Clone, Copy)]
pub(crate) struct Layer {
    /// 1/m; 0 without a hit.
    vergence: [f64; GROUP],
    /// Bits of the [`TileTriangle::label`].
    label: [f64; GROUP],
}

const NO_HIT: Layer = Layer { vergence: [0.0; GROUP], label: [0.0; GROUP] };

/// Sorted hits of a row of pixels: 64 B a layer of a group, 9 layers at first, for the deepest sample at most 257.
pub(crate) struct RowHits {
    layers: Vec<Layer>,
    /// Layers in use of each group.
    used: Vec<u16>,
    /// Layers allocated per group; odd, so that groups do not fall on the same lines of a cache.
    capacity: usize,
    /// Layers kept: [`MAX_HITS`], or 1 if only the nearest counts.
    keep: usize,
    /// Hits beyond [`MAX_HITS`].
    dropped: u64,
}

/// Layers allocated at first.
const FIRST_CAPACITY: usize = 9;

impl RowHits {
    /// For `samples` a pixel.
    pub(crate) fn new(samples: usize) -> Self {
        let groups = samples * GROUPS;
        Self {
            layers: vec![NO_HIT; groups * FIRST_CAPACITY],
            used: vec![0; groups],
            capacity: FIRST_CAPACITY,
            keep: MAX_HITS,
            dropped: 0,
        }
    }

    /// Removes all hits; from here on the `keep` nearest of each sample are kept.
    pub(crate) fn clear(&mut self, keep: usize) {
        self.used.fill(0);
        self.keep = keep;
    }

    /// Hits dropped so far.
    pub(crate) fn dropped(&self) -> u64 {
        self.dropped
    }

    /// Hits of a sample of the pixel at a column, the nearest first.
    #[inline(always)]
    pub(crate) fn of(&self, sample: usize, column: usize) -> impl Iterator<Item = (f64, Label)> + Clone + '_ {
        let group = sample * GROUPS + column / GROUP;
        let lane = column % GROUP;
        let layers = &self.layers[group * self.capacity..][..usize::from(self.used[group])];
        layers
            .iter()
            .map(move |layer| (layer.vergence[lane], Label(layer.label[lane].to_bits())))
            .take_while(|hit| hit.0 > 0.0)
    }

    /// Whether all samples of the pixel at a column hit the same triangles in the same order, and at least one.
    #[inline(always)]
    pub(crate) fn are_equal(&self, samples: usize, column: usize) -> bool {
        let (group, lane) = (column / GROUP, column % GROUP);
        let layers = |i: usize| {
            let group = i * GROUPS + group;
            &self.layers[group * self.capacity..][..usize::from(self.used[group])]
        };
        let first = layers(0);
        let count = first.iter().take_while(|layer| layer.vergence[lane] > 0.0).count();
        let is_equal = |i: usize| {
            let other = layers(i);
            let has_more = other.get(count).is_some_and(|layer| layer.vergence[lane] > 0.0);
            let label = |layer: &Layer| layer.label[lane].to_bits();
            !has_more
                && other.len() >= count
                && first[..count]
                    .iter()
                    .zip(other)
                    .all(|(a, b)| label(a) == label(b) && b.vergence[lane] > 0.0)
        };
        count > 0 && (1..samples).all(is_equal)
    }

    /// Hit of a layer of a sample, which must have one.
    #[inline(always)]
    pub(crate) fn hit(&self, sample: usize, column: usize, layer: usize) -> (f64, Label) {
        let group = sample * GROUPS + column / GROUP;
        let layer = &self.layers[group * self.capacity + layer];
        (layer.vergence[column % GROUP], Label(layer.label[column % GROUP].to_bits()))
    }

    /// Inserts hits of one triangle; a vergence of 0 is none.
    #[inline(always)]
    fn insert<V: Lanes>(&mut self, group: usize, mut vergence: V, mut label: V) {
        let used = usize::from(self.used[group]);
        let mut moved = V::splat(0.0);
        for layer in &mut self.layers[group * self.capacity..][..used] {
            let (v, l) = (V::load(&layer.vergence), V::load(&layer.label));
            moved = moved.or(vergence.above(v));
            v.replaced(moved, vergence).store(&mut layer.vergence);
            l.replaced(moved, label).store(&mut layer.label);
            vergence = vergence.replaced(moved, v);
            label = label.replaced(moved, l);
        }
        let rest = vergence.above(V::splat(0.0)).bits();
        if rest != 0 {
            self.append(group, vergence, label, rest);
        }
    }

    /// Adds a last layer.
    #[inline(always)]
    fn append<V: Lanes>(&mut self, group: usize, vergence: V, label: V, hits: u32) {
        let used = usize::from(self.used[group]);
        if used == self.keep {
            self.dropped += if self.keep == MAX_HITS { u64::from(hits.count_ones()) } else { 0 };
            return;
        }
        if used == self.capacity {
            self.grow();
        }
        let layer = &mut self.layers[group * self.capacity + used];
        vergence.store(&mut layer.vergence);
        label.store(&mut layer.label);
        self.used[group] += 1;
    }

    #[cold]
    fn grow(&mut self) {
        let capacity = 2 * self.capacity - 1;
        let mut layers = vec![NO_HIT; self.used.len() * capacity];
        for (to, from) in layers.chunks_exact_mut(capacity).zip(self.layers.chunks_exact(self.capacity)) {
            to[..self.capacity].copy_from_slice(from);
        }
        (self.layers, self.capacity) = (layers, capacity);
    }
}

/// A row of pixels of a tile.
pub(crate) struct Row<'a> {
    /// Triangles of the tile.
    pub(crate) triangles: &'a [TileTriangle],
    /// Those in the row, ascending.
    pub(crate) active: &'a [u32],
    /// x of the samples of each column.
    pub(crate) x: &'a [[f64; TILE_PX]],
    /// y of the samples.
    pub(crate) y: &'a [f64],
}

/// Adds the hits of the samples of a row of pixels. Compiled once per instruction set ([`super::Engine`]).
#[inline(always)]
pub(super) fn add_row<V: Lanes>(row: &Row<'_>, hits: &mut RowHits) {
    for &number in row.active {
        let t = &row.triangles[number as usize];
        let (first, end) = (usize::from(t.groups.0), usize::from(t.groups.1));
        let label = V::splat(f64::from_bits(t.label.0));
        for (sample, (x, &y)) in row.x.iter().zip(row.y).enumerate() {
            let line = Line::<V>::new(&t.edges, y);
            for (group, x) in x.as_chunks().0[first..end].iter().enumerate() {
                if let Some(vergence) = line.vergence(V::load(x)) {
                    hits.insert(sample * GROUPS + first + group, vergence, label);
                }
            }
        }
    }
}

/// A triangle on a line of samples, y constant.
struct Line<V> {
    /// n_x, n_y y, n_z and least positive value of each edge function.
    edges: [[V; 4]; 3],
    /// N_x, N_y y, N_z, N·v0.
    plane: [V; 4],
}

impl<V: Lanes> Line<V> {
    #[inline(always)]
    fn new(edges: &Edges, y: f64) -> Self {
        let of =
            |n: &[f64; 3], last: f64| [V::splat(n[0]), V::splat(n[1] * y), V::splat(n[2]), V::splat(last)];
        let [a, b, c] = &edges.n;
        Self {
            edges: [of(a, edges.least[0]), of(b, edges.least[1]), of(c, edges.least[2])],
            plane: of(&edges.plane, edges.offset),
        }
    }

    /// Vergences of the hits of a group, 0 without a hit; `None` if there are none.
    #[inline(always)]
    fn vergence(&self, x: V) -> Option<V> {
        let is_positive = |e: &[V; 4]| e[0].times(x).plus(e[1]).plus(e[2]).at_least(e[3]);
        let [a, b, c] =
            [is_positive(&self.edges[0]), is_positive(&self.edges[1]), is_positive(&self.edges[2])];
        let (all, any) = (a.and(b).and(c), a.or(b).or(c));
        // One sign: all are positive or none is.
        if all.bits() == 0 && any.bits() == (1 << LANES) - 1 {
            return None;
        }
        let v = self.plane[0].times(x).plus(self.plane[1]).plus(self.plane[2]).over(self.plane[3]);
        let exists = v.above(V::splat(0.0)).and(V::splat(f64::INFINITY).above(v));
        Some(v.and(exists).without(any.without(all)))
    }
}
