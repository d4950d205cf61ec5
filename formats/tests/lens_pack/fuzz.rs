//! Damaged packs may give any answer but a panic. Seeds are fixed, so a failure is found again.

use crate::*;
use serde_json::{Value, json};
use std::fs;

/// splitmix64 (Steele, Lea, Flood 2014).
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    fn below(&mut self, n: usize) -> usize {
        (self.next() % n.max(1) as u64) as usize
    }
}

/// Flips bits, sets bytes, cuts, repeats a piece.
fn damage(bytes: &mut Vec<u8>, r: &mut Random) {
    for _ in 0..=r.below(3) {
        let at = r.below(bytes.len());
        match r.below(8) {
            0 => bytes.truncate(at),
            1 if at < bytes.len() => {
                let piece = bytes[at..].to_vec();
                bytes.extend(piece);
            }
            2 if at < bytes.len() => bytes[at] = [0, 0xFF, 0x7F, 0x80][r.below(4)],
            _ if at < bytes.len() => bytes[at] ^= 1 << r.below(8),
            _ => {}
        }
    }
}

/// Unpacks the fixture (no crc32c, so damage reaches the decoders) or writes a small pack, as a directory.
fn directory(at: &Path, from_zarr_python: bool) -> Vec<PathBuf> {
    if from_zarr_python {
        zip::ZipArchive::new(fs::File::open(fixture()).unwrap()).unwrap().extract(at).unwrap();
        fs::rename(at.join("zarr_python.lens.zarr"), at.join("pack")).unwrap();
    } else {
        write_small(&at.join("pack"));
    }
    let mut files = Vec::new();
    let mut open = vec![at.join("pack")];
    while let Some(directory) = open.pop() {
        for entry in fs::read_dir(directory).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() { open.push(path) } else { files.push(path) }
        }
    }
    files.sort();
    files
}

/// Damages one file a time and puts it back; gives how many cases were still read.
fn damage_files(
    from_zarr_python: bool,
    cases: usize,
    seed: u64,
    one: impl Fn(&mut Vec<u8>, &mut Random),
) -> usize {
    let tmp = tempfile::tempdir().unwrap();
    let files = directory(tmp.path(), from_zarr_python);
    let pack = tmp.path().join("pack");
    read_all(&pack).unwrap();
    let mut r = Random(seed);
    let mut read = 0;
    for _ in 0..cases {
        let file = &files[r.below(files.len())];
        let whole = fs::read(file).unwrap();
        let mut bytes = whole.clone();
        one(&mut bytes, &mut r);
        fs::write(file, &bytes).unwrap();
        read += usize::from(read_all(&pack).is_ok());
        fs::write(file, &whole).unwrap();
    }
    read
}

#[test]
fn flipped_bits_in_our_packs() {
    damage_files(false, 600, 1, damage);
}

#[test]
fn flipped_bits_in_packs_without_checksums() {
    damage_files(true, 800, 2, damage);
}

#[test]
fn strange_metadata() {
    let strange = |bytes: &mut Vec<u8>, r: &mut Random| {
        let Ok(mut json) = serde_json::from_slice::<Value>(bytes) else { return };
        let node = pick(&mut json, r);
        let values = [
            json!(0),
            json!(-1),
            json!(1),
            json!(u64::MAX),
            json!(1u64 << 33),
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
            json!("float64"),
            json!("int8"),
            json!("big"),
        ];
        *node = values[r.below(values.len())].clone();
        *bytes = json.to_string().into_bytes();
    };
    damage_files(false, 500, 3, strange);
    damage_files(true, 500, 4, strange);
}

/// Some node of the tree.
fn pick<'a>(json: &'a mut Value, r: &mut Random) -> &'a mut Value {
    let children = match json {
        Value::Array(list) => list.len(),
        Value::Object(map) => map.len(),
        _ => 0,
    };
    if children == 0 || r.below(4) == 0 {
        return json;
    }
    let i = r.below(children);
    let child = match json {
        Value::Array(list) => list.get_mut(i),
        Value::Object(map) => map.values_mut().nth(i),
        _ => None,
    };
    pick(child.expect("i is below the number of children"), r)
}

#[test]
fn damaged_zips() {
    let tmp = tempfile::tempdir().unwrap();
    let ours = tmp.path().join("ours.zip");
    write_small(&ours);
    let case = tmp.path().join("case.zip");
    let mut r = Random(5);
    for source in [ours, fixture()] {
        let whole = fs::read(source).unwrap();
        for _ in 0..400 {
            let mut bytes = whole.clone();
            damage(&mut bytes, &mut r);
            fs::write(&case, &bytes).unwrap();
            let _ = read_all(&case);
        }
    }
}
