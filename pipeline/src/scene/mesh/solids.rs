//! Components of triangles that are connected by edges, and which are closed: every edge has exactly one triangle in each direction.
//!
//! An edge is kept at its lower vertex as (higher vertex, triangle); those that run from the lower to the higher one stand first. So two short
//! sorted lists per vertex are compared, 8 B an edge, in time linear in the number of triangles.

use crate::scratch::{List, Scratch, ScratchError};

/// A component.
pub(super) struct Component {
    /// Its first triangle.
    pub(super) first: u32,
    /// Whether each edge has one triangle in each direction.
    pub(super) is_closed: bool,
}

/// Component of each of `triangles` triangles, in the order of their first triangles, [`super::NOT_SOLID`] where `corners` has none.
///
/// `corners`: welded vertices below `vertices`, three different ones.
pub(super) fn components(
    triangles: u32,
    vertices: usize,
    corners: impl Fn(u32) -> Option<[u32; 3]>,
    scratch: &Scratch,
) -> Result<(List<u32>, Vec<Component>), ScratchError> {
    let mut sets = Sets::new(triangles, scratch)?;
    let mut is_open = scratch.zeros(triangles as usize)?;
    let mut edges = EdgeLists::new(triangles, vertices, &corners, scratch)?;
    for v in 0..vertices {
        let [up, down] = edges.of(v);
        up.sort_unstable();
        down.sort_unstable();
        compare(up, down, &mut sets, &mut is_open);
    }
    drop(edges);
    number(sets, &is_open, |t| corners(t).is_some(), scratch)
}

/// Unites the triangles at each edge of one lower vertex and marks those at open edges.
fn compare(mut up: &[[u32; 2]], mut down: &[[u32; 2]], sets: &mut Sets, is_open: &mut [u8]) {
    while let Some(end) = [up.first(), down.first()].into_iter().flatten().map(|e| e[0]).min() {
        let here = up.partition_point(|e| e[0] == end);
        let there = down.partition_point(|e| e[0] == end);
        let all = up[..here].iter().chain(&down[..there]);
        let first = all.clone().next().map_or(0, |e| e[1]);
        for &[_, t] in all {
            sets.unite(first, t);
            is_open[t as usize] |= u8::from(here != 1 || there != 1);
        }
        (up, down) = (&up[here..], &down[there..]);
    }
}

/// Numbers the components in the order of their first triangles.
fn number(
    mut sets: Sets,
    is_open: &[u8],
    exists: impl Fn(u32) -> bool,
    scratch: &Scratch,
) -> Result<(List<u32>, Vec<Component>), ScratchError> {
    let mut numbers = scratch.list(is_open.len())?;
    numbers.resize(is_open.len(), super::NOT_SOLID);
    let of_triangle = &mut numbers[..];
    let mut components: Vec<Component> = Vec::new();
    for t in (0..is_open.len() as u32).filter(|&t| exists(t)) {
        // The root of a set is its lowest triangle, which therefore has its number already.
        let root = sets.root(t);
        if root == t {
            of_triangle[t as usize] = components.len() as u32;
            components.push(Component { first: t, is_closed: true });
        }
        let c = of_triangle[root as usize];
        of_triangle[t as usize] = c;
        components[c as usize].is_closed &= is_open[t as usize] == 0;
    }
    Ok((numbers, components))
}

/// Edges by lower vertex.
struct EdgeLists {
    /// Start of each vertex's edges, and the end.
    start: List<u32>,
    /// End of the edges from the lower to the higher vertex.
    split: List<u32>,
    /// Higher vertex, triangle.
    edges: List<[u32; 2]>,
}

impl EdgeLists {
    fn new(
        triangles: u32,
        vertices: usize,
        corners: &impl Fn(u32) -> Option<[u32; 3]>,
        scratch: &Scratch,
    ) -> Result<Self, ScratchError> {
        let mut list = scratch.zeros::<u32>(vertices + 1)?;
        let start = &mut list[..];
        let all = || (0..triangles).filter_map(|t| corners(t).map(|c| (t, c)));
        let of = |[a, b, c]: [u32; 3]| [(a, b), (b, c), (c, a)];
        all().flat_map(|(_, c)| of(c)).for_each(|(a, b)| start[a.min(b) as usize + 1] += 1);
        (0..vertices).for_each(|v| start[v + 1] += start[v]);
        let mut edges = scratch.zeros(start[vertices] as usize)?;
        let (mut front, mut back) = (scratch.list(vertices)?, scratch.list(vertices)?);
        front.extend(start[..vertices].iter().copied());
        back.extend(start[1..].iter().copied());
        let (to, fronts, backs) = (&mut edges[..], &mut front[..], &mut back[..]);
        for (t, c) in all() {
            for (a, b) in of(c) {
                let at = if a < b {
                    fronts[a as usize] += 1;
                    fronts[a as usize] - 1
                } else {
                    backs[b as usize] -= 1;
                    backs[b as usize]
                };
                to[at as usize] = [a.max(b), t];
            }
        }
        Ok(Self { start: list, split: front, edges })
    }

    /// Edges from the vertex to higher ones, and from them to it.
    fn of(&mut self, vertex: usize) -> [&mut [[u32; 2]]; 2] {
        let (start, split) = (self.start[vertex] as usize, self.split[vertex] as usize);
        self.edges[start..self.start[vertex + 1] as usize].split_at_mut(split - start).into()
    }
}

/// Disjoint sets; the root of each is its lowest element.
struct Sets(List<u32>);

impl Sets {
    fn new(n: u32, scratch: &Scratch) -> Result<Self, ScratchError> {
        let mut list = scratch.list(n as usize)?;
        list.extend(0..n);
        Ok(Self(list))
    }

    fn root(&mut self, mut i: u32) -> u32 {
        let parents = &mut self.0[..];
        while parents[i as usize] != i {
            let parent = parents[i as usize];
            parents[i as usize] = parents[parent as usize];
            i = parent;
        }
        i
    }

    fn unite(&mut self, a: u32, b: u32) {
        let (a, b) = (self.root(a), self.root(b));
        self.0[a.max(b) as usize] = a.min(b);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(triangles: &[[u32; 3]]) -> (Vec<u32>, Vec<bool>) {
        let vertices = triangles.as_flattened().iter().max().map_or(0, |v| *v as usize + 1);
        let corners = |t| Some(triangles[t as usize]);
        let (of, components) =
            components(triangles.len() as u32, vertices, corners, &Scratch::default()).unwrap();
        (of.to_vec(), components.iter().map(|c| c.is_closed).collect())
    }

    const TETRAHEDRON: [[u32; 3]; 4] = [[0, 1, 2], [0, 3, 1], [1, 3, 2], [2, 3, 0]];

    #[test]
    fn a_tetrahedron_is_closed_and_without_a_face_open() {
        assert_eq!(of(&TETRAHEDRON), (vec![0; 4], vec![true]));
        assert_eq!(of(&TETRAHEDRON[1..]), (vec![0; 3], vec![false]));
        let mut turned = TETRAHEDRON;
        turned[2].swap(0, 1);
        assert_eq!(of(&turned), (vec![0; 4], vec![false]));
    }

    #[test]
    fn components_that_share_a_vertex_are_two_and_those_that_share_an_edge_one() {
        let moved = |map: [u32; 4]| TETRAHEDRON.map(|t| t.map(|v| map[v as usize]));
        let mut both = TETRAHEDRON.to_vec();
        both.extend(moved([3, 4, 5, 6]));
        assert_eq!(of(&both), (vec![0, 0, 0, 0, 1, 1, 1, 1], vec![true, true]));
        let mut both = TETRAHEDRON.to_vec();
        both.extend(moved([2, 3, 5, 6]));
        assert_eq!(of(&both), (vec![0; 8], vec![false]));
    }

    #[test]
    fn triangles_without_corners_belong_to_no_component() {
        let corners = |t| (t > 0).then(|| TETRAHEDRON[t as usize - 1]);
        let (of, components) = components(5, 4, corners, &Scratch::default()).unwrap();
        assert_eq!(of, [super::super::NOT_SOLID, 0, 0, 0, 0]);
        assert!(components.len() == 1 && components[0].is_closed && components[0].first == 1);
    }
}
