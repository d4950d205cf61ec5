//! The triangles of each tile.
//!
//! A triangle before the camera lies in the rectangle of its projected corners; a larger one is tested against each tile of it
//! ([`Edges::may_hit`]), and one that crosses the plane z = 0 against the chart and its parts. A triangle in many tiles is listed in blocks
//! of 16 × 16 tiles instead, so memory is 4 B per (triangle, tile) for at most [`MAX_TILES`] tiles a triangle, and 4 B per (triangle, block).

use super::TILE_PX;
use super::triangle::Edges;
use crate::scene::frame::Frame;
use crate::scene::mesh::Mesh;
use crate::scratch::{List, Scratch, ScratchError};
use rayon::prelude::*;

/// Tiles of a block, across and down.
const BLOCK_TILES: usize = 16;
/// Triangles in more tiles are listed in blocks.
const MAX_TILES: usize = 64;
/// Triangles of a unit of parallel work.
const UNIT: usize = 1 << 16;
/// Grows the rectangle of projected corners, px: rounding is 10⁻¹¹ px but for triangles seen edge-on to 10⁻¹⁰.
const MARGIN_PX: f64 = 1.0 / 64.0;

/// Tiles of a chart: 64 × 64 px, cut at its right and lower edge.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TileGrid {
    /// Rows of the chart.
    pub height_px: usize,
    /// Columns of the chart.
    pub width_px: usize,
}

impl TileGrid {
    /// Tiles across.
    pub fn across(&self) -> usize {
        self.width_px.div_ceil(TILE_PX)
    }

    /// Tiles down.
    pub fn down(&self) -> usize {
        self.height_px.div_ceil(TILE_PX)
    }

    /// Number of tiles; tile k is in row k / across, column k mod across.
    pub fn tiles(&self) -> usize {
        self.across() * self.down()
    }

    /// Row and column of the first pixel of a tile, and its height and width.
    pub fn rect(&self, tile: usize) -> (usize, usize, usize, usize) {
        let (row, column) = (tile / self.across() * TILE_PX, tile % self.across() * TILE_PX);
        (row, column, TILE_PX.min(self.height_px - row), TILE_PX.min(self.width_px - column))
    }
}

/// Rectangle of tiles or px; the ends are excluded.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Span {
    pub(crate) rows: (usize, usize),
    pub(crate) columns: (usize, usize),
}

/// Rectangle of pixels, rows and columns below `end`, with samples that the triangle can hit; `None` if there is none. A triangle that crosses the
/// plane z = 0 has all.
pub(crate) fn pixels(frame: &Frame, corners: &[[f64; 3]; 3]) -> Option<Span> {
    let behind = corners.iter().filter(|c| c[2] <= 0.0).count();
    if behind == 3 {
        return None;
    }
    if behind > 0 {
        return Some(Span { rows: (0, frame.height), columns: (0, frame.width) });
    }
    let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
    for c in corners {
        for k in 0..2 {
            low[k] = low[k].min(c[k] / c[2]);
            high[k] = high[k].max(c[k] / c[2]);
        }
    }
    let (low, high) = frame.places((low, high));
    // Pixel i has samples from i − ½ to i + ½. Casts limit to the range of usize.
    let range = |k: usize, n: usize| {
        let first = (low[k] - MARGIN_PX + 0.5).floor().max(0.0) as usize;
        let end = (high[k] + MARGIN_PX + 0.5).floor() + 1.0;
        let end = (end.max(0.0) as usize).min(n);
        (first < end).then_some((first, end))
    };
    Some(Span { rows: range(0, frame.height)?, columns: range(1, frame.width)? })
}

/// Triangles by tile, ascending.
pub(crate) struct Bins {
    grid: TileGrid,
    of_tile: Lists,
    of_block: Lists,
}

impl Bins {
    /// Of all triangles that are not degenerate.
    ///
    /// # Errors
    /// [`ScratchError`].
    pub(crate) fn new(mesh: &Mesh, frame: &Frame) -> Result<Self, ScratchError> {
        let grid = TileGrid { height_px: frame.height, width_px: frame.width };
        let units: Vec<(usize, usize)> = (0..mesh.triangles() as usize)
            .step_by(UNIT)
            .map(|first| (first, (first + UNIT).min(mesh.triangles() as usize)))
            .collect();
        let scratch = mesh.scratch();
        let found: Vec<(Pairs, Pairs)> = units
            .into_par_iter()
            .map(|(first, end)| {
                let mut found =
                    Found { tiles: Vec::with_capacity((end - first) / 4 * 5), blocks: Vec::new() };
                (first as u32..end as u32).for_each(|t| found.add(mesh, frame, grid, t));
                Ok((scratch.keep(found.tiles)?, scratch.keep(found.blocks)?))
            })
            .collect::<Result<_, _>>()?;
        let blocks = grid.across().div_ceil(BLOCK_TILES) * grid.down().div_ceil(BLOCK_TILES);
        let of_tile = Lists::new(grid.tiles(), || found.iter().flat_map(|f| &f.0[..]), scratch)?;
        let of_block = Lists::new(blocks, || found.iter().flat_map(|f| &f.1[..]), scratch)?;
        Ok(Self { grid, of_tile, of_block })
    }

    /// Tiles.
    pub(crate) fn grid(&self) -> TileGrid {
        self.grid
    }

    /// Triangles that may have hits in a tile, ascending.
    pub(crate) fn of(&self, tile: usize) -> impl Iterator<Item = u32> {
        let across = self.grid.across();
        let block = tile / across / BLOCK_TILES * across.div_ceil(BLOCK_TILES) + tile % across / BLOCK_TILES;
        let (mut a, mut b) = (
            self.of_tile.of(tile).iter().copied().peekable(),
            self.of_block.of(block).iter().copied().peekable(),
        );
        std::iter::from_fn(move || match (a.peek(), b.peek()) {
            (Some(x), Some(y)) if y < x => b.next(),
            (None, _) => b.next(),
            _ => a.next(),
        })
    }

    /// Bytes in memory.
    pub(crate) fn bytes(&self) -> usize {
        self.of_tile.bytes() + self.of_block.bytes()
    }
}

/// Tiles or blocks, each with a triangle.
type Pairs = List<[u32; 2]>;

/// Tile or block, and triangle, of a unit.
struct Found {
    tiles: Vec<[u32; 2]>,
    blocks: Vec<[u32; 2]>,
}

impl Found {
    fn add(&mut self, mesh: &Mesh, frame: &Frame, grid: TileGrid, t: u32) {
        if mesh.is_degenerate(t) {
            return;
        }
        let corners = mesh.corners(t);
        let Some(Span { rows, columns }) = pixels(frame, &corners) else { return };
        let tiles = |(first, end): (usize, usize)| (first / TILE_PX, (end - 1) / TILE_PX + 1);
        let span = Span { rows: tiles(rows), columns: tiles(columns) };
        let (down, across) = (span.rows.1 - span.rows.0, span.columns.1 - span.columns.0);
        if (down, across) == (1, 1) {
            self.tiles.push([(span.rows.0 * grid.across() + span.columns.0) as u32, t]);
            return;
        }
        let Some(edges) = Edges::new(corners) else { return };
        if down * across <= MAX_TILES {
            divide(frame, &edges, span, 1, &mut |row, column| {
                self.tiles.push([(row * grid.across() + column) as u32, t]);
            });
            return;
        }
        let start = self.tiles.len();
        let mut is_large = false;
        divide(frame, &edges, span, 1, &mut |row, column| {
            is_large |= self.tiles.len() - start == MAX_TILES;
            if !is_large {
                self.tiles.push([(row * grid.across() + column) as u32, t]);
            }
        });
        if is_large {
            self.tiles.truncate(start);
            let blocks = |(first, end): (usize, usize)| (first / BLOCK_TILES, (end - 1) / BLOCK_TILES + 1);
            let span = Span { rows: blocks(span.rows), columns: blocks(span.columns) };
            divide(frame, &edges, span, BLOCK_TILES, &mut |row, column| {
                self.blocks.push([(row * grid.across().div_ceil(BLOCK_TILES) + column) as u32, t]);
            });
        }
    }
}

/// Calls `found` for each cell of `span`, of `tiles` × `tiles` tiles, in which the triangle may have hits.
fn divide(frame: &Frame, edges: &Edges, span: Span, tiles: usize, found: &mut impl FnMut(usize, usize)) {
    let cell = (tiles * TILE_PX) as f64;
    let border = |row: usize, column: usize| [row as f64 * cell - 0.5, column as f64 * cell - 0.5];
    let (low, high) =
        frame.directions((border(span.rows.0, span.columns.0), border(span.rows.1, span.columns.1)));
    if !edges.may_hit(low, high) {
        return;
    }
    let (down, across) = (span.rows.1 - span.rows.0, span.columns.1 - span.columns.0);
    if down.max(across) == 1 {
        found(span.rows.0, span.columns.0);
    } else if down >= across {
        let middle = span.rows.0 + down / 2;
        divide(frame, edges, Span { rows: (span.rows.0, middle), ..span }, tiles, found);
        divide(frame, edges, Span { rows: (middle, span.rows.1), ..span }, tiles, found);
    } else {
        let middle = span.columns.0 + across / 2;
        divide(frame, edges, Span { columns: (span.columns.0, middle), ..span }, tiles, found);
        divide(frame, edges, Span { columns: (middle, span.columns.1), ..span }, tiles, found);
    }
}

/// Lists of triangles one after another.
struct Lists {
    start: Vec<usize>,
    triangles: List<u32>,
}

impl Lists {
    /// From pairs of list and triangle, with ascending triangles.
    fn new<'a, I: Iterator<Item = &'a [u32; 2]>>(
        lists: usize,
        pairs: impl Fn() -> I,
        scratch: &Scratch,
    ) -> Result<Self, ScratchError> {
        let mut start = vec![0; lists + 1];
        pairs().for_each(|&[list, _]| start[list as usize + 1] += 1);
        (0..lists).for_each(|k| start[k + 1] += start[k]);
        let mut at = start.clone();
        let mut triangles = scratch.zeros(start[lists])?;
        let to = &mut triangles[..];
        for &[list, t] in pairs() {
            to[at[list as usize]] = t;
            at[list as usize] += 1;
        }
        Ok(Self { start, triangles })
    }

    fn of(&self, list: usize) -> &[u32] {
        &self.triangles[self.start[list]..self.start[list + 1]]
    }

    fn bytes(&self) -> usize {
        8 * self.start.len() + self.triangles.memory_bytes()
    }
}
