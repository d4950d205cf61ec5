//! Hits of the samples of a row of pixels of a tile, sorted.
//!
//! Samples are in the order of the columns, those of a pixel one after the other. Four of them, a group, are evaluated together: of one pixel, or of four
//! pixels with one sample each. A group holds layers: layer 0 has the nearest hit of each of its samples, layer 1 the next. A hit is
//! inserted by moving the farther ones down; triangles come in ascending order, so a hit goes behind those of equal vergence.

use super::lanes::{LANES, Lanes};
use super::spans::RowSpan;
use super::triangle::Edges;
use super::{MAX_HITS, TILE_PX};

/// Samples of a group.
pub(crate) const GROUP: usize = LANES;
/// Bits of a mask of all of them.
const ALL: u32 = (1 << LANES) - 1;

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
    /// Place of the first row in the list of spans.
    pub(crate) spans: usize,
    /// Whether hits see the front.
    pub(crate) is_front: bool,
    /// Whether hits of the back are no surfaces unless the triangle is of a solid.
    pub(crate) is_one_sided: bool,
    /// Whether the shader decides if a hit exists.
    pub(crate) has_alpha: bool,
}

/// Number of a triangle in the tile, its solid, and whether its hits see the back of a one-sided material.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Label(u64);

impl Label {
    /// Solids from this one on have no bit, nor have triangles without a solid.
    pub(crate) const LAST: u32 = 63;

    const SOLID: u64 = (Self::LAST as u64) << 32;
    const BACK: u64 = 1 << 40;

    /// Of triangle `number`; `solid` is its number in the tile, `u32::MAX` if none.
    pub(crate) fn new(number: u32, solid: u32) -> Self {
        Self(u64::from(solid.min(Self::LAST)) << 32 | u64::from(number))
    }

    /// Of hits that see the back of a one-sided material.
    pub(crate) fn of_back(self) -> Self {
        Self(self.0 | Self::BACK)
    }

    /// Number of the triangle in the tile.
    #[inline(always)]
    pub(crate) fn number(self) -> u32 {
        self.0 as u32
    }

    /// The bit of its solid, 0 without.
    #[inline(always)]
    pub(crate) fn solid_bit(self) -> u64 {
        (1 << ((self.0 & Self::SOLID) >> 32)) & !(1 << Self::LAST)
    }
}

/// One layer of a group.
#[derive(Clone, Copy)]
#[repr(align(64))]
struct Layer {
    /// 1/m; 0 without a hit.
    vergence: [f64; GROUP],
    /// Bits of the [`TileTriangle::label`].
    label: [f64; GROUP],
}

const NO_HIT: Layer = Layer { vergence: [0.0; GROUP], label: [0.0; GROUP] };

/// Hits of one layer in the samples of a pixel.
#[derive(Clone, Copy)]
pub(crate) struct PixelLayer {
    /// Of the first sample.
    pub(crate) label: Label,
    /// Bits in which labels of samples differ.
    differs: u64,
    /// Largest vergence, 1/m; 0 without hits.
    pub(crate) near: f64,
    /// Least vergence; 0 if a sample has no hit.
    pub(crate) far: f64,
    /// Sum in the order of the samples.
    pub(crate) sum: f64,
}

impl PixelLayer {
    /// Whether all samples have hits.
    #[inline(always)]
    pub(crate) fn is_full(&self) -> bool {
        self.far > 0.0
    }

    /// Whether all hits are those of one triangle.
    #[inline(always)]
    pub(crate) fn is_of_one_triangle(&self) -> bool {
        self.differs == 0
    }

    /// Whether all hits have the same bit of a solid.
    #[inline(always)]
    pub(crate) fn is_of_one_solid_bit(&self) -> bool {
        self.differs & Label::SOLID == 0
    }
}

/// Sorted hits of a row of pixels: 64 B a layer of a group.
pub(crate) struct RowHits {
    /// Layers of all groups, one layer after another; the first always has values.
    layers: Vec<Layer>,
    /// Layers in use of each group, unless only the nearest hit is kept.
    used: Vec<u16>,
    /// Samples of a pixel.
    samples: usize,
    /// Groups of a layer; one more than the row has, so that layers of a group do not fall on the same lines of a cache.
    stride: usize,
    /// Hits beyond [`MAX_HITS`].
    dropped: u64,
}

/// Groups of a row of pixels with this number of samples.
pub(super) fn groups_of_row(samples: usize) -> usize {
    samples * TILE_PX / GROUP
}

impl RowHits {
    /// For `samples` a pixel.
    pub(crate) fn new(samples: usize) -> Self {
        let groups = groups_of_row(samples);
        let stride = groups + 1;
        Self { layers: vec![NO_HIT; stride], used: vec![0; groups], samples, stride, dropped: 0 }
    }

    /// Removes all hits.
    pub(super) fn clear(&mut self) {
        self.used.fill(0);
        self.layers[..self.stride].fill(NO_HIT);
    }

    /// Hits dropped so far.
    pub(crate) fn dropped(&self) -> u64 {
        self.dropped
    }

    /// Group and lane of a sample of the pixel at a column.
    #[inline(always)]
    fn place(&self, sample: usize, column: usize) -> (usize, usize) {
        let at = column * self.samples + sample;
        (at / GROUP, at % GROUP)
    }

    /// Hits of a sample of the pixel at a column, the nearest first.
    #[inline(always)]
    pub(crate) fn of(&self, sample: usize, column: usize) -> impl Iterator<Item = (f64, Label)> + Clone + '_ {
        let (group, lane) = self.place(sample, column);
        let layers = self.layers[group..].iter().step_by(self.stride).take(usize::from(self.used[group]));
        layers
            .map(move |layer| (layer.vergence[lane], Label(layer.label[lane].to_bits())))
            .take_while(|hit| hit.0 > 0.0)
    }

    /// Hit of a layer of a sample, 0 without. The layer must be 0 or less than [`RowHits::depth`].
    #[inline(always)]
    pub(crate) fn hit(&self, sample: usize, column: usize, layer: usize) -> (f64, Label) {
        let (group, lane) = self.place(sample, column);
        let layer = &self.layers[layer * self.stride + group];
        (layer.vergence[lane], Label(layer.label[lane].to_bits()))
    }

    /// Layers in use of the groups of the pixel at a column: least and most of them.
    #[inline(always)]
    pub(crate) fn depth(&self, column: usize) -> (usize, usize) {
        let first = self.place(0, column).0;
        let of_pixel = &self.used[first..][..self.samples.div_ceil(GROUP)];
        let (mut least, mut most) = (u16::MAX, 0);
        for &used in of_pixel {
            least = least.min(used);
            most = most.max(used);
        }
        (usize::from(least), usize::from(most))
    }

    /// A layer of the samples of the pixel at a column: 0, or less than [`RowHits::depth`].
    #[inline(always)]
    pub(crate) fn layer(&self, column: usize, layer: usize) -> PixelLayer {
        let (group, lane) = self.place(0, column);
        let layers = &self.layers[layer * self.stride + group..];
        if self.samples < GROUP {
            let (v, label) = (layers[0].vergence[lane], Label(layers[0].label[lane].to_bits()));
            return PixelLayer { label, differs: 0, near: v, far: v, sum: v };
        }
        let label = layers[0].label[0].to_bits();
        let (mut differs, mut near, mut far, mut sum) = (0, 0.0, f64::INFINITY, 0.0);
        for layer in &layers[..self.samples / GROUP] {
            for (&v, l) in layer.vergence.iter().zip(layer.label) {
                differs |= l.to_bits() ^ label;
                near = if v > near { v } else { near };
                far = if v < far { v } else { far };
                sum += v;
            }
        }
        PixelLayer { label: Label(label), differs, near, far, sum }
    }

    /// Least vergence of the nearest hits of the pixel at a column, 1/m; infinity without hits.
    #[inline]
    pub(crate) fn farthest_first(&self, column: usize) -> f64 {
        let of = (0..self.samples).map(|i| self.hit(i, column, 0).0);
        of.filter(|&v| v > 0.0).fold(f64::INFINITY, |far, v| if v < far { v } else { far })
    }

    /// Whether a nearest hit sees the back of a one-sided material, or has a vergence above `nearest`, 1/m.
    pub(crate) fn has_unclear(&self, nearest: f64) -> bool {
        let (mut labels, mut near) = (0, 0.0);
        for layer in &self.layers[..self.stride] {
            for (&v, label) in layer.vergence.iter().zip(layer.label) {
                labels |= label.to_bits();
                near = if v > near { v } else { near };
            }
        }
        labels & Label::BACK != 0 || near > nearest
    }

    /// Adds hits of one triangle, to the nearest or to all; a vergence of 0 is none.
    #[inline(always)]
    fn add<V: Lanes, const NEAREST: bool>(&mut self, group: usize, vergence: V, label: V) {
        match NEAREST {
            true => self.keep_nearest(group, vergence, label),
            false => self.insert(group, vergence, label),
        }
    }

    /// Keeps the nearer hits, of those of one triangle and those found before; a vergence of 0 is none.
    #[inline(always)]
    fn keep_nearest<V: Lanes>(&mut self, group: usize, vergence: V, label: V) {
        let layer = &mut self.layers[group];
        let (v, l) = (V::load(&layer.vergence), V::load(&layer.label));
        let nearer = vergence.above(v);
        // Stores of parts of a register are slow: all or nothing is usual.
        match nearer.bits() {
            0 => {}
            ALL => {
                vergence.store(&mut layer.vergence);
                label.store(&mut layer.label);
            }
            _ => {
                v.replaced(nearer, vergence).store(&mut layer.vergence);
                l.replaced(nearer, label).store(&mut layer.label);
            }
        }
    }

    /// Inserts hits of one triangle; a vergence of 0 is none. From the farthest layer up, as triangles often come from near to far.
    #[inline(always)]
    fn insert<V: Lanes>(&mut self, group: usize, vergence: V, label: V) {
        let used = usize::from(self.used[group]);
        let mut at = used * self.stride + group;
        // The layer below that at `at`, as it was: vergence, label, and where the hits are nearer.
        let mut below = (V::splat(0.0), V::splat(0.0), vergence.above(V::splat(0.0)));
        let mut is_last = true;
        while at > group {
            let layer = &self.layers[at - self.stride];
            let (v, l) = (V::load(&layer.vergence), V::load(&layer.label));
            let nearer = vergence.above(v);
            let moved_v = below.0.replaced(below.2, vergence).replaced(nearer, v);
            let moved_l = below.1.replaced(below.2, label).replaced(nearer, l);
            if is_last {
                self.append(group, at, moved_v, moved_l);
                is_last = false;
            } else {
                let layer = &mut self.layers[at];
                moved_v.store(&mut layer.vergence);
                moved_l.store(&mut layer.label);
            }
            if nearer.bits() == 0 {
                return;
            }
            below = (v, l, nearer);
            at -= self.stride;
        }
        let (v, l) = (below.0.replaced(below.2, vergence), below.1.replaced(below.2, label));
        if is_last {
            self.append(group, at, v, l);
        } else {
            let layer = &mut self.layers[at];
            v.store(&mut layer.vergence);
            l.store(&mut layer.label);
        }
    }

    /// Adds a last layer if it has hits.
    #[inline(always)]
    fn append<V: Lanes>(&mut self, group: usize, at: usize, vergence: V, label: V) {
        let hits = vergence.above(V::splat(0.0)).bits();
        if hits == 0 {
            return;
        }
        if usize::from(self.used[group]) == MAX_HITS {
            self.dropped += u64::from(hits.count_ones());
            return;
        }
        if at >= self.layers.len() {
            self.grow();
        }
        let layer = &mut self.layers[at];
        vergence.store(&mut layer.vergence);
        label.store(&mut layer.label);
        self.used[group] += 1;
    }

    #[cold]
    fn grow(&mut self) {
        self.layers.resize(self.layers.len() + self.stride, NO_HIT);
    }
}

/// A row of pixels of a tile.
pub(crate) struct Row<'a> {
    /// Number of the row in the tile.
    pub(crate) row: usize,
    /// Triangles of the tile.
    pub(crate) triangles: &'a [TileTriangle],
    /// Their columns.
    pub(crate) spans: &'a [RowSpan],
    /// Those in the row, ascending.
    pub(crate) active: &'a [u32],
    /// x of the samples of each group.
    pub(crate) x: &'a [[f64; GROUP]],
    /// y of the samples of the groups of a pixel, of four pixels with one sample each; or of each group, where y changes along a row.
    pub(crate) y: &'a [[f64; GROUP]],
    /// Groups of a pixel.
    pub(crate) of_pixel: usize,
    /// Binary logarithm of the pixels of a group, which are 1 or 4.
    pub(crate) group_shift: u32,
}

/// Adds the hits of the samples of a row of pixels, the nearest of each sample or all. Compiled once per instruction set ([`super::Engine`]).
#[inline(always)]
pub(super) fn add_row<V: Lanes, const NEAREST: bool>(row: &Row<'_>, hits: &mut RowHits) {
    for &number in row.active {
        let t = &row.triangles[number as usize];
        let span = row.spans[t.spans + row.row - usize::from(t.rows.0)];
        let down = |column: u8| usize::from(column) >> row.group_shift;
        let up = |column: u8| (usize::from(column) + (1 << row.group_shift) - 1) >> row.group_shift;
        let (first, end) = (down(span.all.0), up(span.all.1));
        let covered = (up(span.covered.0), down(span.covered.1));
        let covered = if covered.0 < covered.1 { covered } else { (end, end) };
        let label = V::splat(f64::from_bits(t.label.0));
        if row.y.len() != row.of_pixel {
            for group in first * row.of_pixel..end * row.of_pixel {
                let (x, y) = (V::load(&row.x[group]), V::load(&row.y[group]));
                if let Some(all) = Sides::new(&t.edges, y).hits(x) {
                    let vergence = Plane::new(&t.edges, y).vergence(x);
                    hits.add::<V, NEAREST>(group, vergence.and(all), label);
                }
            }
            continue;
        }
        for (k, y) in row.y.iter().enumerate() {
            let y = V::load(y);
            let plane = Plane::new(&t.edges, y);
            let group = |place: usize| place * row.y.len() + k;
            if first < covered.0 || covered.1 < end {
                let sides = Sides::new(&t.edges, y);
                for place in (first..covered.0).chain(covered.1..end) {
                    let x = V::load(&row.x[group(place)]);
                    if let Some(all) = sides.hits(x) {
                        hits.add::<V, NEAREST>(group(place), plane.vergence(x).and(all), label);
                    }
                }
            }
            for place in covered.0..covered.1 {
                let x = V::load(&row.x[group(place)]);
                hits.add::<V, NEAREST>(group(place), plane.vergence(x), label);
            }
        }
    }
}

/// Factor of x, sum with the product of y, and constant of an edge function or plane on a line of samples.
#[inline(always)]
fn on_line<V: Lanes>(n: &[f64; 3], y: V) -> [V; 3] {
    [V::splat(n[0]), V::splat(n[1]).times(y), V::splat(n[2])]
}

#[inline(always)]
fn along<V: Lanes>(n: &[V; 3], x: V) -> V {
    n[0].times(x).plus(n[1]).plus(n[2])
}

/// Edge functions of a triangle on a line of samples.
struct Sides<V> {
    edges: [[V; 3]; 3],
    /// Least positive values.
    least: [V; 3],
}

impl<V: Lanes> Sides<V> {
    #[inline(always)]
    fn new(edges: &Edges, y: V) -> Self {
        let [a, b, c] = &edges.n;
        let [d, e, f] = edges.least;
        Self {
            edges: [on_line(a, y), on_line(b, y), on_line(c, y)],
            least: [V::splat(d), V::splat(e), V::splat(f)],
        }
    }

    /// Mask of the samples of a group that the triangle covers; `None` if there are none.
    #[inline(always)]
    fn hits(&self, x: V) -> Option<V> {
        let is_positive = |k: usize| along(&self.edges[k], x).at_least(self.least[k]);
        let [a, b, c] = [is_positive(0), is_positive(1), is_positive(2)];
        let (all, any) = (a.and(b).and(c), a.or(b).or(c));
        // One sign: all are positive or none is.
        if all.bits() == 0 && any.bits() == ALL {
            return None;
        }
        Some(all.or(V::splat(f64::from_bits(u64::MAX)).without(any)))
    }
}

/// Plane of a triangle on a line of samples.
struct Plane<V> {
    plane: [V; 3],
    offset: V,
}

impl<V: Lanes> Plane<V> {
    #[inline(always)]
    fn new(edges: &Edges, y: V) -> Self {
        Self { plane: on_line(&edges.plane, y), offset: V::splat(edges.offset) }
    }

    /// Vergences, 0 where they are not positive and finite.
    #[inline(always)]
    fn vergence(&self, x: V) -> V {
        let v = along(&self.plane, x).over(self.offset);
        v.and(v.above(V::splat(0.0)).and(V::splat(f64::INFINITY).above(v)))
    }
}
