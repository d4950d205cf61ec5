//! Damaged MAT-files of level 5.

use crate::fuzz_support::{Random, fuzz};
use crate::{ArrayFiles, directory};
use lenscube_formats::chart::NanPolicy;
use lenscube_formats::chart::matlab::open;
use pipeline::flow::ChartSource;
use pipeline::geometry::Rect;
use std::fs;

/// Pixels of all bands beyond which a chart is not decoded: it would take long, and only the disk limits it.
const MAX_PIXELS: usize = 1 << 20;

#[test]
fn damaged_matlab_charts_do_not_panic() {
    let dir = directory();
    let at = dir.path().join("c.mat");
    let files = ArrayFiles::new(
        "matlab",
        [
            ("photons.mat", ""),
            ("model.mat", ""),
            ("model.mat", "mcCOEF"),
            ("scene.mat", ""),
            ("other.mat", "plane"),
        ],
    );
    let damaged = |r: &mut Random| {
        let mut bytes = files.damaged(r);
        // Types, sizes and dimensions are words.
        for _ in 0..r.below(3) {
            let first = 4 * r.below(bytes.len().max(9) / 4);
            let value = [0u32, 1, 5, 14, 15, 255, 0x7fff_ffff, u32::MAX, 0x1000_0000, 0x4_0005][r.below(10)];
            if let Some(place) = bytes.get_mut(first..first + 4) {
                place.copy_from_slice(&value.to_le_bytes());
            }
        }
        fs::write(&at, &bytes).unwrap();
        bytes
    };
    fuzz("MATLAB chart", 600, damaged, |_| {
        let Ok(chart) = open(&at, files.array.get(), NanPolicy::Zero) else { return false };
        let (bands, size) = (chart.bands(), chart.size());
        if bands.saturating_mul(size.pixels()) > MAX_PIXELS {
            return true;
        }
        let rect = Rect::new(0, 0, size.height.min(40), size.width.min(40));
        let mut out = vec![0.0; rect.size().pixels()];
        chart.copy_bands(&[0, bands - 1], dir.path(), 1, &|_, _| ()).is_ok()
            && chart.read_rect(0, rect, &mut out).is_ok()
    });
    assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 1, "a temporary file remains");
}
