//! Flat charts: damaged headers of a NumPy file and of an ENVI file, in a directory in memory.

use crate::directory;
use crate::fuzz_support::{damage, damage_text, fuzz};
use lenscube_formats::chart::{NanPolicy, RasterChart};
use pipeline::flow::ChartSource;
use pipeline::geometry::Rect;
use std::fs;

const ENVI: &str = "ENVI\nsamples = 5\nlines = 7\nbands = 3\nheader offset = 4\ndata type = 12\ninterleave = bil\n\
                    byte order = 1\ndata ignore value = -9\nwavelength units = Micrometers\nwavelength = {0.45, 0.55, 0.65}\n";

#[test]
fn damaged_flat_charts_do_not_panic() {
    let dir = directory();
    let (npy, hdr) = (dir.path().join("c.npy"), dir.path().join("e.hdr"));
    fs::write(dir.path().join("e.img"), [7; 5 * 7 * 3 * 2 + 4]).unwrap();
    let header = "{'descr': '<f4', 'fortran_order': False, 'shape': (3, 7, 5), }\n";
    let mut original = b"\x93NUMPY\x01\x00".to_vec();
    original.extend((header.len() as u16).to_le_bytes());
    original.extend(header.as_bytes());
    original.extend([0; 3 * 7 * 5 * 4]);
    let path = std::cell::RefCell::new(npy.clone());
    let make = |r: &mut crate::fuzz_support::Random| {
        let (file, mut bytes) = match r.below(2) {
            0 => (&npy, original.clone()),
            _ => (&hdr, ENVI.as_bytes().to_vec()),
        };
        match r.below(3) {
            0 => damage(&mut bytes, r),
            _ => damage_text(&mut bytes, r),
        }
        fs::write(file, &bytes).unwrap();
        path.borrow_mut().clone_from(file);
        bytes
    };
    fuzz("flat chart", 2000, make, |_| {
        let Ok(chart) = RasterChart::open(&path.borrow(), NanPolicy::Zero) else { return false };
        let size = chart.size();
        let rect = Rect::new(0, 0, size.height.min(40), size.width.min(40));
        let mut out = vec![0.0; rect.size().pixels()];
        for band in [0, chart.bands() - 1] {
            let _ = chart.read_rect(band, rect, &mut out);
        }
        true
    });
}
