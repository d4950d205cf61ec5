//! Invalid, damaged and incomplete stores: an error each, never a panic.

use super::*;
use serde_json::Value;

fn with_nan(policy: NanPolicy) -> ChartOptions {
    ChartOptions { nan: policy, ..ChartOptions::default() }
}

fn edit(path: &Path, change: impl Fn(String) -> String) {
    let file = path.join("zarr.json");
    let json = std::fs::read_to_string(&file).unwrap();
    let changed = change(json.clone());
    assert_ne!(json, changed, "the edit must change something");
    std::fs::write(file, changed).unwrap();
}

#[test]
fn path_without_a_chart_is_an_error_that_names_the_cause() {
    let dir = tempfile::tempdir().unwrap();
    assert!(matches!(open_error(&dir.path().join("nowhere")), ChartError::NotFound { .. }));
    assert!(matches!(open_error(dir.path()), ChartError::NotZarr { .. }));
    let file = dir.path().join("picture.png");
    std::fs::write(&file, b"PNG").unwrap();
    assert!(matches!(open_error(&file), ChartError::NotZarr { .. }));
    let e = open_error(&PathBuf::from(format!("{}//film", fixture("v3-sharded").display()))).to_string();
    assert!(e.contains("\"film\"") && e.contains("chart, wavelength"), "{e}");
    let (_dir, path) = copied("v3-wrong-order");
    edit(&path, |s| s.replace("\"y\"", "\"time\"").replace("\"x\"", "\"depth\""));
    let e = open_error(&path).to_string();
    assert!(
        e.contains("(time, depth, wavelength)") && e.contains("any order") && e.contains("--axes"),
        "{e}"
    );
    let e = open_error(&fixture("v3-int32")).to_string();
    assert!(e.contains("int32") && e.contains("float32"), "{e}");
    let e =
        open_error(&PathBuf::from(format!("{}//wavelength", fixture("v3-sharded").display()))).to_string();
    assert!(e.contains("[3]"), "{e}");
}

#[test]
fn oversized_shapes_are_an_error_before_memory_is_allocated() {
    let edits: [(&str, &str); 4] = [
        ("37,", "1000000000000000000,"),
        ("37,", "0,"),
        ("16,", "100000000,"),
        ("16,", "18446744073709551615,"),
    ];
    for (from, to) in edits {
        let (_dir, path) = copied("v3-bip-zstd");
        edit(&path, |s| s.replacen(from, to, 2));
        let e = open_error(&path).to_string();
        assert!(e.contains("expected"), "{from} {to}: {e}");
    }
    let (_dir, path) = copied("v3-index-first");
    edit(&path, |s| s.replace("32,", "2000000000000000,"));
    assert!(open_error(&path).to_string().contains("inner chunks"));
}

#[test]
fn chain_of_too_many_codecs_is_an_error_before_memory_is_allocated() {
    let gzip = r#"{"name": "gzip", "configuration": {"level": 1}}"#;
    let many = |count: usize| [gzip].repeat(count).join(", ");
    let expect = |path: &Path, count: &str| {
        let e = open_error(path).to_string();
        assert!(e.contains("array") && e.contains(count) && e.contains("at most 16 in all"), "{e}");
    };
    // An array without shards, the inner chunks of a shard, its index.
    for (name, file, list) in [
        ("v3-bip-zstd", "zarr.json", "/codecs"),
        ("v3-sharded", "chart/zarr.json", "/codecs/0/configuration/codecs"),
        ("v3-sharded", "chart/zarr.json", "/codecs/0/configuration/index_codecs"),
    ] {
        let (_dir, path) = copied(name);
        let mut json: Value = serde_json::from_slice(&std::fs::read(path.join(file)).unwrap()).unwrap();
        let codecs = json.pointer_mut(list).and_then(Value::as_array_mut).unwrap();
        let (more, length) = (format!("[{}]", many(150)), codecs.len() + 150);
        codecs.extend(serde_json::from_str::<Vec<Value>>(&more).unwrap());
        std::fs::write(path.join(file), json.to_string()).unwrap();
        expect(&path, &format!("{length} codecs"));
    }
    // Filters and compressor of format 2.
    let (_dir, path) = copied("v2-big-endian-fortran");
    let mut json: Value = serde_json::from_slice(&std::fs::read(path.join(".zarray")).unwrap()).unwrap();
    let shuffle = serde_json::json!({"id": "shuffle", "elementsize": 4});
    json["filters"] = vec![shuffle; 150].into();
    std::fs::write(path.join(".zarray"), json.to_string()).unwrap();
    expect(&path, "codecs");
}

#[test]
fn damaged_chunk_is_an_error_with_file_and_region() {
    let (_dir, path) = copied("v3-sharded");
    let file = path.join("chart/c/1/0/1");
    let good = std::fs::read(&file).unwrap();
    let mut bad = good.clone();
    bad[40] ^= 1;
    std::fs::write(&file, &bad).unwrap();
    let chart = open(&path);
    let e = all(&chart, 1).unwrap_err();
    let ChartError::Corrupt { path: reported, first_band: 1, region, .. } = &e else { panic!("{e}") };
    assert_eq!((reported, *region), (&file, Rect::new(0, 32, 16, 9)));
    assert!(all(&chart, 0).is_ok());
    for cut in [0, 10, good.len() / 2, good.len() - 1] {
        std::fs::write(&file, &good[..cut]).unwrap();
        let e = all(&open(&path), 1).unwrap_err();
        assert!(matches!(e, ChartError::Corrupt { .. }), "cut to {cut}: {e}");
    }
    std::fs::write(&file, &good).unwrap();
    assert!(all(&chart, 1).is_ok(), "errors are not cached");
}

#[test]
fn flipped_bytes_of_a_chunk_cause_no_panic() {
    for (name, key) in
        [("v3-bip-zstd", "c/0/0/0"), ("v2-big-endian-fortran", "0.0.0"), ("v3-sharded", "chart/c/0/1/0")]
    {
        let (_dir, path) = copied(name);
        let file = path.join(key);
        let good = std::fs::read(&file).unwrap();
        for k in (0..good.len()).step_by(1 + good.len() / 300) {
            for flip in [0xff, 0x80, 1] {
                let mut bad = good.clone();
                bad[k] ^= flip;
                std::fs::write(&file, &bad).unwrap();
                let _ = all(&open(&path), 0);
            }
        }
    }
}

#[test]
fn nan_is_an_error_with_band_row_column_or_a_counted_zero() {
    // No compression: the NaN goes straight into the file. Band 0, chunk (1, 2), row 3, column 4 of it.
    let (_dir, path) = copied("v3-two-dimensional");
    let file = path.join("c/1/2");
    let mut bytes = std::fs::read(&file).unwrap();
    bytes[(3 * 16 + 4) * 2..][..2].copy_from_slice(&half::f16::NAN.to_le_bytes());
    // Beyond the edge of the chart (columns 41..48): ignored.
    bytes[(3 * 16 + 12) * 2..][..2].copy_from_slice(&half::f16::INFINITY.to_le_bytes());
    std::fs::write(&file, bytes).unwrap();
    let e = all(&open(&path), 0).unwrap_err();
    assert!(matches!(e, ChartError::NotFinite { band: 0, row: 19, column: 36, .. }), "{e}");
    let chart = ChartStore::open(path.to_str().unwrap(), with_nan(NanPolicy::Zero)).unwrap();
    let pixels = all(&chart, 0).unwrap();
    assert_eq!((pixels[19 * 41 + 36], pixels[19 * 41 + 37]), (0.0, sample(1, 19, 37)));
    all(&chart, 0).unwrap();
    assert_eq!(chart.stats().nan_replaced, 1);
}

#[test]
fn missing_chunk_reads_as_its_fill_value_and_is_counted() {
    let (_dir, path) = copied("v3-bip-zstd");
    std::fs::remove_file(path.join("c/0/1/1")).unwrap();
    edit(&path, |s| s.replace("\"fill_value\": 0", "\"fill_value\": 9"));
    let chart = open(&path);
    for band in 0..3 {
        assert_eq!(all(&chart, band).unwrap()[20 * 41 + 20], 9.0);
    }
    assert_eq!(chart.stats().missing_chunks, 1);
}

#[test]
fn samples_without_data_are_counted_in_bands_that_are_read() {
    let (_dir, path) = copied("v3-bip-zstd");
    std::fs::remove_file(path.join("c/0/1/1")).unwrap();
    edit(&path, |s| s.replace("\"attributes\": {}", "\"attributes\": {\"_FillValue\": 0}"));
    let open = || ChartStore::open(path.to_str().unwrap(), with_nan(NanPolicy::Zero)).unwrap();
    let chart = open();
    all(&chart, 0).unwrap();
    let of_one = chart.stats().nan_replaced;
    assert!(of_one >= 256, "{of_one}");
    all(&chart, 0).unwrap();
    assert_eq!(chart.stats().nan_replaced, of_one);
    // A copy of one band of chunks of three counts as reading that band does.
    let (copied, temp) = (open(), tempfile::tempdir().unwrap());
    copied.rechunk(&[0], temp.path(), 1, &|_, _| ()).unwrap();
    assert_eq!(copied.stats().nan_replaced, of_one);
}

#[test]
fn missing_chunk_with_fill_value_nan_is_an_error() {
    let (_dir, path) = copied("v3-sharded");
    std::fs::remove_file(path.join("chart/c/2/1/0")).unwrap();
    let chart = open(&path);
    let e = all(&chart, 2).unwrap_err();
    assert!(matches!(e, ChartError::MissingChunk { band: 2, region: Rect { y: 32, x: 0, .. }, .. }), "{e}");
    assert!(e.to_string().contains("--nan zero"), "{e}");
    let chart = ChartStore::open(path.to_str().unwrap(), with_nan(NanPolicy::Zero)).unwrap();
    assert_eq!(all(&chart, 2).unwrap()[36 * 41], 0.0);
    let stats = chart.stats();
    assert_eq!((stats.missing_chunks, stats.nan_replaced), (2, 5 * 32));
}

#[test]
fn request_outside_the_chart_is_an_error() {
    let chart = open(&fixture("v3-sharded"));
    let mut out = vec![0.0; 4];
    for (band, rect) in [(3, Rect::new(0, 0, 2, 2)), (0, Rect::new(-1, 0, 2, 2)), (0, Rect::new(36, 0, 2, 2))]
    {
        assert!(matches!(chart.read_rect(band, rect, &mut out), Err(ChartError::Request { .. })));
    }
    assert!(matches!(chart.read_rect(0, Rect::new(0, 0, 3, 2), &mut out), Err(ChartError::Request { .. })));
}

/// Metadata with bytes changed, removed and duplicated at random positions (xorshift, fixed seed).
#[test]
fn random_metadata_cause_no_panic() {
    let mut seed = 0x9e37_79b9_7f4a_7c15_u64;
    let mut random = |n: usize| {
        seed ^= seed << 13;
        seed ^= seed >> 7;
        seed ^= seed << 17;
        (seed % n as u64) as usize
    };
    let tokens: [&[u8]; 10] = [
        b"0",
        b"-1",
        b"1e308",
        b"18446744073709551615",
        b"null",
        b"[]",
        b"{}",
        b"\"\"",
        b"999999999",
        b"NaN",
    ];
    for (name, key) in [
        ("v3-sharded", "chart/zarr.json"),
        ("v3-index-first", "zarr.json"),
        ("v3-transposed", "zarr.json"),
        ("v2-big-endian-fortran", ".zarray"),
        ("v3-sharded", "wavelength/zarr.json"),
    ] {
        let (_dir, path) = copied(name);
        let good = std::fs::read(path.join(key)).unwrap();
        for _ in 0..600 {
            let mut bad = good.clone();
            for _ in 0..=random(2) {
                let (at, token) = (random(bad.len()), tokens[random(tokens.len())]);
                match random(4) {
                    0 => bad[at] = random(256) as u8,
                    1 => bad.truncate(at + 1),
                    2 => {
                        // Replaces a number or string.
                        let is_end = |b: &u8| matches!(b, b',' | b']' | b'}' | b'\n');
                        let end = bad[at..].iter().position(is_end).map_or(bad.len(), |k| at + k);
                        let start = bad[..at]
                            .iter()
                            .rposition(|b| matches!(b, b' ' | b'[' | b':'))
                            .map_or(at, |k| k + 1);
                        bad.splice(start.min(end)..end, token.iter().copied());
                    }
                    _ => {
                        let part = bad[at..(at + 30).min(bad.len())].to_vec();
                        bad.splice(at..at, part);
                    }
                }
            }
            std::fs::write(path.join(key), &bad).unwrap();
            if let Ok(chart) = ChartStore::open(path.to_str().unwrap(), ChartOptions::default())
                && chart.size().pixels() < 1 << 20
            {
                let _ = all(&chart, 0);
            }
        }
    }
}
