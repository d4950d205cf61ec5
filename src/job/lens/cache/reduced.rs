//! Cache of reduced charts (`pipeline::reduced_chart`), which are independent of the lens: reading a chart once more costs a third of a job store to store.
//!
//! Files are named `RECIPE-CONTENT.reduced` as the bands beside them: a line with RECIPE, then its stored values, f32, little-endian.

use super::{DIGITS, Unusable, entry_name, find_entry};
use crate::progress::detail_line;
use formats::durable::{fault_point, temp_name};
use pipeline::geometry::Size;
use pipeline::reduced_chart::ReducedChart;
use std::fs::File;
use std::io::{BufReader, BufWriter, Read, Write};
use std::path::Path;

pub(super) const EXTENSION: &str = ".reduced";
/// Largest reduced chart that is kept: 16 times that of a film of 512 x 512 bins.
const MAX_BYTES: usize = 16 << 20;
/// Bytes that are read and hashed at a time.
const BLOCK_BYTES: usize = 1 << 16;

/// The reduced chart of `recipe` of a chart of `chart` px in cells of `side` px. A damaged entry is removed with a note.
pub fn find(dir: &Path, recipe: &str, chart: Size, side: usize) -> Option<ReducedChart> {
    let count = ReducedChart::count(chart, side);
    let values = find_entry(dir, recipe, EXTENSION, "the chart is read again", |path, content| {
        match read(path, content, recipe, count) {
            Ok(values) => values.ok_or_else(Unusable::damaged),
            Err(_) => Err(Unusable::Unreadable),
        }
    })?;
    Some(ReducedChart::of_stored(chart, side, values))
}

/// Stores the reduced chart of `recipe`. What cannot be stored is computed again by the next run.
pub fn insert(dir: &Path, recipe: &str, reduced: &ReducedChart) {
    if 4 * reduced.stored().len() > MAX_BYTES {
        return;
    }
    let temp = dir.join(temp_name());
    let stored = write(&temp, recipe, reduced.stored()).and_then(|content| {
        fault_point("reduced-chart-written");
        std::fs::rename(&temp, dir.join(entry_name(recipe, &content, EXTENSION)))
    });
    if let Err(error) = stored {
        detail_line(format!("a reduced chart cannot be stored in {}: {error}", dir.display()));
        // The first error is reported.
        let _ = std::fs::remove_file(&temp);
    }
}

/// The `count` values of an entry; `None` if it is not the one that was stored as `content` for `recipe`.
fn read(path: &Path, content: &str, recipe: &str, count: usize) -> std::io::Result<Option<Vec<f32>>> {
    let file = File::open(path)?;
    let head = format!("{recipe}\n");
    if file.metadata()?.len() != (head.len() + 4 * count) as u64 {
        return Ok(None);
    }
    let mut reader = BufReader::with_capacity(BLOCK_BYTES, file);
    let mut digest = blake3::Hasher::new();
    let mut found = vec![0; head.len()];
    reader.read_exact(&mut found)?;
    digest.update(&found);
    let (mut values, mut block) = (Vec::with_capacity(count), vec![0; BLOCK_BYTES]);
    while values.len() < count {
        let bytes = &mut block[..(4 * (count - values.len())).min(BLOCK_BYTES)];
        reader.read_exact(bytes)?;
        digest.update(bytes);
        values.extend(bytes.as_chunks::<4>().0.iter().map(|value| f32::from_le_bytes(*value)));
    }
    let is_intact = found == head.as_bytes() && digest.finalize().to_hex()[..DIGITS] == *content;
    Ok((is_intact && values.iter().all(|value| value.is_finite())).then_some(values))
}

/// Writes the entry and returns its digest.
fn write(temp: &Path, recipe: &str, values: &[f32]) -> std::io::Result<String> {
    let mut writer = BufWriter::with_capacity(BLOCK_BYTES, File::create_new(temp)?);
    let mut digest = blake3::Hasher::new();
    let mut put = |bytes: &[u8]| {
        digest.update(bytes);
        writer.write_all(bytes)
    };
    put(format!("{recipe}\n").as_bytes())?;
    values.iter().try_for_each(|value| put(&value.to_le_bytes()))?;
    writer.flush()?;
    Ok(digest.finalize().to_hex()[..DIGITS].to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reduced_charts_are_found_again_and_damaged_ones_removed() {
        let dir = tempfile::tempdir().unwrap();
        let (chart, side) = (Size::new(300, 201), 2);
        let cells = (0..150 * 101).map(|i| (i as f32).sqrt()).collect();
        let reduced = ReducedChart::of_cells(chart, side, cells);
        let [recipe, other] = ["a", "b"].map(|c| c.repeat(64));
        insert(dir.path(), &recipe, &reduced);
        insert(dir.path(), &recipe, &reduced);
        assert_eq!(find(dir.path(), &recipe, chart, side).as_ref(), Some(&reduced));
        assert_eq!(find(dir.path(), &other, chart, side), None);
        let only = || {
            let mut files = std::fs::read_dir(dir.path()).unwrap();
            (files.next().unwrap().unwrap().path(), assert!(files.next().is_none())).0
        };
        type Damage = fn(&mut Vec<u8>);
        for damage in [|b| b[5000] ^= 1, |b| b[3] = b'b', |b| b.truncate(900), |b| b.push(0)] as [Damage; 4] {
            let mut bytes = std::fs::read(only()).unwrap();
            damage(&mut bytes);
            std::fs::write(only(), bytes).unwrap();
            assert_eq!(find(dir.path(), &recipe, chart, side), None);
            assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 0);
            insert(dir.path(), &recipe, &reduced);
        }
        // A directory that cannot be written is no error.
        insert(&dir.path().join("none"), &recipe, &reduced);
    }
}
