//! A binary hierarchy of boxes of bounded depth.
//!
//! Ranges are divided where the surface area heuristic, Σ area·count over two sides, is least of [`BINS`] − 1 planes across the longest extent of the centres
//! (Wald, "On fast Construction of SAH-based Bounding Volume Hierarchies", RT 2007), and in halves where all centres are equal or the depth is
//! [`HALVES_FROM`] or more. The depth is then at most [`HALVES_FROM`] + 28 for 2²⁸ boxes, whatever the mesh: the hierarchy is traversed by recursion.
//! The builder of `obvhs` is not used: a mesh with 20,000 equal triangles makes it a chain.

use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::node::Bvh2Node;

const BINS: usize = 16;
const HALVES_FROM: usize = 48;
/// Boxes from which on two halves are built in parallel.
const PARALLEL: usize = 8192;

/// A box: its least and greatest corner.
#[derive(Clone, Copy, Debug)]
pub(super) struct Bounds {
    pub min: [f32; 3],
    pub max: [f32; 3],
}

impl Bounds {
    const EMPTY: Self = Self { min: [f32::INFINITY; 3], max: [f32::NEG_INFINITY; 3] };

    fn with(&self, other: &Self) -> Self {
        Self {
            min: std::array::from_fn(|k| self.min[k].min(other.min[k])),
            max: std::array::from_fn(|k| self.max[k].max(other.max[k])),
        }
    }

    /// Twice the centre.
    fn centre(&self) -> [f32; 3] {
        std::array::from_fn(|k| self.min[k] + self.max[k])
    }

    /// Half the surface; 0 for an empty box.
    fn area(&self) -> f32 {
        let [x, y, z] = std::array::from_fn(|k| (self.max[k] - self.min[k]).max(0.0));
        (x + y) * z + x * y
    }

    fn node(&self, boxes: u32, first: u32) -> Bvh2Node {
        Bvh2Node::new(Aabb::new(self.min.into(), self.max.into()), boxes, first)
    }
}

/// The hierarchy of `boxes`, one a leaf.
pub(super) fn build(boxes: &[Bounds]) -> Bvh2 {
    let mut hierarchy = Bvh2::default();
    if boxes.is_empty() {
        return hierarchy;
    }
    let mut order: Vec<u32> = (0..boxes.len() as u32).collect();
    let mut nodes = vec![Bvh2Node::default(); 2 * boxes.len() - 1];
    if let Some((root, below)) = nodes.split_first_mut() {
        fill(root, below, Range { boxes, order: &mut order, first: 0, below: 1, depth: 0 });
    }
    (hierarchy.nodes, hierarchy.primitive_indices) = (nodes, order);
    hierarchy
}

/// The boxes of a node.
struct Range<'a> {
    boxes: &'a [Bounds],
    /// Their numbers.
    order: &'a mut [u32],
    /// Place of the first in the list of all.
    first: usize,
    /// Number of the first node below this one: both children, then all below the first, then all below the second.
    below: usize,
    depth: usize,
}

/// Writes a node and all below it.
fn fill(node: &mut Bvh2Node, below: &mut [Bvh2Node], range: Range<'_>) {
    let Range { boxes, order, first, below: number, depth } = range;
    let of = |i: u32| &boxes[i as usize];
    let bounds = order.iter().fold(Bounds::EMPTY, |b, &i| b.with(of(i)));
    if order.len() == 1 {
        *node = bounds.node(1, first as u32);
        return;
    }
    *node = bounds.node(0, number as u32);
    let split = divide(boxes, order, depth);
    let [left_node, right_node, rest @ ..] = below else {
        unreachable!("a node of n boxes has 2n − 2 nodes below it")
    };
    let (left_rest, right_rest) = rest.split_at_mut(2 * split - 2);
    let (left, right) = order.split_at_mut(split);
    let is_large = left.len() + right.len() >= PARALLEL;
    let depth = depth + 1;
    let left = Range { boxes, order: left, first, below: number + 2, depth };
    let right = Range { boxes, order: right, first: first + split, below: number + 2 * split, depth };
    if is_large {
        rayon::join(|| fill(left_node, left_rest, left), || fill(right_node, right_rest, right));
    } else {
        fill(left_node, left_rest, left);
        fill(right_node, right_rest, right);
    }
}

/// Orders two or more boxes so that the first part is one side; the number in it, at least 1 and not all.
fn divide(boxes: &[Bounds], order: &mut [u32], depth: usize) -> usize {
    let half = order.len() / 2;
    let centre = |i: u32| boxes[i as usize].centre();
    let (mut low, mut high) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
    for c in order.iter().map(|&i| centre(i)) {
        low = std::array::from_fn(|k| low[k].min(c[k]));
        high = std::array::from_fn(|k| high[k].max(c[k]));
    }
    let extent = |k: usize| high[k] - low[k];
    let axis = (1..3).fold(0, |best, k| if extent(k) > extent(best) { k } else { best });
    let (start, length) = (low[axis], extent(axis));
    if !(length > 0.0 && length.is_finite()) {
        return half;
    }
    if depth >= HALVES_FROM {
        let key = |i: &u32| (centre(*i)[axis], *i);
        order.select_nth_unstable_by(half, |a, b| key(a).partial_cmp(&key(b)).unwrap_or(a.cmp(b)));
        return half;
    }
    let scale = BINS as f32 / length;
    let bin = |i: u32| (((centre(i)[axis] - start) * scale) as usize).min(BINS - 1);
    let mut bins = [(Bounds::EMPTY, 0usize); BINS];
    for &i in order.iter() {
        let (bounds, count) = &mut bins[bin(i)];
        (*bounds, *count) = (bounds.with(&boxes[i as usize]), *count + 1);
    }
    // Costs of the right sides, then those of the left ones.
    let cost = |(bounds, count): &(Bounds, usize)| bounds.area() * *count as f32;
    let join = |a: &(Bounds, usize), b: &(Bounds, usize)| (a.0.with(&b.0), a.1 + b.1);
    let mut costs = [0f32; BINS];
    let mut side = (Bounds::EMPTY, 0);
    for b in (1..BINS).rev() {
        side = join(&side, &bins[b]);
        costs[b] = cost(&side);
    }
    let mut best = (f32::INFINITY, 0);
    side = (Bounds::EMPTY, 0);
    for b in 1..BINS {
        side = join(&side, &bins[b - 1]);
        let total = cost(&side) + costs[b];
        if total < best.0 && side.1 > 0 && side.1 < order.len() {
            best = (total, b);
        }
    }
    // Infinite areas, of boxes of 10¹⁹ m, have no best plane.
    match best.1 {
        0 => half,
        plane => partition(order, |i| bin(i) < plane),
    }
}

/// Moves those that are in the first part to the front; their number.
fn partition(order: &mut [u32], is_first: impl Fn(u32) -> bool) -> usize {
    let mut count = 0;
    for k in 0..order.len() {
        if is_first(order[k]) {
            order.swap(count, k);
            count += 1;
        }
    }
    count
}
