//! The shards of a scene, row by row: what is seen first of the tiles in reach, the tiles near an edge, what is hidden in those.

use super::done::Done;
use super::job::SceneJob;
use super::objects::Objects;
use super::prepared::Prepared;
use super::report;
use super::scratch::no_renderer;
use crate::args::SceneArgs;
use crate::failure::{code, other_job, usage};
use crate::film::group;
use crate::progress::{counting, interrupt, log_line, mib, resume_note};
use anyhow::Result;
use formats::durable::{Store, fault_point, link_target, parent_of, sweep_entries};
use formats::group::{Found, GroupError};
use formats::parallel;
use formats::scene::{FAR_M, Plane, SceneShard, SceneSpec, SceneStore};
use pipeline::geometry::Rect;
use pipeline::scene::appearance::Appearance;
use pipeline::scene::mesh::Mesh;
use pipeline::scene::sheets::{Counts, EdgeMap, Renderer, Sheet, Worker};
use pipeline::scene::visibility::{Engine, TILE_PX};
use std::ops::Range;
use std::path::Path;
use std::sync::Mutex;
use std::sync::atomic::Ordering::Relaxed;
use std::time::Instant;

/// Bytes of a thread's tile while it is made: hits of a row of pixels, planes of the tile, a shard's plane and its encoded bytes.
const THREAD_BYTES: usize = 24 << 20;

/// Part of the memory for pages of a scratch file.
const SCRATCH_PART: usize = 4;

/// Attempts to create or open a scene that other processes remove and create meanwhile.
const ATTEMPTS: usize = 3;

/// Makes or resumes the scene of `job`; the exit code.
pub fn scene(
    args: &SceneArgs,
    prepared: &Prepared,
    appearance: &Appearance<'_, Mesh>,
    job: &SceneJob,
) -> Result<u8> {
    let start = Instant::now();
    let Some(out) = &args.out else { return Err(usage("SCENE is required")) };
    let renderer = Renderer::new(
        &prepared.mesh,
        prepared.frame.clone(),
        appearance,
        job.settings.clone(),
        Engine::detect(),
    )
    .map_err(no_renderer)?;
    let budget = Budget::new(prepared, appearance, &renderer, job)?;
    if args.process.overwrite || !Store::at(&link_target(out))?.exists()? {
        report::check_space(out, job, args.process.force)?;
    }
    interrupt::listen();
    let store = open(args, job, out)?;
    let all: Vec<SceneShard> = store.spec().all_shards().collect();
    if store.missing(&all)?.is_empty() {
        group::report_complete(store.group(), args.process.take_over, all.len());
        return Ok(0);
    }
    let _lock = group::lock_and_sweep(store.group(), args.process.take_over, args.no_fsync)?;
    let missing = store.missing(&all)?;
    group::report_resumed(store.group(), missing.len(), all.len());
    let objects = Objects { mesh: &prepared.mesh, parts: &prepared.scene.parts };
    let run = SceneRun::new(&renderer, &store, job, objects, prepared.threads, budget);
    let outcome = run.shards(&missing);
    let outcome = outcome.and_then(|done| store.group().check_in_place().map(|()| done).map_err(Into::into));
    report::write_record(&store, &outcome, prepared, start);
    let done = outcome?;
    report::print_warnings(prepared, appearance, &done);
    if done.left > 0 {
        log_line(format!(
            "interrupted: {} of {} shards are missing; {}",
            done.left,
            missing.len(),
            resume_note(args.process.overwrite)
        ));
        return Ok(code::INTERRUPTED);
    }
    log_line(report::summary(out, job, &done, start));
    Ok(0)
}

/// The scene at `out`, created, or opened if it is of this job.
fn open(args: &SceneArgs, job: &SceneJob, out: &Path) -> Result<SceneStore> {
    if args.process.overwrite {
        group::remove(out, args.process.take_over, SceneStore::remove)?;
    }
    for _ in 0..ATTEMPTS {
        match SceneStore::create(out, job.spec.clone(), job.all_attributes(), !args.no_fsync) {
            Err(GroupError::Exists { .. }) => {
                if let Some(store) = resumed(args, job, out)? {
                    return Ok(store);
                }
            }
            created => return Ok(created?),
        }
    }
    Err(group::contended(out))
}

/// The scene at `out`, if it is this job's own; `None` if nothing is there.
fn resumed(args: &SceneArgs, job: &SceneJob, out: &Path) -> Result<Option<SceneStore>> {
    let store = match SceneStore::open(out, !args.no_fsync) {
        Ok(store) => store,
        Err(GroupError::NotOfKind { found: Found::Nothing, .. }) => return Ok(None),
        Err(e @ GroupError::NotOfKind { .. }) => return Err(other_job(e.to_string())),
        Err(e) => return Err(e.into()),
    };
    sweep_entries(parent_of(&link_target(out)))?;
    group::check_job(("scene", out), store.attributes(), &job.identity, args.process.overwrite)?;
    Ok(Some(store))
}

/// Bytes for tiles that are kept.
#[derive(Clone, Copy)]
struct Budget {
    /// For what is seen first, until its row is written; beyond it is computed again.
    fronts: usize,
    /// For what is hidden in the tiles of the shards that are written together.
    hidden: usize,
}

impl Budget {
    /// What the limit of memory leaves.
    ///
    /// # Errors
    /// Too little.
    fn new(
        prepared: &Prepared,
        appearance: &Appearance<'_, Mesh>,
        renderer: &Renderer<'_>,
        job: &SceneJob,
    ) -> Result<Self> {
        let limit = prepared.limit.bytes as usize;
        let pages = if prepared.mesh.scratch().file_bytes() > 0 { limit / SCRATCH_PART } else { 0 };
        let fixed = prepared.bytes()
            + appearance.bytes()
            + renderer.bytes()
            + prepared.threads * THREAD_BYTES
            + pages;
        let shard = job.spec.shard_shape().pixels() * job.plane_bytes() * job.spec.sheets;
        let row = renderer.grid().across() * TILE_PX * TILE_PX * job.plane_bytes();
        let needed = fixed + shard + row;
        let left = limit.checked_sub(needed).ok_or_else(|| {
            prepared.limit.too_small(format!(
                "the mesh with its textures and lists takes {}, one shard of {} surfaces {}",
                mib(fixed),
                job.spec.sheets,
                mib(shard)
            ))
        })?;
        Ok(Self { fronts: left / 2, hidden: shard + left / 2 })
    }
}

/// The work on missing shards.
struct SceneRun<'a> {
    renderer: &'a Renderer<'a>,
    store: &'a SceneStore,
    spec: &'a SceneSpec,
    objects: Objects<'a>,
    gap_dioptre: f64,
    reach_px: Option<usize>,
    threads: usize,
    budget: Budget,
    tile_bytes: usize,
    workers: Mutex<Vec<Worker>>,
}

/// Tiles of the chart: what is seen first, what is hidden, where edges are.
struct Tiles {
    edges: EdgeMap,
    /// Rows of tiles whose fronts are known.
    known: Vec<bool>,
    /// Kept fronts; of the others only edges are known.
    fronts: Vec<Option<Sheet>>,
    kept_bytes: usize,
}

/// What is stored of a tile.
struct TileSheets {
    front: Sheet,
    /// Without those that have no pixels.
    hidden: Vec<Option<Sheet>>,
    /// Numbers of objects, if they are stored.
    objects: Vec<f32>,
}

impl<'a> SceneRun<'a> {
    fn new(
        renderer: &'a Renderer<'a>,
        store: &'a SceneStore,
        job: &SceneJob,
        objects: Objects<'a>,
        threads: usize,
        budget: Budget,
    ) -> Self {
        Self {
            renderer,
            store,
            spec: store.spec(),
            objects,
            gap_dioptre: job.settings.gap_dioptre,
            reach_px: job.reach_px,
            threads,
            budget,
            tile_bytes: TILE_PX * TILE_PX * job.plane_bytes(),
            workers: Mutex::default(),
        }
    }

    /// Makes the shards `missing`.
    fn shards(&self, missing: &[SceneShard]) -> Result<Done> {
        let grid = self.renderer.grid();
        let mut tiles = Tiles {
            edges: EdgeMap::new(grid, self.gap_dioptre),
            known: vec![false; grid.down()],
            fronts: (0..grid.tiles()).map(|_| None).collect(),
            kept_bytes: 0,
        };
        let (mut done, mut left) = (Done::default(), missing);
        let (bar, progress) = counting("making the scene");
        while let Some(row) = left.first().map(|shard| shard.place.0) {
            let count = left.iter().take_while(|shard| shard.place.0 == row).count();
            let (now, later) = left.split_at(count);
            if !self.row(row, now, &mut tiles, &mut done)? {
                break;
            }
            left = later;
            progress((missing.len() - left.len()) as u64, missing.len() as u64);
        }
        bar.finish_and_clear();
        done.left = missing.len() - done.shards;
        Ok(done)
    }

    /// Makes the missing shards of a row of shards; false after an interruption, with some of them made.
    fn row(&self, row: usize, missing: &[SceneShard], tiles: &mut Tiles, done: &mut Done) -> Result<bool> {
        let grid = self.renderer.grid();
        let tiles_down = self.spec.shard_shape().height / TILE_PX;
        let rows = row * tiles_down..((row + 1) * tiles_down).min(grid.down());
        // An edge of a tile is known when its neighbours are.
        let reach = self.reach_px.unwrap_or(0).div_ceil(TILE_PX) + 1;
        let around = rows.start.saturating_sub(reach)..(rows.end + reach).min(grid.down());
        if !self.fronts(around, rows.start, tiles, done)? {
            return Ok(false);
        }
        let in_reach = match self.reach_px {
            None => vec![true; grid.tiles()],
            Some(reach_px) => tiles.edges.in_reach(reach_px),
        };
        let mut left = missing;
        while let Some(first) = left.first().map(|shard| shard.place.1) {
            let columns = self.columns_together(first, rows.len());
            let count = left.iter().take_while(|shard| columns.contains(&shard.place.1)).count();
            let (now, later) = left.split_at(count);
            let made = self.sheets(&rows, &columns, &in_reach, tiles, done)?;
            if is_cancelled() || !self.write(now, &rows, &columns, &made, done)? {
                return Ok(false);
            }
            left = later;
        }
        for row in rows {
            tiles.forget(row, self.tile_bytes, grid.across());
        }
        Ok(true)
    }

    /// Columns of shards from `first` on that are made together, of `rows` rows of tiles.
    fn columns_together(&self, first: usize, rows: usize) -> Range<usize> {
        let tiles_across = self.spec.shard_shape().width / TILE_PX;
        let bytes = rows * tiles_across * self.tile_bytes * self.spec.sheets;
        let count = (self.budget.hidden / bytes.max(1)).max(1);
        first..(first + count).min(self.spec.shards().1)
    }

    /// Finds what is seen first in the rows of tiles `around` that are not known, and keeps it from the row `kept` on; false after an interruption.
    fn fronts(&self, around: Range<usize>, kept: usize, tiles: &mut Tiles, done: &mut Done) -> Result<bool> {
        let across = self.renderer.grid().across();
        for row in around {
            if tiles.known[row] {
                continue;
            }
            let found = self
                .each(row * across..(row + 1) * across, |tile, worker| self.renderer.front(tile, worker))?;
            let Some(found) = found else { return Ok(false) };
            tiles.known[row] = true;
            for (tile, front) in (row * across..).zip(found) {
                done.counts.add(&front.counts);
                tiles.edges.add(tile, front.has_edge, front.border);
                if row >= kept && tiles.kept_bytes + self.tile_bytes <= self.budget.fronts {
                    tiles.kept_bytes += self.tile_bytes;
                    tiles.fronts[tile] = Some(front.sheet);
                }
            }
        }
        Ok(true)
    }

    /// The surfaces of the tiles in these rows of tiles and columns of shards, row by row.
    fn sheets(
        &self,
        rows: &Range<usize>,
        columns: &Range<usize>,
        in_reach: &[bool],
        tiles: &mut Tiles,
        done: &mut Done,
    ) -> Result<Vec<TileSheets>> {
        let across = self.renderer.grid().across();
        let columns = self.tile_columns(columns);
        let numbers: Vec<usize> =
            rows.clone().flat_map(|row| columns.clone().map(move |column| row * across + column)).collect();
        let kept: Vec<Mutex<Option<Sheet>>> =
            numbers.iter().map(|&tile| Mutex::new(tiles.fronts[tile].take())).collect();
        tiles.kept_bytes -=
            kept.iter().filter(|k| k.lock().is_ok_and(|k| k.is_some())).count() * self.tile_bytes;
        let has_hidden = self.spec.sheets > 1;
        let made = self.each(0..numbers.len(), |i, worker| {
            let front = kept[i].lock().expect("no panic while held").take();
            let front = front.unwrap_or_else(|| self.renderer.front(numbers[i], worker).sheet);
            let (hidden, counts) = match has_hidden && in_reach[numbers[i]] {
                true => self.renderer.hidden(numbers[i], worker),
                false => (Vec::new(), Counts::default()),
            };
            let hidden =
                hidden.into_iter().map(|sheet| Some(sheet).filter(|sheet| !sheet.is_empty())).collect();
            let objects = match self.spec.ids {
                true => self.objects.of_tile(self.renderer, numbers[i], worker),
                false => Vec::new(),
            };
            (TileSheets { front, hidden, objects }, counts)
        })?;
        let (sheets, counts): (Vec<_>, Vec<_>) = made.unwrap_or_default().into_iter().unzip();
        counts.iter().for_each(|counts| done.counts.add(counts));
        Ok(sheets)
    }

    /// Columns of tiles in columns of shards.
    fn tile_columns(&self, columns: &Range<usize>) -> Range<usize> {
        let tiles_across = self.spec.shard_shape().width / TILE_PX;
        let across = self.renderer.grid().across();
        columns.start * tiles_across..(columns.end * tiles_across).min(across)
    }

    /// Encodes and writes `shards`, of tiles whose surfaces are `made`; false after an interruption.
    fn write(
        &self,
        shards: &[SceneShard],
        rows: &Range<usize>,
        columns: &Range<usize>,
        made: &[TileSheets],
        done: &mut Done,
    ) -> Result<bool> {
        let columns = self.tile_columns(columns);
        let written = Mutex::new((0, 0));
        let whole = |_: u64, _: u64| ();
        parallel::for_each::<anyhow::Error>(self.threads, shards.len(), &whole, |i| {
            if is_cancelled() {
                return Ok(());
            }
            let rect = self.spec.shard_rect(shards[i].place);
            let mut pixels = vec![shards[i].fill_value(); rect.size().pixels()];
            for (k, tile) in made.iter().enumerate() {
                let (row, column) = (rows.start + k / columns.len(), columns.start + k % columns.len());
                self.copy(shards[i], row * self.renderer.grid().across() + column, tile, rect, &mut pixels);
            }
            let bytes = self.store.commit(shards[i], &|y| &pixels[y * rect.width..][..rect.width])?;
            fault_point("scene-shard");
            let mut written = written.lock().expect("no panic while held");
            *written = (written.0 + 1, written.1 + bytes);
            Ok(())
        })?;
        let (count, bytes) = written.into_inner().expect("no panic while held");
        done.shards += count;
        done.bytes += bytes;
        Ok(!is_cancelled())
    }

    /// Copies a plane of a tile to the part of `pixels`, those of `rect`, that it covers.
    fn copy(&self, shard: SceneShard, tile: usize, made: &TileSheets, rect: Rect, pixels: &mut [f32]) {
        let sheet = match shard.sheet {
            0 => Some(&made.front),
            n => made.hidden.get(n - 1).and_then(Option::as_ref),
        };
        let (top, left, height, width) = self.renderer.grid().rect(tile);
        let place = Rect::new(top as i64, left as i64, height, width);
        let (Some(sheet), false) = (sheet, rect.intersect(place).is_empty()) else { return };
        let plane = match shard.plane {
            Plane::Weight(basis) => &sheet.weights[basis * height * width..][..height * width],
            Plane::Depth => &sheet.depth,
            Plane::Coverage => &sheet.coverage,
            Plane::Object => &made.objects,
        };
        let (first_y, first_x) = (top - rect.y as usize, left - rect.x as usize);
        for (y, line) in plane.chunks_exact(width).enumerate() {
            let to = &mut pixels[(first_y + y) * rect.width + first_x..][..width];
            match shard.plane {
                // Infinity alone: what is not a number is refused where it is encoded.
                Plane::Depth => {
                    to.iter_mut().zip(line).for_each(|(to, v)| *to = if *v > FAR_M { FAR_M } else { *v })
                }
                Plane::Weight(_) | Plane::Coverage | Plane::Object => to.copy_from_slice(line),
            }
        }
    }

    /// `work` of each item, in their order, on all threads; `None` after an interruption.
    fn each<T: Send>(
        &self,
        items: Range<usize>,
        work: impl Fn(usize, &mut Worker) -> T + Sync,
    ) -> Result<Option<Vec<T>>> {
        let results: Vec<Mutex<Option<T>>> = items.clone().map(|_| Mutex::new(None)).collect();
        let whole = |_: u64, _: u64| ();
        parallel::for_each::<anyhow::Error>(self.threads, items.len(), &whole, |i| {
            if is_cancelled() {
                return Ok(());
            }
            let pooled = self.workers.lock().expect("no panic while held").pop();
            let mut worker = pooled.unwrap_or_else(|| self.renderer.worker());
            *results[i].lock().expect("no panic while held") = Some(work(items.start + i, &mut worker));
            self.workers.lock().expect("no panic while held").push(worker);
            Ok(())
        })?;
        Ok(results.into_iter().map(|result| result.into_inner().expect("no panic while held")).collect())
    }
}

impl Tiles {
    /// Frees what is kept of a row of tiles.
    fn forget(&mut self, row: usize, tile_bytes: usize, across: usize) {
        for front in &mut self.fronts[row * across..(row + 1) * across] {
            if front.take().is_some() {
                self.kept_bytes -= tile_bytes;
            }
        }
    }
}

fn is_cancelled() -> bool {
    interrupt::cancel_flag().load(Relaxed)
}
