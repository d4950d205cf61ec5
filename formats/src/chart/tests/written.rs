//! Charts written by [`write_chart`].

use pipeline::flow::{ChartSource, SourceSinkError};

use super::*;

/// 2 bands of noise with a ramp.
struct Ramp(Size);

fn value(band: usize, y: i64, x: i64) -> f32 {
    let n = (y * 40_503 + x * 9_973 + band as i64 * 77).rem_euclid(1013) as f32;
    0.25 + band as f32 + y as f32 * 1e-4 + n * 1e-5
}

impl ChartSource for Ramp {
    fn size(&self) -> Size {
        self.0
    }

    fn read(&self, band: usize, rect: Rect, out: &mut [f32]) -> Result<(), SourceSinkError> {
        if band > 1 {
            return Err("no such band".into());
        }
        for (k, v) in out.iter_mut().enumerate() {
            *v = value(band, rect.y + (k / rect.width) as i64, rect.x + (k % rect.width) as i64);
        }
        Ok(())
    }
}

fn meta(bands: usize) -> ChartMeta {
    ChartMeta {
        wavelengths_nm: (0..bands).map(|b| 500.0 + b as f64).collect(),
        pitch_um: Some(2.5),
        film_size: Some(Size::new(2000, 600)),
        units: Some("radiance".into()),
        attributes: serde_json::from_str(r#"{"title": "ramp"}"#).unwrap(),
    }
}

#[test]
fn pixels_and_metadata_read_equal_those_written() {
    let dir = tempfile::tempdir().unwrap();
    let size = Size::new(2100, 700);
    let mut files = Vec::new();
    for codec in [Codec::None, Codec::Lz4, Codec::Zstd] {
        for threads in [1, 3] {
            let path = dir.path().join(format!("{codec:?}-{threads}.zarr"));
            let report = write_chart(&path, &Ramp(size), &meta(2), codec, threads, &|_, _| {}).unwrap();
            assert_eq!(report.shards, 4);
            let chart = open(&path);
            assert_eq!((chart.size(), chart.bands(), chart.pitch_um()), (size, 2, Some(2.5)));
            assert_eq!((chart.units(), chart.film_size()), (Some("radiance"), Some(Size::new(2000, 600))));
            assert_eq!(chart.wavelengths_nm(), Some(&[500.0, 501.0][..]));
            let pixels = all(&chart, 1).unwrap();
            assert!(
                pixels.iter().enumerate().all(|(k, v)| *v == value(1, (k / 700) as i64, (k % 700) as i64))
            );
            assert_eq!(chart.stats().missing_chunks, 0);
            files.push(chart.identity().unwrap().content);
            let e = write_chart(&path, &Ramp(size), &meta(2), codec, 1, &|_, _| {}).unwrap_err();
            assert!(matches!(e, WriteError::Exists { .. }));
        }
        let n = files.len();
        assert_eq!(files[n - 1], files[n - 2], "same files for any number of threads");
    }
    assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 6);
}

#[test]
fn failed_write_leaves_no_file() {
    let dir = tempfile::tempdir().unwrap();
    let e =
        write_chart(&dir.path().join("c.zarr"), &Ramp(Size::new(8, 8)), &meta(3), Codec::Zstd, 2, &|_, _| {});
    assert!(matches!(e, Err(WriteError::Source { band: 2, .. })), "{e:?}");
    assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 0);
}

#[test]
fn chart_at_a_url_equals_the_one_in_a_directory() {
    let dir = tempfile::tempdir().unwrap();
    let size = Size::new(2100, 700);
    let (local, url) = (dir.path().join("c.zarr"), Path::new("memory://chart/deep/c.zarr"));
    for path in [&local, url] {
        write_chart(path, &Ramp(size), &meta(2), Codec::Zstd, 2, &|_, _| {}).unwrap();
    }
    let e = write_chart(url, &Ramp(size), &meta(2), Codec::Zstd, 2, &|_, _| {}).unwrap_err();
    assert!(matches!(e, WriteError::Exists { .. }));
    let by_url = |spec: &str| ChartStore::open(spec, ChartOptions::default()).unwrap();
    for spec in [
        "memory://chart/deep/c.zarr",
        "memory://chart/deep/c.zarr//chart",
        "memory://chart/deep/c.zarr/chart",
    ] {
        let chart = by_url(spec);
        assert_eq!(all(&chart, 1).unwrap(), all(&open(&local), 1).unwrap(), "{spec}");
        assert_eq!(chart.wavelengths_nm(), Some(&[500.0, 501.0][..]), "{spec}");
        let identity = chart.identity().unwrap();
        assert_eq!(identity.content, open(&local).identity().unwrap().content, "{spec}");
        assert_eq!(identity, by_url(spec).identity().unwrap());
    }
    // Same size, different bytes.
    let before = by_url("memory://chart/deep/c.zarr").identity().unwrap();
    let store = crate::durable::Store::at(url).unwrap();
    let mut bytes = store.read("chart/c/1/1/0").unwrap().unwrap();
    bytes[7] ^= 1;
    store.write("chart/c/1/1/0", bytes).unwrap();
    let after = by_url("memory://chart/deep/c.zarr").identity().unwrap();
    assert!(before.content == after.content && before.mtimes != after.mtimes);
    remove_chart(url).unwrap();
    let e = ChartStore::open("memory://chart/deep/c.zarr", ChartOptions::default()).unwrap_err();
    assert!(matches!(e, ChartError::NotFound { .. }), "{e}");
}

#[test]
fn arrays_of_surfaces_lie_beside_the_chart() {
    let dir = tempfile::tempdir().unwrap();
    let (path, size) = (dir.path().join("c.zarr"), Size::new(600, 30));
    let ramp = Ramp(size);
    let array = |name, has_bands, units| SurfaceArray { name, source: &ramp, has_bands, units };
    let surfaces = [
        array("depth", false, "m"),
        array("hidden/1/chart", true, "radiance"),
        array("hidden/1/depth", false, "m"),
    ];
    let chart = NewChart { source: &ramp, meta: &meta(2), surfaces: &surfaces };
    let write =
        |overwrite| write_surfaces(&path, &chart, Codec::Lz4, 2, overwrite, &|_, _| {}).map(|r| r.shards);
    assert_eq!(write(false).unwrap(), 6);
    assert!(matches!(write(false), Err(WriteError::Exists { .. })));
    assert_eq!(write(true).unwrap(), 6);
    for (name, bands, units) in
        [("depth", 1, "m"), ("hidden/1/chart", 2, "radiance"), ("chart", 2, "radiance")]
    {
        let chart = open(&path.join(name));
        assert_eq!((chart.size(), chart.bands(), chart.units()), (size, bands, Some(units)), "{name}");
        let last = all(&chart, bands - 1).unwrap();
        assert_eq!(last[31], value(bands - 1, 1, 1), "{name}");
    }
    let metadata: serde_json::Value =
        serde_json::from_slice(&std::fs::read(path.join("zarr.json")).unwrap()).unwrap();
    let members = metadata["consolidated_metadata"]["metadata"].as_object().unwrap();
    let mut names: Vec<&String> = members.keys().collect();
    names.sort();
    assert_eq!(
        names,
        ["chart", "depth", "hidden", "hidden/1", "hidden/1/chart", "hidden/1/depth", "wavelength"]
    );
    remove_chart(&path).unwrap();
    assert!(!path.exists());
}
