//! Identity of a flat file; files that change or are truncated; memory of a sequential read.

use super::*;

#[test]
fn identity_changes_with_everything_that_changes_values() {
    let directory = tempfile::tempdir().unwrap();
    fs::write(directory.path().join("e.img"), [1; 300]).unwrap();
    let hdr = directory.path().join("e.hdr");
    let identity = |text: &str| {
        fs::write(&hdr, text).unwrap();
        RasterChart::open(&hdr, NanPolicy::Error).unwrap().identity().unwrap().0.to_string()
    };
    // Wavelengths that are within bounds in either unit.
    let envi = ENVI.replace("0.45,\n 0.55, 0.65", "2.45,\n 2.55, 2.65");
    let mut seen = vec![identity(&envi)];
    assert_eq!(identity(&envi.replace("a\n cube", "another")), seen[0], "the description does not change it");
    for (from, to) in [
        ("samples = 5\nlines = 7", "samples = 7\nlines = 5"),
        ("lines = 7", "lines = 6"),
        ("header offset = 4", "header offset = 6"),
        ("data type = 12", "data type = 1"),
        ("data type = 12", "data type = 2"),
        ("interleave = bil", "interleave = bsq"),
        ("interleave = bil", "interleave = bip"),
        ("byte order = 1", "byte order = 0"),
        ("Micrometers", "Nanometers"),
        ("Micrometers", "Index"),
        ("2.45", "2.46"),
        ("bands = 3", "bands = 3\ndata ignore value = 5"),
        ("bands = 3", "bands = 3\ndata ignore value = 6"),
        ("bands = 3", "bands = 3\nreflectance scale factor = 100"),
        ("bands = 3", "bands = 3\ndata gain values = {2, 2, 2}"),
        ("bands = 3", "bands = 3\ndata gain values = {2, 2, 3}"),
        ("bands = 3", "bands = 3\ndata offset values = {2, 2, 2}"),
    ] {
        let text = envi.replace(from, to);
        assert_ne!(text, envi, "{from}");
        seen.push(identity(&text));
    }
    fs::write(&hdr, &envi).unwrap();
    let declared = RasterChart::open(&hdr, NanPolicy::Error).unwrap().with_wavelengths(vec![1.0, 2.0, 3.0]);
    seen.push(declared.unwrap().identity().unwrap().0.to_string());
    let distinct: std::collections::HashSet<_> = seen.iter().collect();
    assert_eq!(distinct.len(), seen.len());
}

#[test]
fn change_of_a_file_after_opening_is_an_error() {
    let directory = tempfile::tempdir().unwrap();
    let (data, hdr) = (directory.path().join("e.img"), directory.path().join("e.hdr"));
    let write = || {
        fs::write(&data, [1; 300]).unwrap();
        fs::write(&hdr, ENVI).unwrap();
    };
    let assert_detected = |change: &dyn Fn(), expected: &str| {
        write();
        let chart = RasterChart::open(&hdr, NanPolicy::Error).unwrap();
        assert_eq!(chart.identity().unwrap(), chart.identity().unwrap());
        change();
        let e = chart.identity().unwrap_err();
        assert!(
            matches!(e, ChartError::Changed { .. }) && e.to_string().contains(expected),
            "{expected}: {e}"
        );
    };
    let time = fs::metadata(directory.path()).unwrap().modified().unwrap();
    assert_detected(&|| fs::write(&data, [2; 300]).unwrap(), "e.img");
    assert_detected(&|| fs::write(&data, [2; 301]).unwrap(), "size changed");
    // Same size, modification time restored.
    let restore_time = || {
        let then = fs::metadata(&data).unwrap().modified().unwrap();
        fs::write(&data, [2; 300]).unwrap();
        File::options().write(true).open(&data).unwrap().set_modified(then).unwrap();
    };
    assert_detected(&restore_time, "written to");
    let replaced = || {
        let other = directory.path().join("other");
        fs::write(&other, [1; 300]).unwrap();
        File::options().write(true).open(&other).unwrap().set_modified(time).unwrap();
        fs::rename(&other, &data).unwrap();
    };
    assert_detected(&replaced, "replaced by another file");
    assert_detected(&|| fs::remove_file(&data).unwrap(), "removed");
    assert_detected(&|| fs::write(&hdr, ENVI.replace("byte order = 1", "byte order = 0")).unwrap(), "e.hdr");
    // The same text is the same header.
    write();
    let chart = RasterChart::open(&hdr, NanPolicy::Error).unwrap();
    fs::write(&hdr, ENVI).unwrap();
    assert!(chart.identity().is_ok());
}

#[test]
fn truncation_of_a_mapped_file_is_an_error_and_no_signal() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("s.raw");
    let sample = RasterSample::Plain(Sample::F32);
    let (shape, interleave) = ([1, 64, 4096], Interleave::Bsq);
    let layout = RasterLayout { shape, interleave, sample, little_endian: true, offset: 0 };
    fs::write(&path, vec![1u8; 64 * 4096 * 4]).unwrap();
    let chart = RasterChart::raw(&path, layout, NanPolicy::Error).unwrap();
    let mut line = vec![0.0; 4096];
    chart.read_rect(0, Rect::new(3, 0, 1, 4096), &mut line).unwrap();
    File::options().write(true).open(&path).unwrap().set_len(4096 * 4 * 2).unwrap();
    let error = chart.read_rect(0, Rect::new(60, 0, 1, 4096), &mut line).unwrap_err();
    assert!(matches!(error, ChartError::Short { expected: 1_048_576, found: 32_768, .. }), "{error}");
    assert_eq!(line, vec![0.0; 4096], "lost pages read as zeros");
}

/// Pages behind the reader are released: a file of 256 MiB takes less than a third of its size.
#[test]
#[cfg(target_os = "linux")]
fn sequential_read_of_a_large_file_keeps_few_rows_in_memory() {
    let resident_bytes = || {
        let status = fs::read_to_string("/proc/self/status").unwrap();
        let line = status.lines().find_map(|l| l.strip_prefix("RssFile:")).unwrap();
        line.split_whitespace().next().unwrap().parse::<u64>().unwrap() << 10
    };
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("large.raw");
    let sample = RasterSample::Plain(Sample::F32);
    let shape = [1, 16384, 4096];
    let layout = RasterLayout { shape, interleave: Interleave::Bsq, sample, little_endian: true, offset: 0 };
    File::create(&path).unwrap().set_len(16384 * 4096 * 4).unwrap();
    let chart = RasterChart::raw(&path, layout, NanPolicy::Error).unwrap();
    let before = resident_bytes();
    let (mut out, mut peak) = (vec![0.0; 64 * 4096], 0);
    for row in (0..16384).step_by(64) {
        chart.read_rect(0, Rect::new(row, 0, 64, 4096), &mut out).unwrap();
        peak = peak.max(resident_bytes().saturating_sub(before));
    }
    assert_eq!(chart.stats().0, 256 << 20);
    // 2048 rows are kept, and up to 512 more before any go: 40 MiB. Other tests run in this process.
    assert!(peak > 16 << 20 && peak < 80 << 20, "{} MiB", peak >> 20);
}
