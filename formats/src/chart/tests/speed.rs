//! Throughput in MB/s of encoding, committing and reading on one core: `cargo test -p lenscube-formats store_throughput -- --ignored --nocapture`.

use super::*;
use crate::film::{FilmSpec, FilmStore};

const SIDE: usize = 4096;

/// CPU time of this thread in s.
fn thread_cpu_s() -> f64 {
    let stat = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap();
    stat.split_whitespace().next().unwrap().parse::<f64>().unwrap() * 1e-9
}

/// A smooth image with 1 % noise (xorshift).
fn smooth_image() -> Vec<f32> {
    let mut seed = 0x2545_f491_4f6c_dd1d_u64;
    (0..SIDE * SIDE)
        .map(|k| {
            let (y, x) = ((k / SIDE) as f32, (k % SIDE) as f32);
            seed ^= seed << 13;
            seed ^= seed >> 7;
            seed ^= seed << 17;
            let noise = (seed >> 40) as f32 / (1 << 24) as f32 - 0.5;
            (1.0 + 0.5 * (y * 0.003).sin() * (x * 0.005).cos()) * (1.0 + 0.02 * noise)
        })
        .collect()
}

#[test]
#[ignore = "measurement: run alone, in release, with --nocapture"]
fn store_throughput() {
    let dir = tempfile::tempdir_in(std::env::var_os("LENSCUBE_SPEED_DIR").unwrap_or_else(|| "/tmp".into()))
        .unwrap();
    let image = smooth_image();
    let size = Size::new(SIDE, SIDE);
    let mb = (image.len() * 4) as f64 / 1e6;
    for codec in [Codec::Zstd, Codec::Lz4, Codec::None] {
        for chunk in [256, 512] {
            for fsync in [true, false] {
                let path = dir.path().join(format!("{codec:?}-{chunk}-{fsync}"));
                let spec = FilmSpec { chunk, codec, ..FilmSpec::full_film(size, vec![550.0], 2.0) };
                let film = FilmStore::create(&path, spec, serde_json::Map::new(), fsync).unwrap();
                let (mut encode, mut commit, mut bytes) = (0.0, 0.0, 0);
                for shard in [(0, 0), (0, 1), (1, 0), (1, 1)] {
                    let r = film.shard_rect(0, shard);
                    let mut pixels = Vec::new();
                    for y in r.y..r.bottom() {
                        pixels.extend_from_slice(&image[y as usize * SIDE + r.x as usize..][..r.width]);
                    }
                    let t = thread_cpu_s();
                    let shard = film.encode_shard(0, 0, shard, &pixels).unwrap();
                    encode += thread_cpu_s() - t;
                    let t = std::time::Instant::now();
                    film.commit(&shard).unwrap();
                    commit += t.elapsed().as_secs_f64();
                    bytes += shard.bytes().len();
                }
                let chart = open(&path);
                let t = thread_cpu_s();
                let pixels = all(&chart, 0).unwrap();
                let read = thread_cpu_s() - t;
                assert!(pixels == image);
                let decode = chart.stats().decode_ns as f64 * 1e-9;
                println!(
                    "{codec:?} chunk {chunk} fsync {fsync}: encode {:.0} MB/s, commit {:.0} MB/s of film ({:.0} of file), \
                     decode {:.0} (wall), read {:.0}, size {:.1} %",
                    mb / encode,
                    mb / commit,
                    bytes as f64 * 1e-6 / commit,
                    mb / decode,
                    mb / read,
                    bytes as f64 * 1e-4 / mb
                );
            }
        }
    }
}
