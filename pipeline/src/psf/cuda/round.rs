//! One round of the PSF stage: the descriptors of its tiles, a pure function of tiles, frame and grid.
//!
//! A tile is divided into equal blocks ([`Partition::blocks`]). The nodes of a block are divided into *groups* of at most
//! [`MAX_GROUP_NODES`], each with thread blocks and an image of its own, so that the blocks at the axis, where hundreds of nodes
//! may meet, do not delay all others. Block, group and kernel part of each term of a pixel's sum, and their order, follow from the
//! tile alone.

use super::descriptors::{Block, BlockImages, Job, KernelPart, Tile, Weight};
use super::partition::{Partition, packed_width};
use super::tile::PsfTile;
use super::touching::touching;
use crate::geometry::{Frame, Rect};
use crate::psf::grid::{Node, NodeGrid};
use crate::psf::polar::BlockPlace;
use crate::real;
use bytemuck::Zeroable;
use std::ops::Range;

/// Maximum of nodes that a thread block processes.
pub(super) const MAX_GROUP_NODES: usize = 16;

/// A batch, or as many of its tiles as fit in memory at once.
#[derive(Debug, Default)]
pub(super) struct Round {
    pub(super) tiles: Vec<Tile>,
    pub(super) blocks: Vec<Block>,
    pub(super) block_images: Vec<BlockImages>,
    pub(super) jobs: Vec<Job>,
    pub(super) weights: Vec<Weight>,
    /// The node of each weight.
    pub(super) nodes: Vec<Node>,
    /// First job and first weight of each node group, which has one job for each kernel part.
    pub(super) groups: Vec<(usize, usize)>,
    /// Total rows of the packed blocks.
    pub(super) packed_rows: usize,
    /// Maximum rows and columns of a contribution.
    pub(super) max_contribution: (u32, u32),
}

impl Round {
    /// Device memory of packed blocks, images and lists, bytes.
    pub(super) fn bytes(&self, partition: &Partition) -> usize {
        4 * (self.packed_len(partition) + self.jobs.len() * partition.image_len())
            + self.list_bytes(partition)
    }

    /// f32 values of the packed blocks.
    pub(super) fn packed_len(&self, partition: &Partition) -> usize {
        4 * self.packed_rows * partition.side
    }

    /// Bytes of all lists, with a [`KernelPart`] for every part of every node.
    fn list_bytes(&self, partition: &Partition) -> usize {
        size_of_val(&self.tiles[..])
            + size_of_val(&self.blocks[..])
            + size_of_val(&self.block_images[..])
            + size_of_val(&self.jobs[..])
            + self.weights.len() * (size_of::<Weight>() + partition.images() * size_of::<KernelPart>())
            + 8 * 16
    }

    /// Appends a tile.
    pub(super) fn add(&mut self, tile: &PsfTile, frame: &Frame, grid: &NodeGrid, partition: &Partition) {
        let (rect, tail) = (tile.rect, partition.window - 1);
        let (rows, cols) = ((rect.height + tail) as u32, (rect.width + tail) as u32);
        self.max_contribution = (self.max_contribution.0.max(rows), self.max_contribution.1.max(cols));
        let unsplit = Tile {
            remapped: tile.remapped_offset as u64,
            contribution: tile.contribution_offset as u64,
            stride: tile.contribution_stride as u32,
            rows,
            cols,
            first: self.block_images.len() as u32,
            ..Tile::zeroed()
        };
        if partition.side == 0 {
            return self.tiles.push(unsplit);
        }
        let ((down, block_y), (across, block_x)) =
            (partition.blocks(rect.height), partition.blocks(rect.width));
        self.tiles.push(Tile {
            block_y: block_y as u32,
            block_x: block_x as u32,
            down: down as u32,
            across: across as u32,
            last_rows: (rect.height - (down - 1) * block_y) as u32,
            last_cols: (rect.width - (across - 1) * block_x) as u32,
            ..unsplit
        });
        for block in rect.tiles(block_y, block_x) {
            self.add_block(tile, block, frame, grid, partition);
        }
    }

    fn add_block(
        &mut self,
        tile: &PsfTile,
        block: Rect,
        frame: &Frame,
        grid: &NodeGrid,
        partition: &Partition,
    ) {
        let place = BlockPlace {
            dy_px: block.y as f64 - frame.axis_px.0,
            dx_px: block.x as f64 - frame.axis_px.1,
            rows: block.height,
            cols: block.width,
        };
        let (half_y, half_x, r, azimuth, around) = place.centre();
        let (y, x) = ((block.y - tile.rect.y) as usize, (block.x - tile.rect.x) as usize);
        let (height, width) = (partition.height(block.height), packed_width(block.width));
        let (packed, first) = (self.packed_rows as u32, self.weights.len());
        self.blocks.push(Block {
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
            near_axis: around.into(),
            packed,
            unused: 0,
        });
        self.packed_rows += height;
        for (node, weight) in touching(&place, grid) {
            self.nodes.push(node);
            self.weights.push(Weight {
                rise: weight.rise,
                rise_at: weight.rise_at,
                fall: weight.fall,
                fall_at: weight.fall_at,
                azimuth: weight.azimuth_rad,
                per_rad: weight.per_rad,
                spectrum: 0,
                unused: 0,
            });
        }
        let count = self.weights.len() - first;
        let groups = count.div_ceil(MAX_GROUP_NODES);
        self.block_images.push(BlockImages { first: self.jobs.len() as u32, groups: groups as u32 });
        for group in 0..groups {
            let start = |group: usize| (first + count * group / groups) as u32;
            self.groups.push((self.jobs.len(), start(group) as usize));
            self.jobs.extend((0..partition.images() as u32).map(|part| Job {
                packed,
                height: height as u32,
                width: width as u32,
                first: start(group),
                end: start(group + 1),
                part,
                unused: [0; 2],
            }));
        }
    }

    /// Appends the tiles of `other`.
    pub(super) fn append(&mut self, other: Self) {
        let (packed, image, job, weight) = (
            self.packed_rows as u32,
            self.block_images.len() as u32,
            self.jobs.len() as u32,
            self.weights.len() as u32,
        );
        self.tiles.extend(other.tiles.into_iter().map(|t| Tile { first: t.first + image, ..t }));
        self.blocks.extend(other.blocks.into_iter().map(|b| Block { packed: b.packed + packed, ..b }));
        self.block_images
            .extend(other.block_images.into_iter().map(|b| BlockImages { first: b.first + job, ..b }));
        let moved =
            |j: Job| Job { packed: j.packed + packed, first: j.first + weight, end: j.end + weight, ..j };
        self.jobs.extend(other.jobs.into_iter().map(moved));
        self.weights.extend(other.weights);
        self.nodes.extend(other.nodes);
        let groups = other.groups.into_iter().map(|(j, w)| (j + job as usize, w + weight as usize));
        self.groups.extend(groups);
        self.packed_rows += other.packed_rows;
        let ((rows, columns), of_other) = (self.max_contribution, other.max_contribution);
        self.max_contribution = (rows.max(of_other.0), columns.max(of_other.1));
    }

    /// Jobs and weights of node group `i`.
    pub(super) fn group(&self, i: usize) -> (Range<usize>, Range<usize>) {
        let (job, weight) = self.groups[i];
        let (end_job, end_weight) =
            self.groups.get(i + 1).copied().unwrap_or((self.jobs.len(), self.weights.len()));
        (job..end_job, weight..end_weight)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn groups_are_within_the_maximum_and_cover_all_weights() {
        let grid = NodeGrid::new(&[0.0, 0.5, 1.0, 1.5, 2.0], &[1, 72, 72, 72, 72], 0.01);
        let frame =
            Frame::centred(crate::geometry::Size::new(300, 300), crate::geometry::Size::new(300, 300), 10.0);
        let mut round = Round::default();
        let tile = PsfTile {
            rect: Rect::new(-7, -7, 300, 310),
            remapped_offset: 5,
            contribution_offset: 9,
            contribution_stride: 400,
        };
        round.add(&tile, &frame, &grid, &Partition::for_window(151));
        let mut end = 0;
        for i in 0..round.groups.len() {
            let (jobs, weights) = round.group(i);
            assert!(
                jobs.len() == 1 && weights.start == end && (1..=MAX_GROUP_NODES).contains(&weights.len())
            );
            end = weights.end;
        }
        assert_eq!(end, round.weights.len());
        assert_eq!(round.block_images.len(), round.blocks.len());
    }

    #[test]
    fn appended_rounds_are_those_of_all_tiles() {
        let grid = NodeGrid::new(&[0.0, 0.5, 1.0, 1.5, 2.0], &[1, 72, 72, 72, 72], 0.01);
        let film = crate::geometry::Size::new(300, 300);
        let (frame, partition) = (Frame::centred(film, film, 10.0), Partition::for_window(201));
        let tile = |i: usize| PsfTile {
            rect: Rect::new(-7, 90 * i as i64, 110, 90),
            remapped_offset: 9900 * i,
            contribution_offset: 200_000 * i,
            contribution_stride: 400,
        };
        let (mut all, mut appended) = (Round::default(), Round::default());
        for i in 0..3 {
            all.add(&tile(i), &frame, &grid, &partition);
            let mut one = Round::default();
            one.add(&tile(i), &frame, &grid, &partition);
            appended.append(one);
        }
        assert_eq!(format!("{all:?}"), format!("{appended:?}"));
    }
}
