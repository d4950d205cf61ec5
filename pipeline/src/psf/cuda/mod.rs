//! The PSF stage of one band on a GPU: the sums of [`crate::psf`], launched; `psf.cu` beside its CPU twins does them.
//!
//! Tiles come as remapped and go as light with their tails, both in device memory. A batch of tiles shares its launches; what a tile gets
//! depends on the tile alone (`work`). Kernels are made by the CPU as for its own transforms, one *seed* for four or
//! eight of them; the device turns them and keeps seeds and spectra in two pools (`resident`). Where memory is short a batch is
//! worked off in rounds of fewer tiles, and these in rounds of fewer nodes: the same sums in the same order.
//!
//! On a card (H200: 132 multiprocessors at 1.755 GHz; counted, see `scripts/bench`): at 51 px 16 warp instructions a pixel, at 151 px 38.

mod budget;
mod cut;
mod launch;
mod resident;
mod work;

pub use cut::Cut;

use crate::cuda::handle::CudaStream;
use crate::cuda::slice::CudaSlice;
use crate::cuda::{CudaError, Device};
use crate::geometry::{Frame, Rect};
use crate::psf::BandPsf;
use crate::psf::blocks::Blocks;
use crate::psf::grid::{Node, NodeGrid};
use crate::psf::kernel::{KernelScratch, NodeKernels};
use crate::psf::polar::{ATAN, SECANT};
use budget::Budget;
use launch::{Entries, Launcher, Lists, grow};
use rayon::prelude::*;
use resident::Resident;
use std::ops::Range;
use std::sync::Arc;
use work::{JobWork, TurnWork, Work};

/// Seeds that the CPU makes before they go up together.
const SEEDS_AT_ONCE: usize = 64;

/// One tile of a batch: where its remapped lies, and where its light goes.
#[derive(Clone, Copy, Debug)]
pub struct PsfTile {
    /// On the film.
    pub rect: Rect,
    /// Its first value in the remapped_px; rows are as wide as the tile.
    pub remapped_offset: usize,
    /// The first value in the lights of [`BandPsf::reaches`] of it.
    pub light_offset: usize,
    /// Values from one row of light to the next.
    pub light_stride: usize,
}

/// The PSF stage of one band on one GPU, for one stream at a time.
#[derive(Debug)]
pub struct PsfOnDevice {
    device: Arc<Device>,
    frame: Frame,
    grid: NodeGrid,
    kernels: Arc<NodeKernels>,
    cut: Cut,
    budget: Budget,
    entries: Entries,
    tables: CudaSlice<f32>,
    polynomials: CudaSlice<f32>,
    spectra: CudaSlice<f32>,
    seeds: CudaSlice<f32>,
    spectrum_places: Resident,
    seed_places: Resident,
    /// Packed blocks, images, lists.
    scratch: CudaSlice<u32>,
}

/// What a round does, in order.
#[derive(Debug)]
enum Step {
    /// Seeds into their places.
    Seeds(Vec<(usize, Node)>),
    /// Some of the turns.
    Spectra(Range<usize>),
    /// Some of the jobs.
    Scatter(Range<usize>),
}

impl PsfOnDevice {
    /// The least device memory, in bytes, that the stage can work in for tiles of `tile_side`.
    pub fn least_bytes(blocks: &Blocks, grid: &NodeGrid, tile_side: usize) -> usize {
        let cut = Cut::choose(blocks.window);
        Budget::least(&cut, grid, tile_side).bytes(&cut)
    }

    /// The stage of `psf` on `device`, in at most `bytes` of its memory.
    ///
    /// # Errors
    /// Less than [`PsfOnDevice::least_bytes`], and what the driver reports.
    pub fn new(device: &Arc<Device>, frame: &Frame, psf: &BandPsf, bytes: usize) -> Result<Self, CudaError> {
        let (grid, cut) = (psf.grid(), Cut::choose(psf.blocks().window));
        let budget = Budget::within(bytes, &cut, grid, psf.blocks().tile).map_err(|least| {
            let (what, asked_bytes) = ("the PSF stage of one tile".to_owned(), least.bytes(&cut) as u64);
            let (device, free_bytes) = (device.index(), bytes as u64);
            CudaError::OutOfMemory { device, what, asked_bytes, free_bytes, total_bytes: free_bytes }
        })?;
        let stream = device.context.default_stream();
        let room = |len: usize, what| device.allocate::<f32>(&stream, len.max(1), what);
        let fill = |values: &[f32], what| {
            let mut to = room(values.len(), what)?;
            stream.memcpy_htod(values, &mut to).map_err(device.failed("uploading tables"))?;
            Ok(to)
        };
        let tables = if cut.side == 0 { vec![0.0] } else { cut.tables() };
        let this = Self {
            entries: Entries::load(device, &cut)?,
            tables: fill(&tables, "roots of unity")?,
            polynomials: fill(&[&ATAN[..], &SECANT[..]].concat(), "polynomials")?,
            spectra: room(budget.spectra * cut.spectrum_len(), "spectra")?,
            seeds: room(budget.seeds * cut.window * cut.window, "kernels")?,
            scratch: device.allocate(&stream, 1, "blocks")?,
            spectrum_places: Resident::new(budget.spectra),
            seed_places: Resident::new(budget.seeds),
            device: Arc::clone(device),
            frame: *frame,
            grid: grid.clone(),
            kernels: psf.shared_kernels(),
            cut,
            budget,
        };
        stream.synchronize().map_err(device.failed("uploading tables"))?;
        Ok(this)
    }

    /// Scatters the `remapped` of `tiles` into their `light`, every value of which is set; in the order of `stream`, on which all
    /// launches of this stage must be.
    ///
    /// # Errors
    /// What the driver reports; the stage is of no more use then.
    ///
    /// # Panics
    /// If a tile lies beyond `remapped` or `light`.
    pub fn launch(
        &mut self,
        stream: &Arc<CudaStream>,
        tiles: &[PsfTile],
        remapped: &CudaSlice<f32>,
        light: &mut CudaSlice<f32>,
    ) -> Result<(), CudaError> {
        for tile in tiles {
            let reach = tile.rect.grown(self.cut.window / 2);
            assert!(
                !tile.rect.is_empty() && tile.remapped_offset + tile.rect.size().pixels() <= remapped.len()
            );
            let last = tile.light_offset + (reach.height - 1) * tile.light_stride + reach.width;
            assert!(tile.light_stride >= reach.width && last <= light.len());
        }
        let mut rest = tiles;
        while !rest.is_empty() {
            let mut work = self.round(rest)?;
            rest = &rest[work.tiles.len()..];
            self.run(stream, &mut work, remapped, light)?;
        }
        Ok(())
    }

    /// As many of `tiles` as the scratch memory holds.
    fn round(&self, tiles: &[PsfTile]) -> Result<Work, CudaError> {
        let mut work = Work::default();
        for (i, tile) in tiles.iter().enumerate() {
            work.add(tile, &self.frame, &self.grid, &self.cut);
            let (asked, may) = (work.bytes(&self.cut), self.budget.scratch);
            if asked > may && i == 0 {
                let (device, what) =
                    (self.device.index(), format!("the PSF stage of the tile {}", tile.rect));
                let (asked_bytes, free_bytes) = (asked as u64, may as u64);
                let total_bytes = self.device.info.memory_bytes;
                return Err(CudaError::OutOfMemory { device, what, asked_bytes, free_bytes, total_bytes });
            }
            if asked > may {
                work.truncate(i);
                break;
            }
        }
        Ok(work)
    }

    /// Gives spectra their places, and tells what has to be done in which order.
    fn schedule(&mut self, work: &mut Work) -> (Vec<Step>, Vec<TurnWork>) {
        let (mut steps, mut turns, mut fresh) = (Vec::new(), Vec::new(), Vec::new());
        let mut jobs = 0..0;
        self.spectrum_places.release();
        for i in 0..work.pieces.len() {
            let (own, tents) = work.piece(i);
            if !self.place(work, tents.clone(), &mut fresh) {
                self.make(&mut fresh, &mut steps, &mut turns);
                steps.push(Step::Scatter(jobs.clone()));
                jobs = own.start..own.start;
                self.spectrum_places.release();
                let placed = self.place(work, tents, &mut fresh);
                assert!(placed, "there is room for the nodes of a piece");
            }
            jobs.end = own.end;
        }
        self.make(&mut fresh, &mut steps, &mut turns);
        steps.push(Step::Scatter(jobs));
        (steps, turns)
    }

    /// Places for the nodes of `tents`; false if they are not all to be had. `fresh` are those whose spectrum is not there yet.
    fn place(&mut self, work: &mut Work, tents: Range<usize>, fresh: &mut Vec<(Node, usize)>) -> bool {
        for t in tents {
            let node = work.nodes[t];
            let Some(place) = self.spectrum_places.place(self.grid.id(node)) else { return false };
            work.tents[t].spectrum = (place.index * self.cut.images()) as u32;
            if place.fresh {
                fresh.push((node, place.index));
            }
        }
        true
    }

    /// The steps that make the spectra of `fresh`.
    fn make(&mut self, fresh: &mut Vec<(Node, usize)>, steps: &mut Vec<Step>, turns: &mut Vec<TurnWork>) {
        let (mut seeds, mut begun) = (Vec::new(), turns.len());
        self.seed_places.release();
        for (node, index) in fresh.drain(..) {
            let making = self.kernels.making(&self.grid, node);
            let id = self.grid.id(making.seed);
            let place = self.seed_places.place(id).unwrap_or_else(|| {
                steps.extend([Step::Seeds(std::mem::take(&mut seeds)), Step::Spectra(begun..turns.len())]);
                begun = turns.len();
                self.seed_places.release();
                self.seed_places.place(id).expect("room for one seed")
            });
            if place.fresh {
                seeds.push((place.index, making.seed));
            }
            let Cut { window, parts, part, .. } = self.cut;
            turns.extend((0..self.cut.images()).map(|i| TurnWork {
                seed: (place.index * window * window) as u32,
                exchanged: making.exchanged.into(),
                quarter: making.quarter as u32,
                y: (i / parts * part) as u32,
                x: (i % parts * part) as u32,
                rows: part.min(window - i / parts * part) as u32,
                cols: part.min(window - i % parts * part) as u32,
                spectrum: (index * self.cut.images() + i) as u32,
            }));
        }
        if begun < turns.len() {
            steps.extend([Step::Seeds(seeds), Step::Spectra(begun..turns.len())]);
        }
    }

    fn run(
        &mut self,
        stream: &Arc<CudaStream>,
        work: &mut Work,
        remapped: &CudaSlice<f32>,
        light: &mut CudaSlice<f32>,
    ) -> Result<(), CudaError> {
        let (steps, turns) = self.schedule(work);
        let mut lists = Lists::default();
        let [tiles, blocks, slots, jobs, tents] = [
            lists.push(&work.tiles),
            lists.push(&work.blocks),
            lists.push(&work.slots),
            lists.push(&work.jobs),
            lists.push(&work.tents),
        ];
        let turn_list = lists.push(&turns);
        let (device, cut) = (&self.device, &self.cut);
        let (packed_len, images_len) = (work.packed_len(cut), work.jobs.len() * cut.image_len());
        grow(device, stream, &mut self.scratch, packed_len + images_len + lists.words.len())?;
        let (mut packed, mut rest) = self.scratch.split_at_mut(packed_len);
        let (mut images, mut rest) = rest.split_at_mut(images_len);
        stream.memcpy_htod(&lists.words, &mut rest).map_err(device.failed("uploading lists"))?;

        let on = Launcher { device, stream, cut, entries: &self.entries, tables: &self.tables };
        let list = |range: &Range<usize>| rest.slice(range.clone());
        let tile_grid = (work.light.1.div_ceil(32), work.light.0.div_ceil(8), work.tiles.len() as u32);
        if cut.side == 0 {
            return on.copy(tile_grid, &list(&tiles), remapped, light);
        }
        on.pack(work.blocks.len(), &list(&blocks), remapped, &self.polynomials, &mut packed)?;
        for step in steps {
            match step {
                Step::Seeds(seeds) => upload_seeds(&on, &self.kernels, &self.grid, &seeds, &mut self.seeds)?,
                Step::Spectra(range) => {
                    let own = sub::<TurnWork>(&turn_list, &range);
                    on.spectra(range.len(), &list(&own), &self.seeds, &mut self.spectra)?;
                }
                Step::Scatter(range) => {
                    let own = sub::<JobWork>(&jobs, &range);
                    let images = &mut images.slice_mut(range.start * cut.image_len()..);
                    let lists = (&list(&own), &list(&tents));
                    on.scatter(range.len(), lists, &packed, &self.spectra, images)?;
                }
            }
        }
        on.unfold(work.jobs.len(), &mut images)?;
        on.add(tile_grid, (&list(&tiles), &list(&slots)), &images, light)
    }
}

/// The part of a list in `all` that `range` of its entries takes.
fn sub<T>(all: &Range<usize>, range: &Range<usize>) -> Range<usize> {
    let words = size_of::<T>() / 4;
    all.start + range.start * words..all.start + range.end * words
}

/// Makes seeds, on all cores, and sends them to their places.
fn upload_seeds(
    on: &Launcher<'_>,
    kernels: &NodeKernels,
    grid: &NodeGrid,
    seeds: &[(usize, Node)],
    to: &mut CudaSlice<f32>,
) -> Result<(), CudaError> {
    let len = on.cut.window * on.cut.window;
    for some in seeds.chunks(SEEDS_AT_ONCE) {
        let make = |s: &mut KernelScratch, (_, seed): &(usize, Node)| kernels.seed(grid, *seed, s).to_vec();
        let made: Vec<Vec<f32>> = some.par_iter().map_init(KernelScratch::default, make).collect();
        for ((place, _), seed) in some.iter().zip(&made) {
            let place = &mut to.slice_mut(place * len..(place + 1) * len);
            on.stream.memcpy_htod(seed, place).map_err(on.device.failed("uploading kernels"))?;
        }
    }
    Ok(())
}
