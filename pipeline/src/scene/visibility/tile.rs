//! The triangles of one tile, prepared for its samples.

use super::bins::{Bins, Span, pixels};
use super::raster::{GROUP, Label, Row, RowHits, TileTriangle, groups_of_row};
use super::spans::{Outline, RowSpan};
use super::surfaces::TileSolids;
use super::triangle::Edges;
use super::{Engine, TILE_PX};
use crate::scene::frame::Frame;
use crate::scene::mesh::Mesh;
use crate::scene::shading::Shader;

/// Which hits of a sample are kept.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Kept {
    /// The nearest.
    Nearest,
    /// All, up to [`super::MAX_HITS`].
    All,
}

/// Triangles of a tile and the directions of its samples. Kept by a worker from tile to tile.
pub(crate) struct TileScene {
    places: Vec<[f64; 2]>,
    /// First row and column, height, width in px.
    rect: (usize, usize, usize, usize),
    /// x of the samples of each group; of a chart that is not planar, in a row.
    x: Vec<[f64; GROUP]>,
    /// y of the samples of the groups of a pixel in a row; of a chart that is not planar, of each group.
    y: Vec<[f64; GROUP]>,
    triangles: Vec<TileTriangle>,
    /// Columns of the triangles, row by row.
    spans: Vec<RowSpan>,
    /// Weights of each triangle, one per basis, if those of none depend on the place.
    even_weights: Vec<f64>,
    /// Weights of a pixel that sees one triangle alone.
    pixel_weights: Vec<f32>,
    has_even_weights: bool,
    solids: TileSolids,
    has_alpha: bool,
    has_one_sided_back: bool,
    /// Triangles by first row.
    starts: [Vec<u32>; TILE_PX],
    active: Vec<u32>,
    merged: Vec<u32>,
    row: usize,
}

impl TileScene {
    /// For samples at `places` of each pixel.
    pub(crate) fn new(places: Vec<[f64; 2]>) -> Self {
        Self {
            rect: (0, 0, 0, 0),
            x: vec![[0.0; GROUP]; groups_of_row(places.len())],
            y: vec![[0.0; GROUP]; places.len().div_ceil(GROUP)],
            triangles: Vec::new(),
            spans: Vec::new(),
            even_weights: Vec::new(),
            pixel_weights: Vec::new(),
            has_even_weights: false,
            solids: TileSolids::default(),
            has_alpha: false,
            has_one_sided_back: false,
            starts: std::array::from_fn(|_| Vec::new()),
            active: Vec::new(),
            merged: Vec::new(),
            row: 0,
            places,
        }
    }

    /// Prepares a tile.
    pub(crate) fn prepare(
        &mut self,
        mesh: &Mesh,
        frame: &Frame,
        bins: &Bins,
        shader: &dyn Shader,
        tile: usize,
    ) {
        self.rect = bins.grid().rect(tile);
        let (row, column, height, width) = self.rect;
        let samples = self.places.len();
        if frame.film.is_none() {
            for (at, x) in self.x.as_flattened_mut().iter_mut().enumerate() {
                *x = frame.x((column + at / samples) as f64 + self.places[at % samples][0]);
            }
        } else {
            self.y.resize(self.x.len(), [0.0; GROUP]);
        }
        self.triangles.clear();
        self.spans.clear();
        self.even_weights.clear();
        self.pixel_weights.clear();
        self.has_even_weights = true;
        self.solids.clear();
        (self.has_alpha, self.has_one_sided_back) = (false, false);
        self.starts.iter_mut().for_each(Vec::clear);
        self.active.clear();
        for t in bins.of(tile) {
            let corners = mesh.corners(t);
            let Some(Span { rows, columns }) = pixels(frame, &corners) else { continue };
            let rows = (rows.0.max(row), rows.1.min(row + height));
            let columns = (columns.0.max(column), columns.1.min(column + width));
            if rows.0 >= rows.1 || columns.0 >= columns.1 {
                continue;
            }
            let Some(edges) = Edges::new(corners) else { continue };
            let is_front = edges.is_counter_clockwise() != mesh.is_mirrored(t);
            let solid = self.solids.number(mesh, t);
            let is_one_sided = mesh.is_one_sided(t);
            if is_one_sided && !is_front && solid == u32::MAX {
                continue;
            }
            let number = self.triangles.len() as u32;
            let has_alpha = !shader.is_opaque(t);
            if has_alpha {
                self.solids.add_alpha();
            }
            self.has_alpha |= has_alpha;
            let is_back = is_one_sided && !is_front;
            self.has_one_sided_back |= is_back;
            self.add_even_weights(shader, t);
            let label = Label::new(number, solid);
            let rows = (rows.0 - row, rows.1 - row);
            self.starts[rows.0].push(number);
            self.triangles.push(TileTriangle {
                edges,
                triangle: t,
                solid,
                label: if is_back { label.of_back() } else { label },
                rows: (rows.0 as u8, rows.1 as u8),
                spans: self.spans.len(),
                is_front,
                is_one_sided,
                has_alpha,
            });
            let columns = (columns.0 - column, columns.1 - column);
            match Outline::new(frame, &corners) {
                Some(outline) => outline.add_spans((row, column), rows, columns, &mut self.spans),
                None => self.spans.extend((rows.0..rows.1).map(|_| RowSpan::uncovered(columns))),
            }
        }
    }

    /// Adds the weights of the next triangle, unless those of one depend on the place.
    fn add_even_weights(&mut self, shader: &dyn Shader, triangle: u32) {
        if self.has_even_weights {
            let first = self.even_weights.len();
            self.even_weights.resize(first + shader.bases(), 0.0);
            self.has_even_weights = shader.even_weights(triangle, &mut self.even_weights[first..]);
            // Their mean is that of one; a sum is never -0.
            self.pixel_weights.extend(self.even_weights[first..].iter().map(|w| (0.0 + w) as f32));
        }
    }

    /// Weights of a hit of each triangle, one per basis, and those of a pixel that sees it alone; `None` if those of a triangle depend on the place.
    #[inline]
    pub(crate) fn even_weights(&self) -> Option<(&[f64], &[f32])> {
        self.has_even_weights.then_some((&self.even_weights, &self.pixel_weights))
    }

    /// First row and column, height and width in px.
    pub(crate) fn rect(&self) -> (usize, usize, usize, usize) {
        self.rect
    }

    /// Whether no triangle may have hits.
    pub(crate) fn is_empty(&self) -> bool {
        self.triangles.is_empty()
    }

    /// Whether the shader decides which hits of a triangle exist.
    pub(crate) fn has_alpha(&self) -> bool {
        self.has_alpha
    }

    /// Whether hits may see the back of a one-sided material.
    pub(crate) fn has_one_sided_back(&self) -> bool {
        self.has_one_sided_back
    }

    /// A triangle by its number in the tile.
    #[inline]
    pub(crate) fn triangle(&self, number: u32) -> &TileTriangle {
        &self.triangles[number as usize]
    }

    /// Direction (x, y) of a sample of the pixel at a column of the tile, in the row of [`TileScene::hits`].
    #[inline]
    pub(crate) fn direction(&self, sample: usize, column: usize) -> (f64, f64) {
        let at = column * self.places.len() + sample;
        let of_y = if self.y.len() == self.x.len() { at } else { sample };
        (self.x[at / GROUP][at % GROUP], self.y[of_y / GROUP][of_y % GROUP])
    }

    /// Solids of the tile.
    pub(crate) fn solids(&mut self) -> (&mut TileSolids, &[TileTriangle]) {
        (&mut self.solids, &self.triangles)
    }

    /// Hits of the samples of a row of the tile, the nearest of each sample or all; rows must come in order from 0 on.
    pub(crate) fn hits(&mut self, frame: &Frame, row: usize, engine: Engine, kept: Kept, hits: &mut RowHits) {
        self.row = row;
        if row == 0 {
            self.active.clear();
        }
        let samples = self.places.len();
        let line = |at: usize, places: &[[f64; 2]]| (self.rect.0 + row) as f64 + places[at % samples][1];
        if frame.film.is_none() {
            for (at, y) in self.y.as_flattened_mut().iter_mut().enumerate() {
                *y = frame.y(line(at, &self.places));
            }
        } else {
            let all = self.x.as_flattened_mut().iter_mut().zip(self.y.as_flattened_mut());
            for (at, (x, y)) in all.enumerate() {
                let across = (self.rect.1 + at / samples) as f64 + self.places[at % samples][0];
                (*x, *y) = frame.direction(line(at, &self.places), across);
            }
        }
        let triangles = &self.triangles;
        self.active.retain(|&t| usize::from(triangles[t as usize].rows.1) > row);
        merge(&self.active, &self.starts[row], &mut self.merged);
        std::mem::swap(&mut self.active, &mut self.merged);
        self.hits_again(engine, kept, hits);
    }

    /// Hits of the row of the last call of [`TileScene::hits`].
    pub(crate) fn hits_again(&self, engine: Engine, kept: Kept, hits: &mut RowHits) {
        hits.clear();
        let row = Row {
            row: self.row,
            triangles: &self.triangles,
            spans: &self.spans,
            active: &self.active,
            x: &self.x,
            y: &self.y,
            of_pixel: self.places.len().div_ceil(GROUP),
            group_shift: GROUP.div_ceil(self.places.len()).ilog2(),
        };
        engine.add_row(&row, kept, hits);
    }
}

/// The elements of two ascending lists, ascending.
fn merge(a: &[u32], b: &[u32], to: &mut Vec<u32>) {
    to.clear();
    let (mut i, mut j) = (0, 0);
    while i < a.len() && j < b.len() {
        let first = a[i] < b[j];
        to.push(if first { a[i] } else { b[j] });
        i += usize::from(first);
        j += usize::from(!first);
    }
    to.extend_from_slice(&a[i..]);
    to.extend_from_slice(&b[j..]);
}
