//! Lens packs, as .zip in memory: entries damaged before they are packed (so that the archive's checksums are valid), damaged
//! archives, and packs with extreme tables, attributes or entry names.

use crate::fuzz_support::extreme::{integer, magnitude, name, text, wavelengths_nm};
use crate::fuzz_support::{Random, damage, fuzz};
use crate::{data, directory, json};
use lenscube_formats::design::builtin::BuiltinLens;
use lenscube_formats::import::{self, ImportOptions};
use lenscube_formats::lens::{LensPack, LensPackWriter, PackAttributes, summary};
use pipeline::design::trace::{Azimuths, PsfHeights, TraceOptions, TracedBand, trace_lens};
use serde_json::json;
use std::io::{Cursor, Read, Write};
use std::path::Path;
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipArchive, ZipWriter};

type Entries = Vec<(String, Vec<u8>)>;

fn unpack(bytes: &[u8]) -> Entries {
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

fn pack(entries: &Entries) -> Vec<u8> {
    let mut zip = ZipWriter::new(Cursor::new(Vec::new()));
    let options = SimpleFileOptions::default().compression_method(CompressionMethod::Stored);
    for (name, bytes) in entries {
        // Names that the library does not write are omitted.
        if zip.start_file(name.as_str(), options).is_ok() {
            zip.write_all(bytes).unwrap();
        }
    }
    zip.finish().unwrap().into_inner()
}

/// Small packs of this program (with crc32c), one with pupil functions, and of zarr-python (without), two of them without rotational symmetry.
fn seeds() -> Vec<Vec<u8>> {
    let dir = directory();
    let out = dir.path().join("seed.zip");
    let options = ImportOptions { field_points: 11, ..ImportOptions::default() };
    import::write(&out, import::open(&data("../../data/tables-example"), &options).unwrap(), |_, _| ())
        .unwrap();
    let pupils = dir.path().join("pupils.zip");
    let _ = write_pupils(&pupils);
    let python = ["", "_polar", "_grid"].map(|kind| data(&format!("zarr_python{kind}.lens.zip")));
    let [symmetric, polar, grid] = python;
    [out, symmetric, pupils, polar, grid].map(|path| std::fs::read(path).unwrap()).into()
}

/// Writes a traced band with pupil functions, and returns it.
fn write_pupils(path: &Path) -> TracedBand {
    let system = BuiltinLens::named("wide-100").unwrap().system();
    let options = TraceOptions {
        field_points: 11,
        heights: PsfHeights::Given(vec![0.0, 4.0]),
        azimuths: Azimuths::Given(8),
        ..TraceOptions::new(vec![550.0], 4.0)
    };
    let mut pack = LensPackWriter::create(path).unwrap();
    let mut traced = None;
    let lens = trace_lens(&system, &options, &mut |_| (), |i, band| {
        let written = pack.pupils(i, &band.pupils);
        traced = Some(band);
        written
    });
    pack.finish(&lens.unwrap(), &PackAttributes::default()).unwrap();
    traced.unwrap()
}

/// A pack with pupil functions and up to three extreme numbers.
fn extreme_pupils((entries, band): &(Entries, TracedBand), r: &mut Random) -> Vec<u8> {
    let (segments, values) = band.pupils.parts();
    let rows = values.len() / segments.len() / 5;
    let mut tables = [
        ("pupil/0", vec![segments.len(), 5, rows], values),
        ("pupil_segment/0", vec![segments.len(), 8], segments.into_flattened()),
        ("psf_size", vec![1], vec![band.pupils.size() as f64]),
        ("psf_pitch", vec![1], vec![band.pupils.pitch_um()]),
    ];
    for _ in 0..=r.below(3) {
        let table = &mut tables[r.below(4)].2;
        let at = r.below(table.len());
        table[at] = if r.below(3) == 0 { integer(r) as f64 } else { magnitude(r) };
    }
    let mut entries = entries.clone();
    for (name, shape, values) in &tables {
        entries.retain(|e| !e.0.starts_with(&format!("{name}/")));
        let bytes = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        put(&mut entries, (name, "float64"), shape, bytes);
    }
    pack(&entries)
}

/// Adds an uncompressed array of one chunk.
fn put(entries: &mut Entries, (name, kind): (&str, &str), shape: &[usize], bytes: Vec<u8>) {
    let metadata = json!({
        "zarr_format": 3, "node_type": "array", "shape": shape, "data_type": kind, "fill_value": 0,
        "chunk_grid": {"name": "regular", "configuration": {"chunk_shape": shape}},
        "chunk_key_encoding": {"name": "default", "configuration": {"separator": "/"}},
        "codecs": [{"name": "bytes", "configuration": {"endian": "little"}}], "attributes": {},
    });
    entries.push((format!("{name}/zarr.json"), metadata.to_string().into_bytes()));
    let key = ["c", "c/0", "c/0/0", "c/0/0/0"][shape.len()];
    entries.push((format!("{name}/{key}"), bytes));
}

fn damaged_pack(seeds: &[(Vec<u8>, Entries)], r: &mut Random) -> Vec<u8> {
    let (archive, entries) = &seeds[r.below(seeds.len())];
    if r.below(4) == 0 {
        let mut bytes = archive.clone();
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
            json::damage_values(&mut entries[metadata[r.below(metadata.len())]].1, r);
        }
    }
    pack(&entries)
}

#[test]
fn damaged_lens_packs_do_not_panic() {
    let seeds: Vec<_> = seeds().into_iter().map(|s| (s.clone(), unpack(&s))).collect();
    fuzz(
        "lens pack",
        300,
        |r| damaged_pack(&seeds, r),
        |bytes| {
            let Ok(pack) = LensPack::open_bytes(bytes.to_vec()) else { return false };
            (0..pack.lens().bands.len()).all(|b| pack.psf(b).is_ok())
        },
    );
}

/// Uncompressed tables: (name, shape, values).
type Tables = Vec<(&'static str, Vec<usize>, Vec<f64>)>;

/// Tables of two bands.
fn tables() -> Tables {
    let rows = |n: usize, f: fn(usize) -> f64| (0..2).flat_map(move |_| (0..n).map(f)).collect::<Vec<_>>();
    let window = |k: usize| {
        (0..25).map(move |i| if i == 12 { 0.76 - 0.1 * k as f64 } else { (0.24 + 0.1 * k as f64) / 24.0 })
    };
    let windows: Vec<f64> = (0..3).flat_map(window).collect();
    vec![
        ("wavelength", vec![2], vec![500.0, 600.0]),
        ("ideal_height", vec![2, 6], rows(6, |i| i as f64)),
        ("image_height", vec![2, 6], rows(6, |i| i as f64 * 0.99)),
        ("relative_illumination", vec![2, 6], rows(6, |i| 1.0 - 0.05 * i as f64)),
        ("psf_height", vec![2, 3], rows(3, |i| 2.0 * i as f64)),
        ("azimuth_count", vec![2, 3], rows(3, |i| if i == 0 { 1.0 } else { 8.0 })),
        ("psf_energy", vec![2, 3], rows(3, |_| 0.99)),
        ("psf_pitch", vec![2], vec![2.0; 2]),
        ("solid_angle", vec![2], vec![0.1; 2]),
        ("transmission", vec![2], vec![1.0; 2]),
        ("psf/0", vec![3, 5, 5], windows.clone()),
        ("psf/1", vec![3, 5, 5], windows),
    ]
}

/// Tables of two bands without rotational symmetry, with PSFs at three azimuths of a height or at two places of a grid.
fn planar_tables(is_polar: bool) -> Tables {
    let node = |i: usize, n: usize| i as f64 - (n - 1) as f64 / 2.0;
    let twice = |values: Vec<f64>| values.repeat(2);
    let map = |of: fn(f64, f64) -> f64| twice((0..20).map(|i| of(node(i % 5, 5), node(i / 5, 4))).collect());
    let count = if is_polar { 4 } else { 2 };
    let windows: Vec<f64> = (0..count * 9).map(|i| if i % 9 == 4 { 0.6 } else { 0.05 }).collect();
    let mut tables = vec![
        ("wavelength", vec![2], vec![500.0, 600.0]),
        ("map_x", vec![2, 5], twice((0..5).map(|i| node(i, 5)).collect())),
        ("map_y", vec![2, 4], twice((0..4).map(|i| node(i, 4)).collect())),
        ("map_ideal_x", vec![2, 4, 5], map(|x, y| x * (1.0 + 0.01 * y))),
        ("map_ideal_y", vec![2, 4, 5], map(|_, y| y + 0.1)),
        ("map_relative_illumination", vec![2, 4, 5], map(|x, _| 1.0 - 0.1 * x)),
        ("psf_energy", vec![2, count], vec![0.99; 2 * count]),
        ("psf_pitch", vec![2], vec![2.0; 2]),
        ("solid_angle", vec![2], vec![0.1; 2]),
        ("transmission", vec![2], vec![1.0; 2]),
        ("psf/0", vec![count, 3, 3], windows.clone()),
        ("psf/1", vec![count, 3, 3], windows),
    ];
    tables.extend(match is_polar {
        true => vec![
            ("psf_height", vec![2, 2], vec![0.0, 2.0, 0.0, 2.0]),
            ("azimuth_count", vec![2, 2], vec![1.0, 8.0, 1.0, 8.0]),
            ("psf_azimuths", vec![2, 2], vec![1.0, 3.0, 1.0, 3.0]),
        ],
        false => vec![("psf_x", vec![2, 2], vec![-1.0, 1.0, -1.0, 1.0]), ("psf_y", vec![2, 1], vec![0.0; 2])],
    });
    tables
}

/// A pack with up to three extreme values, wavelengths, attributes or names.
fn extreme_pack(r: &mut Random) -> Vec<u8> {
    extreme_pack_of(tables(), head("lenscube/lens-pack/1"), r)
}

/// As [`extreme_pack`], of a lens without rotational symmetry.
fn extreme_planar_pack(r: &mut Random) -> Vec<u8> {
    let is_polar = r.below(2) == 0;
    let mut attributes = head("lenscube/lens-pack/4");
    attributes["psf_field"] = json!(if is_polar { "polar" } else { "grid" });
    attributes["reference_point"] = json!("as given");
    attributes["errors"] =
        json!({"seed": 1, "values": [{"id": "gap 3/thickness", "value": 12.0, "unit": "um"}]});
    extreme_pack_of(planar_tables(is_polar), attributes, r)
}

fn head(schema: &str) -> serde_json::Value {
    json!({
        "schema": schema, "name": "limits", "distortion_focal_length_mm": 50.0, "effective_focal_length_mm": 50.0,
        "f_number": 2.0, "primary_wavelength_nm": 550.0, "psf_sample": "integrated", "object_distance_mm": null,
        "magnification": 0.0, "defocus_mm": 0.1, "frame": "x", "source": {},
    })
}

fn extreme_pack_of(mut tables: Tables, mut attributes: serde_json::Value, r: &mut Random) -> Vec<u8> {
    let mut names: Vec<String> = Vec::new();
    for _ in 0..=r.below(3) {
        match r.below(8) {
            0 => tables[0].2 = wavelengths_nm(2, r),
            1 | 2 => {
                let map = attributes.as_object_mut().unwrap();
                let at = r.below(map.len());
                let value = map.values_mut().nth(at).unwrap();
                *value = match r.below(4) {
                    0 => json!(text(r)),
                    1 => json!(integer(r)),
                    _ => json!(magnitude(r)),
                };
            }
            3 => names.push(text(r)),
            // All values of a table.
            4 => {
                let t = r.below(tables.len());
                let v = magnitude(r);
                tables[t].2.fill(v);
            }
            _ => {
                let t = r.below(tables.len());
                let i = r.below(tables[t].2.len());
                tables[t].2[i] = magnitude(r);
            }
        }
    }
    let group = json!({"zarr_format": 3, "node_type": "group", "attributes": attributes});
    let mut entries: Entries = vec![("zarr.json".into(), group.to_string().into_bytes())];
    for (name, shape, values) in &tables {
        let (kind, bytes): (_, Vec<u8>) = match *name {
            "azimuth_count" | "psf_azimuths" => {
                ("int32", values.iter().flat_map(|v| (*v as i32).to_le_bytes()).collect())
            }
            _ if name.starts_with("psf/") => {
                ("float32", values.iter().flat_map(|v| (*v as f32).to_le_bytes()).collect())
            }
            _ => ("float64", values.iter().flat_map(|v| v.to_le_bytes()).collect()),
        };
        put(&mut entries, (name, kind), shape, bytes);
    }
    for name in names {
        // A further entry, a parent directory, or the name of an entry.
        match r.below(3) {
            0 => entries.push((name, b"x".to_vec())),
            1 => entries.iter_mut().for_each(|e| e.0 = format!("{name}/{}", e.0)),
            _ => {
                let at = r.below(entries.len());
                entries[at].0 = name;
            }
        }
    }
    entries.sort();
    entries.dedup_by(|a, b| a.0 == b.0);
    let mut bytes = pack(&entries);
    // Bytes that are not UTF-8 in a name.
    if r.below(16) == 0 {
        let raw = name(r);
        let at = bytes.windows(10).position(|w| w == b"wavelength").unwrap_or(0);
        let n = raw.len().min(10);
        bytes[at..at + n].copy_from_slice(&raw[..n]);
    }
    bytes
}

#[test]
fn extreme_lens_packs_are_errors_or_finite() {
    fuzz("lens pack limits", 500, extreme_pack, is_finite_pack);
}

#[test]
fn extreme_lens_packs_without_symmetry_are_errors_or_finite() {
    fuzz("planar lens pack limits", 500, extreme_planar_pack, is_finite_pack);
}

#[test]
fn extreme_pupil_functions_are_errors_or_finite() {
    let dir = directory();
    let path = dir.path().join("seed.zip");
    let band = write_pupils(&path);
    let seed = (unpack(&std::fs::read(path).unwrap()), band);
    fuzz("pupil limits", 200, |r| extreme_pupils(&seed, r), is_finite_pack);
}

/// Whether a pack can be read; all that is read is finite.
fn is_finite_pack(bytes: &[u8]) -> bool {
    let Ok(pack) = LensPack::open_bytes(bytes.to_vec()) else { return false };
    let _ = summary(&pack, true, None).to_string();
    let lens = pack.lens();
    assert!(
        lens.bands.windows(2).all(|b| b[0].wavelength_nm < b[1].wavelength_nm),
        "wavelengths do not ascend"
    );
    let finite = |v: &[f64]| v.iter().all(|v| v.is_finite());
    for b in &lens.bands {
        assert!(finite(&b.ideal_height_mm) && finite(&b.image_height_mm) && finite(&b.psf_height_mm));
        assert!(finite(&b.relative_illumination) && finite(&b.psf_energy));
        assert!(finite(&[b.wavelength_nm, b.psf_pitch_um, b.solid_angle_sr, b.transmission]));
        if let Some(planar) = &b.planar {
            let map = &planar.map;
            assert!(finite(&map.ideal_x_mm) && finite(&map.ideal_y_mm) && finite(&map.relative_illumination));
            assert!(finite(&map.x_mm) && finite(&map.y_mm) && b.psf_energy.len() == planar.psfs.count());
        }
    }
    (0..lens.bands.len()).all(|b| pack.psf(b).is_ok_and(|p| p.samples.iter().all(|v| v.is_finite())))
}
