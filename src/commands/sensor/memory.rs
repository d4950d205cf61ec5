//! Memory of a run, planned before the first pixel.
//!
//! Fixed: the program; the signal of a row of shards (two planes if illuminance is summed); the rows finished by a block of the film. Per
//! thread: the film pixels of some bands of a row block and column block, their sums, a shard of digital numbers and its encoded bytes; whole columns where charge flows along them; what surrounds the block where the camera moves. The rest is a cache of decoded
//! chunks where column blocks share film columns, at most two columns of chunks of all bands.

use crate::machine::MemoryLimit;
use crate::progress::mib;
use anyhow::Result;

/// The program, its threads' stacks, the allocator's slack.
const BASE: usize = 48 << 20;
/// Of each thread: a chunk on its way, lanes.
const WORKER: usize = 6 << 20;
/// Maximum default limit.
pub const DEFAULT: u64 = 1 << 30;
/// Of each row of a column along which charge flows: a strip of the signal and the flows of a part of it.
const STRIP_BYTES: usize = 4 * STRIP + 64 * 8 * 8;
/// Columns of the signal that are read at a time for that.
pub const STRIP: usize = 512;
/// Bands of a block that are read together where memory allows it. Of 31 bands of 16 Mpx with corrections, whose sums are then read and written less often, 16 took 3.6 core seconds, 4 4.3 and 1 5.4; without, 1 to 4 the same. Weights of angles are interpolated for up to 4 bands at a time.
const BANDS_AT_ONCE: usize = 4;
const BANDS_AT_ONCE_WITH_CORRECTIONS: usize = 16;
/// Minimum rows of a block of the film.
const BLOCK_ROWS: usize = 512;

/// What a run's memory depends on.
pub struct Needs {
    /// Width of the widest output in pixels.
    pub width: usize,
    /// Rows and columns of the largest shard.
    pub shard: (usize, usize),
    /// Bands of the film.
    pub bands: usize,
    /// Rows and columns of the film's chunks.
    pub chunk: (usize, usize),
    /// Film pixels a sensor pixel.
    pub ratio: f64,
    /// Whether film columns belong to one column block each.
    pub aligned: bool,
    /// Planes of the pass.
    pub planes: usize,
    /// Further ones, of crosstalk.
    pub corrections: usize,
    /// Rows of the columns along which charge flows; 0 without.
    pub column: usize,
    /// Film pixels around a block that motion of the camera reads; 0 without.
    pub margin: usize,
}

/// How a run's memory is spent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Memory {
    /// All of it, bytes.
    pub limit: usize,
    /// Worker threads.
    pub threads: usize,
    /// Decoded chunks of the film, bytes.
    pub cache: usize,
    /// Rows and columns of the film that a worker reads at a time.
    pub block: (usize, usize),
    /// Bands of a block that a worker reads before it adds them.
    pub bands_at_once: usize,
}

impl Memory {
    /// Plans within the limit `given`, with at most `threads` threads.
    pub fn plan(given: MemoryLimit, threads: usize, needs: &Needs) -> Result<Self> {
        let limit = usize::try_from(given.bytes).unwrap_or(usize::MAX);
        let block = (BLOCK_ROWS.div_ceil(needs.chunk.0) * needs.chunk.0, needs.chunk.1);
        let rows = (block.0 as f64 / needs.ratio).ceil() as usize + 1;
        // Crosstalk keeps the rows of a block of all planes beside those that it delivers.
        let all_planes = needs.planes + needs.corrections;
        let kept = if needs.corrections > 0 { 2 * all_planes } else { 0 };
        let signal = 4 * needs.width * (needs.shard.0 + (all_planes + kept) * rows);
        let film_columns = (needs.width as f64 * needs.ratio) as usize;
        let carry = if needs.aligned { 0 } else { 2 * 8 * 4 * needs.bands * film_columns };
        let shard = needs.shard.0 * needs.shard.1;
        let sums =
            (8 * needs.planes + 4 * needs.corrections) * rows * ((block.1 as f64 / needs.ratio) as usize + 2);
        let moved = match needs.margin {
            0 => 0,
            margin => 4 * (block.0 + 2 * margin) * (block.1 + 16 + 2 * margin),
        };
        let flows = needs.column * (STRIP_BYTES + 4 * needs.shard.1);
        let worker_with = |bands_at_once: usize| {
            let block_bytes = 4 * bands_at_once * block.0 * (block.1 + 16) + sums;
            let chunks = 4 * needs.chunk.0 * needs.chunk.1 * 2;
            WORKER + flows + (chunks + block_bytes + moved).max(shard * (4 + 2 + 2))
        };
        let fixed = BASE + signal + carry;
        let usable = limit / 16 * 15;
        let most = if needs.corrections > 0 { BANDS_AT_ONCE_WITH_CORRECTIONS } else { BANDS_AT_ONCE };
        let most = most.min(needs.bands.max(1));
        let mut fewer = std::iter::successors(Some(most), |n| Some(n / 2).filter(|n| *n > 0));
        let fits = |n: &usize| fixed + threads * worker_with(*n) <= usable;
        let bands_at_once = fewer.find(fits).unwrap_or(1);
        let worker = worker_with(bands_at_once);
        let fit = (1..=threads).rev().find(|n| fixed + n * worker <= usable);
        let Some(threads) = fit else {
            let minimum = (fixed + worker) / 15 * 16;
            return Err(given.too_small(format!(
                "rows of {} pixels need at least {}; give that much, or a smaller --size",
                needs.width,
                mib(minimum)
            )));
        };
        let column = 4 * needs.chunk.0 * needs.chunk.1 * needs.bands * (block.0 / needs.chunk.0);
        let wanted = if needs.aligned { 0 } else { column.saturating_mul(threads + 2) };
        Ok(Self {
            limit,
            threads,
            cache: wanted.min(usable - fixed - threads * worker),
            block,
            bands_at_once,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plan(bytes: u64, threads: usize, needs: &Needs) -> Result<Memory> {
        Memory::plan(MemoryLimit::new(Some(bytes), DEFAULT), threads, needs)
    }

    fn needs(aligned: bool) -> Needs {
        Needs {
            width: 14141,
            shard: (2048, 2048),
            bands: 31,
            chunk: (512, 512),
            ratio: 1.0,
            aligned,
            planes: 1,
            corrections: 0,
            column: 0,
            margin: 0,
        }
    }

    #[test]
    fn largest_sensor_works_in_256_mib_and_100_mib_is_an_error() {
        let memory = plan(256 << 20, 2, &needs(true)).unwrap();
        assert!(memory.threads >= 1 && memory.cache == 0);
        assert!(plan(100 << 20, 2, &needs(true)).unwrap_err().to_string().contains("too small"));
        let memory = plan(1 << 30, 2, &Needs { ratio: 2.75, width: 5142, ..needs(false) }).unwrap();
        assert_eq!((memory.threads, memory.cache), (2, (4 * 31) << 20));
    }
}
