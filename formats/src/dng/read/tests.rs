//! DNGs that are written here, tag by tag, and read back; damaged ones.

use super::super::lossless_jpeg::tests::{encoded, noise};
use super::*;
use std::io::Write;

type Tag = (u16, u16, Vec<u64>);

/// A TIFF of directories; the first one names the others as its sub-directories. Tag 273 or 324 stands for the data, whose offsets are put in.
fn tiff(directories: &[(Vec<Tag>, Vec<Vec<u8>>)], big_endian: bool) -> Vec<u8> {
    let order = |v: u64, n: usize| -> Vec<u8> {
        let bytes = v.to_be_bytes();
        let mut own = bytes[8 - n..].to_vec();
        if !big_endian {
            own.reverse();
        }
        own
    };
    let mut out: Vec<u8> = if big_endian { b"MM\0\x2a".to_vec() } else { b"II\x2a\0".to_vec() };
    out.extend([0; 4]);
    let mut places = Vec::new();
    for (k, (tags, data)) in directories.iter().enumerate().rev() {
        let mut tags = tags.clone();
        let mut offsets = Vec::new();
        for part in data {
            offsets.push(out.len() as u64);
            out.extend(part);
            out.extend(vec![0; out.len() % 2]);
        }
        if !data.is_empty() {
            let tiled = tags.iter().any(|t| t.0 == 322);
            tags.push((if tiled { 324 } else { 273 }, 4, offsets));
            tags.push((if tiled { 325 } else { 279 }, 4, data.iter().map(|d| d.len() as u64).collect()));
        }
        if k == 0 && !places.is_empty() {
            tags.push((330, 4, places.clone()));
        }
        tags.sort_by_key(|t| t.0);
        let mut entries = order(tags.len() as u64, 2);
        for (tag, kind, values) in &tags {
            let size = [0, 1, 1, 2, 4, 4, 1, 1, 2, 4, 4][usize::from(*kind)];
            let mut bytes: Vec<u8> = values.iter().flat_map(|v| order(*v, size)).collect();
            let count = if *kind == 5 || *kind == 10 { values.len() / 2 } else { values.len() };
            entries.extend(
                [order(u64::from(*tag), 2), order(u64::from(*kind), 2), order(count as u64, 4)].concat(),
            );
            if bytes.len() > 4 {
                let at = out.len() as u64;
                out.extend(&bytes);
                bytes = order(at, 4);
            }
            bytes.resize(4, 0);
            entries.extend(bytes);
        }
        out.extend(vec![0; out.len() % 2]);
        places.insert(0, out.len() as u64);
        out.extend(entries);
        out.extend([0; 4]);
    }
    let first = order(places[0], 4);
    out[4..8].copy_from_slice(&first);
    out
}

/// A raw of 10 × 14 pixels in tiles of 8 × 6, below a preview.
fn file(compression: u64, bits: u32, big_endian: bool) -> (Vec<u8>, Vec<u16>) {
    let (rows, columns, tile) = (10, 14, (8, 6));
    let samples = noise(rows * columns, bits);
    let mut parts = Vec::new();
    for top in (0..rows).step_by(tile.0) {
        for left in (0..columns).step_by(tile.1) {
            let at = |y: usize, x: usize| {
                let (y, x) = (top + y, left + x);
                if y < rows && x < columns { samples[y * columns + x] } else { 0 }
            };
            let part: Vec<u16> =
                (0..tile.0).flat_map(|y| (0..tile.1).map(move |x| (y, x))).map(|(y, x)| at(y, x)).collect();
            parts.push(match compression {
                7 => encoded(&part, (tile.0, tile.1 / 2, 2), bits, 1, 0),
                8 => {
                    let mut zlib = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::new(6));
                    zlib.write_all(&packed(&part, tile.1, bits, big_endian)).unwrap();
                    zlib.finish().unwrap()
                }
                _ => packed(&part, tile.1, bits, big_endian),
            });
        }
    }
    let raw = vec![
        (254, 4, vec![0]),
        (256, 4, vec![columns as u64]),
        (257, 4, vec![rows as u64]),
        (258, 3, vec![u64::from(bits)]),
        (259, 3, vec![compression]),
        (262, 3, vec![32803]),
        (322, 4, vec![tile.1 as u64]),
        (323, 4, vec![tile.0 as u64]),
        (33421, 3, vec![2, 2]),
        (33422, 1, vec![0, 1, 1, 2]),
        (50713, 3, vec![2, 2]),
        (50714, 5, vec![1, 2, 2, 1, 3, 1, 4, 1]),
        (50715, 10, (0..12).flat_map(|x| [x, 4]).collect()),
        (50716, 10, (0..9).flat_map(|y| [y, 1]).collect()),
        (50717, 4, vec![(1 << bits) - 1]),
        (50719, 5, vec![1, 1, 2, 1]),
        (50720, 5, vec![8, 1, 6, 1]),
        (50829, 4, vec![1, 2, 10, 14]),
    ];
    let first = vec![
        (254, 4, vec![1]),
        (262, 3, vec![2]),
        (274, 3, vec![6]),
        (34855, 3, vec![400]),
        (33434, 5, vec![1, 50]),
        (50706, 1, vec![1, 4, 0, 0]),
        (50708, 2, b"Model X\0".iter().map(|b| u64::from(*b)).collect()),
        (50721, 10, [[1u64, 1], [0, 1], [0, 1], [0, 1], [1, 1], [0, 1], [0, 1], [0, 1], [1, 1]].concat()),
        (50728, 5, vec![1, 2, 1, 1, 3, 4]),
        (50778, 3, vec![21]),
    ];
    (tiff(&[(first, Vec::new()), (raw, parts)], big_endian), samples)
}

fn packed(samples: &[u16], width: usize, bits: u32, big_endian: bool) -> Vec<u8> {
    let one = |v: &u16| if big_endian { v.to_be_bytes() } else { v.to_le_bytes() };
    if bits == 16 {
        return samples.iter().flat_map(one).collect();
    }
    let row = |row: &[u16]| -> Vec<u8> {
        let mut all: Vec<bool> =
            row.iter().flat_map(|v| (0..bits).rev().map(move |k| v >> k & 1 == 1)).collect();
        all.resize(all.len().next_multiple_of(8), false);
        all.chunks(8).map(|byte| byte.iter().fold(0, |v, b| v << 1 | u8::from(*b))).collect()
    };
    samples.chunks(width).flat_map(row).collect()
}

fn opened(bytes: &[u8]) -> Result<CameraRaw, DngError> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.dng");
    std::fs::write(&path, bytes).unwrap();
    CameraRaw::open(&path)
}

#[test]
fn numbers_of_every_packing_compression_and_byte_order_are_read() {
    for big_endian in [false, true] {
        for (compression, bits) in [
            (1, 8),
            (1, 10),
            (1, 12),
            (1, 14),
            (1, 16),
            (7, 8),
            (7, 12),
            (7, 14),
            (7, 16),
            (8, 8),
            (8, 12),
            (8, 16),
        ] {
            let (bytes, samples) = file(compression, bits, big_endian);
            let raw = opened(&bytes).unwrap();
            // The crop: 6 × 8 from (1 + 2, 2 + 1).
            assert_eq!(raw.area, Rect::new(3, 3, 6, 8));
            let expected: Vec<u16> = (3..9).flat_map(|y| samples[y * 14 + 3..][..8].to_vec()).collect();
            assert_eq!(raw.stored(raw.size().rect()), expected, "{compression} {bits} {big_endian}");
        }
    }
}

#[test]
fn levels_pattern_colour_and_labels_are_read() {
    let raw = opened(&file(1, 12, false).0).unwrap();
    // From the active area's first pixel: the crop begins at its row 2, column 1.
    assert_eq!(raw.pattern, Some([1, 0, 2, 1]));
    let (stored, linear) = (raw.stored(raw.size().rect()), raw.linear(raw.size().rect()));
    for (k, (s, l)) in std::iter::zip(stored, linear).enumerate() {
        let (y, x) = (2 + k / 8, 1 + k % 8);
        let black = [0.5, 2.0, 3.0, 4.0][y % 2 * 2 + x % 2] + x as f64 / 4.0 + y as f64;
        assert_eq!(l, (f64::from(s) - black) as f32, "{y} {x}");
    }
    assert_eq!(raw.ranges(), [4095.0 - (4.0 + 11.0 / 4.0 + 8.0)]);
    let profile = raw.profile.unwrap();
    assert_eq!(profile.neutral, [0.5, 1.0, 0.75]);
    assert!(
        raw.description.starts_with("Model X, 1/50 s, ISO 400; 14x10 pixels of 12 bits"),
        "{}",
        raw.description
    );
    assert!(raw.notes[0].contains("orientation (6) is not applied"), "{:?}", raw.notes);
}

/// A raw of 2 × 2 pixels in one strip, with tags of its own in place of others.
fn small(own: &[Tag], data: Vec<u8>) -> Vec<u8> {
    let mut tags: Vec<Tag> = vec![
        (256, 4, vec![2]),
        (257, 4, vec![2]),
        (258, 3, vec![8]),
        (259, 3, vec![1]),
        (262, 3, vec![32803]),
        (33421, 3, vec![2, 2]),
        (33422, 1, vec![1, 2, 0, 1]),
        (50706, 1, vec![1, 4, 0, 0]),
    ];
    tags.retain(|t| own.iter().all(|o| o.0 != t.0));
    tags.extend_from_slice(own);
    tiff(&[(tags, vec![data])], false)
}

#[test]
fn tables_of_linear_numbers_and_linear_raws_are_read() {
    let table = (50712, 3, vec![0, 10, 40, 90]);
    let raw = opened(&small(&[table, (50717, 3, vec![90])], vec![0, 1, 2, 9])).unwrap();
    assert_eq!(raw.linear(raw.size().rect()), [0.0, 10.0, 40.0, 90.0]);
    assert_eq!((raw.pattern, raw.profile), (Some([1, 2, 0, 1]), None));
    let linear = [(262, 3, vec![34892]), (277, 3, vec![3]), (258, 3, vec![8; 3]), (50714, 3, vec![1, 2, 3])];
    let raw = opened(&small(&linear, (10..22).collect())).unwrap();
    assert_eq!((raw.samples, raw.pattern), (3, None));
    assert_eq!(raw.linear(Rect::new(1, 0, 1, 2)), [15.0, 15.0, 15.0, 18.0, 18.0, 18.0]);
    assert_eq!(raw.ranges(), [254.0, 253.0, 252.0]);
}

#[test]
fn what_is_not_supported_is_one_error_with_a_way_out() {
    let cases: [(&[Tag], &str); 7] = [
        (&[(259, 3, vec![34892])], "34892 (lossy JPEG)"),
        (&[(259, 3, vec![52546])], "52546 (JPEG XL)"),
        (&[(259, 3, vec![7])], "damaged"),
        (&[(33422, 1, vec![0, 1, 1, 1])], "(Bayer)"),
        (&[(258, 3, vec![32]), (339, 3, vec![3])], "integers of 8 to 16 bits"),
        (&[(262, 3, vec![2])], "without one"),
        (&[(50717, 3, vec![0])], "a white level above the black level"),
    ];
    for (tags, expected) in cases {
        let error = opened(&small(tags, vec![1, 2, 3, 4])).unwrap_err().to_string();
        assert!(error.contains(expected) && !error.contains('\n'), "{error}");
    }
    let huge = small(&[(256, 4, vec![1 << 29])], vec![1, 2, 3, 4]);
    assert!(opened(&huge).unwrap_err().to_string().contains("2^29 samples"));
    let large = small(&[(256, 4, vec![1 << 27])], vec![1, 2, 3, 4]);
    assert!(opened(&large).unwrap_err().to_string().contains("expected at least 268435456"));
}

#[test]
fn circle_of_directories_ends() {
    let mut bytes = small(&[], vec![1, 2, 3, 4]);
    let first = u32::from_le_bytes(bytes[4..8].try_into().unwrap());
    let end = bytes.len() - 4;
    bytes[end..].copy_from_slice(&first.to_le_bytes());
    assert_eq!(opened(&bytes).unwrap().stored(Rect::new(0, 0, 2, 2)), [1, 2, 3, 4]);
}

#[test]
fn damaged_files_are_errors_or_pictures_but_never_panic() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.dng");
    for (compression, bits) in [(1, 12), (7, 14), (8, 16)] {
        let (bytes, _) = file(compression, bits, false);
        let mut refused = 0;
        for at in 0..bytes.len() {
            let mut check = |other: &[u8]| {
                std::fs::write(&path, other).unwrap();
                match CameraRaw::open(&path) {
                    Ok(raw) => {
                        let rect = raw.size().rect();
                        assert_eq!(raw.linear(rect).len(), rect.size().pixels() * raw.samples);
                    }
                    Err(e) => {
                        refused += 1;
                        assert!(!e.to_string().contains('\n'));
                    }
                }
                is_dng(&path)
            };
            if at % 3 == 0 {
                check(&bytes[..at]);
            }
            for change in [0x01, 0x80, 0xFF] {
                let mut other = bytes.clone();
                other[at] ^= change;
                check(&other);
            }
        }
        assert!(refused > bytes.len() / 3, "{refused} of {}", bytes.len());
    }
}

#[test]
fn other_files_are_no_dng() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a");
    assert!(!is_dng(&path) && !is_dng(folder.path()));
    std::fs::write(&path, "II*").unwrap();
    assert!(!is_dng(&path));
    std::fs::write(&path, file(1, 8, true).0).unwrap();
    assert!(is_dng(&path));
}
