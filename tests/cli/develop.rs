//! `lenscube develop`, `shoot`, `compare`, and `lenscube sensor` with files as output, from outside.

mod angles;
mod colour;
mod compare;
mod files;
mod options;

use formats::chart::image::{ImageFile, Transfer};
use pipeline::geometry::Size;
use std::path::Path;

const USAGE: i32 = 2;
const OTHER_JOB: i32 = 3;
const CHECKER: &str = "checker?size=450x300&pitch_um=2";

/// Size and linear channels of a picture.
fn linear(path: &Path, transfer: Transfer) -> (Size, Vec<Vec<f32>>) {
    let file = ImageFile::open(path).unwrap();
    let (size, channels) = (file.size(), if file.is_grey() { 1 } else { 3 });
    let source = file.linear(transfer, path.parent().unwrap(), 2, &|_, _| ()).unwrap();
    let read = |c| {
        let mut pixels = vec![0.0; size.pixels()];
        source.read(c, size.rect(), &mut pixels).unwrap();
        pixels
    };
    (size, (0..channels).map(read).collect())
}
