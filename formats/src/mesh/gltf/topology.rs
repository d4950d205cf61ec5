//! Triangles of a list, a strip and a fan of vertices (glTF 2.0, 3.7.2.1), counter-clockwise seen from the front.
//!
//! List: (v_3i, v_3i+1, v_3i+2). Strip: (v_i, v_{i+1+i%2}, v_{i+2−i%2}). Fan: (v_{i+1}, v_{i+2}, v_0).

/// How vertices form triangles.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum Topology {
    List,
    Strip,
    Fan,
}

impl Topology {
    /// Number of triangles of `vertices` vertices.
    pub(super) fn triangles(self, vertices: usize) -> usize {
        match self {
            Self::List => vertices / 3,
            Self::Strip | Self::Fan => vertices.saturating_sub(2),
        }
    }

    /// Triangle `i`; `vertex` gives the vertex at a place of the sequence.
    pub(super) fn triangle(self, i: usize, vertex: impl Fn(usize) -> u32) -> [u32; 3] {
        match self {
            Self::List => [vertex(3 * i), vertex(3 * i + 1), vertex(3 * i + 2)],
            Self::Strip => [vertex(i), vertex(i + 1 + i % 2), vertex(i + 2 - i % 2)],
            Self::Fan => [vertex(i + 1), vertex(i + 2), vertex(0)],
        }
    }
}
