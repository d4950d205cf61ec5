//! Damaged JSON metadata: values, keys, and texts that no JSON writer produces.

use crate::fuzz_support::extreme::{integer, magnitude, text, wavelengths_nm};
use crate::fuzz_support::{Random, damage_text};
use serde_json::{Value, json};

/// Placeholder for a text that [`Value`] cannot represent.
const RAW: &str = "@raw@";

/// Replaces some values of the tree, or renames a key; a file that is not JSON is damaged as text.
pub fn damage_values(bytes: &mut Vec<u8>, r: &mut Random) {
    let Ok(mut tree) = serde_json::from_slice::<Value>(bytes) else { return damage_text(bytes, r) };
    for _ in 0..=r.below(2) {
        let node = pick_node(&mut tree, r);
        match (r.below(8), &mut *node) {
            (0, Value::Object(map)) if !map.is_empty() => {
                let key = map.keys().nth(r.below(map.len())).expect("the index is below the length").clone();
                let value = map.remove(&key).expect("the key exists");
                map.insert(text(r), value);
            }
            _ => *node = random_value(r),
        }
    }
    let raw = match r.below(7) {
        0 => "1e999".into(),
        1 => "-0".into(),
        2 => "1e-400".into(),
        3 => "9".repeat(400),
        4 => format!("{}1{}", "[".repeat(100_000), "]".repeat(100_000)),
        5 => "{\"a\":".repeat(2000),
        _ => "NaN".into(),
    };
    *bytes = tree.to_string().replace(&format!("\"{RAW}\""), &raw).into_bytes();
    // Bytes that are not UTF-8.
    if r.below(16) == 0 {
        let at = r.below(bytes.len());
        bytes.splice(at..at, [[0xFF, 0xFE], [0xC3, 0x28]][r.below(2)]);
    }
}

fn random_value(r: &mut Random) -> Value {
    match r.below(12) {
        0 | 1 => {
            let v = magnitude(r);
            match (v.is_finite(), r.below(2)) {
                (true, _) => json!(v),
                (false, 0) => json!(RAW),
                _ => json!(["NaN", "Infinity", "-Infinity", "0x7fc00000", "0x7f800000"][r.below(5)]),
            }
        }
        2 => json!(integer(r)),
        3 => json!(-(integer(r) as i64 / 2)),
        4 => json!(text(r)),
        5 => json!(wavelengths_nm(3, r).into_iter().map(finite).collect::<Vec<_>>()),
        6 => json!((0..r.below(5)).map(|_| integer(r)).collect::<Vec<_>>()),
        7 => json!(RAW),
        _ => zarr_value(r),
    }
}

fn finite(v: f64) -> Value {
    if v.is_finite() { json!(v) } else { json!("NaN") }
}

/// Values that have a meaning in another place of Zarr metadata.
fn zarr_value(r: &mut Random) -> Value {
    let values = [
        json!(null),
        json!(true),
        json!(""),
        json!([]),
        json!([0, 0, 0]),
        json!([3, 3]),
        json!([u64::MAX, u64::MAX, 1]),
        json!([2, 1, 0]),
        json!([[[]]]),
        json!({}),
        json!({"name": "sharding_indexed"}),
        json!({"name": "transpose", "configuration": {"order": [0, 0, 9]}}),
        json!([{"name": "transpose", "configuration": {"order": [1, 0]}}, {"name": "bytes"}]),
        json!([{"name": "bytes", "configuration": {"endian": "little"}}, {"name": "gzip", "configuration": {"level": 5}}]),
        json!([{"name": "bytes", "configuration": {"endian": "little"}}, {"name": "zstd", "configuration": {"level": 1, "checksum": true}}]),
        json!([{"name": "bytes"}, {"name": "crc32c"}, {"name": "crc32c"}]),
        json!({"id": "zlib", "level": 5}),
        json!({"id": "blosc", "cname": "zstd", "clevel": 9, "shuffle": 2, "blocksize": u32::MAX}),
        json!("float64"),
        json!("float16"),
        json!("int8"),
        json!("complex64"),
        json!("big"),
        json!("<f8"),
        json!("<f2"),
        json!("|V9"),
        json!("<U300"),
        json!("F"),
    ];
    values[r.below(values.len())].clone()
}

/// A random node of the tree.
fn pick_node<'a>(tree: &'a mut Value, r: &mut Random) -> &'a mut Value {
    let children = match tree {
        Value::Array(list) => list.len(),
        Value::Object(map) => map.len(),
        _ => 0,
    };
    if children == 0 || r.below(5) == 0 {
        return tree;
    }
    let i = r.below(children);
    let child = match tree {
        Value::Array(list) => list.get_mut(i),
        Value::Object(map) => map.values_mut().nth(i),
        _ => None,
    };
    pick_node(child.expect("i is below the number of children"), r)
}
