//! Chunks that decode to more than their size, or declare that, are errors and take memory for their size only.

use super::*;
use serde_json::{Value, json};
use zarrs::array::data_type;

use crate::bombs;

const SAMPLES: u64 = 1024;

fn chain(codecs: Value) -> CodecChain {
    CodecChain::from_metadata(&serde_json::from_value::<Vec<_>>(codecs).unwrap()).unwrap()
}

fn little_endian() -> Value {
    json!({"name": "bytes", "configuration": {"endian": "little"}})
}

fn decode(codecs: &Value, encoded: &[u8]) -> Result<Vec<u8>, String> {
    let shape = [NonZeroU64::new(SAMPLES).unwrap()];
    let chain = BoundedChain::new(&chain(codecs.clone()))?;
    chain.decode(Cow::Borrowed(encoded), &shape, &data_type::float32(), &FillValue::from(0f32))
}

fn all_compressions() -> Vec<Value> {
    let gzip = json!({"name": "gzip", "configuration": {"level": 1}});
    let zlib = json!({"name": "numcodecs.zlib", "configuration": {"level": 1}});
    let zstd = json!({"name": "zstd", "configuration": {"level": 1, "checksum": false}});
    let crc = json!({"name": "crc32c"});
    let blosc = |name: &str| {
        json!({"name": "blosc", "configuration": {
            "cname": name, "clevel": 5, "shuffle": "shuffle", "typesize": 4, "blocksize": 0
        }})
    };
    let single = [gzip, zlib, zstd]
        .into_iter()
        .chain(["lz4", "lz4hc", "blosclz", "zstd", "zlib", "snappy"].map(blosc));
    single.flat_map(|c| [json!([little_endian(), c]), json!([little_endian(), c, crc])]).collect()
}

#[test]
fn every_codec_decodes_its_own_output_and_rejects_truncated_bytes() {
    let samples: Vec<u8> = (0..SAMPLES).flat_map(|k| (k as f32).sqrt().to_ne_bytes()).collect();
    let shape = [NonZeroU64::new(SAMPLES).unwrap()];
    let (t, fill) = (data_type::float32(), FillValue::from(0f32));
    for codecs in all_compressions() {
        let array = zarrs::array::ArrayBytes::new_flen(samples.clone());
        let encoded = chain(codecs.clone()).encode(array, &shape, &t, &fill, &single_threaded()).unwrap();
        assert_eq!(decode(&codecs, &encoded).unwrap(), samples, "{codecs}");
        for cut in [0, 3, 10, encoded.len() / 2, encoded.len() - 1] {
            assert!(decode(&codecs, &encoded[..cut]).is_err(), "{codecs} cut to {cut}");
        }
    }
}

#[test]
fn chunk_of_another_size_is_an_error() {
    let (t, fill) = (data_type::float32(), FillValue::from(0f32));
    for codecs in all_compressions() {
        for samples in [SAMPLES - 1, SAMPLES + 1, 100 * SAMPLES] {
            let shape = [NonZeroU64::new(samples).unwrap()];
            let zeros = zarrs::array::ArrayBytes::new_flen(vec![0u8; samples as usize * 4]);
            let encoded = chain(codecs.clone()).encode(zeros, &shape, &t, &fill, &single_threaded()).unwrap();
            let error = decode(&codecs, &encoded).unwrap_err();
            assert!(error.contains("expected 4096"), "{codecs}, {samples} samples: {error}");
        }
    }
}

#[test]
fn decompression_bomb_is_an_error_at_the_chunk_size() {
    let codecs = |codec: Value| json!([little_endian(), codec]);
    let gzip = codecs(json!({"name": "gzip", "configuration": {"level": 1}}));
    let zlib = codecs(json!({"name": "numcodecs.zlib", "configuration": {"level": 1}}));
    let zstd = codecs(json!({"name": "zstd", "configuration": {"level": 1, "checksum": false}}));
    let error = decode(&gzip, &bombs::gzip_zeros(8 << 20)).unwrap_err();
    assert!(error.contains("decodes to 4097 bytes or more, expected 4096"), "{error}");
    let error = decode(&zlib, &bombs::zlib_zeros(8 << 20)).unwrap_err();
    assert!(error.contains("decodes to 4097 bytes or more, expected 4096"), "{error}");
    // Decoded sizes: 32 GiB, and 16 EiB as declared.
    for bomb in [bombs::zstd_without_content_size(1 << 18), bombs::zstd_with_stated_size(u64::MAX >> 1)] {
        let error = decode(&zstd, &bomb).unwrap_err();
        assert!(error.contains("expected 4096"), "{error}");
    }
    let blosc = codecs(json!({"name": "blosc", "configuration": {
        "cname": "zstd", "clevel": 1, "shuffle": "noshuffle", "typesize": 1, "blocksize": 0
    }}));
    for compressor in 0..5 {
        let error = decode(&blosc, &bombs::blosc_with_stated_size(i32::MAX as u32, compressor)).unwrap_err();
        assert!(error.contains("decodes to 2147483647 bytes or more, expected 4096"), "{error}");
    }
}

#[test]
fn bomb_below_a_second_compression_is_an_error() {
    let zstd = json!({"name": "zstd", "configuration": {"level": 1, "checksum": false}});
    let gzip = json!({"name": "gzip", "configuration": {"level": 1}});
    let codecs = json!([little_endian(), gzip, zstd]);
    let error = decode(&codecs, &bombs::zstd_without_content_size(1 << 16)).unwrap_err();
    assert!(error.contains("expected at most"), "{error}");
}

#[test]
fn chain_is_decoded_up_to_the_maximum_length_and_rejected_beyond() {
    let gzip = json!({"name": "gzip", "configuration": {"level": 1}});
    let of = |compressions: usize| -> Value {
        [vec![little_endian()], vec![gzip.clone(); compressions]].concat().into()
    };
    let samples: Vec<u8> = (0..SAMPLES).flat_map(|k| (k as f32).sqrt().to_ne_bytes()).collect();
    let shape = [NonZeroU64::new(SAMPLES).unwrap()];
    let (t, fill) = (data_type::float32(), FillValue::from(0f32));
    let longest = of(MAX_CODECS - 1);
    let array = zarrs::array::ArrayBytes::new_flen(samples.clone());
    let encoded = chain(longest.clone()).encode(array, &shape, &t, &fill, &single_threaded()).unwrap();
    assert_eq!(decode(&longest, &encoded).unwrap(), samples);
    for compressions in [MAX_CODECS, 150] {
        let error = decode(&of(compressions), &encoded).unwrap_err();
        assert!(
            error.contains(&format!("{} codecs", compressions + 1)) && error.contains("of 16"),
            "{error}"
        );
    }
    let transpose = json!({"name": "transpose", "configuration": {"order": [0]}});
    let error = decode(&[vec![transpose; 16], vec![little_endian()]].concat().into(), &[]).unwrap_err();
    assert!(error.contains("17 codecs"), "{error}");
}

/// The bound of an inner compression is the same at each position.
#[test]
fn output_below_a_chain_of_compressions_is_bounded_by_the_samples() {
    let gzip = json!({"name": "gzip", "configuration": {"level": 1}});
    let zstd = json!({"name": "zstd", "configuration": {"level": 1, "checksum": false}});
    let bound = SAMPLES * 4 + SAMPLES + (64 << 10);
    for compressions in [1, MAX_CODECS - 2] {
        for (outer, bomb) in
            [(&gzip, bombs::gzip_zeros(8 << 20)), (&zstd, bombs::zstd_without_content_size(1 << 16))]
        {
            let inner = vec![gzip.clone(); compressions];
            let codecs = [vec![little_endian()], inner, vec![outer.clone()]].concat().into();
            let error = decode(&codecs, &bomb).unwrap_err();
            let expected = format!("decodes to {} bytes or more, expected at most {bound}", bound + 1);
            assert!(error.contains(&expected), "{compressions}: {error}");
        }
    }
}

#[test]
fn nested_shards_are_rejected() {
    let index = json!([little_endian(), {"name": "crc32c"}]);
    let shard = json!({"name": "sharding_indexed", "configuration": {
        "chunk_shape": [16], "codecs": [little_endian()], "index_codecs": index, "index_location": "end"
    }});
    let error = BoundedChain::new(&chain(json!([shard]))).unwrap_err();
    assert!(error.contains("sharding_indexed"), "{error}");
}
