//! Metadata that is JSON, and means something else.

use crate::fuzz_support::{Random, damage_text};
use serde_json::{Value, json};

/// Puts a strange value somewhere into the tree; what is no JSON is damaged as text.
pub fn strange(bytes: &mut Vec<u8>, r: &mut Random) {
    let Ok(mut tree) = serde_json::from_slice::<Value>(bytes) else { return damage_text(bytes, r) };
    for _ in 0..=r.below(2) {
        let values = [
            json!(0),
            json!(-1),
            json!(1),
            json!(u64::MAX),
            json!(1u64 << 33),
            json!(1_000_000_000_000_000_000u64),
            json!(1e300),
            json!(1e-300),
            json!(0.5),
            json!(null),
            json!(true),
            json!(""),
            json!("NaN"),
            json!("/../"),
            json!([]),
            json!([0, 0, 0]),
            json!([3, 3]),
            json!([u64::MAX, u64::MAX, 1]),
            json!([2, 1, 0]),
            json!({}),
            json!({"name": "sharding_indexed"}),
            json!({"name": "transpose", "configuration": {"order": [0, 0, 9]}}),
            json!([{"name": "transpose", "configuration": {"order": [1, 0]}}, {"name": "bytes"}]),
            json!([{"name": "bytes", "configuration": {"endian": "little"}}, {"name": "gzip", "configuration": {"level": 5}}]),
            json!("float64"),
            json!("int8"),
            json!("big"),
            json!("<f8"),
            json!("|V9"),
        ];
        *pick(&mut tree, r) = values[r.below(values.len())].clone();
    }
    *bytes = tree.to_string().into_bytes();
}

/// Some node of the tree.
fn pick<'a>(tree: &'a mut Value, r: &mut Random) -> &'a mut Value {
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
    pick(child.expect("i is below the number of children"), r)
}
