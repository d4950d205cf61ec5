//! Lens packs, as .zip in memory: entries damaged before they are packed (so that no checksum of the archive hides them), and
//! archives damaged as they are.

use crate::fuzz_support::{Random, damage, fuzz};
use crate::{data, folder, json};
use lenscube_formats::import::{self, ImportOptions};
use lenscube_formats::lens::LensPack;
use std::io::{Cursor, Read, Write};
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipArchive, ZipWriter};

type Entries = Vec<(String, Vec<u8>)>;

fn unpacked(bytes: &[u8]) -> Entries {
    let mut archive = ZipArchive::new(Cursor::new(bytes)).unwrap();
    let mut entries = Vec::new();
    for i in 0..archive.len() {
        let mut entry = archive.by_index(i).unwrap();
        let mut bytes = Vec::new();
        entry.read_to_end(&mut bytes).unwrap();
        entries.push((entry.name().unwrap().into_owned(), bytes));
    }
    entries
}

fn packed(entries: &Entries) -> Vec<u8> {
    let mut zip = ZipWriter::new(Cursor::new(Vec::new()));
    let options = SimpleFileOptions::default().compression_method(CompressionMethod::Stored);
    for (name, bytes) in entries {
        zip.start_file(name.as_str(), options).unwrap();
        zip.write_all(bytes).unwrap();
    }
    zip.finish().unwrap().into_inner()
}

/// A pack of ours (with crc32c) and one of zarr-python (without), both small.
fn seeds() -> Vec<Vec<u8>> {
    let dir = folder();
    let out = dir.path().join("seed.zip");
    let options = ImportOptions { field_points: 11, ..ImportOptions::default() };
    import::write(&out, import::open(&data("tables-example"), &options).unwrap(), |_, _| ()).unwrap();
    vec![std::fs::read(out).unwrap(), std::fs::read(data("zarr_python.lens.zip")).unwrap()]
}

fn spoilt(seeds: &[(Vec<u8>, Entries)], r: &mut Random) -> Vec<u8> {
    let (whole, entries) = &seeds[r.below(seeds.len())];
    if r.below(4) == 0 {
        let mut bytes = whole.clone();
        damage(&mut bytes, r);
        return bytes;
    }
    let mut entries = entries.clone();
    let at = r.below(entries.len());
    match r.below(8) {
        0 => {
            entries.remove(at);
        }
        1..4 => damage(&mut entries[at].1, r),
        _ => {
            let metadata: Vec<usize> =
                (0..entries.len()).filter(|&i| entries[i].0.ends_with("zarr.json")).collect();
            json::strange(&mut entries[metadata[r.below(metadata.len())]].1, r);
        }
    }
    packed(&entries)
}

#[test]
fn lens_packs() {
    let seeds: Vec<_> = seeds().into_iter().map(|s| (s.clone(), unpacked(&s))).collect();
    fuzz(
        "lens pack",
        300,
        |r| spoilt(&seeds, r),
        |bytes| {
            let Ok(pack) = LensPack::open_bytes(bytes.to_vec()) else { return false };
            (0..pack.lens().bands.len()).all(|b| pack.psf(b).is_ok())
        },
    );
}
