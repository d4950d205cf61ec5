//! Chunks of charts: valid metadata, and chunks of every codec with invalid sizes, offsets or values.

use crate::codecs::{Bombs, blosc, crc32c, damage_blosc_header, samples, shard, zstd};
use crate::fuzz_support::{Random, fuzz};
use crate::{data, directory};
use lenscube_formats::chart::{ChartOptions, ChartStore};
use pipeline::geometry::Rect;
use serde_json::{Value, json};
use std::cell::RefCell;
use std::fs;
use std::path::{Path, PathBuf};

const HEIGHT: usize = 20;
const WIDTH: usize = 24;

/// Compression of a chunk.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Codec {
    None,
    Zstd,
    Gzip,
    Zlib,
    Blosc,
}

const V3: [Codec; 4] = [Codec::None, Codec::Zstd, Codec::Gzip, Codec::Blosc];

struct Store {
    path: PathBuf,
    /// In the order of encoding.
    codecs: Vec<Codec>,
    /// Bytes of a sample.
    bytes: usize,
    checksum: bool,
    /// Four inner chunks; whether the index comes first.
    sharded: Option<bool>,
    v2: bool,
}

fn codecs(codecs: &[Codec], bytes: usize, checksum: bool) -> Vec<Value> {
    let mut list = vec![json!({"name": "bytes", "configuration": {"endian": "little"}})];
    list.extend(codecs.iter().filter_map(|codec| match codec {
        Codec::None | Codec::Zlib => None,
        Codec::Zstd => Some(json!({"name": "zstd", "configuration": {"level": 1, "checksum": false}})),
        Codec::Gzip => Some(json!({"name": "gzip", "configuration": {"level": 1}})),
        Codec::Blosc => Some(json!({"name": "blosc", "configuration":
            {"typesize": bytes, "cname": "zstd", "clevel": 1, "shuffle": "noshuffle", "blocksize": 0}})),
    }));
    list.extend(checksum.then(|| json!({"name": "crc32c"})));
    list
}

impl Store {
    fn v3(root: &Path, chain: &[Codec], bytes: usize, checksum: bool, sharded: Option<bool>) -> Self {
        let names: String = chain.iter().map(|codec| format!("-{codec:?}")).collect();
        let path = root.join(format!("v3{names}-{bytes}-{checksum}-{sharded:?}"));
        let inner = codecs(chain, bytes, checksum);
        let codecs = match sharded {
            None => json!(inner),
            Some(first) => json!([{"name": "sharding_indexed", "configuration": {
                "chunk_shape": [1, HEIGHT / 2, WIDTH / 2], "codecs": inner,
                "index_codecs": [{"name": "bytes", "configuration": {"endian": "little"}}, {"name": "crc32c"}],
                "index_location": if first { "start" } else { "end" }}}]),
        };
        let metadata = json!({
            "zarr_format": 3, "node_type": "array", "shape": [1, HEIGHT, WIDTH], "fill_value": 0.0,
            "data_type": format!("float{}", 8 * bytes),
            "chunk_grid": {"name": "regular", "configuration": {"chunk_shape": [1, HEIGHT, WIDTH]}},
            "chunk_key_encoding": {"name": "default", "configuration": {"separator": "/"}},
            "codecs": codecs, "attributes": {"wavelengths_nm": [550], "pitch_um": 2.0},
        });
        fs::create_dir_all(path.join("c/0/0")).unwrap();
        fs::write(path.join("zarr.json"), metadata.to_string()).unwrap();
        Self { path, codecs: chain.to_vec(), bytes, checksum, sharded, v2: false }
    }

    fn v2(root: &Path, codec: Codec) -> Self {
        let path = root.join(format!("v2-{codec:?}"));
        let compressor = match codec {
            Codec::None => json!(null),
            Codec::Zstd => json!({"id": "zstd", "level": 1}),
            Codec::Gzip => json!({"id": "gzip", "level": 1}),
            Codec::Zlib => json!({"id": "zlib", "level": 1}),
            Codec::Blosc => {
                json!({"id": "blosc", "cname": "lz4", "clevel": 5, "shuffle": 0, "blocksize": 0})
            }
        };
        let metadata = json!({
            "zarr_format": 2, "shape": [1, HEIGHT, WIDTH], "chunks": [1, HEIGHT, WIDTH], "dtype": "<f4", "fill_value": 0.0,
            "order": "C", "filters": null, "dimension_separator": ".", "compressor": compressor,
        });
        fs::create_dir_all(&path).unwrap();
        fs::write(path.join(".zarray"), metadata.to_string()).unwrap();
        fs::write(path.join(".zattrs"), r#"{"wavelengths_nm": [550]}"#).unwrap();
        Self { path, codecs: vec![codec], bytes: 4, checksum: false, sharded: None, v2: true }
    }

    fn chunk_file(&self) -> PathBuf {
        self.path.join(if self.v2 { "0.0.0" } else { "c/0/0/0" })
    }

    fn encode(&self, count: usize, bombs: &Bombs, r: &mut Random) -> Vec<u8> {
        let mut out = samples(count, self.bytes, r);
        for codec in &self.codecs {
            out = match codec {
                Codec::None => out,
                Codec::Zstd => zstd(&out, r),
                Codec::Gzip => bombs.gzip(&out, r),
                Codec::Zlib => bombs.zlib(&out, r),
                Codec::Blosc => blosc(&out, self.bytes, r),
            };
        }
        if self.checksum {
            let sum = crc32c(&out);
            out.extend(sum.to_le_bytes());
        }
        out
    }

    fn encode_file(&self, bombs: &Bombs, r: &mut Random) -> Vec<u8> {
        match self.sharded {
            None => self.encode(HEIGHT * WIDTH, bombs, r),
            Some(first) => {
                let chunks: Vec<_> = (0..4).map(|_| self.encode(HEIGHT * WIDTH / 4, bombs, r)).collect();
                shard(&chunks, first, r)
            }
        }
    }
}

/// Reads the first band and checks that all values are finite.
fn read_first_band(path: &Path) -> bool {
    let options = ChartOptions::default();
    let Ok(chart) = ChartStore::open(&path.to_string_lossy(), options) else { return false };
    let rect = Rect::new(0, 0, chart.size().height.min(40), chart.size().width.min(40));
    let mut out = vec![f32::NAN; rect.size().pixels()];
    let complete = chart.read_rect(0, rect, &mut out).is_ok();
    assert!(
        !complete || out.iter().all(|v| v.is_finite()),
        "a value that is not finite was read without an error"
    );
    complete
}

#[test]
fn damaged_chart_chunks_do_not_panic() {
    let dir = directory();
    let mut stores = Vec::new();
    for codec in V3 {
        for bytes in [2, 4, 8] {
            stores.push(Store::v3(dir.path(), &[codec], bytes, bytes == 8, None));
        }
        for (checksum, first) in [(false, false), (true, true)] {
            stores.push(Store::v3(dir.path(), &[codec], 4, checksum, Some(first)));
        }
    }
    // Compressions above others, up to the maximum length of a chain.
    for chain in
        [&[Codec::Gzip, Codec::Zstd][..], &[Codec::Zstd, Codec::Blosc, Codec::Gzip], &[Codec::Gzip; 15]]
    {
        stores.push(Store::v3(dir.path(), chain, 4, false, None));
        stores.push(Store::v3(dir.path(), &chain[1..], 4, true, Some(false)));
    }
    stores.extend(
        [Codec::None, Codec::Zstd, Codec::Gzip, Codec::Zlib, Codec::Blosc].map(|c| Store::v2(dir.path(), c)),
    );
    let bombs = Bombs::new();
    let current = RefCell::new(PathBuf::new());
    let make = |r: &mut Random| {
        let store = &stores[r.below(stores.len())];
        let bytes = store.encode_file(&bombs, r);
        fs::write(store.chunk_file(), &bytes).unwrap();
        current.borrow_mut().clone_from(&store.path);
        // The case begins with the name of its store, so that a finding can be reproduced.
        [store.path.file_name().unwrap().as_encoded_bytes(), b"\n", &bytes[..]].concat()
    };
    fuzz("chart chunks", 1000, make, |_| read_first_band(&current.borrow()));
}

/// Chunks written by c-blosc (LZ4), with other sizes in their headers.
#[test]
fn damaged_blosc_headers_do_not_panic() {
    let dir = directory();
    let from = data("charts/v2-blosc/chart");
    for name in [".zarray", ".zattrs"] {
        fs::copy(from.join(name), dir.path().join(name)).unwrap();
    }
    let names = ["0.0.0", "0.1.1", "0.2.2", "1.0.1"];
    let originals = names.map(|n| fs::read(from.join(n)).unwrap());
    originals.iter().zip(names).for_each(|(bytes, name)| fs::write(dir.path().join(name), bytes).unwrap());
    let mut last = 0;
    let make = |r: &mut Random| {
        fs::write(dir.path().join(names[last]), &originals[last]).unwrap();
        last = r.below(names.len());
        let mut bytes = originals[last].clone();
        if r.below(8) != 0 {
            damage_blosc_header(&mut bytes, r);
        }
        fs::write(dir.path().join(names[last]), &bytes).unwrap();
        bytes
    };
    let path = dir.path().to_path_buf();
    fuzz("blosc headers", 500, make, |_| {
        let options =
            ChartOptions { wavelengths_nm: Some(vec![500.0, 550.0, 600.0]), ..ChartOptions::default() };
        let Ok(chart) = ChartStore::open(&path.to_string_lossy(), options) else { return false };
        let rect = Rect::new(0, 0, 37, 41);
        chart.read_rect(0, rect, &mut vec![0.0; rect.size().pixels()]).is_ok()
    });
}
