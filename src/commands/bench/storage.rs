//! Codecs on one core, and disk.

use super::{Bench, FILM_MM, median};
use anyhow::{Context, Result};
use formats::chart::{ChartMeta, ChartOptions, ChartStore, Codec, NanPolicy, write_chart};
use formats::durable::{Directory, evict};
use formats::film::{FilmSpec, FilmStore};
use formats::group::Output;
use pipeline::chart::Generator;
use pipeline::flow::ChartSource;
use pipeline::geometry::{Rect, Size};
use serde_json::Map;
use std::path::Path;
use std::time::Instant;

/// Side of a shard, px.
const SHARD: usize = 2048;
/// Size and number of the files of the disk measurement: the size is that of an encoded shard.
const FILE_BYTES: usize = 14 << 20;
const FILES: usize = 48;
/// Writer threads of a run.
const WRITERS: usize = 2;
/// Codecs, their names, and the keys of their rate and size; the first is that of films and charts by default.
const CODECS: [(Codec, &str, &str, &str); 2] = [
    (Codec::Lz4, "lz4", "encode_mpx_s", "encoded_share"),
    (Codec::Zstd, "zstd", "encode_zstd_mpx_s", "encoded_zstd_share"),
];

pub(super) fn measure(bench: &mut Bench<'_>) -> Result<()> {
    let chart: Generator = format!("composite?size={SHARD}&wavelengths=550&overscan=0&noise=0.01").parse()?;
    let pixels = (SHARD * SHARD) as f64 * 1e-6;
    encode(bench, &chart, pixels)?;
    decode(bench, &chart, pixels)?;
    disk(bench)
}

fn encode(bench: &mut Bench<'_>, chart: &Generator, pixels: f64) -> Result<()> {
    let side = Size::new(SHARD, SHARD);
    let mut data = vec![0.0; side.pixels()];
    let full = side.rect();
    chart.read(0, full, &mut data).map_err(|e| anyhow::anyhow!("{e}"))?;
    for (codec, name, rate_key, share_key) in CODECS {
        let spec = FilmSpec {
            outputs: vec![Output { name: "film".into(), rect: full }],
            shard: SHARD,
            chunk: 512,
            codec,
            ..FilmSpec::full_film(side, vec![550.0], FILM_MM * 1e3 / f64::from(bench.args.film_size))
        };
        let path = bench.scratch.0.join(format!("{rate_key}.zarr"));
        let film = FilmStore::create(&path, spec, Map::new(), true)?;
        let mut bytes = 0;
        let rate = bench.rate(pixels, || {
            bytes = film.encode_shard(0, 0, (0, 0), &data)?.bytes().len();
            Ok(())
        })?;
        let label = format!("encoding (byte shuffle, {name}, 1 % noise), one core");
        bench.add_number(rate_key, rate, "Mpx/s", &label);
        bench.add_number(share_key, bytes as f64 / (4e6 * pixels), "of f32", "  encoded size");
    }
    Ok(())
}

fn decode(bench: &mut Bench<'_>, chart: &Generator, pixels: f64) -> Result<()> {
    let path = bench.scratch.0.join("decode.zarr");
    let meta = ChartMeta {
        wavelengths_nm: vec![550.0],
        pitch_um: Some(2.0),
        film_size: None,
        units: None,
        attributes: Map::new(),
    };
    write_chart(&path, chart, &meta, Codec::default(), 1, &|_, _| ())?;
    let mut line = vec![0.0; SHARD];
    let rate = bench.rate(pixels, || {
        let nan = NanPolicy::Error;
        let store = ChartStore::open(
            &path.to_string_lossy(),
            ChartOptions { cache_bytes: 64 << 20, nan, ..ChartOptions::default() },
        )?;
        // Reading one line decodes all chunks of its row.
        for y in (0..SHARD).step_by(store.chunk_shape()[1]) {
            store.read_rect(0, Rect::new(y as i64, 0, 1, SHARD), &mut line)?;
        }
        Ok(())
    })?;
    bench.add_number("decode_mpx_s", rate, "Mpx/s", "decoding that shard, from the page cache, one core");
    Ok(())
}

fn disk(bench: &mut Bench<'_>) -> Result<()> {
    let root = bench.scratch.0.join("disk");
    let mut state = 0x9e37_79b9_7f4a_7c15_u64;
    let bytes: Vec<u8> = (0..FILE_BYTES / 8)
        .flat_map(|_| {
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            state.to_le_bytes()
        })
        .collect();
    let megabytes = (FILES * FILE_BYTES) as f64 * 1e-6;
    let (mut writes, mut reads) = (Vec::new(), Vec::new());
    for _ in 0..bench.rounds {
        let start = Instant::now();
        on_threads(|i| Ok(Directory::new(&root).write(&i.to_string(), &bytes)?))?;
        writes.push(megabytes / start.elapsed().as_secs_f64());
        drop_from_page_cache(&root)?;
        let start = Instant::now();
        on_threads(|i| {
            let read = Directory::new(&root).read(&i.to_string())?.context("file not found after writing")?;
            anyhow::ensure!(read.len() == bytes.len(), "file {i} has {} bytes after writing", read.len());
            Ok(())
        })?;
        reads.push(megabytes / start.elapsed().as_secs_f64());
        std::fs::remove_dir_all(&root)?;
    }
    bench.add_number(
        "disk_write_mb_s",
        median(writes),
        "MB/s",
        "disk, writing 14-MiB shards with fsync, two writers",
    );
    bench.add_number("disk_read_mb_s", median(reads), "MB/s", "disk, reading them uncached, two readers");
    Ok(())
}

fn on_threads(work: impl Fn(usize) -> Result<()> + Sync) -> Result<()> {
    std::thread::scope(|scope| {
        let one = |w: usize| {
            let work = &work;
            scope.spawn(move || (w..FILES).step_by(WRITERS).try_for_each(work))
        };
        let all: Vec<_> = (0..WRITERS).map(one).collect();
        all.into_iter().try_for_each(|t| t.join().expect("a bench thread does not panic"))
    })
}

/// Removes all files below `path` from the page cache.
pub(super) fn drop_from_page_cache(path: &Path) -> Result<()> {
    for entry in std::fs::read_dir(path).with_context(|| format!("listing {}", path.display()))? {
        let path = entry?.path();
        if path.is_dir() { drop_from_page_cache(&path)? } else { evict(&path)? }
    }
    Ok(())
}
