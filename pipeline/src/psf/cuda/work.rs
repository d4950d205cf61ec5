//! What a batch of tiles has to do, told in the descriptors of `psf.cu`: a pure function of tiles, frame and grid.
//!
//! A tile is cut into equal blocks ([`Cut::blocks`]). The nodes that touch a block are worked off in *pieces* of at most
//! [`PIECE`], each by thread blocks of its own with an image of its own, so that the blocks at the axis, where hundreds of nodes
//! may meet, do not hold up all others. Which block, piece and kernel part adds to a pixel, and in which order, follows from the
//! tile alone.

use super::PsfTile;
use super::cut::{Cut, packed_width};
use crate::geometry::{Frame, Rect};
use crate::psf::grid::{Node, NodeGrid, Reach, Tent};
use crate::psf::polar::BlockPlace;
use crate::real;
use bytemuck::{Pod, Zeroable};
use std::f64::consts::{PI, TAU};

/// Nodes that a thread block works off at most.
pub(super) const PIECE: usize = 16;

/// How far off the reach of a block may be told, px and rad: far more than f32 loses, far less than a node's share can show.
const SLACK_PX: f64 = 1e-3;
const SLACK_RAD: f64 = 1e-6;

/// `Block` in `psf.cu`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(super) struct BlockWork {
    dy: f64,
    dx: f64,
    r: f64,
    azimuth: f64,
    cosine: f32,
    sine: f32,
    half_y: f32,
    half_x: f32,
    remapped: u64,
    stride: u32,
    rows: u32,
    cols: u32,
    height: u32,
    width: u32,
    around: u32,
    packed: u32,
    unused: u32,
}

/// `Tent` in `psf.cu`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(super) struct TentWork {
    rise: f32,
    rise_at: f32,
    fall: f32,
    fall_at: f32,
    azimuth: f32,
    per_rad: f32,
    pub(super) spectrum: u32,
    unused: u32,
}

/// `Job` in `psf.cu`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(super) struct JobWork {
    packed: u32,
    height: u32,
    width: u32,
    first: u32,
    end: u32,
    part: u32,
    unused: [u32; 2],
}

/// `Turn` in `psf.cu`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(super) struct TurnWork {
    pub(super) seed: u32,
    pub(super) exchanged: u32,
    pub(super) quarter: u32,
    pub(super) y: u32,
    pub(super) x: u32,
    pub(super) rows: u32,
    pub(super) cols: u32,
    pub(super) spectrum: u32,
}

/// `Tile` in `psf.cu`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(super) struct TileWork {
    remapped: u64,
    light: u64,
    stride: u32,
    rows: u32,
    cols: u32,
    block_y: u32,
    block_x: u32,
    down: u32,
    across: u32,
    last_rows: u32,
    last_cols: u32,
    first: u32,
}

/// `Slots` in `psf.cu`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(super) struct SlotsWork {
    first: u32,
    pieces: u32,
}

/// A batch, or as much of it as is in memory at once.
#[derive(Debug, Default)]
pub(super) struct Work {
    pub(super) tiles: Vec<TileWork>,
    pub(super) blocks: Vec<BlockWork>,
    pub(super) slots: Vec<SlotsWork>,
    pub(super) jobs: Vec<JobWork>,
    pub(super) tents: Vec<TentWork>,
    /// Of each tent.
    pub(super) nodes: Vec<Node>,
    /// First job and first tent of each piece; its jobs are one for each kernel part.
    pub(super) pieces: Vec<(usize, usize)>,
    /// Rows of packed blocks.
    pub(super) packed_rows: usize,
    /// The largest tile of light.
    pub(super) light: (u32, u32),
}

impl Work {
    /// Device memory that it takes, without spectra and seeds.
    pub(super) fn bytes(&self, cut: &Cut) -> usize {
        4 * (self.packed_len(cut) + self.jobs.len() * cut.image_len()) + self.list_bytes(cut)
    }

    /// Values of the packed blocks.
    pub(super) fn packed_len(&self, cut: &Cut) -> usize {
        4 * self.packed_rows * cut.side
    }

    /// Bytes of all lists, with a turn for every part of every node.
    fn list_bytes(&self, cut: &Cut) -> usize {
        size_of_val(&self.tiles[..])
            + size_of_val(&self.blocks[..])
            + size_of_val(&self.slots[..])
            + size_of_val(&self.jobs[..])
            + self.tents.len() * (size_of::<TentWork>() + cut.images() * size_of::<TurnWork>())
            + 8 * 16
    }

    /// Adds a tile.
    pub(super) fn add(&mut self, tile: &PsfTile, frame: &Frame, grid: &NodeGrid, cut: &Cut) {
        let (rect, tail) = (tile.rect, cut.window - 1);
        let (rows, cols) = ((rect.height + tail) as u32, (rect.width + tail) as u32);
        self.light = (self.light.0.max(rows), self.light.1.max(cols));
        let whole = TileWork {
            remapped: tile.remapped_offset as u64,
            light: tile.light_offset as u64,
            stride: tile.light_stride as u32,
            rows,
            cols,
            first: self.slots.len() as u32,
            ..TileWork::zeroed()
        };
        if cut.side == 0 {
            return self.tiles.push(whole);
        }
        let ((down, block_y), (across, block_x)) = (cut.blocks(rect.height), cut.blocks(rect.width));
        self.tiles.push(TileWork {
            block_y: block_y as u32,
            block_x: block_x as u32,
            down: down as u32,
            across: across as u32,
            last_rows: (rect.height - (down - 1) * block_y) as u32,
            last_cols: (rect.width - (across - 1) * block_x) as u32,
            ..whole
        });
        for block in rect.tiles(block_y, block_x) {
            self.add_block(tile, block, frame, grid, cut);
        }
    }

    fn add_block(&mut self, tile: &PsfTile, block: Rect, frame: &Frame, grid: &NodeGrid, cut: &Cut) {
        let place = BlockPlace {
            dy_px: block.y as f64 - frame.axis_px.0,
            dx_px: block.x as f64 - frame.axis_px.1,
            rows: block.height,
            cols: block.width,
        };
        let (half_y, half_x, r, azimuth, around) = place.centre();
        let (y, x) = ((block.y - tile.rect.y) as usize, (block.x - tile.rect.x) as usize);
        let (height, width) = (cut.height(block.height), packed_width(block.width));
        let (packed, first) = (self.packed_rows as u32, self.tents.len());
        self.blocks.push(BlockWork {
            dy: place.dy_px,
            dx: place.dx_px,
            r,
            azimuth,
            cosine: real::cos(azimuth) as f32,
            sine: real::sin(azimuth) as f32,
            half_y: half_y as f32,
            half_x: half_x as f32,
            remapped: (tile.remapped_offset + y * tile.rect.width + x) as u64,
            stride: tile.rect.width as u32,
            rows: block.height as u32,
            cols: block.width as u32,
            height: height as u32,
            width: width as u32,
            around: around.into(),
            packed,
            unused: 0,
        });
        self.packed_rows += height;
        for (node, tent) in touching(&place, grid) {
            self.nodes.push(node);
            self.tents.push(TentWork {
                rise: tent.rise,
                rise_at: tent.rise_at,
                fall: tent.fall,
                fall_at: tent.fall_at,
                azimuth: tent.azimuth_rad,
                per_rad: tent.per_rad,
                spectrum: 0,
                unused: 0,
            });
        }
        let count = self.tents.len() - first;
        let pieces = count.div_ceil(PIECE);
        self.slots.push(SlotsWork { first: self.jobs.len() as u32, pieces: pieces as u32 });
        for piece in 0..pieces {
            let at = |piece: usize| (first + count * piece / pieces) as u32;
            self.pieces.push((self.jobs.len(), at(piece) as usize));
            self.jobs.extend((0..cut.images() as u32).map(|part| JobWork {
                packed,
                height: height as u32,
                width: width as u32,
                first: at(piece),
                end: at(piece + 1),
                part,
                unused: [0; 2],
            }));
        }
    }

    /// Takes back the tiles from the `kept`-th on.
    pub(super) fn truncate(&mut self, kept: usize) {
        let first = self.tiles[kept].first as usize;
        self.tiles.truncate(kept);
        let Some(block) = self.blocks.get(first) else { return };
        self.packed_rows = block.packed as usize;
        let job = self.slots[first].first as usize;
        let tent = self.jobs[job].first as usize;
        let piece = self.pieces.partition_point(|(own, _)| *own < job);
        self.blocks.truncate(first);
        self.slots.truncate(first);
        self.jobs.truncate(job);
        self.tents.truncate(tent);
        self.nodes.truncate(tent);
        self.pieces.truncate(piece);
    }

    /// Jobs and tents of piece `i`.
    pub(super) fn piece(&self, i: usize) -> (std::ops::Range<usize>, std::ops::Range<usize>) {
        let (job, tent) = self.pieces[i];
        let (end_job, end_tent) =
            self.pieces.get(i + 1).copied().unwrap_or((self.jobs.len(), self.tents.len()));
        (job..end_job, tent..end_tent)
    }
}

/// The nodes that may have a share in a block, in the order of the sum. Near the axis azimuths may wrap inside the block: a node
/// then comes once for each whole turn at which it meets the block's azimuths, −π to π at most; the shares do not overlap.
fn touching(place: &BlockPlace, grid: &NodeGrid) -> Vec<(Node, Tent)> {
    let reach = reach(place);
    let mut nodes = Vec::new();
    grid.touching(&reach, &mut nodes);
    if !reach.around {
        return nodes;
    }
    let (low, high) = (f64::from(reach.theta.0), f64::from(reach.theta.1));
    let mut turned = Vec::new();
    for (node, tent) in nodes {
        let spacing = 1.0 / f64::from(tent.per_rad);
        if spacing.is_infinite() {
            turned.push((node, tent)); // the axis node takes every azimuth
            continue;
        }
        let azimuths = [0.0, -TAU, TAU].map(|turn| f64::from(tent.azimuth_rad) + turn);
        let meeting = azimuths.into_iter().filter(|a| a - spacing < high && a + spacing > low);
        turned.extend(meeting.map(|a| (node, Tent { azimuth_rad: a as f32, ..tent })));
    }
    turned
}

/// The reach of a block's pixels, a little wide.
fn reach(place: &BlockPlace) -> Reach {
    let (_, _, r_px, azimuth_rad, around) = place.centre();
    let (top, left) = (place.dy_px, place.dx_px);
    let (bottom, right) = (top + (place.rows - 1) as f64, left + (place.cols - 1) as f64);
    let nearest = real::hypot(0f64.clamp(top, bottom), 0f64.clamp(left, right));
    let farthest = real::hypot(top.abs().max(bottom.abs()), left.abs().max(right.abs()));
    // Seen from outside, the corners are the outermost.
    let (mut low, mut high) = (0f64, 0f64);
    for (y, x) in [(top, left), (top, right), (bottom, left), (bottom, right)] {
        let turn = real::atan2(y, x) - azimuth_rad;
        let turn = turn - TAU * (turn / TAU).round();
        (low, high) = (low.min(turn), high.max(turn));
    }
    if top < 1.0 && bottom > -1.0 && left < 1.0 && right > -1.0 {
        (low, high) = (-PI, PI);
    }
    Reach {
        r_px,
        azimuth_rad,
        r: ((nearest - r_px - SLACK_PX) as f32, (farthest - r_px + SLACK_PX) as f32),
        theta: ((low - SLACK_RAD) as f32, (high + SLACK_RAD) as f32),
        around,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shares(place: &BlockPlace, grid: &NodeGrid, y: usize, x: usize) -> Vec<(Node, f32)> {
        let (mut r, mut theta) = (vec![0.0; place.rows * place.cols], vec![0.0; place.rows * place.cols]);
        place.polar(place.cols, &mut r, &mut theta);
        let i = y * place.cols + x;
        let nodes = touching(place, grid);
        nodes.iter().map(|(n, t)| (*n, t.share(r[i], theta[i], false))).filter(|(_, w)| *w > 0.0).collect()
    }

    #[test]
    fn blocks_anywhere_find_the_nodes_of_the_cpu() {
        let grid = NodeGrid::new(&[0.0, 0.3, 0.4, 1.1, 3.0], &[1, 4, 12, 36, 72], 0.01);
        let rc: [(f64, f64); 8] = [
            (-40.0, -35.5),
            (-80.0, -20.0),
            (3.0, 4.0),
            (-90.0, -0.5),
            (0.0, 100.0),
            (-31.0, -150.0),
            (0.0, 0.0),
            (60.0, -300.0),
        ];
        for (dy_px, dx_px) in rc {
            let place = BlockPlace { dy_px, dx_px, rows: 71, cols: 78 };
            let mut all = Vec::new();
            let (mut r, mut theta) = (vec![0.0; 71 * 78], vec![0.0; 71 * 78]);
            let reach = place.polar(78, &mut r, &mut theta);
            grid.touching(&reach, &mut all);
            for (y, x) in [(0, 0), (70, 77), (0, 77), (70, 0), (35, 40), (40, 35), (41, 36)] {
                let i = y * 78 + x;
                let cpu = all.iter().map(|(n, t)| (*n, t.share(r[i], theta[i], reach.around)));
                let mut cpu: Vec<_> = cpu.filter(|(_, w)| *w > 1e-6).collect();
                let mut gpu = shares(&place, &grid, y, x);
                gpu.retain(|(_, w)| *w > 1e-6);
                cpu.sort_by_key(|(n, _)| *n);
                gpu.sort_by_key(|(n, _)| *n);
                assert_eq!(cpu.len(), gpu.len(), "{place:?} at {y}, {x}: {cpu:?}, {gpu:?}");
                for ((n, a), (m, b)) in cpu.iter().zip(&gpu) {
                    assert!(n == m && (a - b).abs() < 1e-5, "{n:?} {a}, {m:?} {b}");
                }
            }
        }
    }

    #[test]
    fn near_blocks_beside_the_axis_leave_out_what_lies_behind_it() {
        let grid = NodeGrid::new(&[0.0, 0.5, 1.0, 1.5, 2.0], &[1, 72, 72, 72, 72], 0.01);
        let count = |dx_px| touching(&BlockPlace { dy_px: -35.0, dx_px, rows: 71, cols: 71 }, &grid).len();
        // The axis's node and all of the first ring, against those of two rings that lie within 74° of +x.
        assert!(count(-35.0) >= 73 && count(10.0) < 73, "{} {}", count(-35.0), count(10.0));
    }

    #[test]
    fn every_piece_is_small_and_none_is_left_out() {
        let grid = NodeGrid::new(&[0.0, 0.5, 1.0, 1.5, 2.0], &[1, 72, 72, 72, 72], 0.01);
        let frame =
            Frame::centred(crate::geometry::Size::new(300, 300), crate::geometry::Size::new(300, 300), 10.0);
        let mut work = Work::default();
        let tile = PsfTile {
            rect: Rect::new(-7, -7, 300, 310),
            remapped_offset: 5,
            light_offset: 9,
            light_stride: 400,
        };
        work.add(&tile, &frame, &grid, &Cut::choose(151));
        let mut tents = 0;
        for i in 0..work.pieces.len() {
            let (jobs, own) = work.piece(i);
            assert!(jobs.len() == 1 && own.start == tents && (1..=PIECE).contains(&own.len()));
            tents = own.end;
        }
        assert_eq!(tents, work.tents.len());
        assert_eq!(work.slots.len(), work.blocks.len());
    }
}
