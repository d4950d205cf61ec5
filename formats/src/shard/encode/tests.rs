//! Non-finite pixels are rejected; bytes as zarrs encodes them; cost of the check and of codecs.

use super::*;
use crate::chart::{ChartOptions, ChartStore};
use serde_json::json;

fn encoder(sample: SampleType, chunk: usize) -> ShardEncoder {
    ShardEncoder::new(Codec::Zstd, sample, chunk, None).unwrap()
}

#[test]
fn non_finite_pixel_is_an_error_with_row_and_column() {
    for sample in [SampleType::F32, SampleType::F16] {
        for value in [f32::NAN, -f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            let mut pixels = vec![1.0; 20 * 30];
            (pixels[13 * 30 + 7], pixels[19 * 30 + 29]) = (value, value);
            let error = encoder(sample, 16).encode(&pixels, (20, 30), (2, 2)).unwrap_err();
            assert!(matches!(error, ShardError::NotFinite { row: 13, column: 7, .. }), "{error}");
        }
    }
    assert!(encoder(SampleType::F32, 16).encode(&[f32::MAX; 4], (2, 2), (1, 1)).is_ok());
}

/// `cargo test -p lenscube-formats --release --lib cost_of_finite_check -- --ignored --nocapture`
#[test]
fn inner_chunks_are_those_of_the_codec_chain_of_the_metadata() {
    let pixels: Vec<f32> = (0..30 * 25).map(|k| (k as f32 * 0.37).sin() + 2.0).collect();
    for sample in [SampleType::F32, SampleType::F16] {
        for codec in [Codec::None, Codec::Lz4, Codec::Zstd] {
            let encoder = ShardEncoder::new(codec, sample, 16, None).unwrap();
            let shard = encoder.encode(&pixels, (30, 25), (2, 2)).unwrap();
            let metadata: Vec<_> = serde_json::from_value(codec.metadata(sample, false)).unwrap();
            let chain = CodecChain::from_metadata(&metadata).unwrap();
            let mut expected = Vec::new();
            for (y, x) in [(0, 0), (0, 16), (16, 0), (16, 16)] {
                let inside =
                    |k: usize| (y + k / 16 < 30 && x + k % 16 < 25).then(|| (y + k / 16) * 25 + x + k % 16);
                let value = |k: usize| inside(k).map_or(f32::NAN, |at| pixels[at]);
                let samples: Vec<u8> = match sample {
                    SampleType::F32 => (0..256).flat_map(|k| value(k).to_ne_bytes()).collect(),
                    SampleType::F16 => {
                        (0..256).flat_map(|k| half::f16::from_f32(value(k)).to_ne_bytes()).collect()
                    }
                    SampleType::U16 => unreachable!("films have no digital numbers"),
                };
                let (shape, fill) = (encoder.chunk_shape(), FillValue::new(sample.fill()));
                let bytes = ArrayBytes::new_flen(Cow::Owned(samples));
                expected.extend_from_slice(
                    &chain.encode(bytes, &shape, &encoder.data_type, &fill, &single_threaded()).unwrap(),
                );
            }
            assert!(shard.starts_with(&expected), "{codec:?} {sample:?}");
            assert_eq!(shard.len(), expected.len() + 4 * 16 + 4, "{codec:?} {sample:?}");
        }
    }
}

#[test]
fn stored_samples_have_the_kept_bits_only() {
    let pixels: Vec<f32> = (0..32 * 32).map(|k| (k as f32 * 0.37).sin() * 100.0).collect();
    for (sample, keep_bits) in [(SampleType::F32, 16), (SampleType::F32, 1), (SampleType::F16, 6)] {
        let encoder = ShardEncoder::new(Codec::None, sample, 32, Some(keep_bits)).unwrap();
        let shard = encoder.encode(&pixels, (32, 32), (1, 1)).unwrap();
        for (k, x) in pixels.iter().enumerate() {
            let at = k * sample.bytes();
            let stored = match sample {
                SampleType::F32 => f32::from_le_bytes(shard[at..at + 4].try_into().unwrap()),
                SampleType::F16 => half::f16::from_le_bytes(shard[at..at + 2].try_into().unwrap()).to_f32(),
                SampleType::U16 => unreachable!("not among the cases"),
            };
            let bound = 0.5_f32.powi(keep_bits as i32 + 1) * x.abs();
            assert!((stored - x).abs() <= bound, "{sample:?}, {keep_bits} bits: {x} -> {stored}");
            assert_eq!(stored.to_bits() & ((1 << (23 - keep_bits)) - 1), 0, "{sample:?}: {stored}");
        }
    }
}

/// CPU time of this thread in s.
fn thread_cpu_s() -> f64 {
    let stat = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap();
    stat.split_whitespace().next().unwrap().parse::<f64>().unwrap() * 1e-9
}

/// Size and rates of codecs on the films of LENSCUBE_CODEC_FILMS (paths separated by `;`), one core:
/// scripts/bench/2026-11-21-codec.
#[test]
#[ignore = "measurement: run alone, with --nocapture"]
fn codec_throughput() {
    const SIDE: usize = 2048;
    const ROUNDS: usize = 5;
    /// Shards per round: the clock of a thread that is not interrupted advances in steps of 4 ms.
    const SHARDS: usize = 8;
    let blosc = |cname: &str, shuffle: &str| {
        json!([
            {"name": "bytes", "configuration": {"endian": "little"}},
            {"name": "blosc", "configuration":
                {"cname": cname, "clevel": 1, "shuffle": shuffle, "typesize": 4, "blocksize": 0}},
            {"name": "crc32c"}
        ])
    };
    let codecs: Vec<(String, Value)> =
        [("zstd", "shuffle"), ("zstd", "bitshuffle"), ("lz4", "shuffle"), ("lz4", "bitshuffle")]
            .map(|(cname, shuffle)| (format!("{cname} {shuffle}"), blosc(cname, shuffle)))
            .into_iter()
            .chain([("none".to_owned(), Codec::None.metadata(SampleType::F32, false))])
            .collect();
    let films = std::env::var("LENSCUBE_CODEC_FILMS").expect("LENSCUBE_CODEC_FILMS lists films");
    println!("film, bits of mantissa, codec: share of f32, encoding MB/s, decoding MB/s");
    for film in films.split(';') {
        let options = ChartOptions { cache_bytes: 64 << 20, ..ChartOptions::default() };
        let store = ChartStore::open(film, options).unwrap();
        let size = store.size();
        let at = |side: usize| ((side - SIDE) / 2) as i64;
        let rect = pipeline::geometry::Rect::new(at(size.height), at(size.width), SIDE, SIDE);
        let mut pixels = vec![0.0; SIDE * SIDE];
        store.read_rect(0, rect, &mut pixels).unwrap();
        for keep_bits in [None, Some(18), Some(16), Some(12)] {
            let encoders: Vec<_> = codecs
                .iter()
                .map(|(_, codecs)| {
                    ShardEncoder::with_codecs(codecs.clone(), SampleType::F32, 512, keep_bits).unwrap()
                })
                .collect();
            let mut seconds = vec![(Vec::new(), Vec::new()); codecs.len()];
            let mut bytes = vec![0; codecs.len()];
            // Interleaved, so that a change of the machine's speed meets all.
            for _ in 0..ROUNDS {
                for (k, encoder) in encoders.iter().enumerate() {
                    let start = thread_cpu_s();
                    let mut shard = Vec::new();
                    for _ in 0..SHARDS {
                        shard = encoder.encode(&pixels, (SIDE, SIDE), (4, 4)).unwrap();
                    }
                    seconds[k].0.push(thread_cpu_s() - start);
                    let start = thread_cpu_s();
                    for _ in 0..SHARDS {
                        encoder.check(&shard, (SIDE, SIDE), (4, 4)).unwrap();
                    }
                    seconds[k].1.push(thread_cpu_s() - start);
                    bytes[k] = shard.len();
                }
            }
            let mb = (SIDE * SIDE * 4) as f64 * 1e-6;
            let median = |s: &mut Vec<f64>| {
                s.sort_by(f64::total_cmp);
                s[ROUNDS / 2]
            };
            for (k, (name, _)) in codecs.iter().enumerate() {
                let (encode, decode) = (median(&mut seconds[k].0), median(&mut seconds[k].1));
                let bits = keep_bits.unwrap_or(23);
                println!(
                    "{film}, {bits}, {name}: {:.3}, {:.0}, {:.0}",
                    bytes[k] as f64 * 1e-6 / mb,
                    SHARDS as f64 * mb / encode,
                    SHARDS as f64 * mb / decode
                );
            }
        }
    }
}
