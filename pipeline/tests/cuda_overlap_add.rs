//! Overlap-add on a GPU: the film has the bits of the sum in the order of the tiles, for any batches, film rows on the device and streams.

mod emulated_cuda;

use emulated_cuda::{Build, Case, PLAIN, SANITIZED_BUILD, Target};
use lenscube_pipeline::cuda::Device;
use lenscube_pipeline::geometry::{Rect, Size};
use lenscube_pipeline::psf::blocks::Blocks;
use lenscube_pipeline::stages::cuda::batches::batches;
use lenscube_pipeline::stages::cuda::film_rows::{FilmRows, strips};
use lenscube_pipeline::tiling::Tiling;
use std::ops::Range;
use std::process::ExitCode;

/// A film and the contributions of its tiles.
struct Film {
    tiling: Tiling,
    columns: Range<i64>,
    rows: Range<i64>,
    tiles: Vec<(usize, usize)>,
}

impl Film {
    /// All tiles of a film, or those that `has` contains.
    fn new(film: Size, window: usize, tile: usize, has: impl Fn(usize, usize) -> bool) -> Self {
        let tiling = Tiling::new(film, Some(&Blocks { window, fft: 64, block: tile, tile }));
        let (rows, columns) = tiling.count();
        let tiles = (0..rows).flat_map(|i| (0..columns).map(move |j| (i, j))).filter(|&(i, j)| has(i, j));
        let (columns, rows) = (0..film.width as i64, 0..film.height as i64);
        Self { tiling, columns, rows, tiles: tiles.collect() }
    }

    /// The contribution of a tile: numbers whose sum depends on its order.
    fn contribution(&self, tile: (usize, usize)) -> Vec<f32> {
        let reach = self.tiling.reach(tile);
        let mut state = (tile.0 * 7919 + tile.1 * 104_729 + 1) as u32;
        let mut next = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / 8_388_608.0 - 0.7
        };
        (0..reach.size().pixels()).map(|_| next() * 10f32.powi(tile.1 as i32 % 4)).collect()
    }

    /// The film rows that tiles reach, by row: the sum in the order of `tiles`.
    fn sum(&self, tiles: impl Iterator<Item = (usize, usize)>) -> Vec<Option<Vec<u32>>> {
        let mut rows: Vec<Option<Vec<f32>>> = vec![None; self.rows.end as usize];
        for tile in tiles {
            let (reach, values) = (self.tiling.reach(tile), self.contribution(tile));
            let area = Rect::new(
                self.rows.start,
                self.columns.start,
                (self.rows.end - self.rows.start) as usize,
                (self.columns.end - self.columns.start) as usize,
            );
            let common = reach.intersect(area);
            for y in reach.y.max(self.rows.start)..reach.bottom().min(self.rows.end) {
                let row = rows[y as usize].get_or_insert_with(|| vec![0.0; area.width]);
                for x in common.x..common.right() {
                    let value = values[(y - reach.y) as usize * reach.width + (x - reach.x) as usize];
                    row[(x - self.columns.start) as usize] += value;
                }
            }
        }
        rows.into_iter().map(|row| Some(row?.iter().map(|v| v.to_bits()).collect())).collect()
    }

    /// The same on a device, with `film_rows` rows on it: twice, one after the other.
    fn on_device(&self, max_tiles: usize, max_rows: usize, film_rows: usize) -> [Vec<Option<Vec<u32>>>; 2] {
        let device = Device::open(0).unwrap();
        let stream = || device.context.new_stream().unwrap();
        let (compute, download) = (stream(), stream());
        let width = (self.columns.end - self.columns.start) as usize;
        let mut rows = FilmRows::new(&device, &compute, self.columns.clone(), film_rows).unwrap();
        let found = [0, 1].map(|_| {
            let mut found = vec![None; self.rows.end as usize];
            for added in batches(&self.tiling, &self.tiles, &self.rows, max_tiles, max_rows) {
                let slot = added.range.tiles().map(|t| self.tiling.reach(t).size().pixels()).max().unwrap();
                let mut contributions = vec![f32::NAN; slot * added.range.len()];
                for (tile, to) in added.range.tiles().zip(contributions.chunks_mut(slot)) {
                    let values = self.contribution(tile);
                    to[..values.len()].copy_from_slice(&values);
                }
                let contributions = compute.clone_htod(&contributions).unwrap();
                rows.extend(&compute, &added).unwrap();
                rows.add(&compute, &self.tiling, &added, &contributions, slot).unwrap();
                download.wait(&compute.record_event(0).unwrap()).unwrap();
                let parts: Vec<Range<i64>> = strips(&added.finished).collect();
                let mut values: Vec<Vec<f32>> = parts
                    .iter()
                    .map(|part| vec![f32::NAN; width * (part.end - part.start) as usize])
                    .collect();
                rows.download(&download, &added, values.iter_mut().map(|v| &mut v[..])).unwrap();
                for (part, values) in parts.into_iter().zip(values) {
                    for (y, row) in part.zip(values.chunks(width)) {
                        let bits = row.iter().map(|v| v.to_bits()).collect();
                        assert!(found[y as usize].replace(bits).is_none(), "row {y} twice");
                    }
                }
            }
            found
        });
        device.context.synchronize().unwrap();
        found
    }

    fn check(&self) {
        let expected = self.sum(self.tiles.iter().copied());
        let reversed = self.sum(self.tiles.iter().rev().copied());
        assert!(
            self.tiling.margin() == 0 || self.tiles.len() < 2 || reversed != expected,
            "sums that depend on the order"
        );
        let (_, columns) = self.tiling.count();
        for (max_tiles, max_rows, spare) in
            [(1, 1, 0), (2, 1, 7), (columns, 1, 0), (3 * columns, 2, 33), (999, 999, 0)]
        {
            let film_rows =
                max_rows.min(self.tiling.count().0) * self.tiling.tile() + 2 * self.tiling.margin();
            for found in self.on_device(max_tiles, max_rows, film_rows + spare) {
                assert!(found == expected, "{max_tiles} tiles, {max_rows} rows: other bits");
            }
        }
    }
}

fn sums_have_the_order_of_the_tiles() {
    Film::new(Size::new(190, 133), 21, 40, |_, _| true).check();
    // Tails beyond the next tile, and no tails.
    Film::new(Size::new(75, 90), 61, 16, |_, _| true).check();
    Film::new(Size::new(100, 70), 1, 32, |_, _| true).check();
    Film::new(Size::new(9, 5), 7, 64, |_, _| true).check();
}

fn missing_tiles_and_a_part_of_the_film() {
    let mut film = Film::new(Size::new(260, 200), 21, 24, |i, j| i % 5 < 2 && (i + j) % 4 != 1);
    film.check();
    (film.rows, film.columns) = (35..151, 20..177);
    // Only tiles that reach the part.
    film.tiles.retain(|&tile| {
        let reach = film.tiling.reach(tile);
        reach.bottom() > 35 && reach.y < 151 && reach.right() > 20 && reach.x < 177
    });
    film.check();
}

fn small() {
    Film::new(Size::new(75, 40), 21, 16, |_, _| true).check();
}

fn main() -> ExitCode {
    let case = |name: &str, build: Build, settings, run: fn()| Case {
        target: Target::Emulated(build, settings),
        ..Case::emulated(name, &[], run)
    };
    emulated_cuda::run(vec![
        case("sums_have_the_order_of_the_tiles", PLAIN, &[], sums_have_the_order_of_the_tiles),
        case("missing_tiles_and_a_part_of_the_film", PLAIN, &[], missing_tiles_and_a_part_of_the_film),
        case("late_streams", PLAIN, &[("STREAMS", "deferred")], missing_tiles_and_a_part_of_the_film),
        case("early_copies", PLAIN, &[("STREAMS", "hasty")], sums_have_the_order_of_the_tiles),
        case("within_memory", SANITIZED_BUILD, &[("STREAMS", "deferred")], small),
        Case::device("sums_have_the_order_of_the_tiles", sums_have_the_order_of_the_tiles),
        Case::device("missing_tiles_and_a_part_of_the_film", missing_tiles_and_a_part_of_the_film),
    ])
}
