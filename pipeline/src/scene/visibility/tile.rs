//! The triangles of one tile, prepared for its samples.

use super::bins::{Bins, Span, pixels};
use super::raster::{GROUP, Label, Row, RowHits, TileTriangle};
use super::surfaces::TileSolids;
use super::triangle::Edges;
use super::{Engine, TILE_PX};
use crate::scene::frame::Frame;
use crate::scene::mesh::Mesh;
use crate::scene::shading::Shader;

/// Triangles of a tile and the directions of its samples. Kept by a worker from tile to tile.
pub(crate) struct TileScene {
    places: Vec<[f64; 2]>,
    /// First row and column, height, width in px.
    rect: (usize, usize, usize, usize),
    /// x of the samples by column.
    x: Vec<[f64; TILE_PX]>,
    triangles: Vec<TileTriangle>,
    solids: TileSolids,
    has_alpha: bool,
    has_one_sided_back: bool,
    /// Triangles by first row.
    starts: [Vec<u32>; TILE_PX],
    active: Vec<u32>,
    merged: Vec<u32>,
    y: Vec<f64>,
}

impl TileScene {
    /// For samples at `places` of each pixel.
    pub(crate) fn new(places: Vec<[f64; 2]>) -> Self {
        Self {
            rect: (0, 0, 0, 0),
            x: vec![[0.0; TILE_PX]; places.len()],
            triangles: Vec::new(),
            solids: TileSolids::default(),
            has_alpha: false,
            has_one_sided_back: false,
            starts: std::array::from_fn(|_| Vec::new()),
            active: Vec::new(),
            merged: Vec::new(),
            y: vec![0.0; places.len()],
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
        for (x, place) in self.x.iter_mut().zip(&self.places) {
            for (k, x) in x.iter_mut().enumerate() {
                *x = frame.x((column + k) as f64 + place[0]);
            }
        }
        self.triangles.clear();
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
            self.has_one_sided_back |= is_one_sided && !is_front;
            self.starts[rows.0 - row].push(number);
            self.triangles.push(TileTriangle {
                edges,
                triangle: t,
                solid,
                label: Label::new(number, solid),
                rows: ((rows.0 - row) as u8, (rows.1 - row) as u8),
                groups: (((columns.0 - column) / GROUP) as u8, (columns.1 - column).div_ceil(GROUP) as u8),
                is_front,
                is_one_sided,
                has_alpha,
            });
        }
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
        (self.x[sample][column], self.y[sample])
    }

    /// Solids of the tile.
    pub(crate) fn solids(&mut self) -> (&mut TileSolids, &[TileTriangle]) {
        (&mut self.solids, &self.triangles)
    }

    /// Hits of the samples of a row of the tile; rows must come in order from 0 on.
    pub(crate) fn hits(
        &mut self,
        frame: &Frame,
        row: usize,
        engine: Engine,
        keep: usize,
        hits: &mut RowHits,
    ) {
        if row == 0 {
            self.active.clear();
        }
        for (y, place) in self.y.iter_mut().zip(&self.places) {
            *y = frame.y((self.rect.0 + row) as f64 + place[1]);
        }
        let triangles = &self.triangles;
        self.active.retain(|&t| usize::from(triangles[t as usize].rows.1) > row);
        merge(&self.active, &self.starts[row], &mut self.merged);
        std::mem::swap(&mut self.active, &mut self.merged);
        self.hits_again(engine, keep, hits);
    }

    /// Hits of the row of the last call of [`TileScene::hits`].
    pub(crate) fn hits_again(&self, engine: Engine, keep: usize, hits: &mut RowHits) {
        let triangles = &self.triangles;
        hits.clear(keep);
        let row = Row { triangles, active: &self.active, x: &self.x, y: &self.y };
        engine.add_row(&row, hits);
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
