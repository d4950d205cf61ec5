//! Values, metadata, identity and re-chunking of valid stores.

use super::*;
use crate::chart::cache::Cache;
use pipeline::flow::ChartSource;

fn check(chart: &ChartStore, bands: std::ops::Range<usize>) {
    let size = chart.size();
    assert_eq!(size, Size::new(37, 41));
    for band in 0..chart.bands() {
        for (k, v) in all(chart, band).unwrap().into_iter().enumerate() {
            let expected = sample(bands.start + band, k / size.width, k % size.width);
            assert_eq!(v, expected, "band {band}, pixel {k}");
        }
        let rect = Rect::new(9, 14, 20, 25);
        let mut part = vec![0.0; rect.size().pixels()];
        chart.read_rect(band, rect, &mut part).unwrap();
        assert_eq!(part[0], sample(bands.start + band, 9, 14));
        assert_eq!(part[20 * 25 - 1], sample(bands.start + band, 28, 38));
    }
}

#[test]
fn every_fixture_has_the_expected_pixels_and_decodes_each_chunk_once() {
    for name in [
        "v3-sharded",
        "v2-blosc",
        "v3-big-endian-gzip",
        "v3-bip-zstd",
        "v3-transposed",
        "v3-index-first",
        "v2-big-endian-fortran",
        "v2-float",
    ] {
        let chart = open(&fixture(name));
        assert_eq!(chart.bands(), 3, "{name}");
        check(&chart, 0..3);
        let stats = chart.stats();
        assert_eq!(stats.missing_chunks, 0, "{name}");
        let chunks: usize = chart.layout.chunk_counts().iter().product();
        assert_eq!(stats.chunks_decoded as usize, chunks, "{name}: each chunk once");
        assert!(stats.bytes_read > 0 && stats.decode_ns > 0);
    }
    check(&open(&fixture("v3-two-dimensional")), 1..2);
}

#[test]
fn charts_read_past_the_page_cache_have_the_same_pixels() {
    for name in
        ["v3-sharded", "v2-blosc", "v3-big-endian-gzip", "v3-transposed", "v3-index-first", "v2-float"]
    {
        let mut chart = open(&fixture(name));
        let single_bands = chart.chunk_shape()[0] == 1;
        chart.read_past_page_cache(&[0, 1, 2], 2, u64::MAX);
        assert!(chart.read_ahead.is_none(), "{name}: fits into the memory");
        chart.read_past_page_cache(&[0, 1, 2], 2, 0);
        assert_eq!(chart.read_ahead.is_some(), single_bands, "{name}");
        // Announced rectangles and others.
        chart.prefetch(1, Rect::new(0, 0, 41, 20));
        check(&chart, 0..3);
        let chunks: usize = chart.layout.chunk_counts().iter().product();
        assert_eq!(chart.stats().chunks_decoded as usize, chunks, "{name}: each chunk once");
    }
}

/// A film's tiles may end far beyond the chart.
#[test]
fn rectangles_announced_beyond_the_chart_change_no_pixel() {
    for name in ["v3-sharded", "v3-index-first", "v2-blosc", "v2-float"] {
        for past_page_cache in [false, true] {
            let mut chart = open(&fixture(name));
            if past_page_cache {
                chart.read_past_page_cache(&[0, 1, 2], 2, 0);
            }
            let Size { height, width } = chart.size();
            for distance in (0..300).step_by(3) {
                let (below, right) = (height as i64 + distance, width as i64 + distance);
                chart.prefetch(0, Rect::new(below, 0, height, width));
                chart.prefetch(0, Rect::new(0, right, height, width));
                chart.prefetch(0, Rect::new(-below, -right, height, width));
            }
            check(&chart, 0..3);
        }
    }
}

#[test]
fn damage_is_found_past_the_page_cache() {
    let (_dir, path) = copied("v3-sharded");
    let mut chart = open(&path);
    chart.read_past_page_cache(&[0], 1, 0);
    let shard = chart.layout.file_path([0, 0, 0]);
    let bytes = std::fs::read(&shard).unwrap();
    // The index has been read when the chunks before it are gone.
    chart.prefetch(0, Rect::new(0, 0, 1, 1));
    std::fs::write(&shard, &bytes[..1]).unwrap();
    chart.cache = Cache::new(0);
    // The first chunk may have been read ahead before that, in part or completely.
    let read = all(&chart, 0);
    assert!(matches!(read, Err(ChartError::Corrupt { .. })), "{read:?}");
}

#[test]
fn arrays_with_axes_in_other_orders_have_the_same_pixels() {
    for name in ["v3-wrong-order", "v3-columns-first"] {
        let chart = open(&fixture(name));
        assert_eq!(chart.bands(), 3, "{name}");
        check(&chart, 0..3);
        let dir = tempfile::tempdir().unwrap();
        let options = ChartOptions { cache_bytes: 0, ..ChartOptions::default() };
        let chart = ChartStore::open(fixture(name).to_str().unwrap(), options).unwrap();
        assert!(chart.rechunk_needed(&[0, 1, 2]), "{name}");
        chart.rechunk(&[0, 1, 2], dir.path(), 2, &|_, _| ()).unwrap();
        check(&chart, 0..3);
        assert!(chart.description().contains("axes"), "{name}");
    }
    let chart = open(&fixture("v3-columns-first"));
    assert_eq!(chart.wavelengths_nm(), Some(&[400.0, 410.0, 420.5][..]));
    assert_eq!((chart.file_shape(), chart.chunk_shape()), ([4, 32, 32], [2, 16, 16]));
    assert_eq!(chart.identity().unwrap(), open(&fixture("v3-columns-first")).identity().unwrap());
}

#[test]
fn declared_axes_replace_names_and_unnamed_spatial_axes_are_an_error() {
    let (_dir, path) = copied("v3-wrong-order");
    let file = path.join("zarr.json");
    let mut json: serde_json::Value = serde_json::from_slice(&std::fs::read(&file).unwrap()).unwrap();
    json["dimension_names"] = serde_json::Value::Null;
    std::fs::write(&file, json.to_string()).unwrap();
    let e = open_error(&path).to_string();
    assert!(e.contains("--axes y,x,wavelength") && e.contains("[37, 41, 3]"), "{e}");
    let with = |axes: &str| {
        let options = ChartOptions { axes: Some(axes.parse().unwrap()), ..ChartOptions::default() };
        ChartStore::open(path.to_str().unwrap(), options)
    };
    check(&with("y,x,wavelength").unwrap(), 0..3);
    assert_eq!(with("wavelength,y,x").unwrap().bands(), 37);
    let transposed = with("x,y,wavelength").unwrap();
    assert_eq!(transposed.size(), Size::new(41, 37));
    let mut pixel = [0.0];
    transposed.read_rect(1, Rect::new(5, 9, 1, 1), &mut pixel).unwrap();
    assert_eq!(pixel[0], sample(1, 9, 5));
    assert!(with("y,x").unwrap_err().to_string().contains("2 axes"));
}

#[test]
fn chart_scale_multiplies_and_changes_the_identity() {
    let with = |scale: f64| {
        let options = ChartOptions { scale, ..ChartOptions::default() };
        ChartStore::open(fixture("v3-bip-zstd").to_str().unwrap(), options).unwrap()
    };
    let mut pixel = [0.0];
    with(0.25).read_rect(1, Rect::new(2, 3, 1, 1), &mut pixel).unwrap();
    assert_eq!(pixel[0], 0.25 * sample(1, 2, 3));
    assert_ne!(with(0.25).description(), with(1.0).description());
    assert_eq!(with(1.0).description(), open(&fixture("v3-bip-zstd")).description());
}

#[test]
fn chart_metadata_comes_from_the_group_and_its_arrays() {
    let chart = open(&fixture("v3-sharded"));
    assert_eq!(chart.wavelengths_nm(), Some(&[400.0, 410.0, 420.5][..]));
    assert_eq!((chart.pitch_um(), chart.units()), (Some(2.0), Some("reflectance")));
    assert_eq!(chart.film_size(), Some(Size::new(33, 35)));
    assert_eq!(
        (chart.sample(), chart.file_shape(), chart.chunk_shape()),
        (Sample::F32, [1, 32, 32], [1, 16, 16])
    );
    let v2 = open(&fixture("v2-blosc"));
    let nm = v2.wavelengths_nm().unwrap();
    assert!((nm[2] - 420.5).abs() < 1e-9 && v2.sample() == Sample::U8, "µm become nm");
    assert_eq!(open(&fixture("v3-big-endian-gzip")).wavelengths_nm(), Some(&[400.0, 410.0, 420.0][..]));
    assert_eq!(open(&fixture("v3-bip-zstd")).wavelengths_nm(), None);
}

#[test]
fn array_is_found_by_name_and_by_its_own_directory() {
    let path = fixture("v3-sharded");
    let by_name = format!("{}//chart", path.display());
    let inside = format!("{}/chart", path.display());
    for spec in [by_name, inside] {
        let chart = ChartStore::open(&spec, ChartOptions::default()).unwrap();
        assert_eq!(chart.wavelengths_nm().unwrap()[1], 410.0, "{spec}");
        check(&chart, 0..3);
    }
}

#[test]
fn declared_wavelengths_replace_those_of_the_store() {
    let declared = |n: usize| ChartOptions {
        wavelengths_nm: Some((0..n).map(|k| 500.0 + k as f64).collect()),
        ..ChartOptions::default()
    };
    let path = fixture("v3-sharded");
    let chart = ChartStore::open(path.to_str().unwrap(), declared(3)).unwrap();
    assert_eq!(chart.wavelengths_nm().unwrap()[2], 502.0);
    let e = ChartStore::open(path.to_str().unwrap(), declared(2)).unwrap_err().to_string();
    assert!(e.contains("wavelengths") && e.contains("3 bands"), "{e}");
}

#[test]
fn identity_depends_on_the_chart_and_not_on_its_location() {
    let (_dir, path) = copied("v3-sharded");
    let (original, copy) = (open(&fixture("v3-sharded")), open(&path));
    let (expected, before) = (original.identity().unwrap(), copy.identity().unwrap());
    assert_eq!((&expected.content, &before), (&before.content, &copy.identity().unwrap()));
    let file = path.join("chart/c/0/0/0");
    let bytes = std::fs::read(&file).unwrap();
    std::fs::File::open(&file).unwrap().set_modified(std::time::UNIX_EPOCH).unwrap();
    let touched = copy.identity().unwrap();
    assert!(touched.mtimes != before.mtimes && touched.content == before.content);
    std::fs::write(&file, &bytes[1..]).unwrap();
    assert_ne!(copy.identity().unwrap().content, expected.content);
}

#[test]
fn modification_times_before_1970_are_told_apart() {
    let (_dir, path) = copied("v3-sharded");
    let chart = open(&path);
    let file = std::fs::File::open(path.join("chart/c/0/0/0")).unwrap();
    let times_at = |seconds_before: u64| {
        let time = std::time::UNIX_EPOCH - std::time::Duration::from_secs(seconds_before);
        file.set_modified(time).unwrap();
        chart.identity().unwrap().mtimes
    };
    let [at_1970, before, long_before] = [0, 1, 86400].map(times_at);
    assert!(at_1970 != before && before != long_before && long_before != at_1970);
}

#[test]
fn removed_chart_is_an_error_rather_than_missing_chunks() {
    let (_dir, path) = copied("v3-sharded");
    let chart = open(&path);
    std::fs::remove_dir_all(&path).unwrap();
    let e = all(&chart, 0).unwrap_err();
    assert!(e.retryable() && e.to_string().contains("has disappeared since the job started"), "{e}");
}

#[test]
fn concurrent_threads_decode_each_chunk_once() {
    let chart = open(&fixture("v3-sharded"));
    std::thread::scope(|s| {
        for _ in 0..8 {
            s.spawn(|| check(&chart, 0..3));
        }
    });
    assert_eq!(chart.stats().chunks_decoded, 27);
}

#[test]
fn cache_of_zero_bytes_gives_the_same_pixels() {
    let options = ChartOptions { cache_bytes: 0, ..ChartOptions::default() };
    let chart = ChartStore::open(fixture("v3-index-first").to_str().unwrap(), options).unwrap();
    check(&chart, 0..3);
}

#[test]
fn rechunking_decodes_each_chunk_once_and_keeps_the_pixels() {
    for name in ["v3-bip-zstd", "v3-transposed", "v2-big-endian-fortran"] {
        let path = fixture(name);
        let options = ChartOptions { cache_bytes: 10_000, ..ChartOptions::default() };
        let chart = ChartStore::open(path.to_str().unwrap(), options).unwrap();
        assert!(chart.rechunk_needed(&[0, 1, 2]) && !chart.rechunk_needed(&[1]), "{name}");
        assert!(!open(&path).rechunk_needed(&[0, 1, 2]), "the chart fits in the cache");
        let dir = tempfile::tempdir().unwrap();
        let done = AtomicU64::new(0);
        chart
            .rechunk(&[0, 1, 2], dir.path(), 2, &|_, _| {
                done.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
            })
            .unwrap();
        let chunks: usize = chart.layout.chunk_counts().iter().product();
        assert_eq!(done.into_inner() as usize, chunks);
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 0, "the temporary file has no name");
        check(&chart, 0..3);
        assert_eq!(chart.stats().chunks_decoded as usize, chunks);
    }
}

#[test]
fn rechunking_without_disk_space_is_an_error() {
    let (_dir, path) = copied("v3-bip-zstd");
    let json = std::fs::read_to_string(path.join("zarr.json")).unwrap();
    let huge =
        json.replace("37,", "20000000,").replace("41\n", "200000\n").replace("        16", "        4096");
    std::fs::write(path.join("zarr.json"), huge).unwrap();
    let chart = open(&path);
    let dir = tempfile::tempdir().unwrap();
    let e = chart.rechunk(&[0, 1, 2], dir.path(), 1, &|_, _| {}).unwrap_err();
    assert!(matches!(e, ChartError::Space { .. }), "{e}");
}
