//! Damaged HDF5, NetCDF-4 and MATLAB 7.3 files.

use crate::fuzz_support::{Random, fuzz};
use crate::{ArrayFiles, directory};
use lenscube_formats::chart::NanPolicy;
use lenscube_formats::chart::hdf5::{Hdf5Chart, open};
use pipeline::flow::ChartSource;
use pipeline::geometry::Rect;
use std::fs;

/// Pixels of all bands beyond which a chart is not decoded: it would take long, and only the disk limits it.
const MAX_PIXELS: usize = 1 << 20;

#[test]
fn damaged_hdf5_charts_do_not_panic() {
    let dir = directory();
    let at = dir.path().join("c.h5");
    let files = ArrayFiles::new(
        "hdf5",
        [
            ("matlab.mat", ""),
            ("matlab-contiguous.mat", "rad"),
            ("netcdf4.nc", "radiance"),
            ("packed.nc", ""),
            ("latest.h5", "fixed"),
            ("latest.h5", "extensible"),
            ("latest.h5", "single"),
            ("filters.h5", "scene/deflate"),
            ("filters.h5", "scene/lzf"),
        ],
    );
    let damaged = |r: &mut Random| {
        let mut bytes = files.damaged(r);
        // Addresses, sizes and counts are everywhere.
        for _ in 0..r.below(3) {
            let (first, width) = (r.below(bytes.len().max(9) - 8), [2, 4, 8][r.below(3)]);
            let value = [0u64, 1, 255, 0x7fff_ffff, u64::MAX, 0x1000_0000, 2048][r.below(7)];
            if let Some(place) = bytes.get_mut(first..first + width) {
                place.copy_from_slice(&value.to_le_bytes()[..width]);
            }
        }
        fs::write(&at, &bytes).unwrap();
        bytes
    };
    fuzz("HDF5 chart", 600, damaged, |_| {
        let Ok(chart) = open(&at, files.array.get(), None, NanPolicy::Zero, None) else { return false };
        let (bands, size) = match &chart {
            Hdf5Chart::Raster(raster) => (raster.bands(), raster.size()),
            Hdf5Chart::Decoded(decoded) => (decoded.bands(), decoded.size()),
        };
        if bands.saturating_mul(size.pixels()) > MAX_PIXELS {
            return true;
        }
        let rect = Rect::new(0, 0, size.height.min(40), size.width.min(40));
        let mut out = vec![0.0; rect.size().pixels()];
        match &chart {
            Hdf5Chart::Raster(raster) => raster.read_rect(bands - 1, rect, &mut out).is_ok(),
            Hdf5Chart::Decoded(decoded) => {
                decoded.copy_bands(&[0, bands - 1], dir.path(), 1, &|_, _| ()).is_ok()
                    && decoded.read_rect(0, rect, &mut out).is_ok()
            }
        }
    });
    assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 1, "a temporary file remains");
}
